"""Informed exhaustive search: every sequence of distinct stops, with the best charging on each.

It has perfect information, one wind and one queue at each station, and is the reference for the other planners: a sequence is
cut off only by a proof that no continuation of it beats the best composition found so far. On each sequence the complete
trade-off between time and charge is carried along exactly (`planner.schedule.profile_kernels`), over flights that may overfly
stations (`planner.exact.flight_functions`). The proof is that of `planner.exact.stop_label_kernels.stop_label_bound`.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import NoRouteError
from skyway.planner.exact.escape import needed_at_destination
from skyway.planner.exact.stop_labels import StopLabel, StopLabels, landing_s
from skyway.planner.exact.subnetwork import whole_subnetwork
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.problem.speeds import TrueSpeeds
from skyway.planner.schedule.no_route import no_route

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


class ExhaustiveSearch:
    """One search, in the wind of the first member of the ensemble and with the true queue at each station with pads.

    After `time_limit_s` it stops, and `complete` is False. `progress` is called about every second with the number of sequences
    evaluated and the best delivery time so far, s.
    """

    def __init__(
        self,
        problem: Problem,
        queues: Mapping[int, QueuePath],
        *,
        time_limit_s: float = math.inf,
        progress: Callable[[int, float], None] | None = None,
    ) -> None:
        self.problem = problem
        self._queues = queues
        self.time_limit_s = time_limit_s
        self.progress = progress
        self.complete = True
        """Whether the search was completed."""
        self.labels_expanded = 0
        """Sequences continued so far."""
        needed = needed_at_destination(problem, TrueSpeeds(problem.air), 0.0, math.inf)
        self._stop_labels = StopLabels(problem, queues, whole_subnetwork(problem, queues), needed)
        self._best: tuple[list[StopLabel], float] | None = None
        self._deadline = math.inf
        self._last_progress = 0.0

    @property
    def best_s(self) -> float:
        """Arrival of the best composition found, POSIX seconds."""
        return self._stop_labels.best_s

    def solve(self) -> Itinerary:
        """Enumerate, best bound first at each stop. Raises a `NoRouteError` if there is no route, or none was found in time."""
        self._last_progress = time.monotonic()
        self._deadline = self._last_progress + self.time_limit_s
        self._visit([self._stop_labels.origin()])
        if self._best is None and not self.complete:
            message = (
                f"no route was found in {self.time_limit_s:g} s: there may be one; give more time, or try planner exact"
            )
            raise NoRouteError(message, constraint="time-limit")
        if self._best is None:
            raise no_route(self.problem, Lookahead(self.problem))
        return self._stop_labels.trace(*self._best)

    def _visit(self, path: list[StopLabel]) -> None:
        """Continue a sequence with every station it has not stopped at."""
        self.labels_expanded += 1
        now = time.monotonic()
        if now > self._deadline:
            self.complete = False
            return
        if self.progress is not None and now - self._last_progress > 1.0:
            self._last_progress = now
            self.progress(self.labels_expanded, self.best_s - self.problem.depart_s)
        useful = self._stop_labels.useful_from(path[-1])
        pieces_of = self._stop_labels.pieces_from(path[-1], useful)
        destination = self.problem.destination
        if useful[destination]:
            arrive, leave = self._stop_labels.arrive(path[-1], pieces_of(destination))
            if arrive < self.best_s - self.problem.parameters.ies.gain_s:
                self._stop_labels.best_s, self._best = arrive, (path, leave)
        useful[[destination, *(stop_label.node for stop_label in path)]] = False
        following = self._stop_labels.land(
            path[-1], np.flatnonzero(useful & (self.problem.network.pads > 0)), pieces_of
        )
        for bound, after in sorted(following, key=lambda pair: pair[0]):
            if (
                landing_s(self.problem, self._queues, bound) < self.best_s - self.problem.parameters.ies.gain_s
                and self.complete
            ):
                self._visit([*path, after])
