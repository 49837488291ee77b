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

    def __init__(self, problem: Problem, sample: int, among: SampledSets | None = None) -> None:
        super().__init__(problem)
        self._sample, self._among = sample, among or SampledSets(problem, [sample])
        self._given: dict[int, QueuePath] = {}

    def at(self, nodes: Iterable[int], until_s: float = math.inf) -> list[QueuePath]:
        """Those of some nodes; what happens after some time may be missing."""
        wanted = list(nodes)
        found = self._among.at(wanted, until_s)[self._sample]
        return [self._given.get(node) or found[node] for node in wanted]

    def with_path(self, node: int, path: QueuePath) -> SampledQueues:
        """Return the same with another queue at one station."""
        other = SampledQueues(self._problem, self._sample, self._among)
        other._given = self._given | {node: path}
        return other


class SampledSets:
    """Some realizations of the other drones at every station, sampled together for the stations that a search asks for."""

    def __init__(self, problem: Problem, samples: Sequence[int]) -> None:
        self._problem, self._samples = problem, samples
        self._until_s: dict[int, float] = {}
        self._paths: dict[int, dict[int, QueuePath]] = {sample: {} for sample in samples}

    def at(self, nodes: Iterable[int], until_s: float) -> dict[int, dict[int, QueuePath]]:
        """Return the paths of each realization by node, at some nodes at least, at least until some time."""
        missing = [node for node in nodes if self._until_s.get(node, -math.inf) < until_s]
        if missing:
            found = self._problem.queue_sets(missing, self._samples, until_s=until_s)
            for sample, paths in zip(self._samples, found, strict=True):
                self._paths[sample] |= paths
            self._until_s |= dict.fromkeys(missing, until_s)
        return self._paths
