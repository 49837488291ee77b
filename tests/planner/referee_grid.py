"""A slow planner on a grid of take-off times: every sequence of stops, every simple walk between two stops.

Take-offs lie on the grid and pads are taken at the next time on it, so that what it finds can be flown: its delivery time is
an upper bound that tends to the optimum. Flights are those of `referee_flights`.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from referee_flights import Flights, Queue


class Grid:
    def __init__(self, problem, queues, hours=7.0, *, speeds=None, margin_soc_per_s=0.0, step_s=4.0):
        self.f = Flights(problem, speeds=speeds)
        self.step_s = step_s
        last = min(hours * 3600.0, self.f.horizon_s)
        self.t = step_s * np.arange(int(last / step_s))
        begin = self.f.begin_s
        self.queues = {node: Queue(path, begin) for node, path in queues.items() if self._pads(node)}
        self.margin = margin_soc_per_s
        self.arrivals = {}

    def _pads(self, node):
        return self.f.network.stations[node].pads > 0

    def earliest(self, a, b):
        """Earliest touch-down for each take-off on the grid."""
        if (a, b) not in self.arrivals:
            best = np.full(len(self.t), math.inf)
            for walk in self.f.walks(a, b):
                best = np.minimum(best, self.f.land(walk, self.t))
            self.arrivals[a, b] = best
        return self.arrivals[a, b]

    def _up(self, times):
        index = np.ceil(np.asarray(times) / self.step_s - 1e-9)
        return np.minimum(np.where(np.isfinite(index), index, len(self.t)), len(self.t)).astype(np.int64)

    def _stay(self, node, joined, spot, charge):
        """Best charge to leave with at each time on the grid, of arrivals in a queue that land with a charge."""
        landed = np.full(len(self.t) + 1, -1.0)
        np.maximum.at(landed, self._up(spot), charge)
        landed = np.maximum.accumulate(landed[:-1])
        if node not in self.queues or (self.f.in_flight and node == self.f.origin):
            return landed
        curve = self.f.curve(node)
        pad = self._up(np.maximum(self.queues[node].pad_at(joined), spot))
        since = np.full(len(self.t) + 1, -math.inf)  # time from empty on the pad, less the time
        np.maximum.at(since, pad, curve.time_at(charge) - self.step_s * pad)
        since = np.maximum.accumulate(since[:-1])
        on = np.isfinite(since)
        charged = np.full(len(self.t), -1.0)
        charged[on] = curve.soc_at(self.t[on] + since[on])
        return np.maximum(landed, charged)

    def _fly(self, charge, a, b):
        down = self.earliest(a, b)
        with np.errstate(invalid="ignore"):
            left = charge - self.f.cost * (down - self.t)
            ok = (charge >= 0.0) & np.isfinite(down) & (left >= self.f.reserve + self.margin * (down - self.t) - 1e-12)
        return self.t[ok], down[ok], left[ok]

    def delivery_time_s(self):
        """Least delivery time over all sequences; infinite when none ends within the grid."""
        f = self.f
        others = [k for k in range(len(f.network)) if k not in (f.origin, f.destination) and self._pads(k)]
        now = np.zeros(1)
        begin = self._stay(f.origin, now, now, np.full(1, f.soc))
        if f.in_flight:
            begin[1:] = -1.0  # it cannot stay
        known, best = {(): begin}, math.inf
        for count in range(len(others) + 1):
            for stops in itertools.permutations(others, count):
                if stops and stops[:-1] not in known:
                    continue
                if stops:
                    before = stops[-2] if count > 1 else f.origin
                    off, down, left = self._fly(known[stops[:-1]], before, stops[-1])
                    spot = self.queues[stops[-1]].spot_at(down)
                    left = left - f.cost * (spot - down)
                    ok = (left >= f.reserve + self.margin * (spot - off)) & (down < best)
                    if not ok.any():
                        continue
                    known[stops] = self._stay(stops[-1], down[ok], spot[ok], left[ok])
                off, down, left = self._fly(known[stops], stops[-1] if stops else f.origin, f.destination)
                if f.needs_escape and len(down):
                    spare = left - f.reserve - self.margin * (down - off)
                    down = down[spare >= f.escape_need(down, self.margin) - 1e-12]
                if self._pads(f.destination):
                    spot = self.queues[f.destination].spot_at(down)
                    left = left - f.cost * (spot - down)
                    down = spot[left >= f.reserve + self.margin * (spot - off) - 1e-12]
                if len(down):
                    best = min(best, float(down.min()))
        return best
