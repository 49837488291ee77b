"""Realizations that deliveries are evaluated in, the same for all planners.

A truth is the wind of a day of the record that the planner's forecast did not contain, gusts about it, a set of queues,
and the error of one vehicle's energy model, as is believed of its drone. Run `r` of a day is the same truth whoever flies in it: gusts, queues and
errors depend on the seed, the day and the run alone (common random numbers).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import utc
from skyway.models.wind.forecast import WindEnsemble, analogue_ensemble
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.error_model import USUAL_ERRORS, Errors
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.schedule.gust_kernels import Disturbance

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.queues.paths import QueuePath
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request

MAX_QUEUES = 500
"""Sets of queues that are sampled at most; with more runs, runs on different days share a set."""
LEGS = 12
"""Legs of a delivery whose energy is drawn; later ones take as much as the first ones."""
MAX_KEPT = 20_000
"""Sampled queue paths, of a few kilobytes each, that are kept at a time."""
_QUEUES, _VEHICLE = 0x51, 0x56  # words of seeds, so that streams are apart


@dataclass(frozen=True, eq=False)
class Realizations:
    """Realizations of one request; make them with `sample_realizations`."""

    scenario: Scenario
    request: Request
    """Scenario and request that the realizations belong to."""
    days: tuple[date, ...]
    """Days of the record, local dates."""
    wind: WindEnsemble
    """Their winds, one member a day."""
    day: NDArray[np.int64]
    """Shape (runs,). Index into `days` of each run."""
    queue: NDArray[np.int64]
    """Shape (runs,). Set of queues of each run."""
    queue_seed: int
    """Set q is what a request with the seed ``queue_seed + q`` would sample first."""
    vehicle_key: NDArray[np.uint64]
    """Shape (runs,). Of each run's errors of energy."""
    gust_key: NDArray[np.uint64]
    """Shape (runs,). Of each run's gusts."""
    errors: Errors
    """As asked for."""
    parameters: PlannerParameters = USUAL
    """Of the problems that are made of these."""
    ratios: NDArray[np.float64] | None = None
    """Shape (runs, legs). Energy of the legs of each run as a multiple of the model's, whatever is believed of a
    drone."""
    _energy: dict[EnergyBelief, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _met: dict[tuple[int, int], QueuePath] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        runs, days = len(self.day), len(self.days)
        faults = [
            Fault("must have one value for each run", field=name, value=np.shape(values), remedy=f"({runs},)")
            for name, values in (("queue", self.queue), ("vehicle_key", self.vehicle_key), ("gust_key", self.gust_key))
            if np.shape(values) != (runs,)
        ]
        if len(self.wind.probability) != days:
            faults.append(Fault("must have a member for each day", field="wind", value=len(self.wind.probability)))
        if runs and not (self.day.min() >= 0 and self.day.max() < days):
            faults.append(Fault("is not a day of these realizations", field="day", remedy=f"0 to {days - 1}"))
        if not faults and runs and self.queue.min() < 0:
            faults.append(Fault("is not a set of queues", field="queue", remedy="0 or more"))
        if faults:
            raise InputError(faults)

    def __len__(self) -> int:
        return len(self.day)

    @property
    def block(self) -> NDArray[np.int64]:
        """Ordinal of the day of each run, shape (runs,): runs that share it are not independent."""
        return np.array([day.toordinal() for day in self.days])[self.day]

    def part(self, begin: int, end: int) -> Realizations:
        """Some of the runs, one after another."""
        some = slice(begin, end)
        return replace(
            self, day=self.day[some], queue=self.queue[some], vehicle_key=self.vehicle_key[some], gust_key=self.gust_key[some],
            ratios=None if self.ratios is None else self.ratios[some], _energy={},
        )  # fmt: skip

    def problem(self, drone: str) -> Problem:
        """The request in the winds of all days, for one drone of the fleet."""
        return Problem(self.scenario, self.request, self.scenario.drone(drone), self.wind, parameters=self.parameters)

    def energy(self, drone: Drone) -> NDArray[np.float64]:
        """Energy of the legs of each run as a multiple of the model's, shape (runs, LEGS); after the last again from the first."""
        if self.ratios is not None:
            return self.ratios
        belief = self.errors.energy_of(drone)
        if belief not in self._energy:
            legs = [belief.sampled(np.random.default_rng(int(key)), 1, LEGS) for key in self.vehicle_key]
            self._energy[belief] = np.concatenate(legs) if legs else np.ones((0, LEGS))
        return self._energy[belief]

    def energy_ratio(self, drone: Drone, run: int, leg: int) -> float:
        """Return that of one leg."""
        energy = self.energy(drone)
        return float(energy[run, leg % energy.shape[1]])

    def disturbance(self, drone: Drone, runs: NDArray[np.int64] | slice = slice(None)) -> Disturbance:
        """Kernel inputs for some runs with a drone."""
        return Disturbance(
            self.queue[runs],
            self.energy(drone)[runs],
            self.gust_key[runs],
            self.errors.gust_sd,
            self.errors.gust_time_s,
        )

    def queues(self, problem: Problem, nodes: Sequence[int], queue: int) -> dict[int, QueuePath]:
        """One set of queues at some nodes; kept, since all who fly in these realizations meet the same ones."""
        missing = [node for node in dict.fromkeys(nodes) if (queue, node) not in self._met]
        if missing:
            if len(self._met) > MAX_KEPT:
                self._met.clear()
                missing = list(dict.fromkeys(nodes))
            found = self.seeded(problem, queue).queue_paths(missing, 0)
            self._met.update({(queue, node): path for node, path in found.items()})
        return {node: self._met[queue, node] for node in nodes}

    def seeded(self, problem: Problem, queue: int) -> Problem:
        """The problem with the seed of a set of queues, as a clairvoyant planner would be given it."""
        twin = copy.copy(problem)
        twin.request = replace(problem.request, seed=self.queue_seed + queue)
        return twin

    def perfect_information(self, run: int) -> tuple[Request, WindEnsemble]:
        """Perfect information of one run, for a clairvoyant planner: request (with the seed of its queues) and hourly wind."""
        request = replace(self.request, seed=self.queue_seed + int(self.queue[run]))
        return request, self.wind.member(int(self.day[run]))


def sample_realizations(
    scenario: Scenario,
    request: Request,
    days: Sequence[date],
    *,
    runs: int,
    errors: Errors = USUAL_ERRORS,
    seed: int = 0,
) -> Realizations:
    """Sample realizations of a request.

    Parameters
    ----------
    scenario : Scenario
        With a wind record.
    request : Request
        Its departure decides the hour from which the winds of the days are taken.
    days : sequence of date
        Local dates of the record; leave them out of the forecast (`held_out_forecast`).
    runs : int
        How many, spread evenly over the days.
    errors : Errors
        Gusts and errors of energy.
    seed : int
        Of everything sampled; independent of the request's own seed, which planners sample with.

    Raises
    ------
    InputError
        No day, no run, a day twice, a day that the record does not hold, or a seed below 0.
    """
    if not days:
        raise InputError(Fault("no day of the record to fly on", field="days", remedy="at least one"))
    if runs < len(days):
        remedy = f"at least {len(days)}: one on each day"
        raise InputError(Fault("too few", field="runs", value=runs, remedy=remedy))
    twice = next((day for number, day in enumerate(days) if day in days[:number]), None)
    if twice is not None:
        raise InputError(Fault("names a day twice, which would count its runs twice", field="days", value=twice))
    _check_seed(seed)
    winds = [scenario.truth(day, request.state.time, HORIZON_H) for day in days]
    day = np.arange(runs) % len(days)
    replicate = np.arange(runs) // len(days)
    first = min(days).toordinal()
    vehicle, key = _vehicles(days, day, seed)
    queue = np.arange(runs) % MAX_QUEUES if len(days) > 1 else replicate
    stream = np.random.SeedSequence((seed, first, _QUEUES))
    return Realizations(
        scenario=scenario,
        request=request,
        days=tuple(days),
        wind=_joined(winds),
        day=day,
        queue=queue % MAX_QUEUES,
        queue_seed=int(stream.generate_state(1, np.uint64)[0] >> np.uint64(2)),
        vehicle_key=vehicle,
        gust_key=key,
        errors=errors,
    )


def _check_seed(seed: int) -> None:
    """Refuse what no random stream can begin with."""
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(Fault("out of range", field="seed", value=seed, remedy="a whole number, 0 or more"))


def _vehicles(days: Sequence[date], day: NDArray[np.int64], seed: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Keys of the vehicle and of the gusts of each run, from a stream of each day: more runs begin with the same ones."""
    keys = np.empty((2, len(day)), dtype=np.uint64)
    for number, date_ in enumerate(days):
        rng = np.random.default_rng((seed, date_.toordinal(), _VEHICLE))
        mine = day == number
        table = rng.integers(0, 2**64, (int(mine.sum()), 2), dtype=np.uint64)
        keys[:, mine] = table.T
    return keys[0], keys[1]


def _joined(winds: Sequence[WindEnsemble]) -> WindEnsemble:
    """Several ensembles of one as one ensemble, equally probable."""
    return replace(
        winds[0],
        north=np.concatenate([wind.north for wind in winds]),
        east=np.concatenate([wind.east for wind in winds]),
        probability=np.full(len(winds), 1.0 / len(winds)),
        labels=tuple(label for wind in winds for label in wind.labels),
    )


def held_out_forecast(scenario: Scenario, request: Request, days: Sequence[date]) -> WindEnsemble:
    """Forecast of a request without the given days and days whose series overlap theirs.

    Raises an `InputError` if the scenario has no record, or if no day of the season is left.
    """
    if scenario.history is None:
        remedy = "give [wind] history in scenario.toml"
        raise InputError(Fault("the scenario has no wind record to hold days out of", scenario.path, remedy=remedy))
    local = utc(request.state.time).astimezone(ZoneInfo(scenario.timezone))
    return analogue_ensemble(scenario.history, local, HORIZON_H, season_days=scenario.season_days, exclude=days)


def season_days(scenario: Scenario, request: Request, count: int, *, seed: int = 0) -> tuple[date, ...]:
    """Draw held-out days of the request's season, at least the planning horizon apart; fewer where no more fit.

    Raises an `InputError` if the scenario has no record, or for a seed below 0.
    """
    from datetime import date as date_

    _check_seed(seed)
    labels = held_out_forecast(scenario, request, ()).labels
    rng = np.random.default_rng((seed, _VEHICLE))
    apart = -(-HORIZON_H // 24)
    chosen: list[date_] = []
    for label in rng.permutation(np.array(labels)).tolist():
        day = date_.fromisoformat(label)
        if len(chosen) < count and all(abs((day - other).days) >= apart for other in chosen):
            chosen.append(day)
    return tuple(sorted(chosen))


def check_same_request(realizations: Realizations, request: Request) -> None:
    """Raise an `InputError` where the plan of a request cannot be judged in realizations of another delivery.

    The reserve, the planner's seed and what becomes of the drone afterwards may differ.
    """
    mine = realizations.request
    wanted = {
        "state.station": (request.state.station, mine.state.station),
        "state.time": (request.state.time, mine.state.time),
        "state.soc": (request.state.soc, mine.state.soc),
        "destination": (request.destination, mine.destination),
        "payload_kg": (request.payload_kg, mine.payload_kg),
        "airspeed_mps": (request.airspeed_mps, mine.airspeed_mps),
    }
    faults = [
        Fault("differs between the plan and the realizations", field=name, value=planned, remedy=f"sample realizations of the plan's request, not of {sampled}")
        for name, (planned, sampled) in wanted.items()
        if planned != sampled
    ]  # fmt: skip
    if faults:
        raise InputError(faults)


def check_held_out(realizations: Realizations, forecast: WindEnsemble) -> None:
    """Raise an `InputError` where a forecast contains a day that the realizations are of."""
    known = {day.isoformat() for day in realizations.days} & set(forecast.labels)
    if known:
        remedy = "forecast with held_out_forecast, or name the day as --actual-wind"
        raise InputError(Fault("the forecast contains the actual wind", field="days", value=min(known), remedy=remedy))
