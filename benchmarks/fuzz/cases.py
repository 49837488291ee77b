"""Random requests that planners must answer or refuse: each is made from its number alone, so that one can be tried again."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np

from benchmarks.cases.networks import CENTRE, new_york
from skyway.models.base.errors import InputError
from skyway.models.base.units import J_PER_WH
from skyway.models.composition.composition import Recharge, State
from skyway.models.drones.drone import M200_V2, Drone
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.wind.ensemble import WindEnsemble
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.registry import PLANNERS

if TYPE_CHECKING:
    from numpy.random import Generator

    from skyway.models.network.network import Network
    from skyway.models.scenario.scenario import Scenario

SIZES = ((2, 4, 0.30), (5, 10, 0.37), (11, 30, 0.22), (31, 100, 0.08), (101, 300, 0.02), (301, 1000, 0.01))
"""Stations of a network, from and to, and the share of the requests."""
SEARCHING = {"ies": ("exact", 60), "pfs-strict": ("pfs", 12)}
"""Planners that try all sequences, or walk for a long time; the one asked in their place, and on more stations than that."""
SLOTS_S = (300.0, 600.0, 1200.0, 3600.0, 3600.0, 10_800.0)


@dataclass(frozen=True)
class Case:
    """One request.

    Attributes
    ----------
    number : int
        What it is made from.
    scenario, request, planner, wind
        What is asked; see `planner.plan.plan`. The clairvoyant planners are told the first member of the wind.
    """

    number: int
    scenario: Scenario
    request: Request
    planner: str
    wind: WindEnsemble

    def __str__(self) -> str:
        ask, state = self.request, self.request.state
        return (
            f"#{self.number}: {self.planner}, {len(self.scenario.network)} stations, {state.station or state.position} > "
            f"{ask.destination}, {ask.payload_kg:g} kg, drone {ask.drone}, airspeed {ask.airspeed_mps}, soc {state.soc:g}, reserve "
            f"{ask.reserve_soc:g}, epsilon {ask.epsilon:g}, {ask.recharge}, {ask.objective.kind}, busy {dict(state.busy_pads)}, "
            f"{len(self.wind.probability)} members of {self.wind.north.shape[1]} slots of {self.wind.slot_s:g} s"
        )


def draw(number: int) -> Case:
    """Make one request."""
    rng = np.random.default_rng((0x5F, number))
    low, high, _ = SIZES[int(rng.choice(len(SIZES), p=[share for *_, share in SIZES]))]
    if rng.random() < 0.15:
        scenario = new_york()
    else:  # some requests share a network, which takes longer to make than most take to answer
        scenario = _scenario(int(rng.integers(low, high + 1)), int(rng.integers(0, 40)))
    depart = datetime(2013, 7, 10, 18, tzinfo=UTC) + timedelta(minutes=int(rng.integers(0, 7 * 24 * 60)))
    wind = _wind(rng, depart)
    planner = str(rng.choice(PLANNERS))
    instead, most = SEARCHING.get(planner, (planner, 0))
    planner = planner if len(scenario.network) <= most else instead
    scenario, request = _request(rng, scenario, depart)
    return Case(number, scenario, request, planner, wind)


def _pick(rng: Generator, *weighted: tuple[float, object]) -> object:
    """One of some values, by their weights."""
    weights = np.array([weight for weight, _ in weighted])
    return weighted[int(rng.choice(len(weighted), p=weights / weights.sum()))][1]


def _request(rng: Generator, scenario: Scenario, depart: datetime) -> tuple[Scenario, Request]:
    """From somewhere to somewhere, with edge values among the rest."""
    network = scenario.network
    start, goal = (int(node) for node in rng.choice(len(network), 2, replace=False))
    destination = network.stations[goal].id
    if rng.random() < 0.25:  # a target without pads, beside the goal
        one = network.stations[goal]
        place = one.lat + rng.normal(0.0, 0.01), one.lon + rng.normal(0.0, 0.01)
        with suppress(InputError):  # in a no-fly zone: the station itself, then
            scenario = scenario.with_target(*place)
            destination = scenario.network.stations[-1].id
    position = None
    if rng.random() < 0.1:
        one = network.stations[start]
        position = one.lat + rng.normal(0.0, 0.02), one.lon + rng.normal(0.0, 0.02)
    busy = {}
    for _ in range(int(cast("int", _pick(rng, (0.6, 0), (0.2, 1), (0.2, 6))))):
        one = network.stations[goal if rng.random() < 0.3 else int(rng.integers(len(network)))]
        busy[one.id] = int(rng.integers(0, 3 * one.pads + one.holding_spots + 2)) if rng.random() < 0.9 else 60
    soc = float(cast("float", _pick(rng, (0.5, 1.0), (0.4, float(rng.uniform(0.05, 1.0))), (0.05, 0.0), (0.05, 0.2))))
    state = State(depart, None if position else network.stations[start].id, position, soc, busy)
    reserve = _pick(rng, (0.6, 0.2), (0.2, float(rng.uniform(0.01, 0.95))), (0.1, 0.0), (0.05, 0.95), (0.05, 0.02))
    epsilon = _pick(rng, (0.6, 1e-3), (0.1, 0.0), (0.1, 0.05), (0.1, 0.5), (0.1, float(rng.uniform(0.0, 0.5))))
    fleet = [drone.id for drone in scenario.drones]
    airspeed = _pick(rng, (0.85, None), (0.1, float(rng.uniform(5.0, 25.0))), (0.03, 1.0), (0.02, 150.0))
    deadline = depart + timedelta(minutes=float(rng.uniform(1.0, 300.0)))
    goal_id = network.stations[int(rng.integers(len(network)))].id
    back = _pick(rng, (0.6, "nearest-pad"), (0.2, "home"), (0.2, goal_id)) if position is None else "nearest-pad"
    undelivered = _pick(rng, (0.8, None), (0.1, "back"), (0.1, goal_id)) if position is None else None
    objective = _pick(rng, (0.7, Objective()), (0.15, Objective("p95")), (0.15, Objective("on-time", deadline)))
    return scenario, Request(
        state=state,
        destination=destination,
        payload_kg=float(
            cast(
                "float",
                _pick(rng, (0.2, 0.0), (0.6, float(rng.uniform(0.0, 1.5))), (0.2, float(rng.uniform(0.0, 6.0)))),
            )
        ),
        drone=str(rng.choice(fleet)) if rng.random() < 0.7 else None,
        airspeed_mps=cast("float | None", airspeed),
        reserve_soc=float(cast("float", reserve)),
        epsilon=float(cast("float", epsilon)),
        recharge=cast("Recharge", _pick(rng, (0.7, "enough"), (0.3, "full"))),
        escape=bool(rng.random() < 0.9),
        seed=int(rng.integers(0, 1000)),
        objective=cast("Objective", objective),
        return_to=str(back),
        dwell_s=float(cast("float", _pick(rng, (0.7, 0.0), (0.3, float(rng.uniform(0.0, 3600.0)))))),
        undelivered_to=cast("str | None", undelivered),
    )


@lru_cache(maxsize=64)
def _scenario(stations: int, seed: int) -> Scenario:
    """Stations strewn over a square, or along a line, or in one place, with any pads, spots and load."""
    rng = np.random.default_rng((seed, stations))
    reach_m = float(rng.uniform(4_000.0, 16_000.0))
    side_m = math.sqrt(stations * math.pi * reach_m**2 / float(rng.uniform(3.0, 14.0)))
    north, east = rng.uniform(-0.5, 0.5, (2, stations)) * side_m
    kind = rng.random()
    if kind < 0.1:
        north *= 0.01
    elif kind < 0.15:
        north, east = 1e-4 * north, 1e-4 * east
    lat = CENTRE[0] + north / 111_045.0
    lon = CENTRE[1] + east / (111_320.0 * np.cos(np.radians(lat)))
    power = None if rng.random() < 0.7 else float(rng.uniform(50.0, 2000.0))
    placed = [
        Station(
            f"s{k}",
            f"Station {k}",
            round(float(lat[k]), 6),
            round(float(lon[k]), 6),
            None if rng.random() < 0.2 else float(rng.uniform(-10.0, 300.0)),
            int(rng.choice([0, 1, 1, 2, 3, 5])),
            int(rng.integers(0, 5)),
            power if rng.random() < 0.5 else None,
        )
        for k in range(stations)
    ]
    rule = ("max-length", "nearest", "gabriel")[int(rng.integers(3))]
    network = build_network(placed, ConnectionRule(rule, reach_m, int(rng.integers(1, 8))))
    base = new_york()
    drones = (*base.drones, M200_V2, _drone(rng), replace(_drone(rng), id="odd-2", price_per_km=1.0))
    return replace(
        base, name=f"fuzz-{stations}-{seed}", network=network, drones=drones, load=_load(rng, network), path=None, sha256=None,
        warnings=(),
    )  # fmt: skip


def _load(rng: Generator, network: Network) -> PadLoad:
    """Nobody, or others who come evenly or by the hour, up to more than the pads can serve."""
    count = len(network)
    if rng.random() < 0.2:
        return PadLoad.none(count, "America/New_York")
    charging = np.full((count, 168), float(rng.uniform(60.0, 7200.0)))
    used = float(cast("float", _pick(rng, (0.8, float(rng.uniform(0.05, 0.9))), (0.2, float(rng.uniform(0.9, 1.3))))))
    shape = rng.uniform(0.0, 2.0, (count, 168)) if rng.random() < 0.5 else np.ones((count, 168))
    arrivals = np.minimum(used * shape * network.pads[:, None] / charging, 1.0)
    return PadLoad(arrivals, charging, "America/New_York")


def _drone(rng: Generator) -> Drone:
    """Any multirotor: tiny, slow, hungry or with a wind limit above its airspeed."""
    endurance_s = float(rng.uniform(300.0, 12_000.0))
    return Drone(
        id="odd",
        name="Odd",
        provider="fuzz",
        mass_kg=float(rng.uniform(0.3, 20.0)),
        max_payload_kg=float(rng.uniform(0.1, 8.0)),
        battery_j=float(rng.uniform(20.0, 3000.0)) * J_PER_WH,
        endurance_empty_s=endurance_s,
        endurance_full_s=endurance_s * float(rng.uniform(0.4, 0.99)),
        max_airspeed_mps=float(rng.uniform(4.0, 35.0)),
        wind_limit_mps=float(rng.uniform(2.0, 30.0)),
        recharge_full_s=float(rng.uniform(300.0, 30_000.0)),
        max_ground_speed_mps=float(rng.uniform(5.0, 40.0)),
    )


def _wind(rng: Generator, depart: datetime) -> WindEnsemble:
    """One constant wind, or members that turn and grow, or days of the record of New York; 0 to 25 m/s and from everywhere."""
    if rng.random() < 0.15:
        return new_york().forecast(depart, HORIZON_H)
    members = int(cast("int", _pick(rng, (0.5, 1), (0.2, 2), (0.25, int(rng.integers(3, 12))), (0.05, 35))))
    slot_s = float(rng.choice(SLOTS_S))
    slots = int(cast("int", _pick(rng, (0.8, math.ceil(HORIZON_H * 3600.0 / slot_s)), (0.2, int(rng.integers(1, 8))))))
    sites = int(rng.integers(1, 4))
    mean, turn_back = float(rng.uniform(0.0, 25.0)), float(cast("float", _pick(rng, (0.5, 0.0), (0.5, 40.0))))
    gain = 0.0 if turn_back == 0.0 else float(rng.uniform(0.0, 0.5))
    speed = np.clip(mean * (1.0 + gain * rng.normal(size=(members, slots, sites))), 0.0, 25.0)
    angle = np.radians(rng.uniform(0.0, 360.0) + np.cumsum(turn_back * rng.normal(size=(members, slots, 1)), axis=1))
    probability = rng.uniform(0.05, 1.0, members)
    begin = depart.timestamp() - float(rng.uniform(0.0, slot_s))
    return WindEnsemble(
        site_lat=CENTRE[0] + rng.normal(0.0, 0.2, sites),
        site_lon=CENTRE[1] + rng.normal(0.0, 0.2, sites),
        start_s=begin,
        slot_s=slot_s,
        north=-speed * np.cos(angle),
        east=-speed * np.sin(angle),
        probability=probability / probability.sum(),
        labels=tuple(f"member-{k}" for k in range(members)),
        height_m=60.0,
    )
