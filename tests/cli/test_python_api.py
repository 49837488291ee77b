"""skyway from Python: what a program hands in, and what a notebook shows."""

import math
import re
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import networkx as nx
import pytest

import skyway

DEPART = datetime(2024, 5, 1, 12, tzinfo=UTC)
PLACES = {"a": (40.70, -74.00), "b": (40.74, -73.96), "c": (40.78, -73.92)}
STATIONS = [skyway.Station(name, name.upper(), *place) for name, place in PLACES.items()]


def _plan(scenario, **more):
    wind = skyway.constant_wind(5.0, 270.0, DEPART, 48, 40.7, -74.0, scenario.rules.cruise_height_m)
    request = skyway.Request(state=skyway.State(DEPART, "a"), destination="c", payload_kg=0.5, **more)
    return skyway.plan(scenario, request, planner="pfs", forecast=wind)


@pytest.fixture(scope="module")
def answer():
    return _plan(skyway.build_scenario(STATIONS))


def test_every_public_name_is_there_and_dir_lists_it():
    assert set(skyway.__all__) <= set(dir(skyway))
    for name in skyway.__all__:
        assert getattr(skyway, name) is not None


def test_scenarios_and_compositions_are_named_by_text(tmp_path, answer):
    assert skyway.read_scenario(str(skyway.NEW_YORK)).name == skyway.read_scenario(skyway.NEW_YORK).name
    file = str(tmp_path / "plan.json")
    skyway.save_composition(answer.composition, file)
    assert skyway.load_composition(file).route == answer.composition.route


def test_an_objective_may_be_text():
    state = skyway.State(DEPART, "a")
    request = skyway.Request(state=state, destination="c", payload_kg=0.5, objective="on-time 2024-05-01T15:00+02:00")
    assert request.objective == skyway.Objective("on-time", datetime(2024, 5, 1, 13, tzinfo=UTC))
    assert replace(request, objective="p95").objective == skyway.Objective("p95")


@pytest.mark.parametrize("text", ["P95", "on-time", "on-time tomorrow", "on-time 2024-05-01T15:00", "mean now", ""])
def test_a_text_that_is_no_objective_is_refused(text):
    with pytest.raises(skyway.InputError, match="objective"):
        skyway.Request(state=skyway.State(DEPART, "a"), destination="c", payload_kg=0.5, objective=text)


def _request(**more):
    return skyway.Request(**({"state": skyway.State(DEPART, "a"), "destination": "c", "payload_kg": 0.5} | more))


def _built(stations=STATIONS, **more):
    return skyway.build_scenario(stations, **more)


MISTAKES = {
    r"state\.time: is not a datetime \(got '2024-05-01T12:00Z'\); a datetime with a time zone: ": lambda: _request(
        state=skyway.State("2024-05-01T12:00Z", "a")
    ),
    r"state: is not a State \(got 'a'\); State\(": lambda: _request(state="a"),
    r"state\.position: is not a place .*; \(lat, lon\), degrees": lambda: _request(
        state=skyway.State(DEPART, position=(40.7,))
    ),
    r"state\.busy_pads: is not a Mapping": lambda: _request(state=skyway.State(DEPART, "a", busy_pads=["b"])),
    r"not_before: is not a datetime": lambda: _request(not_before="2024-05-01T12:00Z"),
    r"stop_at: is not a tuple \(got 'b'\)": lambda: _request(stop_at="b"),
    r"payload_kg: is not a number but text \(got '0\.5'\)": lambda: _request(payload_kg="0.5"),
    r"scenario: is not a Scenario \(got 'newyork'\); read_scenario\(": lambda: skyway.plan("newyork", _request()),
    r"request: is not a Request \(got 'c'\); Request\(": lambda: skyway.plan(_built(), "c"),
    r"forecast: is not a WindEnsemble \(got '5@270'\); such as constant_wind\(": lambda: skyway.plan(
        _built(), _request(), forecast="5@270"
    ),
    r"planners: is one name \(got 'pfs'\); a list of names: \['pfs'\]": lambda: skyway.compare(
        _built(), _request(), "pfs"
    ),
    r"no wind record; in Python give plan a forecast=, such as constant_wind\(.*build_scenario a history=$": lambda: (
        skyway.plan(_built(), _request())
    ),
    r"stations: there is none; give at least one": lambda: _built([]),
    r"lat: station a: latitude out of range \(got '140\.7'\); lat and lon may be swapped": lambda: _built(
        [skyway.Station("a", "A", 140.7, -74.0)]
    ),
    r"lon: station a: is not a number but text": lambda: _built([skyway.Station("a", "A", 40.7, "-74")]),
    r"lat: station a: latitude out of range \(got 'nan'\)": lambda: _built([skyway.Station("a", "A", math.nan, 0.0)]),
    r"lat: station a: latitude out of range \(got '95\.0'\)": lambda: _built([{"id": "a", "lat": 95, "lon": 0}]),
    r"drones\[0\]: is not a Drone \(got 'm200'\)": lambda: _built(drones=["m200"]),
    r"segments: is not a pair": lambda: _built(segments=["ab"]),
    r"speed_mps: is not a number but text": lambda: skyway.constant_wind("5", 270, DEPART, 48, 40.7, -74.0, 60.0),
    r"time: is not a time .*; a datetime with a time zone": lambda: skyway.constant_wind(
        5, 270, "2024-05-01", 48, 40.7, -74.0, 60.0
    ),
    r"path: is not a str": lambda: skyway.read_scenario(7),
}


@pytest.mark.parametrize("told", MISTAKES)
def test_a_wrong_argument_is_named_with_its_value_and_a_remedy(told):
    with pytest.raises(skyway.InputError, match=told):
        MISTAKES[told]()


@pytest.mark.parametrize("what", ["scenario", "network", "load", "history", "forecast", "result", "composition"])
def test_what_a_prompt_shows_is_one_short_line(what, answer):
    scenario = skyway.read_scenario(skyway.NEW_YORK)
    shown = {
        "scenario": scenario,
        "network": scenario.network,
        "load": scenario.load,
        "history": scenario.history,
        "forecast": scenario.forecast(datetime(2013, 7, 10, 18, tzinfo=UTC), 24),
        "result": answer,
        "composition": answer.composition,
    }[what]
    assert len(repr(shown)) < 200
    assert "array" not in repr(shown)
    assert "\n" not in repr(shown)


def test_a_scenario_is_built_from_stations_pairs_and_drones():
    pairs = [("a", "b"), ("b", "c")]
    drone = skyway.read_scenario(skyway.NEW_YORK).drones[0]
    scenario = skyway.build_scenario(STATIONS, segments=pairs, drones=[drone], name="three")
    assert repr(scenario) == "Scenario(three: 3 stations, 2 segments, 1 drone, no wind record)"
    assert _plan(scenario).composition.route == ("a", "b", "c")


def test_the_same_network_comes_from_stations_mappings_tables_and_graphs():
    import geopandas
    import pandas as pd
    from shapely.geometry import Point

    rows = [{"id": name, "lat": lat, "lon": lon, "pads": 3} for name, (lat, lon) in PLACES.items()]
    graph = nx.Graph()
    for name, (lat, lon) in PLACES.items():
        graph.add_node(name, y=lat, x=lon, pads=3)
    graph.add_edges_from([("a", "b"), ("b", "c")])
    points = geopandas.GeoDataFrame(
        {"id": list(PLACES), "pads": 3}, geometry=[Point(lon, lat) for lat, lon in PLACES.values()], crs="EPSG:4326"
    )
    sources = [rows, pd.DataFrame(rows), pd.DataFrame(rows).set_index("id"), graph, points, points.to_crs("EPSG:32618")]
    expected = skyway.build_scenario([replace(station, pads=3) for station in STATIONS]).network
    for source in sources:
        network = skyway.build_scenario(source).network
        assert [station.id for station in network.stations] == ["a", "b", "c"]
        assert set(network.pads) == {3}
        assert sorted(network.distance_m) == pytest.approx(sorted(expected.distance_m), abs=0.01)


def test_a_networks_graph_gives_the_network_back():
    network = skyway.read_scenario(skyway.NEW_YORK).network
    again = skyway.build_scenario(network.graph).network
    assert again.distance_m == pytest.approx(network.distance_m, abs=0.0)
    assert [station.id for station in again.stations] == [station.id for station in network.stations]


@pytest.mark.parametrize(
    ("stations", "problem"),
    [
        (7, "is not a network"),
        ("stations.csv", "is not a network"),
        ([{"id": "a", "lat": 40.0}], "lon: station a: is not a number"),
        ([{"id": "a", "lat": "north", "lon": 1.0}], "lat: station a: is not a number"),
        ([{"id": "a", "lat": 400.0, "lon": 1.0}], "latitude out of range"),
        ([{"id": "a", "lat": 40.0, "lon": 1.0, "pads": -2}], "whole number"),
        ([{"id": "a", "lat": 40.0, "lon": 1.0, "pads": 2.5}], "whole number"),
        ([{"id": "a", "lat": 40.0, "lon": math.nan}], "lon: station a: is not a number"),
        ([{"lat": 40.0, "lon": 1.0}], "no id"),
        ([{"id": "a", "lat": 40.0, "lon": 1.0}] * 2, "same id"),
        ([3.0], "is not a station"),
    ],
)
def test_stations_that_are_none_are_refused_with_the_reason(stations, problem):
    with pytest.raises(skyway.InputError, match=problem):
        skyway.build_scenario(stations)


def test_segments_between_unknown_stations_an_empty_fleet_and_a_load_that_does_not_fit_are_refused():
    with pytest.raises(skyway.InputError, match="is not a known station"):
        skyway.build_scenario(STATIONS, segments=[("a", "z")])
    with pytest.raises(skyway.InputError, match="the fleet is empty"):
        skyway.build_scenario(STATIONS, drones=[])
    with pytest.raises(skyway.InputError, match="does not fit the network"):
        skyway.build_scenario(STATIONS, load=skyway.PadLoad.none(2, "UTC"))


def test_legs_and_stations_are_data_frames(answer):
    legs = answer.composition.to_frame()
    assert list(legs.index) == list(range(1, len(answer.composition.services) + 1))
    assert legs["distance_km"].sum() == pytest.approx(answer.composition.distance_m / 1000.0)
    waiting = legs["then_wait_s"].sum() + legs["then_hold_s"].sum() + legs["then_recharge_s"].sum()
    assert waiting == pytest.approx(answer.composition.wait_time_s + answer.composition.recharge_time_s)
    stations = skyway.read_scenario(skyway.NEW_YORK).network.to_frame()
    assert stations.loc["bellevue", "pads"] == 5


class _Cells(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "Clinic & Sons"])
def test_a_notebook_shows_tables_and_runs_nothing_that_a_name_says(name, answer):
    scenario = skyway.build_scenario([replace(STATIONS[0], name=name), *STATIONS[1:]])
    for shown in (scenario, scenario.network, answer, answer.composition):
        cells = _Cells()
        cells.feed(shown._repr_html_())
        assert "table" in cells.tags
        assert "script" not in cells.tags


def test_results_and_networks_are_pictures(tmp_path, answer):
    from matplotlib.figure import Figure

    assert isinstance(skyway.plot(answer), Figure)
    assert isinstance(skyway.plot(answer.problem.scenario, str(tmp_path / "network.svg")), Figure)
    assert (tmp_path / "network.svg").read_text().startswith("<?xml")
    with pytest.raises(skyway.InputError, match="is not a picture format"):
        skyway.plot(answer, "plan.bmp")
    with pytest.raises(skyway.InputError, match="cannot be drawn"):
        skyway.plot("plan.json")


def test_the_api_reference_has_every_public_name():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "python.md").read_text()
    assert sorted(re.findall(r"^::: skyway\.(\w+)$", page, re.MULTILINE)) == sorted(skyway.__all__)
