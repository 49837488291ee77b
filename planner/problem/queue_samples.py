"""Sampled realizations of the queues of a problem, each sampled once and kept."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.queues.paths import PackedPaths, QueuePath, joined, no_queue, pack, spliced
from skyway.models.queues.sampling import sample_many, sample_sets

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem

_MANY = 0x51


class QueueSamples:
    """The realizations that were asked for so far, of problems that differ in drone and forecast alone.

    Those of `sets` have a seed and a number each; those of `many` are drawn from a stream of the request's seed, and independent of them. All
    are of so many hours from the departure.
    """

    def __init__(self, hours: float) -> None:
        self._hours = hours
        self._sets: dict[tuple[int, int], dict[int, tuple[float, QueuePath]]] = {}
        self._many: dict[tuple[int, int, int], dict[int, tuple[NDArray[np.float64], PackedPaths]]] = {}

    def sets(
        self,
        p: Problem,
        nodes: Iterable[int],
        samples: Sequence[int],
        seed: int,
        until_s: float = math.inf,
        among: Sequence[int] = (),
    ) -> list[dict[int, QueuePath]]:
        """Return some realizations of the other drones at each of some stations.

        What happens after `until_s` may be missing. Those `among` which they are, if given, are sampled with them.
        """
        wanted = list(dict.fromkeys(nodes))
        until_s = until_s if until_s < p.depart_s + self._hours * S_PER_H else math.inf
        kept = [self._sets.setdefault((seed, sample), {}) for sample in samples]
        nothing = -math.inf, no_queue()
        missing = [node for node in wanted if any(paths.get(node, nothing)[0] < until_s for paths in kept)]
        if missing:
            together = among or samples
            seeds = [(seed, sample) for sample in together]
            pads, spots, hours = p.network.pads, p.holding_spots, self._hours
            found = sample_sets(p.load, pads, spots, missing, p.depart_s, hours, seeds, p.busy, p.pads_free_s, until_s)
            for sample, paths in zip(together, found, strict=True):
                known = self._sets.setdefault((seed, sample), {})
                known |= {node: (until_s, p.while_open(node, paths[node])) for node in missing}
        return [{node: paths[node][1] for node in wanted} for paths in kept]

    def many(
        self, p: Problem, nodes: Sequence[int], stream: int, count: int, until_s: float | NDArray[np.float64]
    ) -> PackedPaths:
        """Return `count` realizations of the other drones at each of some places, in order (place, realization).

        Times after `until_s`, of all or of each, shape (count,), may be missing: those after `sampled_until`.
        """
        kept, end_s = self._kept(p, stream, count), p.depart_s + self._hours * S_PER_H
        wanted = np.broadcast_to(np.where(np.less(until_s, end_s), until_s, math.inf), count)
        for node in nodes:
            known, before = kept.get(node, (np.full(count, -math.inf), None))
            lacking = known < wanted
            if before is None or lacking.any():
                found = self._sampled(p, node, stream, count, np.where(lacking, wanted, -math.inf))
                found = found if before is None else spliced(before, found, lacking)
                kept[node] = np.maximum(known, wanted), found
        return joined([kept[node][1] for node in nodes])

    def sampled_until(self, p: Problem, nodes: Sequence[int], stream: int, count: int) -> NDArray[np.float64]:
        """Until when `many` has sampled each realization at all of some places, POSIX seconds, shape (count,); infinite for all of the horizon."""
        kept = self._kept(p, stream, count)
        if any(node not in kept for node in nodes):
            return np.full(count, -math.inf)
        return np.asarray(np.min([kept[node][0] for node in nodes], axis=0))

    def _kept(self, p: Problem, stream: int, count: int) -> dict[int, tuple[NDArray[np.float64], PackedPaths]]:
        return self._many.setdefault((p.request.seed, stream, count), {})

    def _sampled(self, p: Problem, node: int, stream: int, count: int, until_s: NDArray[np.float64]) -> PackedPaths:
        pads, spots, hours = int(p.network.pads[node]), int(p.holding_spots[node]), self._hours
        busy, free_s, seeds = p.busy.get(node), p.pads_free_s.get(node, ()), (_MANY, p.request.seed, stream)
        found = sample_many(p.load, pads, spots, node, p.depart_s, hours, seeds, count, busy, free_s, until_s)
        if node not in p.closures and not (node == p.awaiting and math.isfinite(p.earliest_s)):
            return found
        return pack([p.while_open(node, found[number]) for number in range(count)])
