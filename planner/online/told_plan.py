"""The printed plan of a step: its most probable continuation, with charges that fit the current information."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import AuditError, InfeasibleError
from skyway.models.base.statistics import weighted_quantile
from skyway.models.flight.kernels import slot_of
from skyway.planner.online.untold_wind import with_untold_wind
from skyway.planner.robust.out_of_sample import simulate_fixed
from skyway.planner.schedule.composing import compose
from skyway.planner.schedule.itinerary import Leg, fly_expected, fly_sampled, stop_nodes, typical_member
from skyway.planner.schedule.outcome import outcome
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.network.network import Network
    from skyway.planner.online.following import Step
    from skyway.planner.online.hindsight import Hindsight
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome


Required = Callable[[Leg, float, float, int | None], float | None]
"""Charge without which a leg is not begun, by the landing before it, POSIX seconds, the charge then, and the member whose wind is measured there (None: the
expected one). None: no charge opens it."""

_TURNED = 0x54
"""Of the deviates that say in which deliveries the first leg is turned."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A plan from here, and its results in the forecast."""

    itinerary: Itinerary
    """Its decisions."""
    outcome: Outcome
    """Flown through the forecast."""

    @property
    def arrives(self) -> bool:
        """Whether any course of the wind lets it arrive."""
        return len(self.outcome.weight) > 0


def best_charges(problem: Problem, itinerary: Itinerary, epsilon: float) -> Candidate | None:
    """Fly an itinerary with its own charges, raised where too low, and with just enough; the better of the two.

    None where even full charges do not do.
    """
    needed = needed_charges(problem, itinerary, epsilon)
    if needed is None:
        return None
    raised = tuple(
        replace(
            leg, charge_to=need if leg.charge_to is None else max(need, leg.charge_to) if need is not None else None
        )
        for leg, need in zip(itinerary, needed, strict=True)
    )
    lean = tuple(replace(leg, charge_to=need) for leg, need in zip(itinerary, needed, strict=True))
    found = [
        Candidate(one, outcome(problem, *fly_sampled(problem, one, problem.parameters.online.told_queues)))
        for one in dict.fromkeys((lean, raised))
    ]
    surest = max(one.outcome.p_success for one in found)
    good = [one for one in found if one.outcome.p_success >= surest - epsilon]
    return min(good, key=lambda one: one.outcome.mean_s)


def needed_charges(problem: Problem, itinerary: Itinerary, epsilon: float) -> list[float | None] | None:
    """Return the charge that each flight needs so that its landing keeps the reserve, None at stops without pads.

    The whole answer is None where more than a full battery would be needed.
    """
    nodes = stop_nodes(problem, itinerary)
    full = tuple(
        Leg(leg.segments, 1.0 if problem.has_pads(node) else None, leg.not_before_s)
        for leg, node in zip(itinerary, nodes, strict=True)
    )
    runs = fly_expected(problem, full)
    flown = np.isfinite(runs[:, -1, SOC_LANDING])
    if not flown.any():
        return None
    weight = problem.probability[flown]
    spent = runs[flown, :, SOC_TAKE_OFF] - runs[flown, :, SOC_LANDING]
    needed: list[float | None] = []
    landing = problem.reserve
    for number in reversed(range(len(itinerary))):
        leaves = landing + weighted_quantile(spent[:, number], weight, 1.0 - epsilon)
        pads = problem.has_pads(nodes[number])
        if leaves > (1.0 if pads else problem.soc if number == 0 else 1.0) + 1e-9:
            return None
        needed.append(leaves if pads else None)
        landing = problem.reserve if pads else leaves
    return needed[::-1]


def told_plan(
    seen: Hindsight, step: Step, charge_to: float | None, errors: Errors, required: Required, p_turned: float = 0.0
) -> Composition | None:
    """Compose a plan that begins with a step; None where no wind of the forecast lets it be flown as a whole.

    Its figures are those of simulated deliveries with gusts, wind that is not told (`untold_wind`), queues, the energy of `errors`, relative to the
    problem's, and the time of manoeuvres. The step, chosen by `seen`, leaves with `charge_to`; None: it does not charge. Its leg is turned with a
    probability, and begun again then. Charges of later legs may be too low in the share `epsilon_later` of the
    forecast, but are at least what is `required` in the expected wind, in simulated deliveries in winds like theirs; legs that are closed for it are
    planned around, and `seen` counts on them no more.
    """
    p, parameters = seen.problem, seen.problem.parameters.online
    first = Leg(step.segments, charge_to)
    for whole in (True, False):
        try:
            bare, itinerary = _with_later(seen, step, first, required) if whole else ((first,), (first,))
            member, course = typical_member(p, itinerary)
            flown = outcome(p, *_simulated(p, bare, course, with_untold_wind(p, bare, course, errors), required))
            later_s = parameters.manoeuvres_s * len(itinerary) + _turned_s(seen, step, p_turned, len(flown.arrival_s))
            result = replace(flown, arrival_s=flown.arrival_s + later_s)
            return compose(p, itinerary, course, member, result, planner="online", planning_time_s=0.0)
        except (InfeasibleError, AuditError):
            continue
    return None


def _simulated(
    p: Problem, bare: Itinerary, course: NDArray[np.float64], errors: Errors, required: Required
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Schedules of simulated deliveries, and their weights: in each group of winds later legs leave with what is required in the middle one.

    Without a later leg there is one group. The typical `course` tells when the last leg begins.
    """
    runs = p.parameters.online.told_queues * len(p.probability)
    if len(bare) == 1:
        flown = simulate_fixed(p, bare, errors, runs)
        return flown.schedule, flown.weight
    schedules, weights = [], []
    for middle, members in _alike(p, bare[-1], float(course[-2, TOUCH_DOWN])):
        flown = simulate_fixed(p, _with_required(p, bare, required, middle)[0], errors, runs)
        own = np.isin(flown.member, members)
        schedules.append(flown.schedule[own])
        weights.append(flown.weight[own])
    return np.concatenate(schedules), np.concatenate(weights)


def _turned_s(seen: Hindsight, step: Step, p_turned: float, runs: int) -> NDArray[np.float64]:
    """By how much later each delivery arrives where its first leg is turned, s: the way there and back, and the charge for it."""
    p, spent = seen.problem, seen.turned_soc(step.charge)
    again_s = spent / p.soc_per_s + p.parameters.online.stop_s
    if p.has_pads(p.origin):
        again_s += p.charge_time_s(p.origin, step.charge - spent, step.charge)
    drawn = np.random.default_rng((p.request.seed, _TURNED)).random(runs)
    return np.where(drawn < p_turned, again_s, 0.0)


def _alike(p: Problem, leg: Leg, time_s: float) -> list[tuple[int, NDArray[np.int64]]]:
    """Members in groups of about the same probability, by the wind speed on a leg at a time, POSIX seconds; each with its middle one."""
    slot, weight = slot_of(p.air, time_s), p.air.weight[list(leg.segments)].mean(axis=0)
    speed = np.hypot(p.air.north[:, slot] @ weight, p.air.east[:, slot] @ weight)
    order = np.argsort(speed, kind="stable")
    share = (np.cumsum(p.probability[order]) - 0.5 * p.probability[order]) / p.probability.sum()
    groups = np.minimum((share * p.parameters.online.told_winds).astype(np.int64), p.parameters.online.told_winds - 1)
    found = (order[groups == one] for one in np.unique(groups))
    return [(int(members[len(members) // 2]), members) for members in found]


def _with_later(seen: Hindsight, step: Step, first: Leg, required: Required) -> tuple[Itinerary, Itinerary]:
    """Continue a first leg with those that most probably follow, around legs that cannot be begun; where no way leads around, they leave fully charged.

    Without what is required of the charges, and with it in the expected wind.
    """
    p = seen.problem
    straight: tuple[Itinerary, Itinerary] | None = None
    for _ in range(p.parameters.online.max_closed):
        later = seen.onward(step)
        if not later:
            break
        found = best_charges(p, (first, *later), p.parameters.online.epsilon_later)
        bare = (first, *(later if found is None else found.itinerary[1:]))
        itinerary, closed = _with_required(p, bare, required)
        if closed is None:
            return bare, itinerary
        straight = straight or (bare, itinerary)
        seen.close(closed.segments[0])
    return straight or ((first,), (first,))


def _with_required(
    problem: Problem, itinerary: Itinerary, required: Required, member: int | None = None
) -> tuple[Itinerary, Leg | None]:
    """Raise the charges of later legs to what is required before their take-off in a typical course and the wind of a member; beside it, the first that no charge opens."""
    closed: Leg | None = None
    for number in range(1, len(itinerary)):
        leg = itinerary[number]
        if leg.charge_to is None:
            continue
        _, course = typical_member(problem, itinerary)
        landed_s, soc = float(course[number - 1, TOUCH_DOWN]), float(course[number - 1, SOC_LANDING])
        least = required(leg, landed_s, soc, member)
        if least is None:
            closed = closed or leg
        raised = replace(leg, charge_to=1.0 if least is None else max(leg.charge_to, least))
        itinerary = (*itinerary[:number], raised, *itinerary[number + 1 :])
    return itinerary, closed


def itinerary_of(problem: Problem, composition: Composition) -> Itinerary | None:
    """Return the decisions of a composition that begins where the problem does; None where it does not fit."""
    network = problem.network
    legs: list[Leg] = []
    where = network.stations[problem.origin].id
    for service in composition.services:
        if legs and service.origin != where:
            return None
        names = [where, *service.via, service.destination]
        segments = segments_of(network, names)
        if not segments:
            return None
        stop = composition.stop_before(service)
        charge = stop.soc_to if stop is not None and stop.recharge_s > 0.0 else None
        legs.append(Leg(segments, charge))
        where = service.destination
    return tuple(legs) or None


def segments_of(network: Network, names: Sequence[str]) -> tuple[int, ...]:
    """Return the segments of a way over some stations; empty where one is missing."""
    found = [_segment(network, a, b) for a, b in pairwise(names)]
    return () if any(one is None for one in found) else tuple(one for one in found if one is not None)


def _segment(network: Network, tail: str, head: str) -> int | None:
    if tail not in network.index or head not in network.index:
        return None
    begin, end = network.first[network.index[tail]], network.first[network.index[tail] + 1]
    hit = np.flatnonzero(network.head[begin:end] == network.index[head])
    return int(begin + hit[0]) if len(hit) else None
