"""Queues at every station of a problem, computed or sampled for the stations that a search asks for."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from skyway.models.queues.paths import QueuePath

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from skyway.planner.problem.problem import Problem


class AskedQueues(Mapping[int, QueuePath], ABC):
    """The queues of all nodes of a problem, computed on request."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    @abstractmethod
    def at(self, nodes: Iterable[int], until_s: float = math.inf) -> list[QueuePath]:
        """Those of some nodes, for arrivals until some time."""

    def __getitem__(self, node: int) -> QueuePath:
        return self.at([node])[0]

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self)))

    def __len__(self) -> int:
        return len(self._problem.network)


class SampledQueues(AskedQueues):
    """One realization of the other drones at every station: that of `Problem.queue_paths`, whichever are requested first.

    Those `among` which it is are sampled together, station by station.
    """

    def __init__(self, problem: Problem, sample: int, among: Sequence[int] = ()) -> None:
        super().__init__(problem)
        self._sample, self._among = sample, among
        self._given: dict[int, QueuePath] = {}

    def at(self, nodes: Iterable[int], until_s: float = math.inf) -> list[QueuePath]:
        """Those of some nodes; what happens after some time may be missing."""
        wanted = list(nodes)
        found = self._problem.queue_sets(wanted, [self._sample], until_s=until_s, among=self._among)[0]
        return [self._given.get(node) or found[node] for node in wanted]

    def with_path(self, node: int, path: QueuePath) -> SampledQueues:
        """Return the same with another queue at one station."""
        other = SampledQueues(self._problem, self._sample, self._among)
        other._given = self._given | {node: path}
        return other
