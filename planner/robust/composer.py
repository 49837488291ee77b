"""Routes that are proposed to the robust planner: composed by the exact planner in problems that represent the forecast.

These are that of the mean flight time at several margins (`planner.problem.mean_value`), and some of its members with sampled queues.
"""

from __future__ import annotations

import math
import time
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.wind.ensemble import evenly
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.problem.mean_value import ExpectedQueues, energy_margin
from skyway.planner.problem.objective import Weights
from skyway.planner.problem.speeds import MeanSpeeds
from skyway.planner.robust.loss_search import LossSearch
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary

COMPOSED_IN = 0
"""Seed of the queues in which routes are composed, independent of that of the request, which changes only the
deliveries used for evaluation."""


class TimeLimit:
    """The time of `time.perf_counter` from which a search ends with the first route."""

    def __init__(self, end_at: float) -> None:
        self.was_reached = False
        """Whether a search has noticed it."""
        self._end_at = end_at

    def is_reached(self) -> bool:
        """Whether it is that late."""
        self.was_reached = self.was_reached or time.perf_counter() >= self._end_at
        return self.was_reached


class Composer:
    """Composes routes for one problem, each once, until the limit of time is reached.

    `errors` are those of the truth beyond the forecast.
    """

    def __init__(self, problem: Problem, errors: Errors, limit: TimeLimit) -> None:
        self.problem, self.errors = problem, errors
        self.parameters = problem.parameters.robust
        self.labels_expanded = 0
        """Labels expanded by the searches."""
        self._large = self.parameters.is_large(len(problem.network))
        self._limit = limit
        self._composed: dict[tuple[object, ...], Itinerary | None] = {}

    def routes(self, allowed: NDArray[np.bool_], members: int) -> Iterator[Itinerary]:
        """Compose in the mean-value problem at several margins, and in a number of members with a sampled queue."""
        p = self.problem
        speeds, queues = self._mean_speeds, self._expected_queues
        found = 0
        most_labels = self.parameters.first_route_labels if self._large else math.inf
        for margin in self._margins:
            itinerary = self._compose(speeds, queues, margin, allowed, most_labels=most_labels)
            if itinerary is not None:
                found += 1
                yield itinerary
        if not found:  # there may be a route without any margin; and if so, perhaps with more than none
            bare = self._compose(speeds, queues, 0.0, allowed)
            if bare is None:
                return
            cautious = self._compose(speeds, queues, self._short_margin, allowed)
            yield from (one for one in (cautious, bare) if one is not None)
        for sample, member in enumerate(evenly(len(p.probability), members).tolist()):
            alone = np.zeros(len(p.probability))
            alone[member] = 1.0
            sampled = p.queue_paths(range(len(p.network)), sample, COMPOSED_IN)
            itinerary = self._compose(self._speeds(alone), sampled, self._margins[0], allowed)
            if itinerary is not None:
                yield itinerary

    def earliest_s(self) -> float:
        """Return a bound of the earliest arrival in the mean-value problem without any margin, POSIX seconds; infinite without a way."""
        search = ExactSearch(self.problem, self._expected_queues, speeds=self._mean_speeds)
        return search.bound_s(self.problem.parameters.exact.near_stations)

    def short_flights(self, allowed: NDArray[np.bool_]) -> Itinerary | None:
        """Compose the best route of flights so short that hardly any wind makes them too long for the battery, on large networks the best within a few labels."""
        speeds, queues = self._mean_speeds, self._expected_queues
        labels = self.parameters.short_leg_labels if self._large else math.inf
        return self._compose(speeds, queues, self._short_margin, allowed, most_labels=labels, best=True)

    def sparing(self, allowed: NDArray[np.bool_]) -> Iterator[Itinerary]:
        """Return routes that save what the objective counts beside time, and early ones if stations close while drones charge; else none."""
        p = self.problem
        early = (Weights(per_h=1.0),) if p.closures else ()
        late = (0.0, self.parameters.closing_late_s) if p.closures else (0.0,)
        for weights, late_s in product((*p.request.objective.searched, *early), late):
            for margin in self._margins:
                if self._limit.is_reached():
                    return
                speeds = self._mean_speeds
                labels = self.parameters.sparing_labels_large if self._large else self.parameters.sparing_labels
                queues = self._expected_queues
                search = LossSearch(p, queues, speeds, margin, allowed, weights, most_labels=labels, late_s=late_s)
                yield from search.routes(self.parameters.sparing_routes)
                self.labels_expanded += search.labels_expanded

    @cached_property
    def _margins(self) -> tuple[float, ...]:
        """Margins of each flight's energy with which routes are composed: for the wind, and for the energy belief.

        The first one is that before the first leg, the others those after it.
        """
        begin, *others = self.parameters.margins
        first = self.errors.energy_of(self.problem.drone)
        then = first.learnt(first.mean_ratio, 1.0, soc_sd=0.0)
        epsilon = self.problem.epsilon
        return energy_margin(begin, first, epsilon), *(energy_margin(margin, then, epsilon) for margin in others)

    @property
    def _short_margin(self) -> float:
        belief = self.errors.energy_of(self.problem.drone)
        p = self.parameters
        return energy_margin(
            p.short_leg_margin_large if self._large else p.short_leg_margin, belief, self.problem.epsilon
        )

    @cached_property
    def _mean_speeds(self) -> MeanSpeeds:
        """Speeds of the mean-value problem."""
        return self._speeds(self.problem.probability)

    @cached_property
    def _expected_queues(self) -> ExpectedQueues:
        return ExpectedQueues(self.problem)

    def _speeds(self, probability: NDArray[np.float64]) -> MeanSpeeds:
        count = np.count_nonzero(probability)
        if self._large and count > self.parameters.speed_members:
            kept = evenly(len(probability), self.parameters.speed_members)
            mask = np.zeros(len(probability))
            mask[kept] = probability[kept]
            if mask.sum() > 0.0:
                probability = mask / mask.sum()
        return MeanSpeeds(self.problem.air, probability, self.parameters.speed_hours)

    def _compose(
        self,
        speeds: MeanSpeeds,
        queues: Mapping[int, QueuePath],
        margin: float,
        allowed: NDArray[np.bool_],
        *,
        most_labels: float = math.inf,
        best: bool = False,
    ) -> Itinerary | None:
        """Compose the best route within a number of labels; on large networks the first one found, unless `best`. None if none is found within these.

        The first one keeps to labels with spare charge; the best has less for winds other than the mean. A composed
        route is stored: short flights are composed for several comparisons.
        """
        key = speeds, margin, allowed.tobytes(), most_labels, best  # other queues belong to other speeds
        if key in self._composed:
            return self._composed[key]

        def find(part: Problem) -> tuple[Itinerary | None, float]:
            search = ExactSearch(
                part,
                queues,
                speeds=speeds,
                margin_soc_per_s=margin * part.soc_per_s,
                stops=allowed,
                time_limit_s=0.0 if self._large and not best else math.inf,
                most_labels=most_labels,
            )
            found = search.find()
            self.labels_expanded += search.labels_expanded
            return found, search.best_s

        p = self.problem
        self._composed[key] = _compose_through(p, queues, find) if p.must_stop else find(p)[0]
        return self._composed[key]


def _compose_through(
    problem: Problem,
    queues: Mapping[int, QueuePath],
    find: Callable[[Problem], tuple[Itinerary | None, float]],
) -> Itinerary | None:
    """Compose to each stop of ``problem.must_stop`` and on to the destination; None where a piece has no way.

    `find` composes a piece and returns its arrival, POSIX seconds. The next piece begins then, with the charge on landing
    in the first member; if that wind never permits the flight, with the reserve. Each piece is optimal by itself: that a
    later arrival at a stop could shorten the rest is not examined.
    """
    legs: Itinerary = ()
    here = problem
    for node in (*problem.must_stop, problem.destination):
        part = here.bound_for(node)
        found, arrive_s = find(part)
        if found is None:
            return None
        legs += found
        landed = fly_true(part, found, queues)[0, -1]
        soc = float(landed[SOC_LANDING]) if math.isfinite(landed[TOUCH_DOWN]) else problem.reserve
        here = problem.standing_at(node, arrive_s, min(max(soc, problem.reserve), 1.0))
    return legs
