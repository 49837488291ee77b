"""Flights through changing wind: the triangle against vectors, times against plain integration, FIFO, holding."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_leg import wind_triangle

from skyway.models.base import geodesy
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.kernels import NEVER, cruise, land, leg, next_opening, segment_speed, slot_end, slot_of
from skyway.models.flight.rules import FlightRules, SegmentWind, air_over
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS, ground_speed, speed_from, vector

START = 1_373_464_800.0
SPEED = st.floats(0.0, 30.0)
ANGLE = st.floats(0.0, 360.0)


def by_vectors(airspeed: float, north: float, east: float, bearing_deg: float) -> float:
    """Ground speed along a course: the larger root of |g u - w| = S; 0 where there is none."""
    u = np.array([math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))])
    w = np.array([north, east])
    roots = np.roots([1.0, -2.0 * (w @ u), w @ w - airspeed**2])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real.max(initial=0.0))


@given(st.floats(1.0, 30.0), SPEED, ANGLE, ANGLE)
def test_the_wind_triangle_solves_the_vector_equation(airspeed, wind, wind_from, bearing):
    north, east = (float(part) for part in vector(wind, wind_from))
    triangle = wind_triangle(airspeed, wind, wind_from, bearing)
    course = math.radians(bearing)
    assert triangle.tailwind_mps == pytest.approx(north * math.cos(course) + east * math.sin(course), abs=1e-9)
    assert abs(triangle.crosswind_mps) == pytest.approx(
        abs(east * math.cos(course) - north * math.sin(course)), abs=1e-9
    )
    if triangle.ground_speed_mps > 0.0:
        g = triangle.ground_speed_mps
        air = math.hypot(g * math.cos(course) - north, g * math.sin(course) - east)
        assert air == pytest.approx(airspeed, abs=1e-9)
        assert g == pytest.approx(by_vectors(airspeed, north, east, bearing), abs=1e-5)
    else:
        slow = by_vectors(airspeed, north, east, bearing) < MIN_GROUND_SPEED_MPS + 1e-6
        assert slow or abs(triangle.crosswind_mps) >= airspeed - 1e-6


@pytest.mark.parametrize(
    ("wind_from", "ground", "along", "across"),
    [
        (0.0, 10.0, -5.0, 0.0),
        (180.0, 20.0, 5.0, 0.0),
        (90.0, math.sqrt(200.0), 0.0, 5.0),
        (270.0, math.sqrt(200.0), 0.0, -5.0),
    ],
)
def test_flying_north_wind_from_north_is_a_headwind(wind_from, ground, along, across):
    triangle = wind_triangle(15.0, 5.0, wind_from, 0.0)
    assert triangle.ground_speed_mps == pytest.approx(ground)
    assert triangle.tailwind_mps == pytest.approx(along, abs=1e-12)
    assert abs(triangle.crosswind_mps) == pytest.approx(abs(across), abs=1e-12)


@pytest.mark.parametrize(
    ("airspeed", "wind", "wind_from", "limit"),
    [
        (10.0, 10.0, 90.0, math.inf),  # crosswind as fast as the drone
        (10.0, 25.0, 90.0, math.inf),
        (10.0, 9.5, 0.0, math.inf),  # half a metre a second forward
        (10.0, 30.0, 0.0, math.inf),  # blown backwards
        (20.0, 12.1, 180.0, 12.0),  # a tailwind over the limit
    ],
)
def test_what_nobody_flies_has_no_speed(airspeed, wind, wind_from, limit):
    triangle = wind_triangle(airspeed, wind, wind_from, 0.0, wind_limit_mps=limit)
    assert triangle.ground_speed_mps == 0.0
    assert triangle.ground_speed_mps == 0.0


def test_the_speed_of_the_vehicle_caps_the_plan():
    assert wind_triangle(20.0, 8.0, 180.0, 0.0, max_ground_speed_mps=20.0).ground_speed_mps == 20.0


@given(st.lists(st.tuples(st.floats(0.0, 40.0), SPEED, ANGLE, ANGLE, st.floats(0.0, 30.0)), min_size=1, max_size=20))
def test_many_triangles_at_once_are_those_one_by_one(cases):
    airspeed, _, _, _, limit = (np.array(column) for column in zip(*cases, strict=True))
    single = [wind_triangle(s, w, f, b, wind_limit_mps=m, max_ground_speed_mps=20.0) for s, w, f, b, m in cases]
    along = [t.tailwind_mps for t in single]
    across = [t.crosswind_mps for t in single]
    many = ground_speed(airspeed, along, across, limit, 20.0)
    assert many.tolist() == [t.ground_speed_mps for t in single]
    assert np.isfinite(many).all()


@given(SPEED, ANGLE)
def test_wind_as_people_say_it_survives_being_a_vector(speed, wind_from):
    back_speed, back_from = speed_from(*vector(speed, wind_from))
    assert back_speed == pytest.approx(speed, abs=1e-9)
    if speed > 1e-6:
        assert abs((float(back_from) - wind_from + 180.0) % 360.0 - 180.0) < 1e-6
    assert 0.0 <= back_from < 360.0


@st.composite
def airs(draw, *, gentle: bool = False) -> SegmentWind:
    """A few segments in one member's wind of a few slots; slots near or over the limits are common."""
    slots, sites, segments = draw(st.integers(1, 7)), draw(st.integers(1, 3)), draw(st.integers(1, 3))
    speeds = (
        st.floats(0.0, 5.0) if gentle else st.sampled_from([0.0, 3.0, 8.0, 11.9, 12.1, 20.0]) | st.floats(0.0, 25.0)
    )
    wind = draw(st.lists(st.tuples(speeds, ANGLE), min_size=slots * sites, max_size=slots * sites))
    north, east = vector(*(np.array(column) for column in zip(*wind, strict=True)))
    share = np.array(draw(st.lists(st.floats(0.1, 1.0), min_size=segments * sites, max_size=segments * sites)))
    weight = share.reshape(segments, sites)
    bearing = np.radians(draw(st.lists(ANGLE, min_size=segments, max_size=segments)))
    return SegmentWind(
        start_s=START,
        slot_s=float(draw(st.sampled_from([60.0, 600.0, 3600.0]))),
        north=north.reshape(1, slots, sites),
        east=east.reshape(1, slots, sites),
        weight=weight / weight.sum(axis=1, keepdims=True),
        cos_bearing=np.cos(bearing),
        sin_bearing=np.sin(bearing),
        distance_m=np.array(draw(st.lists(st.floats(0.0, 40_000.0), min_size=segments, max_size=segments))),
        airspeed_mps=draw(st.sampled_from([6.0, 12.0, 20.0])),
        wind_limit_mps=draw(st.sampled_from([12.0, 60.0])),
        max_ground_speed_mps=draw(st.sampled_from([20.0, 30.0])),
        climb_s=draw(st.sampled_from([0.0, 12.0, 200.0])),
        descent_s=draw(st.sampled_from([0.0, 20.0, 300.0])),
        shut_of=np.zeros(segments, dtype=np.int64),
        shut=np.zeros((slots, 1), dtype=bool),
    )


@st.composite
def times(draw, air: SegmentWind) -> float:
    """Departures at, just before, just after and between the boundaries of slots."""
    boundary = START + air.slot_s * draw(st.integers(-1, air.north.shape[1] + 1))
    return boundary + draw(st.sampled_from([0.0, -1e-7, 1e-7, -2e-6, 2e-6, -1.0]) | st.floats(0.0, air.slot_s))


def true_speed(air: SegmentWind, slot: int, segment: int) -> float:
    """Ground speed by vectors, with the rules of flying; 0 is not flyable."""
    north = float(air.weight[segment] @ air.north[0, slot])
    east = float(air.weight[segment] @ air.east[0, slot])
    bearing = math.degrees(math.atan2(air.sin_bearing[segment], air.cos_bearing[segment]))
    across = east * air.cos_bearing[segment] - north * air.sin_bearing[segment]
    if math.hypot(north, east) > air.wind_limit_mps or abs(across) >= air.airspeed_mps:
        return 0.0
    speed = by_vectors(air.airspeed_mps, north, east, bearing)
    return min(speed, air.max_ground_speed_mps) if speed >= MIN_GROUND_SPEED_MPS else 0.0


def slot_holding(air: SegmentWind, time_s: float) -> int:
    return min(max(math.floor((time_s - START) / air.slot_s), 0), air.north.shape[1] - 1)


def integrated(air: SegmentWind, segments, depart_s: float) -> float:
    """Touch-down by adding up distance along a fine grid of time, or never; the definition in plain steps."""
    now = depart_s + air.climb_s
    for segment in segments:
        end = now + air.distance_m[segment] / MIN_GROUND_SPEED_MPS + 1.0
        inner = START + air.slot_s * np.arange(0, air.north.shape[1] + 1)
        grid = np.unique(np.concatenate((np.linspace(now, end, 50), inner[(inner > now) & (inner < end)])))
        middle = (grid[:-1] + grid[1:]) / 2.0
        speed = np.array([true_speed(air, slot_holding(air, t), segment) for t in middle])
        flown = np.concatenate(([0.0], np.cumsum(speed * np.diff(grid))))
        if air.distance_m[segment] > flown[-1]:
            return NEVER
        reached = int(np.searchsorted(flown, air.distance_m[segment]))
        if reached:
            part = (air.distance_m[segment] - flown[reached - 1]) / (flown[reached] - flown[reached - 1])
            now = grid[reached - 1] + part * (grid[reached] - grid[reached - 1])
    now += air.descent_s
    touched = range(slot_holding(air, depart_s), slot_holding(air, now) + 1)
    flyable = all(true_speed(air, slot, segment) > 0.0 for slot in touched for segment in segments)
    return float(now) if flyable else NEVER


def on_edge(air: SegmentWind, *moments: float) -> bool:
    """Whether a moment is so near a boundary of slots that rounding decides on which side it is."""
    phases = [(moment - START) % air.slot_s for moment in moments if math.isfinite(moment)]
    return any(min(phase, air.slot_s - phase) < 1e-4 for phase in phases)


@settings(max_examples=150)
@given(st.data())
def test_a_flight_lands_when_plain_integration_says(data):
    air = data.draw(airs())
    depart = data.draw(times(air))
    segments = np.arange(data.draw(st.integers(1, len(air.distance_m))))
    found = land(air, 0, segments, depart)
    truth = integrated(air, segments, depart)
    assert not math.isnan(found)
    if not on_edge(air, depart, depart + air.climb_s, found, truth):
        assert found == pytest.approx(truth, abs=1e-3)


@settings(max_examples=300)
@given(st.data())
def test_who_leaves_later_does_not_arrive_earlier(data):
    air = data.draw(airs())
    segments = np.arange(data.draw(st.integers(1, len(air.distance_m))))
    early, late = sorted((data.draw(times(air)), data.draw(times(air))))
    arrivals = []
    for ready in (early, late):
        off = next_opening(air, 0, segments, ready)
        assert off >= ready
        arrivals.append(land(air, 0, segments, off) if off < NEVER else NEVER)
    assert arrivals[0] <= arrivals[1] + 1e-4


@settings(max_examples=200)
@given(st.data())
def test_a_drone_holds_no_longer_than_it_must(data):
    air = data.draw(airs())
    segments = np.arange(data.draw(st.integers(1, len(air.distance_m))))
    ready = data.draw(times(air))
    off = next_opening(air, 0, segments, ready)
    if off < NEVER:
        assert land(air, 0, segments, off) < NEVER
    last = min(off, START + air.slot_s * (air.north.shape[1] + 2))
    for earlier in np.linspace(ready, max(last - 1e-3, ready), 40):
        assert earlier >= off or land(air, 0, segments, float(earlier)) == NEVER


@settings(max_examples=300)
@given(st.data())
def test_a_leg_is_the_first_flight_that_can_be_made(data):
    air = data.draw(airs())
    ready = data.draw(times(air))
    off, down = leg(air, 0, 0, ready)
    opening = next_opening(air, 0, np.array([0]), ready)
    assert off == opening
    assert down == (land(air, 0, np.array([0]), opening) if opening < NEVER else NEVER)


@given(st.data())
def test_a_held_drone_waits_for_a_slot_to_begin(data):
    air = data.draw(airs())
    ready = data.draw(times(air))
    off, _ = leg(air, 0, 0, ready)
    assert off in {ready, NEVER} or (off - START) % air.slot_s == 0.0


@given(airs())
def test_speeds_of_the_kernel_are_those_of_the_triangle(air):
    for slot in range(air.north.shape[1]):
        for segment in range(len(air.distance_m)):
            found = segment_speed(air, 0, slot, segment)
            truth = true_speed(air, slot, segment)
            near_limit = abs(found - truth) > 1e-4 and min(found, truth) == 0.0
            assert found == pytest.approx(truth, abs=1e-4) or near_limit_of(air, slot, segment, near_limit)


def near_limit_of(air: SegmentWind, slot: int, segment: int, suspicious: bool) -> bool:
    """Whether rounding may decide that a slot is flyable: its wind, crosswind or speed lies on a limit."""
    north = float(air.weight[segment] @ air.north[0, slot])
    east = float(air.weight[segment] @ air.east[0, slot])
    along = north * air.cos_bearing[segment] + east * air.sin_bearing[segment]
    across = east * air.cos_bearing[segment] - north * air.sin_bearing[segment]
    square = air.airspeed_mps**2 - across**2
    gaps = [math.hypot(north, east) - air.wind_limit_mps, square]
    gaps.append(along + math.sqrt(max(square, 0.0)) - MIN_GROUND_SPEED_MPS)
    return suspicious and min(abs(gap) for gap in gaps) < 1e-6


def still_air(**changes) -> SegmentWind:
    calm = np.zeros_like(changes.get("north", np.zeros((1, 3, 1))))
    air = SegmentWind(
        START,
        3600.0,
        calm,
        calm.copy(),
        np.ones((1, 1)),
        np.ones(1),
        np.zeros(1),
        np.array([9000.0]),
        15.0,
        12.0,
        20.0,
        12.0,
        20.0,
        np.zeros(1, dtype=np.int64),
        np.zeros((calm.shape[1], 1), dtype=bool),
    )
    return air._replace(**changes)


def test_in_still_air_a_flight_takes_climb_distance_and_descent():
    assert leg(still_air(), 0, 0, START + 5.0) == (START + 5.0, START + 5.0 + 12.0 + 600.0 + 20.0)
    assert cruise(still_air(), 0, 0, START) == START + 600.0


def test_a_flight_over_no_distance_is_a_climb_and_a_descent():
    assert leg(still_air(distance_m=np.zeros(1)), 0, 0, START) == (START, START + 32.0)


def test_a_headwind_that_comes_up_on_the_way_slows_the_rest_only():
    north = np.zeros((1, 3, 1))
    north[0, 1] = -5.0
    air = still_air(north=north)
    depart = START + 3600.0 - 12.0 - 300.0
    assert leg(air, 0, 0, depart)[1] == pytest.approx(depart + 12.0 + 300.0 + 4500.0 / 10.0 + 20.0)


def test_a_storm_on_the_way_holds_the_drone_until_it_is_over():
    north = np.zeros((1, 3, 1))
    north[0, 1] = 13.0
    air = still_air(north=north)
    assert leg(air, 0, 0, START + 3000.0) == (START + 7200.0, START + 7200.0 + 632.0)
    in_time = START + 3600.0 - 632.0
    assert leg(air, 0, 0, in_time)[0] == in_time
    assert leg(air, 0, 0, in_time + 0.001)[0] == START + 7200.0


def test_a_storm_that_never_ends_is_never_flown():
    air = still_air(north=np.full((1, 3, 1), 13.0))
    assert leg(air, 0, 0, START) == (NEVER, NEVER)
    assert next_opening(air, 0, np.array([0]), START) == NEVER


def test_a_slow_climb_through_a_storm_is_no_flight_either():
    north = np.zeros((1, 6, 1))
    north[0, 1] = 13.0
    air = still_air(north=north, slot_s=60.0, climb_s=150.0, descent_s=20.0, distance_m=np.array([150.0]))
    assert leg(air, 0, 0, START) == (START + 120.0, START + 120.0 + 180.0)
    sunk = still_air(
        north=north[:, ::-1].copy(), slot_s=60.0, climb_s=10.0, descent_s=250.0, distance_m=np.array([150.0])
    )
    assert leg(sunk, 0, 0, START)[0] == START + 300.0


def test_wind_that_is_no_number_is_not_flown_and_does_not_hang():
    air = still_air(north=np.full((1, 3, 1), math.nan))
    assert leg(air, 0, 0, START) == (NEVER, NEVER)
    assert land(air, 0, np.array([0]), START) == NEVER


def test_the_first_and_the_last_slot_hold_on():
    air = still_air()
    assert slot_of(air, START - 1e6) == 0
    assert slot_of(air, START + 1e6) == 2
    assert slot_end(air, 2) == NEVER
    assert slot_end(air, 0) == START + 3600.0


def test_wind_over_a_network_is_that_of_its_sites_carried_to_cruise_height():
    stations = (Station("a", "A", 40.70, -74.00), Station("b", "B", 40.75, -73.95))
    network = build_network(stations, ConnectionRule())
    north, east = vector(8.0, 270.0)
    ensemble = WindEnsemble(
        np.array([40.72]), np.array([-73.97]), START, 3600.0,
        np.full((1, 2, 1), north), np.full((1, 2, 1), east), np.ones(1), ("west wind",), 10.0,
    )  # fmt: skip
    rules = FlightRules(cruise_height_m=60.0, climb_rate_mps=5.0, descent_rate_mps=3.0, wind_profile_exponent=0.2)
    air = air_over(network, ensemble, M200_V2, rules)
    wind = 8.0 * 6.0**0.2
    assert (air.climb_s, air.descent_s) == (12.0, 20.0)
    for segment in range(2):
        bearing = geodesy.bearing_deg(
            *(p for n in (network.tail[segment], network.head[segment]) for p in (stations[n].lat, stations[n].lon))
        )
        wanted = wind_triangle(20.0, wind, 270.0, bearing, wind_limit_mps=12.0, max_ground_speed_mps=20.0)
        assert segment_speed(air, 0, 1, segment) == pytest.approx(wanted.ground_speed_mps, rel=1e-12)
    slow = air_over(network, ensemble, M200_V2, rules, airspeed_mps=10.0)
    assert slow.airspeed_mps == 10.0
    assert segment_speed(slow, 0, 0, 0) < segment_speed(air, 0, 0, 0)
