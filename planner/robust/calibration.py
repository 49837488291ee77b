"""Weights of simulated deliveries, calibrated on waits whose mean is known.

The difference between seeds is mostly that of the sampled queues. The expected wait at every station is known for any time
of arrival (`models.queues.waiting_times`); so deliveries with queues shorter than on average are given more weight, until the
mean waits, for a common time of arrival of all deliveries of one member, equal the expected ones. With z(i) these waits of a
delivery less their mean in its member, D the expected less the mean waits, both vectors over the places of the route, and w(i) the weights before:

    w(i) (1 + D' S^-1 z(i)),     S = sum of w(i) z(i) z(i)'

so that any weighted mean is its regression estimate (Deville and Särndal, "Calibration estimators in survey sampling", Journal of
the American Statistical Association 87 (1992)). The members of the forecast keep their weights.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.planner.schedule.schedule_kernels import TOUCH_DOWN, Queues, waits_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.out_of_sample import SampledTruths

_LEAST, _MOST = 0.2, 5.0
"""Least and greatest ratio of a new weight to the former one."""
_ANY_S = 1.0
"""Least spread of the waits at a station that is calibrated on, s."""


class Calibrated(NamedTuple):
    """Weights, and the waits of their calibration."""

    weight: NDArray[np.float64]
    """Shape (runs,). Their sum is 1."""
    waits_s: NDArray[np.float64]
    """Shape (runs, places). z(i)."""


def calibrated(
    problem: Problem, nodes: Sequence[int], truths: SampledTruths, paths: PackedPaths, usual_s: NDArray[np.float64]
) -> Calibrated:
    """Calibrate the weights of deliveries over some places, flown in some realizations.

    `paths` are those of the realizations, in order (place, set); they are read at `usual_s`, see `usual_arrivals_s`.
    """
    weight = problem.probability[truths.members]
    weight = weight / weight.sum()
    member, runs = truths.members, len(weight)
    sets = len(paths) // len(nodes)
    queues, share = Queues.of(paths), _sums(weight, member)[member]
    waits, lacking = [], []
    for place, node in enumerate(nodes):
        if not _is_known(problem, node):
            continue
        come_s = np.full(runs, problem.depart_s) if place == 0 else usual_s[:, place - 1]
        there = np.isfinite(come_s)
        found = np.zeros(runs)
        if not there.any():
            continue
        entries = place * sets + truths.disturbance.queue[there]
        found[there] = waits_at(queues, entries, come_s[there])
        problem.waits.need([node], float(come_s[there].max()))
        grid = problem.waits.start_s + problem.waits.step_s * np.arange(problem.waits.wait_s.shape[1])
        expected = np.where(there, np.interp(np.where(there, come_s, 0.0), grid, problem.waits.wait_s[node]), 0.0)
        mean = _sums(weight * found, member)[member] / share
        if weight @ np.abs(found - mean) > _ANY_S:
            waits.append(found - mean)
            lacking.append(float(weight @ (expected - mean)))
    if not waits:
        return Calibrated(weight, np.zeros((runs, 0)))
    z = np.column_stack(waits)
    lean = np.linalg.lstsq((z * weight[:, None]).T @ z, np.array(lacking), rcond=1e-9)[0]
    weight = weight * np.clip(1.0 + z @ lean, _LEAST, _MOST)
    return Calibrated(weight * share / _sums(weight, member)[member], z)


def usual_arrivals_s(schedule: NDArray[np.float64], member: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the median touch-down of each leg in the member of each run, of the runs that land, POSIX seconds, shape (runs, legs); infinite if none does."""
    return np.column_stack([_usual(schedule[:, leg, TOUCH_DOWN], member) for leg in range(schedule.shape[1])])


def _is_known(problem: Problem, node: int) -> bool:
    """Whether the expected wait of a station is that of its sampled queues: other drones use it, its pads never close, and no report of their state is available."""
    closed = node in problem.closures or (node == problem.awaiting and problem.request.not_before is not None)
    return problem.has_pads(node) and not closed and node not in problem.pads_free_s


def _usual(arrival_s: NDArray[np.float64], member: NDArray[np.int64]) -> NDArray[np.float64]:
    """Median arrival in the member of each run, of those that arrive, shape (runs,); infinite if none does."""
    order = np.lexsort((arrival_s, member))
    members, first = np.unique(member[order], return_index=True)
    arrive = np.bincount(member, weights=np.isfinite(arrival_s)).astype(np.int64)[members]
    middle = arrival_s[order[first + np.maximum(arrive - 1, 0) // 2]]
    return np.asarray(np.where(arrive > 0, middle, np.inf)[np.searchsorted(members, member)])


def _sums(values: NDArray[np.float64], member: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums over the runs of each member, by its number."""
    return np.asarray(np.bincount(member, weights=values), dtype=np.float64)
