"""Arrival times of deliveries with `skyway fly`: the online policy simulated in the winds of the forecast, with the wind that no site measures.

The truth of each simulated delivery is a member of the forecast, and the policy's information lacks that member and its neighbours, as in
`planner.robust.out_of_sample`. Between the sites the truth differs from the interpolated wind, where the forecast is of a record. At every stop and all along
each flight the policy gets what is measured, and decides again (`planner.evaluation.watched`). Members are drawn by their probability, evenly; queues, gusts,
vehicles and the wind between the sites are other ones in each delivery. The plan is in force at the departure, and is left for a clear gain only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.statistics import drawn_evenly
from skyway.models.compute.spreading import processors, spread
from skyway.planner.evaluation.flights import GAVE_UP, Flown, pooled
from skyway.planner.evaluation.realizations import LEGS, Realizations
from skyway.planner.evaluation.watched import WatchedDelivery
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.out_of_sample import left_out
from skyway.planner.schedule.outcome import Outcome, full_costs_s
from skyway.planner.schedule.precision import Crossed

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.request import Request
    from skyway.planner.result import PlanResult

LEAST_RUNS = 20
"""Of fewer simulated deliveries no 95 % can be told."""
_STREAM = 0x46
FUTURES, BETTER_EVERY_S = 5, 600.0
"""Parameters of the online policy that are less in simulated deliveries: they are most of what one costs, and hardly change when it arrives (decision 132)."""
_RUNS_OF_A_WORKER = 8
"""So many deliveries are worth the start of a process."""


@dataclass(frozen=True, eq=False)
class AsFlown:
    """Simulated deliveries of the online policy."""

    outcome: Outcome
    """When they arrive; legs are not told, since each delivery may have others."""
    flown: Flown
    """The deliveries, one by one."""

    @property
    def runs(self) -> int:
        """Number of simulated deliveries."""
        return len(self.flown)

    @property
    def below_reserve(self) -> int:
        """Deliveries with a landing below the reserve."""
        return int(self.flown.below_reserve.sum())

    @property
    def on_the_ground(self) -> int:
        """Deliveries that stayed at a station, because no later hour of the forecast allowed a take-off."""
        return int((self.flown.ending == GAVE_UP).sum())


@dataclass(frozen=True, eq=False)
class _World:
    """What all deliveries have in common; each process is sent it once."""

    scenario: Scenario
    request: Request
    drone: str
    parameters: PlannerParameters
    errors: Errors
    forecast: WindEnsemble
    plan: Composition
    """In force at the departure."""
    told: NDArray[np.float64]
    """Shape (members, members). Probability of each member as it is told where one is the truth."""


class _Delivery(NamedTuple):
    """One delivery to be simulated, in this process or in another."""

    member: int
    """The truth."""
    seeds: tuple[int, int, int]
    """Of queues, vehicle and gusts."""
    ratios: NDArray[np.float64]
    """Shape (legs,). Energy of each leg as a multiple of the model's."""


def check_flown_runs(runs: int) -> None:
    """Refuse too few simulated deliveries; none are none."""
    if 0 < runs < LEAST_RUNS:
        raise InputError(
            "too few simulated deliveries", field="flown_runs", value=runs, remedy=f"at least {LEAST_RUNS}"
        )


def as_flown(result: PlanResult, runs: int, *, told: Callable[[int, int, float], None] | None = None) -> AsFlown:
    """Simulate deliveries under a plan as `fly` decides them.

    Parameters
    ----------
    result : PlanResult
        What `fly` is given, from a station.
    runs : int
        Deliveries, `LEAST_RUNS` or more; each takes one to three seconds of a processor, where nothing is decided on the way a tenth.
    told : callable, optional
        Is told deliveries done, deliveries in all, and about how long the rest takes, s.

    Raises
    ------
    InputError
        Too few runs, or a forecast of one member: there is no other member for the policy.
    """
    problem = result.problem
    forecast, errors = problem.forecast, problem.usual_errors
    check_flown_runs(runs)
    if len(forecast) < 2:
        remedy = "remove --wind, or give a forecast with an error"
        raise InputError("a single wind series is not an uncertain forecast", field="wind", remedy=remedy)
    rng = np.random.default_rng((problem.request.seed, _STREAM, runs))
    member = np.searchsorted(np.cumsum(forecast.probability), (np.arange(runs) + 0.5) / runs).clip(
        max=len(forecast) - 1
    )
    shares = [drawn_evenly(rng, 1, runs) for _ in range(1 + LEGS)]
    _, ratios = errors.energy_of(problem.drone).ratios(np.column_stack(shares))
    seeds = rng.integers(0, 2**62, (runs, 3))
    drone = problem.drone.id
    request = replace(problem.request, drone=drone)
    parameters = thrifty(problem.parameters)
    world = _World(
        problem.scenario, request, drone, parameters, errors, forecast, result.composition, left_out(forecast)
    )
    deliveries = [
        _Delivery(one, (queues, vehicle, gusts), ratios[number])
        for number, (one, (queues, vehicle, gusts)) in enumerate(zip(member.tolist(), seeds.tolist(), strict=True))
    ]
    workers = min(processors(), runs // _RUNS_OF_A_WORKER)
    flown = pooled(spread(_fly, deliveries, common=world, workers=workers, told=told))
    return AsFlown(_outcome(problem, flown, member), flown)


def thrifty(parameters: PlannerParameters) -> PlannerParameters:
    """Parameters of the online policy for simulated deliveries, where `fly` has more futures and looks for better stations more often."""
    online = parameters.online
    looks = replace(
        online, futures=min(online.futures, FUTURES), better_every_s=max(online.better_every_s, BETTER_EVERY_S)
    )
    return replace(parameters, online=looks)


def _fly(world: _World, one: _Delivery) -> Flown:
    """Simulate one delivery."""
    queues, vehicle, gusts = one.seeds
    realization = Realizations(
        scenario=world.scenario,
        request=world.request,
        days=(world.request.state.time.date(),),
        wind=world.forecast.member(one.member),
        day=np.zeros(1, dtype=np.int64),
        queue=np.zeros(1, dtype=np.int64),
        queue_seed=queues,
        vehicle_key=np.array([vehicle], dtype=np.uint64),
        gust_key=np.array([gusts], dtype=np.uint64),
        errors=world.errors,
        parameters=world.parameters,
        ratios=one.ratios[None],
    )
    drone = world.scenario.drone(world.drone)
    told = replace(world.forecast, probability=world.told[one.member]).possible()
    start = Problem(world.scenario, world.request, drone, told, parameters=world.parameters)
    return WatchedDelivery(realization, start, np.random.default_rng((gusts, _STREAM)), world.plan).fly()


def _outcome(problem: Problem, flown: Flown, member: NDArray[np.int64]) -> Outcome:
    """When they arrive, and how sure that is: deliveries in one member of the forecast are not independent."""
    there, runs = np.flatnonzero(flown.delivered), len(flown)
    weight = np.full(len(there), 1.0 / runs)
    kept = ~flown.below_reserve
    nothing = np.empty(0)
    return Outcome(
        start_s=problem.depart_s,
        arrival_s=problem.depart_s + flown.delivery_s[there],
        weight=weight,
        p_reserve=nothing,
        p_hold=nothing,
        p_hold_room=nothing,
        p_success=float(kept.mean()),
        p_arrive=len(there) / runs,
        kept=kept[there],
        crossed=Crossed(weight, member[there], there, full_costs_s(problem)),
    )
