"""Compositions as JSON: the fields promised, totals to the second, nothing lost, and wrong files told apart."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import AuditError, InputError
from skyway.models.base.statistics import Figure
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.file import SCHEMA, from_json, load, save, to_json
from skyway.models.composition.service import DroneService, LegSegment, Place, Stop
from skyway.models.wind.summary import Wind

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
NUMBER = st.floats(0.0, 1e6)
POSITIVE = st.floats(1e-3, 1e5)
SHARE = st.floats(0.0, 1.0)
UNKNOWN_SHARE = st.none() | SHARE
SECONDS = st.integers(1, 20_000_000).map(lambda ms: ms / 1000.0)
TEXT = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=8)
INSTANT = st.datetimes(datetime(2000, 1, 1), datetime(2100, 1, 1), timezones=st.just(UTC))  # noqa: DTZ001
PLACE = st.builds(
    Place,
    st.floats(-90, 90),
    st.floats(-180, 180),
    st.none() | st.floats(-450, 9000),
    st.none() | TEXT,
    st.integers(0, 99),
)


WIND = st.builds(Wind, st.floats(0, 40), st.none() | st.floats(0, 359.9), st.none() | NUMBER, st.none() | NUMBER)
FIGURE = st.none() | st.builds(Figure, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), NUMBER, NUMBER)


@st.composite
def legs_and_stops(draw, ids: list[str]):
    """A course without gaps: each flight leaves when the stop before it is over."""
    now, legs, stops = START, [], []
    route = draw(st.lists(st.sampled_from(ids), min_size=2, max_size=5))
    for number, (origin, destination) in enumerate(pairwise(route)):
        if draw(st.booleans()) or number:
            stop = Stop(
                origin,
                now,
                draw(SECONDS),
                draw(SECONDS),
                draw(SECONDS),
                draw(SHARE),
                draw(SHARE),
                draw(UNKNOWN_SHARE),
                draw(SECONDS),
            )
            stops.append(stop)
            now = stop.leave
        arrive = now + timedelta(seconds=draw(SECONDS))
        via = tuple(draw(st.lists(st.sampled_from(ids), max_size=2)))
        segments = tuple(
            LegSegment(key, draw(NUMBER), draw(st.floats(0, 359.9)), draw(WIND), draw(st.floats(-40, 40)), 0.5)
            for key in (*via, destination)
        )
        leg = DroneService(
            id=f"leg-{number}", origin=origin, destination=destination, depart=now, arrive=arrive,
            via=via, distance_m=draw(NUMBER),
            bearing_deg=draw(st.floats(0, 359.9)), ground_speed_mps=draw(POSITIVE), energy_j=draw(NUMBER),
            soc_depart=draw(SHARE), soc_arrive=draw(SHARE), wind=draw(WIND),
            tailwind_mps=draw(st.floats(-40, 40)), crosswind_mps=draw(st.floats(-40, 40)), p_reserve=draw(UNKNOWN_SHARE),
            p_hold=draw(UNKNOWN_SHARE), diverts=tuple(draw(st.lists(TEXT, max_size=2))),
            p_hold_room=draw(UNKNOWN_SHARE), segments=draw(st.sampled_from([(), segments])), course_wind=draw(st.none() | WIND),
        )  # fmt: skip
        legs.append(leg)
        now = arrive
    return tuple(legs), tuple(stops)


@st.composite
def compositions(draw) -> Composition:
    stations = draw(st.dictionaries(TEXT, PLACE, min_size=1, max_size=4))
    legs, stops = draw(legs_and_stops(sorted(stations)))
    unknown = st.none() | INSTANT
    return Composition(
        id=draw(TEXT), planner=draw(TEXT), drone=draw(TEXT), payload_kg=draw(NUMBER), airspeed_mps=draw(POSITIVE),
        max_ground_speed_mps=draw(POSITIVE), cruise_height_m=draw(POSITIVE), climb_rate_mps=draw(POSITIVE),
        descent_rate_mps=draw(POSITIVE), reserve_soc=draw(SHARE), depart=START, origin=legs[0].origin,
        destination=legs[-1].destination, stations=stations, services=legs, stops=stops,
        arrival=ArrivalDistribution(*(draw(unknown) for _ in range(3)), *(draw(FIGURE) for _ in range(3)), draw(st.none() | st.integers(0, 9999))), planning_time_s=draw(NUMBER),
        seed=draw(st.none() | st.integers(0, 2**32)), drone_parameters=draw(st.dictionaries(TEXT, st.none() | TEXT | NUMBER, max_size=3)),
        scenario_path=draw(st.none() | TEXT), scenario_sha256=draw(st.none() | TEXT), on_time_probability=draw(UNKNOWN_SHARE),
        success_probability=draw(UNKNOWN_SHARE), success=draw(FIGURE), on_time=draw(FIGURE), notes=tuple(draw(st.lists(st.text(st.characters(exclude_categories=["Cs"])), max_size=2))),
    )  # fmt: skip


def without_energy(composition: Composition) -> Composition:
    return replace(composition, services=tuple(replace(leg, energy_j=0.0) for leg in composition.services))


@settings(max_examples=70)
@given(compositions())
def test_a_composition_written_and_read_is_the_same(composition):
    back = from_json(json.dumps(to_json(composition)))
    assert without_energy(back) == without_energy(composition)
    for one, other in zip(back.services, composition.services, strict=True):
        assert one.energy_j == pytest.approx(other.energy_j, rel=1e-15)  # Wh in the file: the last digit may turn


@settings(max_examples=40)
@given(compositions())
def test_delivery_is_flight_plus_waiting_plus_recharge_and_that_is_arrival_minus_departure(composition):
    document = to_json(composition)
    parts = sum(document[f"{part}_time_s"] for part in ("flight", "wait", "recharge"))
    assert document["delivery_time_s"] == pytest.approx(parts, abs=1e-6)
    gone = (composition.arrive - composition.depart).total_seconds()
    assert document["delivery_time_s"] == pytest.approx(gone, abs=1e-3)
    assert document["wait_time_s"] == pytest.approx(sum(s["wait_s"] + s["hold_s"] for s in document["stops"]))
    for total, part in (("flight_time_s", "flight_time_s"), ("distance_m", "distance_m"), ("energy_wh", "energy_wh")):
        assert document[total] == pytest.approx(math.fsum(leg[part] for leg in document["legs"]), rel=1e-12)
    assert document["min_soc"] == min(leg["soc_arrive"] for leg in document["legs"])


def one_flight(**changes) -> Composition:
    leg = DroneService(
        "leg-0", "a", "b", START, START + timedelta(seconds=600), 9000.0, 30.0, 15.0, 360_000.0, 1.0, 0.7, Wind(5.0, 270.0), 1.0, -2.0,
    )  # fmt: skip
    places = {"a": Place(40.7, -74.0, 10.0, "A", 5), "b": Place(40.8, -73.9)}
    composition = Composition(
        "c", "pfs", "m200", 0.8, 20.0, 20.0, 60.0, 5.0, 3.0, 0.2, START, "a", "b", places, (leg,), (),
        ArrivalDistribution(None, None, None), 0.004,
    )  # fmt: skip
    return replace(composition, **changes)


ARRIVAL = {"mean", "p50", "p95", "delivery_mean_s", "delivery_p50_s", "delivery_p95_s", "runs", "p_arrive"}


def test_the_file_has_every_field_promised():
    document = to_json(one_flight(stops=(Stop("a", START, 0.0, 0.0, 0.0, 1.0, 1.0),)))
    assert document["schema"] == "skyway.composition/1"
    assert set(document) >= {
        "scenario", "planner", "drone", "payload_kg", "airspeed_mps", "cruise_height_m", "reserve_soc", "seed", "depart",
        "stations", "legs", "stops", "delivery_time_s", "flight_time_s", "wait_time_s", "recharge_time_s", "distance_m",
        "energy_wh", "min_soc", "arrival", "planning_time_s",
    }  # fmt: skip
    assert set(document["scenario"]) == {"path", "sha256"}
    assert set(document["arrival"]) == ARRIVAL
    assert set(document["stations"]["a"]) >= {"lat", "lon", "elevation_m"}
    assert set(document["legs"][0]) >= {
        "from", "to", "via", "distance_m", "bearing_deg", "ground_speed_mps", "depart", "arrive", "flight_time_s",
        "energy_wh", "soc_depart", "soc_arrive", "p_reserve", "p_hold", "p_hold_room", "wind", "course_wind", "segments",
    }  # fmt: skip
    assert set(document["legs"][0]["wind"]) == {"speed_mps", "from_deg", "p10_mps", "p90_mps"}
    assert set(document["stops"][0]) >= {
        "station", "arrive", "wait_s", "hold_s", "hold_room_s", "p_pad_free", "recharge_s", "soc_from", "soc_to",
    }  # fmt: skip


def test_instants_are_utc_charges_are_fractions_and_what_is_unknown_is_null():
    document = to_json(one_flight())
    assert document["depart"] == "2013-07-10T18:00:00Z"
    assert document["legs"][0]["arrive"] == "2013-07-10T18:10:00Z"
    assert document["legs"][0]["soc_arrive"] == 0.7
    assert document["legs"][0]["p_reserve"] is None
    assert document["arrival"] == dict.fromkeys(ARRIVAL)
    assert document["seed"] is None
    assert document["energy_wh"] == 100.0


def test_a_saved_composition_is_loaded_and_not_overwritten(tmp_path):
    path = tmp_path / "plan.json"
    save(one_flight(), path)
    assert load(path) == one_flight()
    with pytest.raises(InputError, match="exists already"):
        save(one_flight(), path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load(path) == one_flight()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_answer_with_a_figure_that_is_no_number_is_none(value):
    with pytest.raises(AuditError, match=r"payload_kg: claimed (nan|inf)"):
        one_flight(payload_kg=value)
    leg = one_flight().services[0]
    with pytest.raises(AuditError, match=r"services\[1\].wind.speed_mps: claimed (nan|inf)"):
        one_flight(services=(replace(leg, wind=replace(leg.wind, speed_mps=value)),))


def test_fields_of_later_versions_are_passed_over_and_optional_ones_may_be_absent():
    document = to_json(one_flight()) | {"colour": [1, {}]}
    for name in ("id", "from", "to", "seed", "scenario", "arrival", "notes", "planning_time_s", "drone_parameters"):
        del document[name]
    back = from_json(json.dumps(document))
    assert (back.origin, back.destination, back.scenario_path) == ("a", "b", None)


REQUIRED = (
    "schema", "planner", "drone", "payload_kg", "airspeed_mps", "cruise_height_m", "reserve_soc", "depart", "stations", "legs", "stops",
)  # fmt: skip


def refused(document) -> str:
    text = document if isinstance(document, str | bytes) else json.dumps(document)
    with pytest.raises(InputError) as caught:
        from_json(text, file="plan.json")
    assert str(caught.value).startswith("plan.json: ")
    assert all(line.isprintable() for line in str(caught.value).split("\n"))
    return str(caught.value)


@pytest.mark.parametrize("name", REQUIRED)
def test_a_missing_field_is_named(name):
    document = to_json(one_flight())
    del document[name]
    assert f"missing required field `{name}`" in refused(document)


@pytest.mark.parametrize("value", [[], {}, True, "nine", None])
@pytest.mark.parametrize("name", ["payload_kg", "airspeed_mps", "cruise_height_m", "reserve_soc", "planning_time_s"])
def test_a_figure_of_another_type_is_named(name, value):
    assert f"$.{name}" in refused(to_json(one_flight()) | {name: value})


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("legs", "distance_m", -1), ("legs", "bearing_deg", 400), ("legs", "ground_speed_mps", 0), ("legs", "energy_wh", -3),
        ("legs", "soc_depart", 80), ("legs", "soc_arrive", 1.01), ("legs", "p_reserve", 1.5), ("legs", "wind", None),
        ("legs", "depart", 1373479200), ("legs", "via", "a"), ("stops", "wait_s", -1), ("stops", "soc_to", 100),
        ("stops", "p_pad_free", -0.1), ("stops", "recharge_s", None), ("stops", "station", 3),
    ],
)  # fmt: skip
def test_a_figure_out_of_range_is_named_with_its_place(part, name, value):
    document = to_json(one_flight(stops=(Stop("a", START, 0.0, 0.0, 0.0, 1.0, 1.0),)))
    document[part][0][name] = value
    assert f"$.{part}[0].{name}`" in refused(document)


def test_a_station_off_the_globe_is_refused():
    document = to_json(one_flight())
    document["stations"]["a"]["lat"] = 140.7
    assert "$.stations[...].lat" in refused(document)


@pytest.mark.parametrize("text", ["2013-07-10T18:00", "noon", ""])
def test_a_time_without_an_offset_is_refused(text):
    document = to_json(one_flight())
    document["legs"][0]["depart"] = text
    assert "legs[0].depart: " in refused(document)


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", "3", '"x"', json.dumps(to_json(one_flight()))[:-40], '{"schema": NaN}', '{"schema": "\ud800"}',
        '{"schema": "\\ud800"}', '{"x":' + "[" * 200_000, '{"x":' + "[" * 200_000 + "]" * 200_000 + "}", b"\xff\xfe{}", b"\x00",
        '{"payload_kg": 1e999}', '{"payload_kg": ' + "9" * 5000 + "}",
    ],
)  # fmt: skip
def test_what_is_no_composition_is_refused_with_what_would_be_one(text):
    assert "not a skyway.composition/1 file: " in refused(text)
    assert "write one with skyway plan -o" in refused(text)


def test_another_schema_is_named():
    said = refused(to_json(one_flight()) | {"schema": "skyway.composition/2"})
    assert said == f"plan.json: schema: unknown schema (got 'skyway.composition/2'); expected {SCHEMA}"


def two_flights() -> dict:
    there = one_flight().services[0]
    back = replace(
        there,
        id="leg-1",
        origin="b",
        destination="a",
        depart=there.arrive,
        arrive=there.arrive + timedelta(seconds=600),
    )
    return to_json(one_flight(services=(there, back), destination="a"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.update(legs=[]), "legs: has no legs"),
        (lambda d: d["legs"][0].update(to="x"), "legs[0]: names a station that is not in stations (got 'x')"),
        (
            lambda d: d["legs"][1].update({"from": "a"}),
            "legs[1].from: does not start where the last leg ended (got 'a')",
        ),
        (lambda d: d["legs"][0].update(arrive="2013-07-10T17:00Z"), "legs[0].arrive: arrives before it departs"),
        (
            lambda d: d["legs"][1].update(depart="2013-07-10T18:09Z"),
            "legs[1].depart: departs before the last leg arrived",
        ),
        (lambda d: d["stations"].update({"\x1b[2J": d["stations"]["a"]}), "stations: must be one line of plain text"),
        (lambda d: d.update(stops=[{**stop_json(), "station": "y"}]), "stops[0].station: names a station that is not"),
    ],
)
def test_a_course_that_does_not_hang_together_is_refused(change, said):
    document = two_flights()
    change(document)
    assert said in refused(document)


def stop_json() -> dict:
    return to_json(one_flight(stops=(Stop("a", START, 0.0, 0.0, 0.0, 1.0, 1.0),)))["stops"][0]


@given(data=st.data())
def test_no_damage_to_a_file_crashes_the_reader(data):
    raw = bytearray(json.dumps(two_flights()).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        back = from_json(bytes(raw))
    except InputError as error:
        assert str(error).isprintable() or "\n" in str(error)  # noqa: PT017
    else:
        assert math.isfinite(back.delivery_time_s)
