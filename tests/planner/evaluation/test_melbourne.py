"""Melbourne: stations, occupancy and wind that nobody here wrote, read as downloaded and planned on."""

import csv
import math
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.models.scenario.file import read_scenario
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request

MELBOURNE = ZoneInfo("Australia/Melbourne")
DEPART = datetime(2023, 7, 12, 10, tzinfo=MELBOURNE).astimezone(UTC)
PLANNERS = ("pfs", "pfs-charge-aware", "shortest")
BATTERY_J = 2 * 7.66 * 22.8 * 3600.0
RESERVE, PAYLOAD_KG = 0.2, 0.8

TOML = """schema = "skyway.scenario/1"
name = "Melbourne"
timezone = "Australia/Melbourne"
[network]
stations = "{data}/stations/melbourne_stations.csv"
rule = "max-length"
max_length_m = 15000
{pads}
[network.columns]
id = "station_id"
lat = "latitude"
lon = "longitude"
{pile_num}
[wind]
history = "{data}/wind/melbourne_2023_hourly_weather.csv"
time = "time"
time_zone = "Australia/Melbourne"
speed = "windspeed"
from = "winddir"
speed_unit = "km/h"
[[wind.sites]]
id = "melbourne"
lat = -37.81
lon = 144.96
[load]
occupancy = "{data}/stations/melbourne_duration.csv.gz"
mean_charging_min = 60
"""


def written(folder, data, pads: str = "", pile_num: str = 'pads = "pile_num"'):
    (folder / "scenario.toml").write_text(TOML.format(data=data.as_posix(), pads=pads, pile_num=pile_num))
    return read_scenario(folder)


@pytest.fixture(scope="module")
def melbourne(shared_data, tmp_path_factory):
    """With as many pads as the record has charging points, most of which are busy nearly always."""
    return written(tmp_path_factory.mktemp("melbourne"), shared_data)


@pytest.fixture(scope="module")
def likely_free_at(shared_data, tmp_path_factory):
    """With more pads everywhere than the record ever shows busy."""
    return written(tmp_path_factory.mktemp("roomy"), shared_data, "pads = 25", "")


@pytest.fixture(scope="module")
def raw(shared_data):
    with (shared_data / "stations" / "melbourne_stations.csv").open(newline="") as stream:
        return {row["station_id"]: row for row in csv.DictReader(stream)}


def test_every_site_is_a_station_with_its_charging_points_as_pads(melbourne, raw):
    assert {s.id: (s.lat, s.lon, s.pads) for s in melbourne.network.stations} == {
        name: (float(row["latitude"]), float(row["longitude"]), int(row["pile_num"])) for name, row in raw.items()
    }


def test_segments_are_as_long_as_the_table_of_distances_says(melbourne, shared_data):
    with (shared_data / "stations" / "melbourne_distance.csv").open(newline="") as stream:
        table = {(row[""], other): float(km) for row in csv.DictReader(stream) for other, km in row.items() if other}
    network = melbourne.network
    ids = [station.id for station in network.stations]
    wanted = {pair for pair, km in table.items() if 0.0 < km <= 15.0}
    found = {(ids[a], ids[b]): d for a, b, d in zip(network.tail, network.head, network.distance_m, strict=True)}
    assert {pair for pair in wanted ^ set(found) if abs(table[pair] - 15.0) > 1e-3} == set()
    for pair, metres in found.items():
        assert metres == pytest.approx(1000.0 * table[pair], abs=0.1)


def test_the_wind_of_a_local_hour_is_that_of_the_record(melbourne, shared_data):
    with (shared_data / "wind" / "melbourne_2023_hourly_weather.csv").open(newline="") as stream:
        (row,) = [row for row in csv.DictReader(stream) if row["time"] == "2023-07-12 10:00:00"]
    slot = int((DEPART.timestamp() - melbourne.history.start_s) // 3600)
    speed, wind_from = float(row["windspeed"]) / 3.6, math.radians(float(row["winddir"]))
    assert melbourne.history.north[slot, 0] == pytest.approx(-speed * math.cos(wind_from), abs=1e-9)
    assert melbourne.history.east[slot, 0] == pytest.approx(-speed * math.sin(wind_from), abs=1e-9)


def test_what_is_odd_of_melbourne_is_said(melbourne):
    said = "\n".join(melbourne.warnings)
    assert "the clock repeats" in said
    assert "all pads busy on average" in said
    assert "the network falls into 2 parts that no segment joins (apart: 61)" in said


def power_w(mass_kg: float) -> float:
    """Published endurances of the M200: 38 min at 4.69 kg, 24 min at 6.14 kg, a power of the mass between."""
    kappa = math.log(38.0 / 24.0) / math.log(6.14 / 4.69)
    return BATTERY_J / (38.0 * 60.0) * (mass_kg / 4.69) ** kappa


def charging_s(soc_from: float, soc_to: float) -> float:
    """CC-CV by the formula: rate r to 80 %, then towards the asymptote that gives 100 % after 2.24 h."""
    tail_time, q = 0.2 * math.log(20.0), 0.2
    for _ in range(100):
        q = 0.2 / -math.expm1(-tail_time / q)
    r = (0.8 + tail_time) / (2.24 * 3600.0)

    def from_empty(soc: float) -> float:
        return soc / r if soc <= 0.8 else (0.8 - q * math.log((0.8 + q - soc) / q)) / r

    return from_empty(soc_to) - from_empty(soc_from)


def assert_each_leg_can_be_flown(composition, raw, *, may_hover: bool = False) -> None:
    for leg in composition.services:
        route = [
            (float(raw[name]["latitude"]), float(raw[name]["longitude"]))
            for name in (leg.origin, *leg.via, leg.destination)
        ]
        parts = [Geodesic.WGS84.Inverse(*a, *b) for a, b in pairwise(route)]
        assert leg.distance_m == pytest.approx(sum(part["s12"] for part in parts), abs=0.01)
        assert all(part["s12"] <= 15_000.0 for part in parts)
        assert leg.bearing_deg == pytest.approx(parts[0]["azi1"] % 360.0, abs=1e-6)
        assert leg.ground_speed_mps <= 20.0 + 1e-6
        assert leg.course_wind.speed_mps <= 12.0 + 1e-6
        cruise_s = leg.flight_time_s - 60.0 / 5.0 - 60.0 / 3.0
        hover_s = cruise_s - leg.distance_m / leg.ground_speed_mps
        assert abs(hover_s) <= 1e-3 * cruise_s + 0.01 or (may_hover and hover_s > 0.0)
        assert leg.energy_j == pytest.approx(power_w(4.69 + PAYLOAD_KG) * leg.flight_time_s, rel=1e-4)
        assert leg.soc_depart - leg.soc_arrive == pytest.approx(leg.energy_j / BATTERY_J, abs=1e-4)
        assert leg.soc_depart <= 1.0
        assert leg.soc_arrive >= RESERVE - 1e-6
        if not leg.via and leg.depart.hour == leg.arrive.hour:
            along, across = triangle(leg)
            assert leg.ground_speed_mps == pytest.approx(min(20.0, along + math.sqrt(400.0 - across**2)), abs=0.02)


def triangle(leg) -> tuple[float, float]:
    """Tail and cross component of the wind a leg names, on the schedule it names."""
    angle = math.radians(leg.course_wind.from_deg + 180.0 - leg.bearing_deg)
    return leg.course_wind.speed_mps * math.cos(angle), leg.course_wind.speed_mps * math.sin(angle)


def assert_the_course_hangs_together(composition, scenario, origin, destination) -> None:
    pads = {station.id: station.pads for station in scenario.network.stations}
    legs, stops = composition.services, {stop.arrive: stop for stop in composition.stops}
    assert (legs[0].origin, legs[-1].destination) == (origin, destination)
    now, soc = composition.depart, 1.0
    assert now == DEPART
    for leg in legs:
        stop = stops.pop(now, None)
        if stop is not None:
            assert stop.station == leg.origin
            assert pads[stop.station] > 0
            assert stop.soc_from == pytest.approx(soc, abs=1e-6)
            assert min(stop.wait_s, stop.recharge_s, stop.hold_s) >= 0.0
            assert stop.recharge_s == pytest.approx(charging_s(stop.soc_from, stop.soc_to), abs=5.0)
            now, soc = stop.leave, stop.soc_to
        assert abs(leg.depart - now) < timedelta(milliseconds=2)
        assert leg.soc_depart == pytest.approx(soc, abs=1e-6)
        now, soc = leg.arrive, leg.soc_arrive
    assert not stops
    total = composition.flight_time_s + composition.wait_time_s + composition.recharge_time_s
    assert composition.delivery_time_s == pytest.approx(total, abs=1.0)
    assert (composition.arrive - composition.depart).total_seconds() == pytest.approx(total, abs=1.0)


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize(("origin", "destination"), [("17", "59"), ("2", "48"), ("15", "18")])
def test_a_delivery_across_melbourne_can_be_flown_leg_by_leg(melbourne, raw, planner, origin, destination):
    request = Request(state=State(DEPART, origin), destination=destination, payload_kg=PAYLOAD_KG)
    composition = plan(melbourne, request, planner=planner).composition
    # The shortest route is planned without a look at queues: it may have to wait over a full station.
    assert_each_leg_can_be_flown(composition, raw, may_hover=planner == "shortest")
    assert_the_course_hangs_together(composition, melbourne, origin, destination)


def test_sixty_kilometres_need_several_stops_and_pads_that_are_free(likely_free_at, raw):
    request = Request(state=State(DEPART, "39"), destination="52", payload_kg=PAYLOAD_KG)
    composition = plan(likely_free_at, request, planner="pfs-charge-aware").composition
    assert_each_leg_can_be_flown(composition, raw)
    assert_the_course_hangs_together(composition, likely_free_at, "39", "52")
    assert len(composition.stops) >= 3
    assert sum(stop.wait_s for stop in composition.stops) < 60.0
    assert composition.delivery_time_s < 12 * 3600.0  # about six of them holding for wind that allows the first leg


def test_a_target_without_pads_is_reached_with_a_way_out(likely_free_at, raw):
    there = likely_free_at.with_target(-37.80, 145.00)
    request = Request(state=State(DEPART, "2"), destination="target", payload_kg=PAYLOAD_KG)
    composition = plan(there, request, planner="pfs-charge-aware").composition
    places = raw | {"target": {"latitude": "-37.80", "longitude": "145.00"}}
    assert_each_leg_can_be_flown(composition, places)
    network = there.network
    escape = network.distance_m[network.tail == len(network) - 1].min()
    needed = power_w(4.69) * (escape / 20.0 + 32.0) / BATTERY_J  # empty, in still air
    assert composition.services[-1].soc_arrive >= RESERVE + 0.8 * needed


@pytest.mark.parametrize("planner", PLANNERS)
def test_the_station_out_of_reach_is_said_to_be_so(melbourne, planner):
    request = Request(state=State(DEPART, "2"), destination="61", payload_kg=PAYLOAD_KG)
    with pytest.raises(NoRouteError, match="61") as caught:
        plan(melbourne, request, planner=planner)
    assert caught.value.constraint == "disconnected"


def test_occupancy_is_matched_by_name_not_by_place(melbourne, shared_data):
    import gzip

    with gzip.open(shared_data / "stations" / "melbourne_duration.csv.gz", "rt", newline="") as stream:
        rows = list(csv.DictReader(stream))
    monday_noon = [
        row for row in rows if datetime.fromisoformat(row[""]).weekday() == 0 and row[""].endswith("12:00:00")
    ]
    for node, station in enumerate(melbourne.network.stations):
        busy = np.mean([float(row[station.id]) for row in monday_noon])
        if busy < 0.9 * station.pads:
            assert melbourne.load.arrivals_per_s[node, 12] == pytest.approx(busy / 3600.0, rel=1e-9)
