"""An independent, slow planner on a grid of times: every sequence of stops, every simple walk between two stops.

Arrivals are rounded up to the grid and charges down, so its delivery time is an upper bound that tends to the optimum.
It shares no code with the planners: its own wind triangle, integration, charging curve and queues.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

STEP_S = 4.0


class GridOracle:
    def __init__(self, problem, queues, hours=7.0, *, speeds=None, margin_soc_per_s=0.0):
        self.p = problem
        self.queues = queues
        self.t = problem.depart_s + STEP_S * np.arange(int(hours * 3600 / STEP_S))
        e = problem.ensemble
        self.speed = np.hypot(e.north[0, :, 0], e.east[0, :, 0])
        self.towards = np.arctan2(e.east[0, :, 0], e.north[0, :, 0])
        self.flights = {}
        self.given = speeds
        self.margin = margin_soc_per_s

    def _ground_speed(self, segment, slot):
        n = self.p.network
        slot = min(slot, len(self.speed) - 1)
        if self.given is not None:
            return self.given[slot, segment]
        off = self.towards[slot] - math.radians(n.bearing_deg[segment])
        along, across = self.speed[slot] * math.cos(off), self.speed[slot] * math.sin(off)
        s = self.p.air.airspeed_mps
        if abs(across) >= s or self.speed[slot] > self.p.drone.wind_limit_mps:
            return 0.0
        ground = along + math.sqrt(s * s - across * across)
        return min(ground, self.p.drone.max_ground_speed_mps) if ground >= 1.0 else 0.0

    def _slot(self, t):
        return max(0, int(math.floor((t + 1e-6 - self.p.ensemble.start_s) / self.p.ensemble.slot_s)))

    def _land(self, walk, depart):
        t = depart + 60.0 / 5.0
        for segment in walk:
            left = self.p.network.distance_m[segment]
            while left > 1e-9:
                speed = self._ground_speed(segment, self._slot(t))
                if speed == 0.0:
                    return math.inf
                end = self.p.ensemble.start_s + (self._slot(t) + 1) * self.p.ensemble.slot_s
                step = min(left / speed, end - t)
                left -= speed * step
                t += step
        t += 60.0 / 3.0
        touched = range(self._slot(depart), self._slot(t - 1e-5) + 1)
        if any(self._ground_speed(s, slot) == 0.0 for slot in touched for s in walk):
            return math.inf
        return t

    def _walks(self, a, b):
        n = self.p.network
        found, stack = [], [(a, ())]
        while stack:
            node, walk = stack.pop()
            if node == b and walk:
                found.append(walk)
                continue
            for s in range(n.first[node], n.first[node + 1]):
                seen = {a, *(int(n.head[k]) for k in walk)}
                if len(walk) < 4 and int(n.head[s]) not in seen:
                    stack.append((int(n.head[s]), (*walk, s)))
        return found

    def arrivals(self, a, b):
        """Earliest touch-down for each take-off on the grid."""
        if (a, b) not in self.flights:
            best = np.full(len(self.t), math.inf)
            n = self.p.network
            walks = sorted(self._walks(a, b), key=lambda w: sum(n.distance_m[s] for s in w))
            shortest = sum(n.distance_m[s] for s in walks[0]) if walks else 0.0
            for walk in walks:
                if sum(n.distance_m[s] for s in walk) < 3.0 * shortest:
                    best = np.minimum(best, [self._land(walk, t) for t in self.t])
            self.flights[a, b] = best
        return self.flights[a, b]

    def _up(self, times):
        """Index of the first grid time at or after each time."""
        index = np.ceil((np.asarray(times) - self.t[0]) / STEP_S - 1e-9)
        return np.where(np.isfinite(index), index, len(self.t)).astype(np.int64)

    def _stay(self, node, landings):
        """Best charge to leave with at each grid time, from (arrival, touch-down, charge) triples."""
        leave = np.full(len(self.t), -1.0)
        curve = self.p.drone.charging_curve()
        knots, levels = curve.piecewise()
        queue = self.queues.get(node)
        best_z = np.full(len(self.t), -math.inf)
        for joined, time, charge in landings:
            i = int(self._up(time))
            if i < len(self.t):
                leave[i] = max(leave[i], charge)
            if queue is not None and self.p.has_pads(node):
                pad = max(time, float(queue.pad_time(joined)))  # who hovers for a spot keeps its place
                j = int(self._up(pad))
                if j < len(self.t):
                    best_z[j] = max(best_z[j], np.interp(charge, levels, knots) - self.t[j])
        spot = np.maximum.accumulate(leave)
        z = np.maximum.accumulate(best_z)
        charged = np.where(np.isfinite(z), np.interp(self.t + np.where(np.isfinite(z), z, 0.0), knots, levels), -1.0)
        return np.maximum(spot, charged)

    def _fly(self, charge, a, b, reserve):
        arrive = self.arrivals(a, b)
        landed = charge - self.p.soc_fixed - self.p.soc_per_s * (arrive - self.t)
        ok = np.isfinite(arrive) & (charge >= 0.0)
        ok[ok] = landed[ok] >= reserve + self.margin * (arrive - self.t)[ok]
        return arrive[ok], landed[ok], self.t[ok]

    def delivery_time_s(self):
        """Least delivery time over all sequences, infinite when there is none."""
        p = self.p
        middles = [k for k in range(len(p.network)) if k not in (p.origin, p.destination) and p.has_pads(k)]
        begin = self._stay(p.origin, [(p.depart_s, p.depart_s, p.soc)])
        best = math.inf
        known = {(): begin}
        for count in range(len(middles) + 1):
            for stops in itertools.permutations(middles, count):
                if stops:
                    before = known.get(stops[:-1])
                    if before is None:
                        continue
                    last = stops[-2] if len(stops) > 1 else p.origin
                    arrive, landed, off = self._fly(before, last, stops[-1], p.reserve)
                    queue = self.queues[stops[-1]]
                    spot = queue.land_time(arrive)
                    landed = landed - p.soc_per_s * (spot - arrive)
                    ok = landed >= p.reserve + self.margin * (spot - off)
                    if not ok.any():
                        continue
                    known[stops] = self._stay(stops[-1], list(zip(arrive[ok], spot[ok], landed[ok], strict=True)))
                here = stops[-1] if stops else p.origin
                arrive, landed, off = self._fly(known[stops], here, p.destination, p.reserve)
                if p.needs_escape and len(arrive):
                    spare = landed - p.reserve - self.margin * (arrive - off)
                    keep = [s >= self._escape(a) for a, s in zip(arrive, spare, strict=True)]
                    arrive = arrive[keep]
                if len(arrive):
                    best = min(best, float(arrive.min()) - p.depart_s)
        return best

    def _escape(self, t):
        rate, fixed = self.p.empty_cost
        best = math.inf
        for s in self.p.escapes:
            off = t
            while self._land((s,), off) == math.inf and off < self.t[-1]:
                off = self.p.ensemble.start_s + (self._slot(off) + 1) * self.p.ensemble.slot_s
            down = self._land((s,), off)
            best = min(best, fixed + (rate + self.margin) * (down - off))
        return best
