"""No-fly zones: read exactly or refused, never silently dropped."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.reading import read_airspace
from skyway.models.airspace.ways import at_any_height
from skyway.models.base.errors import InputError

SQUARE = [[[-74.0, 40.6], [-73.9, 40.6], [-73.9, 40.7], [-74.0, 40.7], [-74.0, 40.6]]]


def polygon(coordinates=SQUARE, kind="Polygon", **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def zones_of(tmp_path, document) -> Airspace:
    path = tmp_path / "zones.geojson"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return Airspace(*read_airspace([path])[:1])


def holder(zones, lat, lon):
    found = zones.holding(np.array([lat]), np.array([lon]))
    return found[0].name if found else None


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


@pytest.mark.parametrize(
    "document",
    [
        collection(polygon(name="JFK")),
        polygon(name="JFK"),
        polygon(kind="MultiPolygon", coordinates=[SQUARE], id="JFK"),
    ],
    ids=["collection", "feature", "multipolygon"],
)
def test_zones_come_as_a_collection_or_alone(tmp_path, document):
    zones = zones_of(tmp_path, document)
    assert zones.names == ("JFK",)
    assert holder(zones, 40.65, -73.95) == "JFK"
    assert holder(zones, 40.75, -73.95) is None


def test_a_bare_geometry_gets_a_number_for_a_name(tmp_path):
    assert zones_of(tmp_path, polygon()["geometry"]).names == ("zone 1",)


def test_a_station_on_the_border_is_inside_and_one_in_a_hole_is_not(tmp_path):
    hole = [[-73.97, 40.63], [-73.93, 40.63], [-73.93, 40.67], [-73.97, 40.67], [-73.97, 40.63]]
    zones = zones_of(tmp_path, collection(polygon([*SQUARE, hole], name="ring")))
    assert holder(zones, 40.6, -73.95) == "ring"
    assert holder(zones, 40.65, -73.95) is None


def test_many_points_are_looked_up_at_once():
    zones = Airspace.of_polygons(("a", "b"), (shapely.box(0, 0, 1, 1), shapely.box(5, 5, 6, 6)))
    held = zones.holding(np.array([0.5, 3.0, 5.5]), np.array([0.5, 3.0, 5.5]))
    assert {place: zone.name for place, zone in held.items()} == {0: "a", 2: "b"}
    assert holder(Airspace(), 0.0, 0.0) is None


def test_no_zones_are_crossed_by_nothing():
    one = np.array([40.7])
    assert not Airspace().crossed_by(at_any_height(one, one, one + 1, one + 1)).any()


def test_a_long_flight_is_tested_along_the_geodesic_not_the_straight_line_of_a_map():
    tromso = (np.array([69.65]), np.array([18.96]))
    novosibirsk = (np.array([69.65]), np.array([82.0]))
    on_the_map = Airspace.of_polygons(("rhumb",), (shapely.box(49.0, 69.0, 51.0, 70.0),))
    on_the_globe = Airspace.of_polygons(("geodesic",), (shapely.box(49.0, 71.0, 51.0, 76.0),))
    assert not on_the_map.crossed_by(at_any_height(*tromso, *novosibirsk)).any()
    assert on_the_globe.crossed_by(at_any_height(*tromso, *novosibirsk)).all()


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ("", "is empty"),
        ('{"type": "FeatureCollection"}', "features: must be a list"),
        ("null", "is not an airspace file"),
        (collection(None), r"features\[0\]: is not a zone"),
        (collection(polygon(kind="Point", coordinates=[1, 2])), r"is a point without a radius"),
        ({"type": "Topology"}, "is not GeoJSON"),
        (collection(polygon([])), "is empty"),
        (collection(polygon([[]])), "has no coordinates"),
        (collection(polygon("abc")), "is empty"),
        (collection(polygon([[[0, 0], [1, None], [1, 1], [0, 0]]])), "is not a position"),
        (collection(polygon([[[0, 0], [1, 0], [1, 1], [0, 10**400]]])), "is not a position"),
        (collection(polygon([[[0, 0], [1, float("nan")], [1, 1], [0, 0]]])), "features"),
        (collection(polygon([[[0, 0], [1, float("inf")], [1, 1], [0, 0]]])), "is not a position"),
        (collection(polygon([[[40, 140], [41, 140], [41, 141], [40, 140]]])), "out of range .*longitude first"),
        (collection(polygon([[[0, 0], [1, 0], [0, 0]]])), "has fewer than three different corners"),
        ({"type": "Polygon", "coordinates": 3}, "is empty"),
        ("[" * 100_000, "is not JSON"),
    ],
)
def test_what_is_no_zone_is_refused(tmp_path, document, said):
    with pytest.raises(InputError, match=said) as caught:
        zones_of(tmp_path, document)
    assert str(caught.value).startswith(str(tmp_path / "zones.geojson"))


def test_all_wrong_zones_are_said_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        zones_of(tmp_path, collection(polygon([]), polygon(), polygon(kind="Point", coordinates=[0, 0])))
    assert [fault.field.split(":")[0] for fault in caught.value.faults] == ["features[0]", "features[2]"]


@pytest.mark.parametrize("properties", [None, [], "x", {"name": None}, {"name": ["a"]}, {"name": "a\ud800\x1b"}])
def test_odd_properties_do_not_lose_a_zone(tmp_path, properties):
    zones = zones_of(tmp_path, collection({**polygon(), "properties": properties}))
    assert len(zones.polygons) == 1
    assert zones.names[0].isprintable()


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=12,
)


@given(kind=st.sampled_from(["Polygon", "MultiPolygon"]), coordinates=json_values)
@example(kind="Polygon", coordinates=[[0.0, 0.0]])
def test_no_coordinates_crash_the_reader_or_are_dropped(tmp_path_factory, kind, coordinates):
    """They are refused, or, where they hold a position, count as closed, and that is told."""
    path = tmp_path_factory.mktemp("zones") / "zones.geojson"
    path.write_text(json.dumps(collection(polygon(coordinates, kind))))
    try:
        zones, notes = read_airspace([path])
    except InputError:
        return
    assert len(zones) == 1
    assert notes
