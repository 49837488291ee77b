"""Random requests carried on: evaluated in sampled realizations, replanned on the ground and in the air, decided at every stop.

What a request of `benchmarks.fuzz.cases` goes through after its plan, and what must hold of each answer: it is finite, or it is an error of ours.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import date, timedelta
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skyway.models.base.errors import InfeasibleError, InputError
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import State
from skyway.models.composition.file import to_json
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.evaluation.evaluate import Realizations, Rolling, evaluate, fly_policy
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import Errors
from skyway.planner.problem.problem import Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.random import Generator

    from benchmarks.fuzz.cases import Case
    from skyway.models.composition.composition import Composition
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.online.information import Decision

WAYS = {"evaluate": 0.3, "ground": 0.3, "air": 0.3, "rolling": 0.03, "replanned": 0.07}
"""How a request is carried on, and how often; deciding at every stop and with every new wind takes by far the longest."""
MAX_STATIONS = 30
"""That is tried in networks of no more stations."""
AHEAD_OF_TIME = ("pfs", "pfs-charge-aware", "shortest", "exact", "robust")
"""Planners that do not know the realization."""
SPEEDS_MPS = (0.0, 1.0, 12.0, 40.0)


class Online(NamedTuple):
    """A request under way.

    Attributes
    ----------
    case : Case
        The request; its drone is named.
    planner : str
        Of what is planned under way.
    rng : numpy.random.Generator
        Of what happens.
    way : str
        Key of `WAYS`.
    """

    case: Case
    planner: str
    rng: Generator
    way: str


def draw_online(case: Case) -> Online:
    """Say how a request is carried on."""
    rng = np.random.default_rng((0x60, case.number))
    planner = str(rng.choice(AHEAD_OF_TIME))
    small = len(case.scenario.network) <= MAX_STATIONS
    way = str(rng.choice(list(WAYS), p=list(WAYS.values())))
    way = way if small or way not in ("rolling", "replanned") else "evaluate"
    drone = case.request.drone or case.scenario.drones[int(rng.integers(len(case.scenario.drones)))].id
    return Online(replace(case, request=replace(case.request, drone=drone)), planner, rng, way)


def carry_on(online: Online) -> Iterator[tuple[str, float]]:
    """Yield every figure of what comes of a request under way, with its name.

    Raises
    ------
    InputError, InfeasibleError
        As its planner and its policy say.
    """
    yield from {
        "evaluate": _evaluated,
        "ground": _on_the_ground,
        "air": _in_the_air,
        "rolling": _rolling,
        "replanned": _replanned,
    }[online.way](online)


def _realizations(online: Online, wind: WindEnsemble, request: Any) -> Realizations:
    """A few realizations: members of a wind, with gusts, errors of energy and queues."""
    case, rng = online.case, online.rng
    days = tuple(date(2001, 1, 1) + timedelta(days=5 * k) for k in range(len(wind.probability)))
    runs = 2 * len(days)
    errors = Errors(
        gust_sd=float(rng.choice([0.0, 0.15, 1.0])),
        gust_time_s=float(rng.choice([1.0, 180.0, 86_400.0])),
        energy=EnergyBelief(1.0, float(rng.choice([0.0, 0.05, 0.5])), float(rng.choice([0.0, 0.03, 0.3]))),
    )
    return Realizations(
        case.scenario, request, days, wind, np.arange(runs) % len(days), np.arange(runs) % 7, int(rng.integers(2**31)),
        rng.integers(0, 2**63, runs).astype(np.uint64), rng.integers(0, 2**63, runs).astype(np.uint64), errors,
    )  # fmt: skip


def _planned(online: Online) -> Any:
    case = online.case
    return plan(case.scenario, case.request, planner=online.planner, forecast=case.wind, time_limit_s=60.0)


def _evaluated(online: Online) -> Iterator[tuple[str, float]]:
    result = _planned(online)
    request = result.problem.request
    found = evaluate(result, _realizations(online, online.case.wind, request))
    json.dumps(found.document(), allow_nan=False)
    yield from ((f"counts.{name}", float(count)) for name, count in found.counts.items())
    if found.counts["delivered"]:
        yield from (("mean_s", found.mean_s.value), ("p95_s", found.p95_s.value), ("flight_s", found.flight_s.value))


def _forecast(online: Online) -> WindEnsemble:
    """The same wind, or one that has grown and turned since."""
    wind, rng = online.case.wind, online.rng
    if rng.random() < 0.5:
        return wind
    angle, gain = rng.normal(0.0, 1.0), rng.uniform(0.3, 2.0)
    north = gain * (math.cos(angle) * wind.north - math.sin(angle) * wind.east)
    east = gain * (math.sin(angle) * wind.north + math.cos(angle) * wind.east)
    return replace(wind, north=north, east=east)


def _belief(rng: Generator) -> EnergyBelief:
    return EnergyBelief(float(rng.choice([0.3, 1.0, 1.08, 3.0])), float(rng.choice([0.0, 0.08, 0.5])))


def _present_plan(online: Online) -> Composition | None:
    try:
        composition: Composition = _planned(online).composition
    except (InfeasibleError, InputError):
        return None
    return composition


def _policy(online: Online) -> OnlinePolicy:
    return OnlinePolicy(online.case.scenario, online.case.request)


def _on_the_ground(online: Online) -> Iterator[tuple[str, float]]:
    case, rng = online.case, online.rng
    ids = [station.id for station in case.scenario.network.stations]
    begin = case.request.state
    where = begin.station if begin.station is not None and rng.random() < 0.5 else str(rng.choice(ids))
    known = Information(
        time_s=begin.time.timestamp() + float(rng.choice([0.0, 700.0, 20_000.0, 200_000.0])),
        soc=float(rng.choice([1.0, 0.5, 0.21, 0.0, 1.3, -0.2])),
        forecast=_forecast(online),
        belief=_belief(rng),
        station=where,
        visited=frozenset(str(one) for one in rng.choice(ids, int(rng.integers(0, 3)))),
        busy_pads=begin.busy_pads,
        plan=_present_plan(online),
        planned_soc=None if rng.random() < 0.5 else 0.8,
    )
    policy = _policy(online)
    yield from _decided(policy.on_ground(known, tell=True))


def _in_the_air(online: Online) -> Iterator[tuple[str, float]]:
    case, rng = online.case, online.rng
    network = case.scenario.network
    ids = [station.id for station in network.stations]
    one = network.stations[int(rng.integers(len(ids)))]
    policy, memory = _policy(online), FlightMemory(turned=bool(rng.random() < 0.4))
    soc, time_s = float(rng.choice([1.0, 0.6, 0.25, 0.05, 0.0])), case.request.state.time.timestamp()
    here = one.lat + rng.normal(0.0, 0.02), one.lon + rng.normal(0.0, 0.02)
    via = tuple(str(name) for name in rng.choice(ids, int(rng.integers(0, 3))))
    goal = case.request.destination if rng.random() < 0.5 else str(rng.choice(ids))
    belief, forecast = _belief(rng), _forecast(online)
    for step in range(6):
        known = Information(
            here=(float(here[0]), float(here[1])),
            time_s=time_s + 60.0 * step,
            soc=max(soc - 0.02 * step, 0.0),
            forecast=forecast,
            belief=belief,
            via=via,
            destination=goal,
            commanded_mps=float(rng.choice(SPEEDS_MPS)),
            diverts=tuple(str(name) for name in rng.choice(ids, int(rng.integers(0, 6)))),
            left=frozenset(ids[:2]),
            sudden=bool(rng.random() < 0.3),
            airspeed_limit_mps=float(rng.choice([math.inf, math.inf, 9.0, 0.5])),
            flight=memory,
        )
        yield from _decided(policy.in_air(known))


def _start(online: Online) -> Problem:
    """The problem of a request from a station: a policy stands at stations only."""
    case = online.case
    begin = case.request.state
    station = begin.station or case.scenario.network.stations[0].id
    request = replace(case.request, state=State(begin.time, station, None, begin.soc, begin.busy_pads))
    return Problem(case.scenario, request, case.scenario.drone(request.drone or ""), case.wind)


def _rolling(online: Online) -> Iterator[tuple[str, float]]:
    start = _start(online)
    realizations = _realizations(online, _forecast(online), start.request)
    flown, done = fly_policy(realizations, start.drone.id, RollingRobust(start, realizations.errors), np.arange(1))
    yield from _flown(flown, len(done))


def _replanned(online: Online) -> Iterator[tuple[str, float]]:
    start = _start(online)
    policy = Rolling(online.case.scenario, start.request, online.planner, lambda _: online.case.wind)
    flown, done = fly_policy(
        _realizations(online, _forecast(online), start.request), start.drone.id, policy, np.arange(2)
    )
    yield from _flown(flown, len(done))


def _flown(flown: Any, runs: int) -> Iterator[tuple[str, float]]:
    assert len(flown) == runs
    landed = flown.delivered | flown.below_reserve  # of a run that never took off there is no lowest charge
    yield from (("lowest_soc", float(one)) for one in flown.lowest_soc[landed])
    yield from (("delivery_s", float(one)) for one in flown.delivery_s[flown.delivered])


def _decided(decision: Decision) -> Iterator[tuple[str, float]]:
    assert decision.reason
    for name, value in decision.figures.items():
        if isinstance(value, float):
            yield f"figures.{name}", value
    for name in ("speed_mps", "charge_to", "until_s"):
        found = getattr(decision, name)
        if found is not None:
            yield name, float(found)
    if decision.composition is not None:
        json.dumps(to_json(decision.composition), allow_nan=False)
    if decision.until_s is not None:
        from_posix(decision.until_s)
