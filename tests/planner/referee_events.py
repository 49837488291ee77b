"""An exact referee: each sequence of stops as a mixed-integer linear program over all events, solved by HiGHS.

A flight between two stops is one of finitely many pieces: a walk, and take-offs between two events (a boundary of a slot
met anywhere on the way, another drone in the queue, an end of a closed slot) between which touch-down, place to land and pad
are linear in the take-off. Charging is one of the chords of the charging curve. Which pieces are taken is a choice of
integers, the rest is linear. Flights are those of `referee_flights`; nothing is enumerated by hand but the pieces.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from referee_flights import Flights, Queue
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

HOUR_S = 3600.0
BIG = 40.0


class Model:
    """Rows and columns of a program."""

    def __init__(self):
        self.low, self.high, self.integer, self.rows = [], [], [], []

    def add(self, low=-np.inf, high=np.inf, *, integer=False):
        self.low.append(low)
        self.high.append(high)
        self.integer.append(int(integer))
        return {len(self.low) - 1: 1.0}

    def row(self, terms, low=-np.inf, high=np.inf):
        self.rows.append((terms, low, high))

    def minimum(self, objective):
        cost = np.zeros(len(self.low))
        for column, value in objective.items():
            cost[column] = value
        entries = [(i, j, v) for i, (terms, _, _) in enumerate(self.rows) for j, v in terms.items()]
        i, j, v = (np.array(part) for part in zip(*entries, strict=True))
        matrix = coo_array((v, (i, j)), shape=(len(self.rows), len(cost))).tocsr()
        limits = LinearConstraint(matrix, [row[1] for row in self.rows], [row[2] for row in self.rows])
        found = milp(
            cost,
            constraints=limits,
            integrality=self.integer,
            bounds=Bounds(self.low, self.high),
            options={"mip_rel_gap": 1e-9, "time_limit": 120.0},
        )
        if found.status == 1:
            raise TimeoutError
        assert found.status in (0, 2), found.message  # solved, or infeasible
        return math.inf if found.status == 2 else float(found.fun)


def total(*parts):
    """Sum of (factor, terms)."""
    out = {}
    for factor, terms in parts:
        for column, value in terms.items():
            out[column] = out.get(column, 0.0) + factor * value
    return out


class Events:
    """The least delivery time of a small problem."""

    def __init__(self, problem, queues, *, until_s, speeds=None):
        self.f = Flights(problem, speeds=speeds)
        begin = self.f.begin_s
        self.queues = {n: Queue(path, begin) for n, path in queues.items() if self.f.network.stations[n].pads > 0}
        self.until_s = min(until_s, self.f.horizon_s)
        self._known = {}

    def _split(self, piece, arrivals):
        """Cut a piece (off, off, down, down) where its touch-down meets one of some times."""
        t0, t1, a0, a1 = piece
        inside = [a for a in arrivals if a0 + 1e-6 < a < a1 - 1e-6]
        at = [a0, *sorted(inside), a1]
        for low, high in itertools.pairwise(at):
            share = [(a - a0) / (a1 - a0) if a1 > a0 else part for part, a in ((0.0, low), (1.0, high))]
            yield t0 + share[0] * (t1 - t0), t0 + share[1] * (t1 - t0), low, high

    def legs(self, a, b):
        """Rows (off, off, down, down, spot, spot, pad, pad, need, need) from stop to stop, linear between."""
        if (a, b) in self._known:
            return self._known[a, b]
        f, out = self.f, []
        high = 0.0 if f.in_flight and a == f.origin else self.until_s
        longest = (max(1.0, f.soc) - f.reserve) / f.cost
        for walk in f.walks(a, b):
            pieces = f.pieces(walk, 0.0, high) if high else np.array([[0.0, 0.0, *[float(f.land(walk, 0.0))] * 2]])
            for piece in pieces:
                if not math.isfinite(piece[2]) or min(piece[2] - piece[0], piece[3] - piece[1]) > longest:
                    continue
                if piece[2] > self.until_s:
                    continue
                out += list(self._to_goal(piece) if b == f.destination else self._to_stop(piece, b))
        self._known[a, b] = np.array(out).reshape(-1, 10)
        return self._known[a, b]

    def _to_stop(self, piece, b):
        q, reserve = self.queues[b], self.f.reserve
        finite = np.isfinite(q.spot), np.isfinite(q.pad)
        events = np.concatenate((q.others, q.spot[finite[0]], (q.pad - q.delay)[finite[1]]))
        for t0, t1, a0, a1 in self._split(piece, events):
            k = int(q.behind(0.5 * (a0 + a1)))
            spot = max(a0, q.spot[k]), max(a1, q.spot[k])
            pad = max(a0 + q.delay[k], q.pad[k]), max(a1 + q.delay[k], q.pad[k])
            yield (t0, t1, a0, a1, *spot, *pad, reserve, reserve)

    def _to_goal(self, piece):
        f = self.f
        if f.destination in self.queues:
            yield from self._to_stop(piece, f.destination)
            return
        if not f.needs_escape:
            yield (*piece, piece[2], piece[3], 0.0, 0.0, f.reserve, f.reserve)
            return
        for walk in f.escapes:
            for t0, t1, a0, a1 in self._split(piece, f.events(walk) - f.dwell_s):
                inset = 1e-3 * (a1 - a0)
                ends = self._way_on(walk, a0 + inset), self._way_on(walk, a1 - inset)
                if not all(math.isfinite(end) for end in ends):
                    continue
                slope = (ends[1] - ends[0]) / (a1 - a0 - 2.0 * inset) if a1 > a0 else 0.0
                need = (
                    f.reserve + f.empty_cost * (ends[0] - slope * inset),
                    f.reserve + f.empty_cost * (ends[1] + slope * inset),
                )
                yield (t0, t1, a0, a1, a0, a1, 0.0, 0.0, *need)

    def _way_on(self, walk, time):
        f, off = self.f, time + self.f.dwell_s
        while math.isinf(float(f.land(walk, off))):
            if int(f.slot(off)) == f.slots - 1:
                return math.inf
            off = f.first_s + (int(f.slot(off)) + 1) * f.slot_s
        return float(f.land(walk, off)) - off

    def _fly(self, m, rows, off):
        """Choose one piece of a flight; terms of take-off, spot, pad and charge."""
        chosen, times = {}, {}
        lines = [{} for _ in range(4)]
        for t0, t1, *values in rows:
            y, t = m.add(0, 1, integer=True), m.add(0.0)
            lo, hi = t0 / HOUR_S, t1 / HOUR_S
            m.row(total((1.0, t), (-lo, y)), low=0.0)
            m.row(total((1.0, t), (-hi, y)), high=0.0)
            chosen, times = total((1.0, chosen), (1.0, y)), total((1.0, times), (1.0, t))
            units = HOUR_S, HOUR_S, HOUR_S, 1.0
            for number, unit in enumerate(units):
                v0, v1 = values[2 * number] / unit, values[2 * number + 1] / unit
                slope = (v1 - v0) / (hi - lo) if hi > lo and math.isfinite(v0) else 0.0
                at_zero = v0 - slope * lo if math.isfinite(v0) else 0.0
                lines[number] = total((1.0, lines[number]), (slope, t), (at_zero, y))
        m.row(chosen, 1.0, 1.0)
        _, spot, pad, need = lines
        left = total((1.0, off), (-self.f.cost * HOUR_S, spot), (self.f.cost * HOUR_S, times))
        m.row(total((1.0, left), (-1.0, need)), low=0.0)
        return times, spot, pad, left

    def _charge(self, m, node, left, pad, leave):
        """Charge to leave a stop with, landed with `left` and on a pad from `pad` on."""
        curve = self.f.curve(node)
        time, soc = curve.time / HOUR_S, curve.soc
        off, use = m.add(0.0, 1.0), m.add(0, 1, integer=True)
        levels, since, chosen = {}, {}, {}
        for (s0, s1), (u0, u1) in zip(itertools.pairwise(soc), itertools.pairwise(time), strict=True):
            x, s = m.add(0, 1, integer=True), m.add(0.0)
            m.row(total((1.0, s), (-s0, x)), low=0.0)
            m.row(total((1.0, s), (-s1, x)), high=0.0)
            slope = (u1 - u0) / (s1 - s0)
            levels, chosen = total((1.0, levels), (1.0, s)), total((1.0, chosen), (1.0, x))
            since = total((1.0, since), (slope, s), (u0 - slope * s0, x))
        m.row(chosen, 1.0, 1.0)
        m.row(total((1.0, levels), (-1.0, left)), 0.0, 0.0)
        m.row(total((1.0, off), (-1.0, left), (-1.0, use)), high=0.0)  # without a pad: no more than landed with
        m.row(total((1.0, leave), (-1.0, pad), (-BIG, use)), low=-BIG)  # with one: not before it is there
        for (s0, s1), (u0, u1) in zip(itertools.pairwise(soc), itertools.pairwise(time), strict=True):
            slope = (s1 - s0) / (u1 - u0)  # the curve is concave: below every chord's line
            line = total((1.0, off), (-slope, since), (-slope, leave), (slope, pad), (BIG, use))
            m.row(line, high=s0 - slope * u0 + BIG)
        return off

    def _sequence(self, stops, best_s):
        f, m = self.f, Model()
        one = m.add(1.0, 1.0)
        nodes = [f.origin, *stops, f.destination]
        landed, place = total((f.soc, one)), total((0.0, one))
        pad = None
        if f.origin in self.queues and not f.in_flight:
            pad = total((float(self.queues[f.origin].pad_at(0.0)) / HOUR_S, one))
        for a, b in itertools.pairwise(nodes):
            rows = self.legs(a, b)
            if not len(rows):
                return math.inf
            leave = m.add(0.0, self.until_s / HOUR_S)
            off = landed if pad is None else self._charge(m, a, landed, pad, leave)
            times, spot, next_pad, left = self._fly(m, rows, off)
            m.row(total((1.0, leave), (-1.0, times)), 0.0, 0.0)
            m.row(total((1.0, leave), (-1.0, place)), low=0.0)
            landed, place, pad = left, spot, next_pad
        m.row(place, high=(best_s - 1e-3) / HOUR_S)
        return m.minimum(place) * HOUR_S

    def delivery_time_s(self):
        """Least delivery time over all sequences; infinite when none arrives before `until_s`."""
        f = self.f
        others = [n for n in self.queues if n not in (f.origin, f.destination)]
        best = self.until_s
        found = math.inf
        for count in range(len(others) + 1):
            for stops in itertools.permutations(others, count):
                time = self._sequence(stops, best)
                if time < best:
                    best = found = time
        return found
