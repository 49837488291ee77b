"""Deliveries flown through sampled truths: fixed itineraries all at once, policies decision by decision."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from models.errors import InfeasibleError
from models.flight_kernels import next_opening
from models.queue_paths import pack
from models.services import State
from models.units import from_posix
from planner.course_kernels import PAD, SOC_DOWN, SOC_OFF, TAKE_OFF, TOUCH_DOWN, Queues, fly_under
from planner.evaluation_kernels import gusty_land
from planner.itinerary import Hop, hops_of, no_waits, stop_nodes
from planner.plan import plan

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from models.queue_paths import QueuePath
    from models.scenario import Scenario
    from models.wind_forecast import WindEnsemble
    from planner.charge_policy import ChargePolicy
    from planner.evaluation_truths import Truths
    from planner.itinerary import Itinerary, Outcome
    from planner.problem import Problem
    from planner.request import Request

DELIVERED, STRANDED, UNFLYABLE, GAVE_UP = range(4)
"""How a run ends: delivered; the charge was used up in flight; the wind never opened a flight within the horizon; the
policy found no way on."""
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""On-time probabilities at which promises are compared with what happens."""
MOST_STOPS = 60
"""A policy that stops more often has given up."""
_AGAIN_S = 30.0  # a drone that cannot leave yet looks at the clock again


@dataclass(frozen=True, eq=False)
class Flown:
    """What became of simulated deliveries.

    Attributes
    ----------
    block : ndarray of int, shape (runs,)
        Ordinal of the day of each run.
    ending : ndarray of int, shape (runs,)
        ``DELIVERED``, ``STRANDED``, ``UNFLYABLE`` or ``GAVE_UP``.
    below_reserve : ndarray of bool, shape (runs,)
        A landing was below the reserve (a stranded run's was).
    lowest_soc : ndarray, shape (runs,)
        Lowest charge at a landing; negative: stranded.
    delivery_s, flight_s, wait_s, recharge_s : ndarray, shape (runs,)
        Of delivered runs, else NaN; the first is the sum of the others. Hovering for a holding spot is flight, holding
        for wind is waiting.
    kept : ndarray of bool, shape (runs, levels)
        The delivery came by the deadlines that are the quantiles `LEVELS` of what was promised; empty without promises.
    promised : ndarray, shape (runs, levels)
        Probability promised of each of these deadlines: the level, or more where many arrivals are promised at one moment.
    clairvoyant_s : ndarray, shape (runs,)
        Delivery time of a planner that is told this truth (without gusts and error of energy), NaN where unknown.
    """

    block: NDArray[np.int64]
    ending: NDArray[np.int64]
    below_reserve: NDArray[np.bool_]
    lowest_soc: NDArray[np.float64]
    delivery_s: NDArray[np.float64]
    flight_s: NDArray[np.float64]
    wait_s: NDArray[np.float64]
    recharge_s: NDArray[np.float64]
    kept: NDArray[np.bool_] = field(default_factory=lambda: np.empty((0, len(LEVELS)), dtype=bool))
    promised: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(LEVELS))))
    clairvoyant_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.block)

    @property
    def delivered(self) -> NDArray[np.bool_]:
        """Whether the package arrived, shape (runs,)."""
        return np.asarray(self.ending == DELIVERED)

    def judged(self, promise: Outcome, depart_s: float) -> Flown:
        """Compare with what was promised at planning time."""
        due = np.array([promise.quantile_s(level) for level in LEVELS])
        promised = np.array([promise.p_by(deadline) for deadline in due])
        time = np.where(self.delivered, self.delivery_s, np.inf)
        kept = time[:, None] <= due - depart_s + 1e-6
        return replace(self, kept=kept, promised=np.broadcast_to(promised, kept.shape))

    def chosen(self, runs: NDArray[np.bool_] | NDArray[np.int64]) -> Flown:
        """Some of the runs."""
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return Flown(**{name: values[runs] if len(values) == len(self) else values for name, values in columns.items()})


def pooled(parts: Sequence[Flown]) -> Flown:
    """Join runs of several plans; promises and clairvoyant times stay where all parts have them."""
    total = sum(len(part) for part in parts)
    joined: dict[str, Any] = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Flown)}
    for name in ("kept", "promised", "clairvoyant_s"):
        if len(joined[name]) != total:
            joined[name] = joined[name][:0]
    return Flown(**joined)


def fly_itinerary(truths: Truths, drone: str, itinerary: Itinerary) -> Flown:
    """Fly a fixed itinerary in all truths."""
    problem = truths.problem(drone)
    runs = np.arange(len(truths))
    return tally(problem, itinerary, truths.block, courses(truths, problem, itinerary, runs))


def fly_charging(truths: Truths, drone: str, policy: ChargePolicy) -> Flown:
    """Fly a route that charges by what is known at each stop in all truths."""
    problem = truths.problem(drone)
    nodes = stop_nodes(problem, policy.itinerary)
    wanted, position = np.unique(truths.queue, return_inverse=True)
    paths: list[QueuePath] = []
    for queue in wanted.tolist():
        found = truths.queues(problem, nodes, queue)
        paths += [found[node] for node in nodes]
    sky = truths.sky()._replace(queue=position.astype(np.int64))
    course, _ = policy.fly(problem, sky, truths.day, paths)
    return tally(problem, policy.itinerary, truths.block, course)


def courses(truths: Truths, problem: Problem, itinerary: Itinerary, runs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Course of an itinerary in some truths, shape (runs, hops, 6); see `course_kernels`."""
    nodes = stop_nodes(problem, itinerary)
    wanted, position = np.unique(truths.queue[runs], return_inverse=True)
    paths = []
    for queue in wanted.tolist():
        found = truths.queues(problem, nodes, queue)
        paths += [found[node] for node in nodes]
    sky = truths.sky(runs)._replace(queue=position.astype(np.int64))
    start = (float(problem.depart_s), float(problem.soc))
    cost = (float(problem.soc_per_s), float(problem.soc_fixed))
    hops, queues = hops_of(problem, itinerary), Queues(*pack(paths))
    return fly_under(sky, problem.air, truths.day[runs], hops, queues, no_waits(len(itinerary)), start, cost)


def tally(problem: Problem, itinerary: Itinerary, block: NDArray[np.int64], course: NDArray[np.float64]) -> Flown:
    """Tell what became of runs of one itinerary from their courses, shape (runs, hops, 6)."""
    down, soc = course[:, :, TOUCH_DOWN], course[:, :, SOC_DOWN]
    begun = np.isfinite(down)
    lowest = np.where(begun, soc, np.inf).min(axis=1)
    ending = np.full(len(course), DELIVERED)
    ending[~begun.all(axis=1)] = UNFLYABLE
    ending[lowest < 0.0] = STRANDED
    whole = ending == DELIVERED
    flown = course[whole]
    recharge = np.zeros(len(flown))
    for number, node in enumerate(stop_nodes(problem, itinerary)):
        before = flown[:, number - 1, SOC_DOWN] if number else np.full(len(flown), problem.soc)
        time, level = problem.curve(node)
        after = np.maximum(flown[:, number, SOC_OFF], before)
        recharge += np.interp(after, level, time) - np.interp(before, level, time)
    delivery = flown[:, -1, TOUCH_DOWN] - problem.depart_s
    flight = (flown[:, :, TOUCH_DOWN] - flown[:, :, TAKE_OFF]).sum(axis=1)

    def spread(values: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.full(len(course), np.nan)
        out[whole] = values
        return out

    return Flown(
        block=block,
        ending=ending,
        below_reserve=lowest < problem.reserve - 1e-9,
        lowest_soc=lowest,
        delivery_s=spread(delivery),
        flight_s=spread(flight),
        wait_s=spread(delivery - flight - recharge),
        recharge_s=spread(recharge),
    )


@dataclass(frozen=True, eq=False)
class Standing:
    """What a policy knows when it decides: a drone that has just landed, or is about to leave its origin.

    Attributes
    ----------
    node, station
        Where it stands.
    time_s, soc : float
        POSIX seconds and charge at the landing.
    visited : tuple of str
        Stations landed at before, in order.
    wind : tuple of ndarray, shape (sites,)
        (north, east) m/s TOWARDS measured at the sites in this hour, at the height of measurement.
    busy : dict of str to int
        Others on the pads and in line at each station, as the pad services tell; where it stands, those before it.
    energy : float
        Energy that its flights have taken as a multiple of the model's; NaN before the first has shown it.
    """

    node: int
    station: str
    time_s: float
    soc: float
    visited: tuple[str, ...]
    wind: tuple[NDArray[np.float64], NDArray[np.float64]]
    busy: dict[str, int]
    energy: float

    def state(self) -> State:
        """The same as the state that a request starts from."""
        soc = min(max(self.soc, 0.0), 1.0)
        visited = frozenset(self.visited)
        return State(from_posix(self.time_s), self.station, None, soc, busy_pads=self.busy, visited=visited)


class Policy(Protocol):
    """Decides at every stop, knowing what is known there; must not look into the truth."""

    def decide(self, standing: Standing) -> Hop | None:
        """The next flight and the stay before it, or None where there is no way on."""


@dataclass(frozen=True)
class Departure:
    """How to leave a stop, until the wind is measured anew or it is time to look again.

    Attributes
    ----------
    segments : tuple of int
        Flown without a landing between, if all goes well.
    charge : float
        Take-off with at least this charge.
    need : callable
        Charge without which the flight is not begun at a time, POSIX seconds.
    look_s : float
        Decide anew then, POSIX seconds.
    """

    segments: tuple[int, ...]
    charge: float
    need: Callable[[float], float]
    look_s: float = math.inf


@runtime_checkable
class Adaptive(Protocol):
    """Decides at every stop, again with every new wind while it stands there, and over stations on the way."""

    def leave(self, standing: Standing) -> Departure | None:
        """How to go on from a stop, or None where there is no way on."""

    def over(self, flying: Standing, rest: tuple[int, ...]) -> tuple[int, ...]:
        """Segments to go on with over a station with pads; none: land there.

        Time and charge are set back by a climb, as if it took off there.
        """


@dataclass(frozen=True)
class OpenLoop:
    """A fixed itinerary as a policy."""

    itinerary: Itinerary

    def decide(self, standing: Standing) -> Hop | None:
        """The hop that the itinerary has at this stop."""
        number = len(standing.visited)
        return self.itinerary[number] if number < len(self.itinerary) else None


@dataclass(frozen=True)
class Rolling:
    """Plans anew at every stop with a planner by name, and flies the first hop of each plan.

    Attributes
    ----------
    scenario, request
        As at the departure; the drone is named.
    planner : str
        See `planner.plan`.
    forecast : callable
        The forecast of a moment: held out, perhaps weighted by the wind measured until then.
    """

    scenario: Scenario
    request: Request
    planner: str
    forecast: Callable[[Standing], WindEnsemble]

    def decide(self, standing: Standing) -> Hop | None:
        """The first hop of the plan from here."""
        request = replace(self.request, state=standing.state())
        try:
            return plan(self.scenario, request, planner=self.planner, forecast=self.forecast(standing)).itinerary[0]
        except InfeasibleError:
            return None


def fly_policy(
    truths: Truths,
    drone: str,
    policy: Policy | Adaptive,
    runs: NDArray[np.int64] | None = None,
    *,
    watch: Callable[[Again], None] | None = None,
) -> tuple[Flown, list[Itinerary]]:
    """Fly a policy in some truths (all by default), run by run; also returns what it did in each.

    `watch` is told of each flight of an adaptive policy how to fly it again in other gusts.
    """
    problem = truths.problem(drone)
    chosen = np.arange(len(truths)) if runs is None else runs
    parts, done = [], []
    for run in chosen.tolist():
        flown, itinerary = _fly_decisions(truths, problem, policy, run, watch)
        parts.append(flown)
        done.append(itinerary)
    return pooled(parts), done


def _fly_decisions(
    truths: Truths, problem: Problem, policy: Policy | Adaptive, run: int, watch: Callable[[Again], None] | None
) -> tuple[Flown, Itinerary]:
    """Fly decision by decision. Each time the whole way is flown again: that it is a pure function keeps one set of rules."""
    network = problem.network
    one = np.array([run])
    block = truths.block[one]
    hops: Itinerary = ()
    node, time_s, soc = problem.origin, problem.depart_s, problem.soc
    visited: tuple[str, ...] = ()
    flown: Flown | None = None
    course: NDArray[np.float64] | None = None
    while len(hops) < MOST_STOPS:
        station = network.stations[node].id
        stay = _Stay(run, node, station, time_s, soc, visited)
        if isinstance(policy, Adaptive):
            found = _fly_adaptive(truths, problem, policy, stay, watch)
            if found is None:
                break
            hop, flight = found
            hops = (*hops, hop)
            course = flight if course is None else np.concatenate((course, flight), axis=1)
        else:
            decided = policy.decide(_standing(truths, problem, stay, time_s, soc))
            if decided is None:
                break
            hops = (*hops, decided)
            course = courses(truths, problem, hops, one)
        visited = (*visited, station)
        flown = tally(problem, hops, block, course)
        node = int(network.head[hops[-1].segments[-1]])
        if node == problem.destination or flown.ending[0] != DELIVERED:
            return flown, hops
        landed = float(course[0, -1, TOUCH_DOWN])
        queue = truths.queues(problem, [node], int(truths.queue[run]))[node]
        time_s = float(queue.land_time(landed))
        soc = float(course[0, -1, SOC_DOWN] - truths.energy[run] * problem.soc_per_s * (time_s - landed))
        course[0, -1, TOUCH_DOWN], course[0, -1, SOC_DOWN] = time_s, soc
    return _given_up(flown, block, problem.soc), hops


@dataclass(frozen=True)
class _Stay:
    """Where a drone has landed in a run, when, and with which charge."""

    run: int
    node: int
    station: str
    landed_s: float
    soc: float
    visited: tuple[str, ...]


@dataclass(frozen=True)
class Again:
    """A flight of an adaptive policy, to be flown again by the same policy in other gusts."""

    _truths: Truths
    _problem: Problem
    _policy: Adaptive
    _stay: _Stay
    _segments: tuple[int, ...]
    _begun: tuple[float, float, float]

    def charge_left(self, gust_key: int) -> float:
        """Charge on touch-down in the gusts of a key."""
        keys = self._truths.gust_key.copy()
        keys[self._stay.run] = gust_key
        other = replace(self._truths, gust_key=keys)
        return float(
            _flight(other, self._problem, self._policy, self._stay, self._segments, self._begun)[1][0, 0, SOC_DOWN]
        )


def _standing(truths: Truths, problem: Problem, stay: _Stay, time_s: float, soc: float) -> Standing:
    """What is known at a stay at a time."""
    day, slot = truths.day[stay.run], truths.wind.slot_at(time_s)
    wind = truths.wind.north[day, slot], truths.wind.east[day, slot]
    nodes = np.flatnonzero(problem.network.pads > 0).tolist()
    paths = truths.queues(problem, nodes, int(truths.queue[stay.run]))
    busy = {problem.network.stations[node].id: paths[node].present_at(time_s) for node in nodes}
    if stay.station in busy and time_s > stay.landed_s:  # who came after it does not stand before it in the line
        path = paths[stay.node]
        left = np.searchsorted(path.left_s, time_s, side="right") - np.searchsorted(
            path.left_s, stay.landed_s, side="right"
        )
        busy[stay.station] = max(path.present_at(stay.landed_s) - int(left), 0)
    energy = float(truths.energy[stay.run]) if stay.visited else math.nan
    return Standing(stay.node, stay.station, time_s, soc, stay.visited, wind, busy, energy)


def _fly_adaptive(
    truths: Truths, problem: Problem, policy: Adaptive, stay: _Stay, watch: Callable[[Again], None] | None
) -> tuple[Hop, NDArray[np.float64]] | None:
    """Take off as the policy says, decided anew whenever the wind is: (hop, its course, shape (1, 1, 6))."""
    now, soc = stay.landed_s, stay.soc
    queue = truths.queues(problem, [stay.node], int(truths.queue[stay.run]))[stay.node]
    pad_s = float(queue.pad_time(stay.landed_s)) if problem.has_pads(stay.node) else math.inf
    curve_s, curve_soc = problem.curve(stay.node)
    charged_s = float(np.interp(stay.soc, curve_soc, curve_s))

    def charge_at(time_s: float) -> float:
        return float(np.interp(charged_s + time_s - pad_s, curve_s, curve_soc)) if time_s > pad_s else stay.soc

    wind = truths.wind
    end_s = wind.start_s + wind.slots * wind.slot_s
    while now < end_s:
        way = policy.leave(_standing(truths, problem, stay, now, soc))
        if way is None:
            return None
        until = min(wind.start_s + (wind.slot_at(now) + 1) * wind.slot_s, max(way.look_s, now + _AGAIN_S))
        segments = np.array(way.segments, dtype=np.int64)
        at = now
        while at < until:
            wanted = max(way.charge, way.need(at))
            if charge_at(at) >= wanted - 1e-9:
                opening = next_opening(problem.air, int(truths.day[stay.run]), segments, at)
                if opening <= at + 1e-6:
                    begun = pad_s, at, charge_at(at)
                    if watch is not None:
                        watch(Again(truths, problem, policy, stay, way.segments, begun))
                    return _flight(truths, problem, policy, stay, way.segments, begun)
                at = opening
            elif wanted <= curve_soc[-1] and pad_s < math.inf:
                reached = pad_s + float(np.interp(wanted, curve_soc, curve_s)) - charged_s
                at = max(reached, at + _AGAIN_S)
            else:
                break
        now, soc = until, charge_at(until)
    return None


def _flight(
    truths: Truths,
    problem: Problem,
    policy: Adaptive,
    stay: _Stay,
    rest: tuple[int, ...],
    begun: tuple[float, float, float],
) -> tuple[Hop, NDArray[np.float64]]:
    """Fly, asking the policy over each station with pads; `begun` is (pad, take-off, charge)."""
    pad_s, off, charge = begun
    sky = truths.sky()
    run, day, air = stay.run, int(truths.day[stay.run]), problem.air
    flown: tuple[int, ...] = ()
    while rest:
        flown, rest = (*flown, rest[0]), rest[1:]
        node = int(problem.network.head[flown[-1]])
        down = gusty_land(air, day, np.array(flown), off, sky.gust_key[run], sky.gust_sd, sky.gust_time_s)
        if rest and problem.has_pads(node):
            as_off = down - air.descent_s - air.climb_s
            soc = charge - float(sky.energy[run]) * problem.soc_per_s * (as_off - off)
            over = _Stay(run, node, problem.network.stations[node].id, as_off, soc, (*stay.visited, stay.station))
            rest = policy.over(_standing(truths, problem, over, as_off, soc), rest)
    soc = charge - float(sky.energy[run]) * (problem.soc_fixed + problem.soc_per_s * (down - off))
    course = np.full((1, 1, 6), off)
    course[0, 0, [PAD, TOUCH_DOWN, SOC_OFF, SOC_DOWN]] = min(pad_s, off), down, charge, soc
    return Hop(flown, charge if charge > stay.soc else None), course


def _given_up(flown: Flown | None, block: NDArray[np.int64], soc: float) -> Flown:
    none = np.full(1, np.nan)
    ending = np.full(1, GAVE_UP)
    if flown is None:
        return Flown(block, ending, np.zeros(1, dtype=bool), np.full(1, soc), none, none, none, none)
    return replace(flown, ending=ending, delivery_s=none, flight_s=none, wait_s=none, recharge_s=none)
