"""Airspace files: every form is recognised by its content, and what is not understood closes more, never less."""

import json
import math
import zipfile
from datetime import UTC, datetime

import pytest
import shapely
from pyproj import Geod

from skyway.cli.main import main
from skyway.models.airspace.reading import inspect_airspace, read_airspace
from skyway.models.base.errors import InputError

SQUARE = [[8.0, 47.0], [8.1, 47.0], [8.1, 47.1], [8.0, 47.1], [8.0, 47.0]]
BOWTIE = [[8.0, 47.0], [8.1, 47.1], [8.1, 47.0], [8.0, 47.1], [8.0, 47.0]]


def held(tmp_path, content, name="zones.json"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return inspect_airspace(path)


def ed269(**changes):
    volume = {
        "uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 120,
        "upperVerticalReference": "AGL", "horizontalProjection": {"type": "Polygon", "coordinates": [SQUARE]},
    }  # fmt: skip
    volumes = [volume | changes.pop("volume", {})]
    zone = {"identifier": "Z1", "country": "CHE", "name": "Prison", "restriction": "PROHIBITED", "geometry": volumes}
    return {"title": "zones", "features": [zone | {"applicability": [{"permanent": "YES"}]} | changes]}


def ed318(geometry, **properties):
    named = {"identifier": "Z1", "country": "CHE", "type": "PROHIBITED", "variant": "COMMON"}
    return {"type": "FeatureCollection", "features": [
        {"type": "Feature", "geometry": geometry, "properties": named | properties}
    ]}  # fmt: skip


def geojson(geometry=None, **properties):
    shape = geometry or {"type": "Polygon", "coordinates": [SQUARE]}
    return {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": shape, "properties": properties}]}


def only(file):
    assert not file.faults
    (zone,) = file.zones
    return zone


@pytest.mark.parametrize(
    ("volume", "floor", "ceiling"),
    [
        ({}, "ground", "120 m AGL"),
        ({"upperLimit": 99999, "upperVerticalReference": "AMSL"}, "ground", "unlimited"),
        ({"upperLimit": 99999, "upperVerticalReference": "AGL"}, "ground", "unlimited"),
        ({"upperLimit": None, "lowerLimit": ""}, "ground", "unlimited"),
        ({"uomDimensions": "FT", "lowerLimit": 100, "upperLimit": 400}, "30 m AGL", "122 m AGL"),
        ({"upperLimit": 2500, "upperVerticalReference": "AMSL", "uomDimensions": "FT"}, "ground", "762 m AMSL"),
        ({"upperLimit": 500, "upperVerticalReference": "WGS84"}, "ground", "500 m WGS84"),
    ],
)
def test_limits_of_ed269_have_units_datums_and_words_for_none(volume, floor, ceiling, tmp_path):
    found = held(tmp_path, b"\xef\xbb\xbf" + json.dumps(ed269(volume=volume)).encode())
    (part,) = only(found).volumes
    assert (found.form, str(part.floor), str(part.ceiling), found.notes) == ("ED-269", floor, ceiling, ())


@pytest.mark.parametrize(
    ("volume", "said"),
    [
        ({"upperVerticalReference": "TOWER"}, "ceiling: has no known unit or reference (got '120 M TOWER'); counted as unlimited"),
        ({"uomDimensions": "CUBIT", "lowerLimit": 60}, "floor: has no known unit or reference (got '60 CUBIT AGL'); counted as ground"),
        ({"lowerLimit": "NOTAM"}, "floor: is not a height (got 'NOTAM'); counted as ground"),
        ({"lowerLimit": 150}, "ceiling: lies below the floor (got '150 m AGL to 120 m AGL'); counted as ground to unlimited"),
        ({"horizontalProjection": {"type": "Polygon", "coordinates": [BOWTIE]}}, "counted as the convex hull of its corners"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_named_and_counted_as_closed(volume, said, tmp_path):
    found = held(tmp_path, json.dumps(ed269(volume=volume)))
    assert any(said in str(note) and "features[0] Z1" in str(note) for note in found.notes)
    (part,) = only(found).volumes
    assert shapely.covers(part.area, shapely.Point(8.02, 47.05))
    assert str(part.floor) == "ground" or str(part.ceiling) == "unlimited" or part.area.area == pytest.approx(0.01)


@pytest.mark.parametrize("word", ["REQ_AUTHORISATION", "REQ_AUTHORIZATION"])
def test_both_spellings_need_an_authorization_in_both_standards(word, tmp_path):
    assert only(held(tmp_path, json.dumps(ed269(restriction=word)))).kind == "authorization"
    layer = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}
    shape = {"type": "Polygon", "coordinates": [SQUARE], "layer": layer}
    found = held(tmp_path, json.dumps(ed318(shape, type=word)))
    assert (found.form, only(found).kind) == ("ED-318", "authorization")


def test_ed318_has_layers_circles_and_names_in_several_languages(tmp_path):
    layer = {"upper": 400, "upperReference": "AGL", "lower": 100, "lowerReference": "AGL", "uom": "ft"}
    ring = {
        "type": "Point",
        "coordinates": [8.0, 47.0],
        "extent": {"subType": "Circle", "radius": 3500},
        "layer": layer,
    }
    square = {
        "type": "MultiPolygon",
        "coordinates": [[SQUARE, [[8.04, 47.04], [8.06, 47.04], [8.06, 47.06], [8.04, 47.04]]]],
    }
    name = [{"text": "Flugplatz", "lang": "de-CH"}, {"text": "Airfield", "lang": "en-GB"}]
    geometry = {"type": "GeometryCollection", "geometries": [ring, square]}
    zone = only(held(tmp_path, json.dumps(ed318(geometry, name=name))))
    assert zone.name == "Airfield"
    assert [str(volume) for volume in zone.volumes] == ["30 m AGL to 122 m AGL", "ground to unlimited"]
    assert not shapely.covers(zone.volumes[1].area, shapely.Point(8.055, 47.045))
    geod = Geod(ellps="WGS84")  # the circle is no smaller than the published one, and hardly larger
    for lon, lat in zone.volumes[0].area.exterior.coords:
        assert 3500.0 <= geod.inv(8.0, 47.0, lon, lat)[2] < 3503.0


@pytest.mark.parametrize(
    ("entry", "inside", "outside"),
    [
        ({"permanent": "YES", "dailyPeriod": [{"day": [""], "startTime": "", "endTime": ""}]}, "2026-08-05T03:00Z", None),
        ({"permanent": "YES", "dailyPeriod": [{"day": ["Any"], "startTime": "00:00:00.00+02:00", "endTime": "00:00:00.00+02:00"}]},
         "2026-08-05T23:59Z", None),
        ({"startDateTime": "2026-08-05T11:00:00+00:00", "endDateTime": "2026-08-05T22:59:00+00:00"}, "2026-08-05T12:00Z", "2026-08-05T10:59Z"),
        ({"permanent": "YES", "schedule": [{"day": ["SAT", "SUN"], "startTime": "17:00:00Z", "endTime": "23:59:59Z"}]},
         "2026-08-08T18:00Z", "2026-08-07T18:00Z"),
        ({"permanent": "YES", "dailyPeriod": [{"day": ["FRI"], "startTime": "22:00+02:00", "endTime": "02:00+02:00"}]},
         "2026-08-07T23:30Z", "2026-08-07T19:30Z"),  # a night that begins on Friday, and ends on Saturday
        ({"permanent": "YES", "dailyPeriod": [{"day": ["MON"], "startTime": "00:30+02:00", "endTime": "01:00+02:00"}]},
         "2026-08-09T22:45Z", "2026-08-10T22:45Z"),  # Monday there is still Sunday in UTC
    ],
)  # fmt: skip
def test_zones_are_active_on_the_days_and_hours_of_their_own_clock(entry, inside, outside, tmp_path):
    activation = only(held(tmp_path, json.dumps(ed269(applicability=[entry])))).activation
    at_s = datetime.fromisoformat(inside).timestamp()
    assert activation.spans(at_s, at_s)
    assert activation.is_permanent == (outside is None)
    if outside is not None:
        at_s = datetime.fromisoformat(outside).timestamp()
        assert not activation.spans(at_s, at_s)


def sun_deg(posix_s, lat, lon):
    """Elevation of the sun's centre without refraction, by the low-precision formulas of the Astronomical Almanac, page C5."""
    n = posix_s / 86_400.0 + 2_440_587.5 - 2_451_545.0
    mean, g = (280.460 + 0.9856474 * n) % 360.0, math.radians(357.528 + 0.9856003 * n)
    along = math.radians(mean + 1.915 * math.sin(g) + 0.020 * math.sin(2.0 * g))
    tilt = math.radians(23.439 - 0.0000004 * n)
    right = math.degrees(math.atan2(math.cos(tilt) * math.sin(along), math.cos(along)))
    up = math.asin(math.sin(tilt) * math.sin(along))
    hour = math.radians(280.46061837 + 360.98564736629 * n + lon - right)
    phi = math.radians(lat)
    return math.degrees(math.asin(math.sin(phi) * math.sin(up) + math.cos(phi) * math.cos(up) * math.cos(hour)))


@pytest.mark.parametrize(
    ("events", "place", "day"),
    [
        (("SR", "SS"), (47.37, 8.54), "2024-06-20"),
        (("BMCT", "EECT"), (-37.8, 145.0), "2024-06-20"),
        (("SS", "SR"), (40.71, -74.01), "2024-12-20"),
    ],
)
def test_hours_of_the_sun_are_those_of_the_zones_place(events, place, day, tmp_path):
    zone = zone_by_the_sun(events, place, tmp_path)
    assert not zone.activation.is_permanent
    assert "-".join(events) in str(zone.activation)
    noon_s = datetime.fromisoformat(day + "T12:00Z").timestamp() - 240.0 * place[1]
    middle_s = noon_s + 43_200.0 * (events[0] == "SS")
    ((begin_s, end_s),) = zone.activation.spans(middle_s - 43_000.0, middle_s + 43_000.0)
    wanted = {"SR": -0.833, "SS": -0.833, "BMCT": -6.0, "EECT": -6.0}
    for event, at_s in zip(events, (begin_s + 300.0, end_s - 300.0), strict=True):
        assert sun_deg(at_s, *place) == pytest.approx(wanted[event], abs=0.25)


def test_where_the_sun_does_not_set_all_of_the_day_counts(tmp_path):
    zone = zone_by_the_sun(("SR", "SS"), (78.22, 15.65), tmp_path)
    begin_s = datetime.fromisoformat("2024-06-20T00:00Z").timestamp()
    assert zone.activation.spans(begin_s, begin_s + 172_800.0) == [(begin_s, begin_s + 172_800.0)]


def zone_by_the_sun(events, place, folder):
    schedule = {"day": ["ANY"], "startEvent": events[0], "endEvent": events[1]}
    document = ed269(applicability=[{"permanent": "YES", "schedule": [schedule]}])
    projection = document["features"][0]["geometry"][0]
    projection["horizontalProjection"] = {"type": "Circle", "center": [place[1], place[0]], "radius": 500}
    return only(held(folder, json.dumps(document)))


@pytest.mark.parametrize(
    "window",
    [
        {"day": ["ANY"], "startEvent": "MOONRISE", "endEvent": "SS"},
        {"day": ["FOO"], "startTime": "25:00", "endTime": "26:00"},
    ],
)
def test_hours_that_are_not_understood_are_all_hours(window, tmp_path):
    found = held(tmp_path, json.dumps(ed269(applicability=[{"permanent": "YES", "schedule": [window]}])))
    assert only(found).activation.is_permanent
    assert found.notes


def test_openair_has_circles_arcs_levels_and_activation(tmp_path):
    # areas and corners as openAIP's own parser (JavaScript, MIT) has them for the same text
    text = (
        "* openAIP fixtures\r\nAC R\r\nAN ED-R3\r\nAH 2200ft AMSL\r\nAL GND\r\nV X=53:24:25 N 010:25:10 E\r\nDC 1.10\r\n"
        "AC R\r\nAN ED-R56 * comment\r\nAH FL 65\r\nAL 50 GND\r\nAA 2025-01-01T12:00Z/NONE\r\n"
        "DP 52:07:36 N 013:23:34 E\r\nDP 52:07:57 N 013:25:08 E\r\nV X=52:06:33 N 013:25:58 E\r\n"
        "DB 52:07:57 N 013:25:08 E, 52:05:09 N 013:26:48 E\r\nDP 52:05:09 N 013:26:48 E\r\nDP 52:04:48 N 013:25:14 E\r\n"
        "V X=52:06:12 N 013:24:24 E\r\nDB 52:04:48 N 013:25:14 E, 52:07:36 N 013:23:34 E\r\n"
        "AC G\r\nAN TH-3-1\r\nAL GND\r\nAH UNL\r\nDP 39:26:00 N 141:08:01 E\r\nV D=-\r\nV X=39:26:00 N 141:08:01 E\r\n"
        "DA 15.00,90.0,270.5\r\nDP 39:26:00 N 141:08:01 E\r\n"
    )
    found = held(tmp_path, text, "zones.txt")
    assert (found.form, found.notes, found.faults) == ("OpenAir", (), ())
    expected = [
        ("authorization", "ground to 671 m AMSL", (10.3888, 53.3886, 10.4501, 53.4253)),
        ("authorization", "15 m AGL to FL65 (1275 m to 2837 m AMSL)", (13.3662, 52.0785, 13.4732, 52.134)),
        ("information", "ground to unlimited", (140.8102, 39.4329, 141.4571, 39.6832)),
    ]
    for zone, (kind, heights, bounds) in zip(found.zones, expected, strict=True):
        (volume,) = zone.volumes
        assert (zone.kind, str(volume)) == (kind, heights)
        assert volume.area.bounds == pytest.approx(bounds, abs=1.5e-3)
    assert found.zones[1].activation.periods[0].end_s == math.inf


@pytest.mark.parametrize(
    ("written", "lon", "lat"),
    [
        ("01:05.5 N 000:05.5 W", -5.5 / 60, 1 + 5.5 / 60),
        ("265644.00N 0500434.00E", 50 + 4 / 60 + 34 / 3600, 26 + 56 / 60 + 44 / 3600),
        ("45.5S, 9.25E", 9.25, -45.5),
        ("42:60:57 N 000:60:00 W", -1.0, 43 + 57 / 3600),
    ],
)
def test_openair_has_many_ways_to_write_a_position(written, lon, lat, tmp_path):
    found = held(tmp_path, f"AC P\nAN Z\nAL GND\nAH 100ft AGL\nV X={written}\nDC 1\n", "zones.txt")
    middle = only(found).volumes[0].area.centroid
    assert (middle.x, middle.y) == pytest.approx((lon, lat), abs=1e-5)


def test_openair_that_is_not_understood_closes_the_hull_to_all_heights(tmp_path):
    text = "AC MOON\nAN Base\nAL NOTAM\nDP 47:00 N 8:00 E\nDP 47:00 N 8:06 E\nDP rubbish\nDP 47:06 N 8:06 E\nXX\n"
    found = held(tmp_path, text, "zones.txt")
    zone = only(found)
    assert (zone.kind, str(zone.volumes[0])) == ("prohibited", "ground to unlimited")
    said = "\n".join(map(str, found.notes))
    for words in ("'MOON'", "'NOTAM'", "'rubbish'", "AH: is missing", "'XX'", "zones.txt:6: Base"):
        assert words in said


def test_two_corners_are_no_area_that_could_be_closed(tmp_path):
    """openAIP's own parser refuses the same text."""
    corners = ("46:03:45 N 008:51:09 E", "46:03:45 N 009:02:03 E", "46:03:45 N 008:51:09 E")
    text = "AC C\nAN FEW\nAL FL125\nAH FL195\n" + "".join(f"DP {one}\n" for one in corners)
    found = held(tmp_path, text, "zones.txt")
    assert not found.zones
    assert "FEW: geometry: has fewer than three different corners" in str(found.faults[0])


def test_kml_and_kmz_have_polygons_with_holes_and_limits_in_their_data(tmp_path):
    ring = " ".join(f"{lon},{lat},50" for lon, lat in SQUARE)
    hole = "8.04,47.04 8.06,47.04 8.06,47.06 8.04,47.04"
    kml = (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>Harbour</name>'
        '<ExtendedData><Data name="kind"><value>authorization</value></Data><Data name="ceiling"><value>120 m AGL</value></Data>'
        f"</ExtendedData><Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
        f"<innerBoundaryIs><LinearRing><coordinates>{hole}</coordinates></LinearRing></innerBoundaryIs></Polygon></Placemark>"
        "<Placemark><name>Label</name><Point><coordinates>8,47</coordinates></Point></Placemark></Document></kml>"
    )
    archive = tmp_path / "zones.kmz"
    with zipfile.ZipFile(archive, "w") as stream:
        stream.writestr("doc.kml", kml)
    for found in (held(tmp_path, kml, "zones.kml"), inspect_airspace(archive)):
        zone = only(found)
        assert (found.form, zone.name, zone.kind) == ("KML", "Harbour", "authorization")
        assert str(zone.volumes[0]) == "ground to 120 m AGL"
        assert len(zone.volumes[0].area.interiors) == 1
        assert "Label" in str(found.notes[0])


@pytest.mark.parametrize(
    ("document", "kind", "heights"),
    [
        (geojson(name="park"), "prohibited", "ground to unlimited"),
        (geojson(name="park", kind="authorization", floor="60 m AGL", ceiling="FL65"), "authorization", "60 m AGL to FL65 (1275 m to 2837 m AMSL)"),
        (geojson(upperCeiling={"value": 400, "unit": "FT", "referenceDatum": "GND"}, type="TMZ"), "conditional", "ground to 122 m AGL"),
        (geojson(CEILING=0, UNIT="LGA ATCT", APT1_ICAO="KLGA"), "authorization", "ground to unlimited"),
        (geojson(CEILING=200, UNIT="LGA ATCT", APT1_ICAO="KLGA"), "authorization", "61 m AGL to unlimited"),
        (geojson(typeId="Politi", Bufferzone="150"), "authorization", "ground to unlimited"),
        (geojson(name="Loviisa", type="R"), "authorization", "ground to unlimited"),
        (geojson(name="park", type="lunar"), "prohibited", "ground to unlimited"),
    ],
)  # fmt: skip
def test_plain_geojson_and_national_forms(document, kind, heights, tmp_path):
    found = held(tmp_path, json.dumps(document))
    zone = only(found)
    assert (found.form, zone.kind, str(zone.volumes[0])) == ("GeoJSON", kind, heights)
    assert bool(found.notes) == (document["features"][0]["properties"].get("type") == "lunar")


def test_danish_buffers_are_kept_about_points_and_outlines(tmp_path):
    point = geojson({"type": "Point", "coordinates": [12.5, 55.6, 0]}, typeId="Civil Lufthavn", Bufferzone="5 km")
    square = geojson(typeId="Militær", Bufferzone="150 m")
    for document, place, reach in ((point, (12.5, 55.6), 5000.0), (square, (8.1, 47.05), 150.0)):
        area = only(held(tmp_path, json.dumps(document))).volumes[0].area
        for bearing, factor, inside in ((90.0, 0.99, True), (90.0, 1.06, False)):
            lon, lat, _ = Geod(ellps="WGS84").fwd(*place, bearing, reach * factor)
            assert area.covers(shapely.Point(lon, lat)) == inside


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty; give a file with zones"),
        (b"\x00\x01", "is not text: byte 0 is NUL"),
        (b"{", "is not JSON"),
        (b"hello world", "is not an airspace file"),
        (b"<html></html>", "root element: is not KML"),
        (b'<!DOCTYPE x [<!ENTITY a "b">]><kml>&a;</kml>', "has a document type"),
        (b'{"type": "FeatureCollection", "features": 3}', "features: must be a list"),
        (b"AC P\n*", "geometry: has no coordinates"),
        (b"[" * 100_000, "is not JSON"),
        (json.dumps(ed269(geometry=[])).encode(), "features[0] Z1: geometry: has no volume"),
        (json.dumps(geojson({"type": "Polygon", "coordinates": [[[47.0, 120.0], [47.1, 120.0], [47.1, 120.1]]]})).encode(),
         "lat and lon look swapped"),
        (json.dumps(geojson({"type": "Point", "coordinates": [8.0, 47.0]})).encode(), "is a point without a radius"),
        (json.dumps(geojson({"type": "Polygon", "coordinates": [["a", "b"]]})).encode(), "is not a position"),
        (json.dumps(geojson({"type": "LineString", "coordinates": SQUARE})).encode(), "is not a polygon (got 'LineString')"),
        (json.dumps(geojson() | {"crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}}).encode(), "save it in WGS-84"),
        (json.dumps(ed318(SQUARE) | {"metadata": {"validFrom": {"object": 1}}}).encode(), "metadata: validFrom: is not a date"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_with_one_clear_line(content, said, tmp_path):
    path = tmp_path / "bad.json"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_airspace([path])
    assert said in str(error.value)
    assert str(error.value).startswith(str(path))
    assert all(len(line) < 400 for line in str(error.value).splitlines())


def test_the_command_lists_zones_and_what_was_not_understood(tmp_path, capsys):
    path = tmp_path / "zones.json"
    window = {"startDateTime": "2026-08-05T11:00:00Z", "endDateTime": "2026-08-05T12:00:00Z"}
    path.write_text(json.dumps(ed269(restriction="MAYBE", applicability=[window])))
    assert main(["airspace", str(path)]) == 0
    shown = capsys.readouterr().out
    for words in ("ED-269, 1 zone with 1 volume (1 prohibited)", "Prison", "counted as closed: 1", "'MAYBE'"):
        assert words in shown
    assert main(["airspace", str(path), "--json", "--depart", "2026-08-05T13:00Z"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["zones"] == []
    path.write_text(json.dumps(ed269(geometry=[])))
    assert main(["airspace", str(path)]) == 1
    assert main(["airspace", str(tmp_path / "absent")]) == 2


def test_a_collection_without_zones_says_so_and_closes_nothing(tmp_path, capsys):
    path = tmp_path / "none.geojson"
    path.write_text('{"type": "FeatureCollection", "features": []}', encoding="utf-8")
    assert main(["airspace", str(path)]) == 0
    told = capsys.readouterr().out
    assert "closes nothing: 1" in told
    assert "has no zones; closes nothing" in told
    assert "counted as closed" not in told


def test_windows_of_a_zone_join_where_they_touch(tmp_path):
    entries = [
        {"startDateTime": f"2026-08-05T1{a}:00Z", "endDateTime": f"2026-08-05T1{b}:00Z"} for a, b in ("12", "23", "67")
    ]
    activation = only(held(tmp_path, json.dumps(ed269(applicability=entries)))).activation
    day = datetime(2026, 8, 5, tzinfo=UTC).timestamp()
    spans = activation.spans(day, day + 86_400.0)
    assert [((a - day) / 3600, (b - day) / 3600) for a, b in spans] == [(11, 13), (16, 17)]
