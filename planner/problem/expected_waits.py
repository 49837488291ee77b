"""Expected waits for pads at the stations of a problem, for kernels and planners."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.queues.sampling import sampled_waits
from skyway.models.queues.waiting_times import STEP_S, forecast_waits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem


class ExpectedWaits:
    """Expected wait and probability of a free pad at every station, for arrivals within a horizon, hours from the departure.

    Rows are filled when first requested (`need`); kernels read the arrays.
    """

    def __init__(self, problem: Problem, horizon_h: int) -> None:
        self._load, self._pads, self._busy = problem.load, problem.network.pads, problem.busy
        self._free_s = {node: times for node, times in problem.pads_free_s.items() if self._pads[node]}
        self.start_s, self._horizon_h = problem.depart_s, horizon_h
        self.step_s = STEP_S
        points = round(horizon_h * S_PER_H / self.step_s) + 1
        self.wait_s = np.zeros((len(problem.network), points))
        self.p_free = np.ones((len(problem.network), points))
        """Both of shape (nodes, times), linear between grid points. Only rows of nodes passed to `need` are filled."""
        self.known = np.zeros(len(problem.network), dtype=bool)
        """Which rows are filled to the end of the horizon, shape (nodes,)."""
        self._hours = np.zeros(len(problem.network), dtype=np.int64)

    def need(self, nodes: NDArray[np.int64] | list[int], until_s: float = math.inf) -> int:
        """Fill the rows of some nodes for arrivals until a time; return the number of valid grid points.

        After these points a row continues with its last wait.
        """
        hours = math.ceil(min(max((until_s - self.start_s) / S_PER_H, 1.0), self._horizon_h))
        points = round(hours * S_PER_H / self.step_s) + 1
        wanted = np.unique(np.asarray(nodes, dtype=np.int64))
        wanted = wanted[self._hours[wanted] < hours]
        if not len(wanted):
            return points
        reported = [node for node in wanted.tolist() if node in self._free_s]
        others = [node for node in wanted.tolist() if node not in self._free_s]
        found = forecast_waits(self._load, self._pads, others, self.start_s, hours, self._busy)
        if reported:
            found |= sampled_waits(self._load, self._pads, reported, self.start_s, hours, self._busy, self._free_s)
        for node, forecast in found.items():
            count = min(self.wait_s.shape[1], len(forecast.wait_s))
            self.wait_s[node, :count] = forecast.wait_s[:count]
            self.wait_s[node, count:] = forecast.wait_s[-1]
            self.p_free[node, :count] = forecast.p_free[:count]
            self.p_free[node, count:] = forecast.p_free[-1]
        self.known[wanted], self._hours[wanted] = hours == self._horizon_h, hours
        return points

    def at(self, node: int, time_s: float) -> tuple[float, float]:
        """(expected wait, P(pad free)) of an arrival."""
        self.need([node])
        x = (time_s - self.start_s) / self.step_s
        grid = np.arange(self.wait_s.shape[1])
        return float(np.interp(x, grid, self.wait_s[node])), float(np.interp(x, grid, self.p_free[node]))
