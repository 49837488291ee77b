"""Stations and segments as files: nothing lost on the way, and everything wrong with a file said at once."""

import json

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.network.files import (
    MAX_FAULTS,
    read_segments,
    read_stations,
    to_geojson,
    write_geojson,
    write_graphml,
    write_segments_csv,
    write_stations_csv,
)
from skyway.models.network.network import Network
from skyway.models.network.station import Station

HEADER = "id,name,lat,lon,elevation_m,pads\n"
GOOD = "bx,Bronx,40.85,-73.9,10,5\n"

letters = st.characters(exclude_categories=["C", "Z"])
words = st.text(letters | st.sampled_from(' ,;"#'), min_size=1, max_size=12).map(str.strip).filter(bool)
stations = st.lists(
    st.builds(
        Station,
        id=words,
        name=words,
        lat=st.floats(-90.0, 90.0).filter(bool),
        lon=st.floats(-180.0, 180.0),
        elevation_m=st.none() | st.floats(-450.0, 9000.0),
        pads=st.integers(0, 10_000),
        holding_spots=st.integers(0, 10_000),
        recharge_power_w=st.none() | st.floats(1.0, 1e6),
    ),
    min_size=1,
    max_size=6,
    unique_by=lambda station: station.id,
)


@st.composite
def networks(draw) -> Network:
    nodes = draw(stations)
    node = st.integers(0, len(nodes) - 1)
    pairs = draw(st.sets(st.tuples(node, node).filter(lambda pair: pair[0] != pair[1]), max_size=8))
    return Network.from_pairs(nodes, np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2))


def assert_same(back: Network, network: Network) -> None:
    assert back.stations == network.stations
    for name in ("tail", "head", "distance_m", "bearing_deg"):
        assert np.array_equal(getattr(back, name), getattr(network, name)), name


def faults_of(call) -> list[str]:
    with pytest.raises(InputError) as caught:
        call()
    return [str(fault) for fault in caught.value.faults]


def stations_of(tmp_path, text, name="stations.csv", **how):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_stations(path, **how)


def said_of(tmp_path, text, name="stations.csv", **how) -> list[str]:
    faults = faults_of(lambda: stations_of(tmp_path, text, name, **how))
    return [fault.removeprefix(f"{tmp_path}/") for fault in faults]


@settings(max_examples=50)
@given(network=networks())
def test_a_network_written_as_csv_comes_back_the_same(tmp_path_factory, network):
    folder = tmp_path_factory.mktemp("csv")
    write_stations_csv(network, folder / "stations.csv")
    write_segments_csv(network, folder / "segments.csv")
    nodes = read_stations(folder / "stations.csv")
    pairs = read_segments(folder / "segments.csv", nodes)
    assert_same(Network.from_pairs(nodes, np.array(pairs, dtype=np.int64).reshape(-1, 2)), network)


@settings(max_examples=50)
@given(network=networks())
def test_a_network_written_as_geojson_comes_back_the_same(tmp_path_factory, network):
    path = tmp_path_factory.mktemp("geojson") / "network.geojson"
    write_geojson(network, path)
    nodes = read_stations(path)
    pairs = read_segments(path, nodes)
    assert_same(Network.from_pairs(nodes, np.array(pairs, dtype=np.int64).reshape(-1, 2)), network)


@settings(max_examples=20)
@given(network=networks())
def test_a_network_written_as_graphml_is_read_by_networkx_as_it_was(tmp_path_factory, network):
    path = tmp_path_factory.mktemp("graphml") / "network.graphml"
    write_graphml(network, path)
    found = nx.read_graphml(path)
    assert set(found.nodes) == {station.id for station in network.stations}
    assert {(a, b): one["distance_m"] for a, b, one in found.edges(data=True)} == {
        (a, b): one["distance_m"] for a, b, one in network.graph.edges(data=True)
    }
    assert all(found.nodes[one.id].get("elevation_m") == one.elevation_m for one in network.stations)


def test_geojson_has_longitude_first_and_a_line_for_both_ways(tmp_path):
    nodes = (Station("a", "A", 40.7, -74.0, 12.0), Station("b", "B", 40.8, -73.9))
    document = to_geojson(Network.from_pairs(nodes, np.array([(0, 1), (1, 0)])))
    point, _, line = document["features"]
    assert point["geometry"] == {"type": "Point", "coordinates": [-74.0, 40.7]}
    assert line["geometry"] == {"type": "LineString", "coordinates": [[-74.0, 40.7], [-73.9, 40.8]]}
    assert (line["properties"]["from"], line["properties"]["to"], line["properties"]["both"]) == ("a", "b", "yes")


def test_nothing_written_before_is_overwritten(tmp_path):
    network = Network.from_pairs((Station("a", "A", 40.7, -74.0),), np.empty((0, 2), dtype=np.int64))
    for write in (write_stations_csv, write_segments_csv, write_geojson, write_graphml):
        write(network, tmp_path / "x", force=True)
        with pytest.raises(InputError, match="exists already"):
            write(network, tmp_path / "x")


def test_a_file_of_ids_and_positions_is_enough(tmp_path):
    (station,) = stations_of(tmp_path, "lon,id,lat\n-73.9,bx,40.85\n", pads=3, holding_spots=2)
    assert station == Station("bx", "bx", 40.85, -73.9, None, 3, 2, None)


def test_a_downloaded_file_is_read_by_naming_its_columns(tmp_path):
    columns = {"id": "station_id", "lat": "latitude", "lon": "longitude", "pads": "pile_num"}
    text = "station_id,longitude,latitude,pile_num,area\n0,145.1,-37.7,1,4330.1\n"
    (station,) = stations_of(tmp_path, text, columns=columns)
    assert station == Station("0", "0", -37.7, 145.1, pads=1)


def test_a_named_column_that_is_not_there_is_no_default(tmp_path):
    said = said_of(tmp_path, "id,lat,lon,piles\nbx,40.85,-73.9,3\n", columns={"pads": "pile_num"})
    assert said == ["stations.csv:1: pile_num: column is missing; the header has id, lat, lon, piles"]


@pytest.mark.parametrize(
    "text",
    [
        (HEADER + GOOD).replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + (HEADER + GOOD).encode(),
        HEADER.replace(",", " , ") + GOOD.replace(",", ", "),
        HEADER + "\n   \n" + GOOD + ",,,,,\n\n",
        (HEADER + GOOD).replace("\n", "\r").encode(),
        HEADER + '"bx","Bronx","40.85","-73.9","10","5"',
        "id,name,lat,lon,elevation_m,pads,\nbx,Bronx,40.85,-73.9,10,5,\n",
    ],
    ids=["CRLF", "byte-order mark", "blanks", "blank lines", "CR", "quotes", "trailing comma"],
)
def test_a_table_from_any_office_program_is_read(tmp_path, text):
    assert stations_of(tmp_path, text) == (Station("bx", "Bronx", 40.85, -73.9, 10.0, 5),)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (",N,40.8,-73.9,1,5", "id: is empty"),
        ("x,N,,-73.9,1,5", "lat: is empty"),
        ("x,N,40.8,,1,5", "lon: is empty"),
        ("x,N,north,-73.9,1,5", "lat: is not a number (got 'north')"),
        ("x,N,nan,-73.9,1,5", "lat: is not a number (got 'nan')"),
        ("x,N,40.8,inf,1,5", "lon: is not a number (got 'inf')"),
        ('x,N,"40,8",-73.9,1,5', "lat: is not a number (got '40,8'); write 40.7, with a point"),
        ("x,N,4_0,-73.9,1,5", "lat: is not a number (got '4_0')"),
        ("x,N,90.5,0,1,5", "lat: latitude out of range (got '90.5'); lat and lon may be swapped"),
        ("x,N,145.1,-37.7,1,5", "lat: latitude out of range (got '145.1'); lat and lon may be swapped"),
        ("x,N,40.8,-187.3,1,5", "lon: longitude out of range (got '-187.3'); degrees from -180 to 180"),
        (
            "x,N,408500000,-739000000,1,5",
            "lat: latitude out of range (got '408500000'); degrees, not ten-millionths of them",
        ),
        ("x,N,0,0,1,5", "lat: lies at 0,0 (got '0'); give the true position"),
        (
            "x,N,40.8,-73.9,29000,5",
            "elevation_m: out of range (got '29000'); metres above mean sea level, -450 to 9000",
        ),
        ("x,N,40.8,-73.9,NaN,5", "elevation_m: is not a number (got 'NaN')"),
        ("x,N,40.8,-73.9,1,-1", "pads: must be a whole number (got '-1'); from 0 to 10000"),
        ("x,N,40.8,-73.9,1,2.5", "pads: must be a whole number (got '2.5'); from 0 to 10000"),
        ("x,N,40.8,-73.9,1,1e9", "pads: must be a whole number (got '1e9'); from 0 to 10000"),
        ("x,N,40.8,-73.9,1,five", "pads: is not a number (got 'five')"),
        ("x,N,40.8,-73.9,1", "has 5 cells, the header has 6"),
        ("x,St. Mary, Bronx,40.8,-73.9,1,5", "has 7 cells, the header has 6"),
        ('"a\x1b[2J",N,40.8,-73.9,1,5', "id: must be one line of plain text (got 'a\\x1b[2J')"),
        ('"a\nb",N,40.8,-73.9,1,5', "id: must be one line of plain text (got 'a\\nb')"),
        ("bx,N,40.8,-73.9,1,5", "id: two stations have the same id (got 'bx'); it is already on line 2"),
    ],
)
def test_each_wrong_field_is_one_line_with_file_line_field_and_value(tmp_path, row, said):
    faults = said_of(tmp_path, HEADER + GOOD + row + "\n")
    line = 4 if "\n" in row else 3
    if "408500000" in row:
        assert len(faults) == 2
        faults.pop()
    assert faults == [f"stations.csv:{line}: {said}".replace("\\x1b", "\\x1b")]


def test_all_faults_of_a_file_are_said_at_once(tmp_path):
    text = HEADER + "a,A,95,-73.9,1,5\n,B,40.8,200,1,5\na,C,40.8,-73.9,1,-2\n"
    faults = said_of(tmp_path, text)
    assert [fault.split(": ")[0] for fault in faults] == [f"stations.csv:{n}" for n in (2, 3, 3, 4, 4)]


def test_a_wrong_power_is_refused(tmp_path):
    said = said_of(tmp_path, "id,lat,lon,recharge_power_w\nx,40.8,-73.9,0\ny,40.8,-73.8,\n")
    assert said == [
        "stations.csv:2: recharge_power_w: out of range (got '0'); watts a pad delivers, 1 to 1000000",
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "stations.csv:1: id: column is missing; the file is empty"),
        (HEADER, "stations.csv: has no stations"),
        ("id;lat;lon\nx;40,8;-73,9\n", "stations.csv:2: has a decimal comma between semicolons (got '40,8')"),
        ("id,lat,lon,lat\nx,1,2,3\n", "stations.csv:1: lat: two columns have this name"),
        (HEADER + "x,N,40.8,-73.9\0,1,5\n", "stations.csv: is not text: byte 47 is NUL"),
        (HEADER.encode() + b"x,Z\xfcrich,40,8,1,5", "stations.csv: is not UTF-8 text (byte 36); save it with"),
        ((HEADER + GOOD).encode("utf-16"), "stations.csv: is UTF-16 text; save it with the encoding UTF-8"),
        (HEADER + "x," + "y" * 200_000 + ",40.8,-73.9,1,5\n", "stations.csv:2: is not CSV: field larger than"),
        (HEADER + GOOD + '"x,N,40.8,-73.9,1,5\n', "stations.csv:3: has 1 cell,"),
    ],
    ids=["empty", "no rows", "decimal commas", "double column", "NUL", "latin-1", "UTF-16", "huge cell", "open quote"],
)
def test_what_is_no_table_of_stations_is_refused(tmp_path, text, said):
    assert said_of(tmp_path, text)[0].startswith(said)


def test_a_file_full_of_faults_is_not_read_to_its_end(tmp_path):
    text = HEADER + "x,N,north,-73.9,1,5\n" * 200_000
    faults = said_of(tmp_path, text)
    assert len(faults) <= MAX_FAULTS + 3
    assert faults[-1].endswith("too many faults; the rest was not read")


def test_200_megabytes_are_refused(tmp_path):
    with (tmp_path / "stations.csv").open("wb") as stream:
        stream.truncate(200_000_000)
    assert "is larger than 67 MB" in faults_of(lambda: read_stations(tmp_path / "stations.csv"))[0]


def test_line_ends_in_a_name_become_blanks(tmp_path):
    (station,) = stations_of(tmp_path, HEADER + 'bx,"Bronx\nHospital",40.85,-73.9,10,5\n')
    assert station.name == "Bronx Hospital"


def feature(kind="Point", coordinates=(-73.9, 40.85), **properties):
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }


def collection(*features) -> str:
    return json.dumps({"type": "FeatureCollection", "features": features})


def test_geojson_points_of_others_are_read(tmp_path):
    text = collection(
        {**feature(coordinates=[-73.9, 40.85, 12.0]), "id": 0},
        feature("LineString", [[0, 0], [1, 1]]),
        feature(id=7, name="Seven", pads=2),
    )
    found = stations_of(tmp_path, text, "s.geojson")
    assert found == (
        Station("0", "0", 40.85, -73.9, 12.0),
        Station("7", "Seven", 40.85, -73.9, None, 2),
    )
    assert stations_of(tmp_path, text, "S.GeoJSON") == found


def test_properties_of_geojson_are_named_as_columns_are(tmp_path):
    columns = {"id": "station_id", "lat": "latitude", "lon": "longitude", "pads": "pile_num"}
    found = stations_of(tmp_path, collection(feature(station_id=0, pile_num=3)), "s.json", columns=columns)
    assert found == (Station("0", "0", 40.85, -73.9, pads=3),)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ('{"type": "FeatureColl', "is not JSON"),
        ("[1, 2]", "is not GeoJSON; expected a FeatureCollection"),
        ("{}", "is not GeoJSON; expected a FeatureCollection"),
        ('{"type": "FeatureCollection"}', "features: must be a list"),
        ('{"type": "FeatureCollection", "features": {"a": 1}}', "features: must be a list"),
        (collection(), "has no stations"),
        (collection(1, None, "x", []), "has no stations"),
        (collection(feature("Polygon")), "has no stations"),
        (collection(feature(coordinates=[])), "features[0]: a point needs [lon, lat] (got '[]')"),
        (collection(feature(coordinates="ab", id="x")), "features[0]: a point needs [lon, lat] (got 'ab')"),
        (collection(feature(coordinates=[None, 1], id="x")), "features[0].lon: is not a number (got 'None')"),
        (collection(feature(coordinates=[True, 1], id="x")), "features[0].lon: is not a number (got 'True')"),
        (collection(feature(coordinates=[[1], 1], id="x")), "features[0].lon: is not a number (got '[1]')"),
        (collection(feature(coordinates=[float("nan"), 1], id="x")), "features[0].lon: is not a number (got 'nan')"),
        (collection(feature()), "features[0].id: is empty"),
        (collection(feature(id=["x"])), "features[0].id: is empty"),
        (collection(feature(id="a\ud800")), "features[0].id: must be one line of plain text"),
        (collection(feature(id="x", pads=-3)), "features[0].pads: must be a whole number (got '-3')"),
        (collection(feature(coordinates=[40.8, -173.9], id="x")), "features[0].lat: latitude out of range"),
        (collection(feature(id=1), feature(id="1")), "features[1].id: two stations have the same id (got '1')"),
    ],
)
def test_wrong_geojson_is_refused_naming_the_feature(tmp_path, text, said):
    assert said_of(tmp_path, text, "s.geojson")[0].startswith(f"s.geojson: {said}")


ENDS = (Station("0", "Zero", 40.85, -73.9), Station("b", "B", 40.8, -73.9), Station("c", "C", 40.7, -73.9))


def segments_of(tmp_path, text, name="segments.csv"):
    (tmp_path / name).write_text(text)
    return read_segments(tmp_path / name, ENDS)


def test_segments_are_flown_both_ways_unless_they_say_otherwise(tmp_path):
    text = "from,to,both\n0,b,\nb,c,no\nc,0,yes\n"
    assert set(segments_of(tmp_path, text)) == {(0, 1), (1, 0), (1, 2), (2, 0), (0, 2)}
    assert segments_of(tmp_path, "to,from\n0,b\n") == [(1, 0), (0, 1)]


def test_segments_of_geojson_are_lines_that_name_their_ends(tmp_path):
    lines = [feature("LineString", **{"from": 0, "to": "b", "both": False}), feature(id="point")]
    assert segments_of(tmp_path, collection(*lines), "s.geojson") == [(0, 1)]


def test_all_wrong_segments_are_said_at_once(tmp_path):
    text = "from,to,both\n0,nowhere,\n,b,\nb,b,\nc,0,perhaps\nb\nc,b,0\n"
    faults = [f.removeprefix(f"{tmp_path}/") for f in faults_of(lambda: segments_of(tmp_path, text))]
    assert faults == [
        "segments.csv:2: to: is not a known station (got 'nowhere')",
        "segments.csv:3: from: is not a known station (got 'nothing')",
        "segments.csv:4: to: leads from a station to itself (got 'b')",
        "segments.csv:5: both: is not known (got 'perhaps'); yes or no",
        "segments.csv:6: has 1 cell, the header has 3",
    ]


def test_segments_without_their_columns_are_refused(tmp_path):
    faults = faults_of(lambda: segments_of(tmp_path, "start,end\n0,b\n"))
    assert [fault.split(": ", 1)[1] for fault in faults] == [
        "from: column is missing; the header has start, end",
        "to: column is missing; the header has start, end",
    ]


@given(
    data=st.binary(max_size=200)
    | st.text(max_size=200).map(lambda text: HEADER.encode() + text.encode("utf-8", "ignore"))
)
def test_no_bytes_crash_the_reader(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("bytes") / "stations.csv"
    path.write_bytes(data)
    try:
        found = read_stations(path)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
    else:
        assert all(-90 <= station.lat <= 90 for station in found)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["id", "type", "name"]), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(geometry=json_values, properties=json_values, coordinates=json_values)
def test_no_json_crashes_the_readers(tmp_path_factory, geometry, properties, coordinates):
    path = tmp_path_factory.mktemp("json") / "s.geojson"
    odd = [{"geometry": geometry, "properties": properties}, feature(coordinates=coordinates)]
    odd.append({**feature(coordinates=coordinates), "properties": properties})
    for item in odd:
        path.write_text(collection(item))
        with pytest.raises(InputError):
            read_stations(path)
        try:
            read_segments(path, ENDS)
        except InputError as error:
            assert str(path) in str(error)  # noqa: PT017
