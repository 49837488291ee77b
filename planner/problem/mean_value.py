"""The mean-value problem: mean flight times and mean waits, in which the robust planner composes routes.

Each segment is flown at the speed whose flight time is the mean of the members' that can fly it, each station has its
expected wait, and a landing keeps, beyond the reserve, a margin for each second of flight. The mean of functions that
are first in, first out is one again, so that the exact planner's proofs hold in this world as well.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING

from skyway.models.queues.paths import expected_paths, no_queue
from skyway.planner.problem.sampled_queues import AskedQueues

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.problem import Problem


HOURS = 16.0
"""How far ahead speeds are computed; beyond, the last hour holds on."""


def energy_margin(margin: float, belief: EnergyBelief, epsilon: float) -> float:
    """Margin of a flight's energy: for the wind, and for what is unknown of the energy of the drone's next leg."""
    mean, sigmas = belief.mean_ratio, NormalDist().inv_cdf(1.0 - epsilon)
    return mean * (1.0 + math.hypot(margin, sigmas * belief.leg_sd / mean)) - 1.0


class ExpectedQueues(AskedQueues):
    """Expected wait at every station as a queue path, computed for the stations that a search asks for."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self._found: dict[int, QueuePath] = {}
        self._until: dict[int, float] = {}

    def at(self, nodes: Iterable[int], until_s: float = math.inf) -> list[QueuePath]:
        """Those of some nodes, for arrivals until some time; those behind it meet the last wait."""
        wanted = list(nodes)
        missing = [node for node in dict.fromkeys(wanted) if self._until.get(node, -math.inf) < until_s]
        if missing:
            waits, has_pads = self._problem.waits, self._problem.has_pads
            padded = [node for node in missing if has_pads(node)]
            points = waits.need(padded, until_s)
            wait_s = waits.wait_s[padded, :points]
            expected = expected_paths(waits.start_s, waits.step_s, wait_s)
            while_open = self._problem.while_open
            self._found |= {node: while_open(node, path) for node, path in zip(padded, expected, strict=True)}
            self._found |= {node: no_queue() for node in missing if not has_pads(node)}
            self._until |= dict.fromkeys(missing, until_s)
        return [self._found[node] for node in wanted]
