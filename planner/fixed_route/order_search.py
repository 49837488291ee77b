"""Search for orders of units by adaptive large neighbourhood search over the exact planner of fixed routes.

Some turns are removed and inserted elsewhere, in whichever direction costs least by time and charge of the ways. The end of a new order
is bounded in a millisecond (`charging_stops.least_end`): the search walks through orders on that bound, and an order whose bound is before
the best known end is computed exactly, with shared pads, so that every reported end was planned. The choice of removal methods follows from how
often it helped (Ropke and Pisinger, "An adaptive large neighborhood search heuristic for the pickup and delivery problem with time windows",
Transportation Science 40, 2006).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise, permutations, product
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.charging_stops import charging_stops, least_end
from skyway.planner.fixed_route.sharing import shared

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.planner.fixed_route.orders import FreeOrder

Tours = list[list[int]]
"""Turns of each drone."""
ITERATIONS, FEWEST_ITERATIONS = 1500, 100
MANY_UNITS = 30
"""With more units fewer orders are tried, as each takes longer: reduced by the square of their number. Surveys with so many lines gain little by more:
of 125 lines the end is 2.9 % earlier with 100 iterations, and with 800 3.0 %."""
FEW_ORDERS = 400
"""Up to this number, all orders are evaluated."""
_FEW_OUT, _MOST_OUT = 6, 30
"""Least and greatest number of turns removed at once: all of a short tour, since otherwise there may be no flyable way from one order to another."""
_WARM, _COLD = 0.2, 1e-3
"""Share of the end by which a worse order is taken at first, and at last."""
_REACTION = 0.1
_TIE_S = 1e-6
LOOSER = 3.0
LEAST_GAIN = 1e-4
"""If not all orders are evaluated, an order whose possible gain is a smaller share is not planned."""


@dataclass(frozen=True, slots=True)
class BestOrder:
    """The best order found, and when all of it ends."""

    tours: tuple[tuple[int, ...], ...]
    end_s: float
    """Last end of the plans of its fixed routes; infinite if none was found."""
    looked_at: int
    """Number of bounded orders."""
    planned: int
    """Number of exactly planned orders."""


def best_order(
    work: FreeOrder,
    begin: Tours,
    *,
    keeps_order: bool = False,
    iterations: int | None = None,
    few: int = FEW_ORDERS,
    seed: int = 0,
) -> BestOrder:
    """Search for the order that ends first, starting from an order; `keeps_order`: units are shared among drones, each in the order of `begin`.

    With at most `few` orders, all are evaluated. The same seed gives the same answer.
    """
    if iterations is None:
        share = min(1.0, (MANY_UNITS / max(work.units, 1)) ** 2)
        iterations = max(FEWEST_ITERATIONS, round(share * ITERATIONS))
    return _Search(work, begin, seed, keeps_order=keeps_order).run(iterations, few)


class _Search:
    def __init__(self, work: FreeOrder, begin: Tours, seed: int, *, keeps_order: bool) -> None:
        self.work, self.coarse = work, work.coarse
        self.bounds = work.coarse.least
        self.rng = np.random.default_rng(seed)
        self.keeps_order = keeps_order
        self.way, self.turn = work.way_cost_s, work.turn_cost_s
        self.edge = len(work.turns)
        """Row of the head and column of the tail."""
        self.rank = {turn // 2: number for number, turn in enumerate(turn for tour in begin for turn in tour)}
        self.begin = begin
        self.known: dict[tuple[int, ...], float] = {}
        self.looked_at = self.planned = 0
        self.best: Tours = begin
        self.best_s = math.inf
        self.least_gain_s = _TIE_S

    def run(self, iterations: int, few: int) -> BestOrder:
        """Walk from order to order, with decreasing acceptance of worse ones."""
        now, now_s = self.begin, self._bounded(self.begin)
        self._plan(now, now_s)
        for start in self._starts():
            bound = self._bounded(start)
            self._plan(start, bound)
            if bound < now_s:
                now, now_s = start, bound
        if self._count() <= few:
            for order in sorted(self._all(), key=self._bounded):
                self._plan(order, self._bounded(order))
            return self._answer()
        ways: list[Callable[[Tours, int], list[int]]] = [self._any, self._near, self._dear, self._run]
        weights = np.ones(len(ways))
        scale = max(now_s if math.isfinite(now_s) else float(self.turn[np.isfinite(self.turn)].sum()), 1.0)
        hot = min(_WARM, 3.0 * _WARM / max(self.work.units, 1))
        self.least_gain_s = max(_TIE_S, LEAST_GAIN * scale)
        now_cost = self._cost(now)
        for number in range(iterations if self.work.units > 1 or len(self.begin) > 1 or self._may_turn() else 0):
            warmth = scale * hot * (_COLD / _WARM) ** (number / max(iterations - 1, 1))
            chosen = int(self.rng.choice(len(ways), p=weights / weights.sum()))
            most = min(_MOST_OUT, self.work.units, max(_FEW_OUT, math.ceil(0.4 * self.work.units)))
            out = ways[chosen](now, int(self.rng.integers(1, most + 1)))
            trial = self._put_in([[one for one in tour if one not in out] for tour in now], out)
            if trial == now:
                continue
            cost = self._cost(trial)
            if math.isfinite(cost) and self.rng.random() >= math.exp(min((now_cost - cost) / (LOOSER * warmth), 0.0)):
                weights[chosen] = max(0.1, (1.0 - _REACTION) * weights[chosen])
                continue
            bound = self._bounded(trial)
            score = 0.1
            if self._plan(trial, bound):
                score = 3.0
            elif bound < now_s:
                score = 1.5
            if bound < now_s or (math.isfinite(bound) and self.rng.random() < math.exp((now_s - bound) / warmth)):
                now, now_s, now_cost = trial, bound, cost
            weights[chosen] = max(0.1, (1.0 - _REACTION) * weights[chosen] + _REACTION * score)
        return self._answer()

    def _answer(self) -> BestOrder:
        return BestOrder(tuple(map(tuple, self.best)), self.best_s, self.looked_at, self.planned)

    def _count(self) -> int:
        """Upper bound for the number of orders, with all drones distinct."""
        units, drones = self.work.units, len(self.begin)
        orders = 1 if self.keeps_order else math.factorial(min(units, 20))
        either = 1 if self.keeps_order else 2 ** sum(one is not None for one in self.work.turns[1::2])
        shared = drones**units if self.keeps_order else math.comb(units + drones - 1, drones - 1)
        return orders * either * shared

    def _all(self) -> Iterator[Tours]:
        """Yield every order that the groups allow."""
        units, drones = self.work.units, len(self.begin)
        if self.keeps_order:
            order = [turn for tour in self.begin for turn in tour]
            for by in product(range(drones), repeat=units):
                yield [[turn for turn, one in zip(order, by, strict=True) if one == drone] for drone in range(drones)]
            return
        for units_in_turn in permutations(range(units)):
            for turns in product(*(self._ways_round(2 * unit) for unit in units_in_turn)):
                for cuts in combinations_with_replacement(range(units + 1), drones - 1):
                    tours = [list(turns[a:b]) for a, b in pairwise((0, *cuts, units))]
                    if all(self._in_groups(tour) for tour in tours):
                        yield tours

    def _in_groups(self, tour: Sequence[int]) -> bool:
        groups = [self.work.groups[turn // 2] for turn in tour]
        return groups == sorted(groups)

    def _may_turn(self) -> bool:
        return any(one is not None for one in self.work.turns[1::2]) and not self.keeps_order

    def _bounded(self, tours: Tours) -> float:
        """Bound of the last end, plus a small share of the others, so that of two orders the one with less total work is preferred."""
        self.looked_at += 1
        ends = []
        for tour in tours:
            key = tuple(tour)
            if key not in self.known:
                self.known[key] = least_end(self.bounds.route(tour)) if tour else -math.inf  # that drone stays at home
            if tour:
                ends.append(self.known[key])
        return max(ends) + 1e-3 * sum(ends) / len(tours)

    def _plan(self, tours: Tours, bound: float) -> bool:
        """Plan an order exactly if it may be the best; return whether it is."""
        last = max(self.known[tuple(tour)] for tour in tours)
        if not math.isfinite(bound) or last >= self.best_s - self.least_gain_s:
            return False
        self.planned += 1
        routes = [self.coarse.route(tour) for tour in tours if tour]
        if len(routes) == 1:
            plan = charging_stops(routes[0], below_s=self.best_s)
            ends = math.inf if plan is None else plan.end_s
        else:
            plans = shared(routes, self.work.counts, below_s=self.best_s)
            ends = math.inf if plans is None else max(plan.end_s for plan in plans)
        if ends >= self.best_s - _TIE_S:
            return False
        self.best, self.best_s = tours, ends
        return True

    def _starts(self) -> list[Tours]:
        """Initial orders: units inserted one by one if they cost least, the most expensive first and at random."""
        turns = [turn for tour in self.begin for turn in tour]
        far = sorted(turns, key=lambda turn: -float(self.way[self.edge, turn]))
        empty: Tours = [[] for _ in self.begin]
        return [self._put_in(empty, order, mixed=False) for order in (far, list(reversed(far)))]

    # removal

    def _any(self, tours: Tours, count: int) -> list[int]:
        turns = [turn for tour in tours for turn in tour]
        return [turns[one] for one in self.rng.permutation(len(turns))[:count].tolist()]

    def _near(self, tours: Tours, count: int) -> list[int]:
        """Remove a unit and those to which its ways are short."""
        turns = np.array([turn for tour in tours for turn in tour])
        here = int(self.rng.choice(turns))
        away = np.minimum(self.way[here, turns], self.way[turns, here])
        away[turns == here] = -math.inf
        return [int(one) for one in turns[np.argsort(away, kind="stable")[:count]]]

    def _dear(self, tours: Tours, count: int) -> list[int]:
        """Remove mostly the turns with the highest cost at their place."""
        costs: list[tuple[float, int]] = []
        for tour in tours:
            around = [self.edge, *tour, self.edge]
            for before, turn, after in zip(around, tour, around[2:], strict=False):
                saved = self.way[before, turn] + self.way[turn, after] - self.way[before, after]
                costs.append((float(saved) * float(self.rng.uniform(0.6, 1.4)), turn))
        return [turn for _, turn in sorted(costs, reverse=True)[:count]]

    def _run(self, tours: Tours, count: int) -> list[int]:
        """Remove a run of one tour."""
        tour = tours[int(self.rng.integers(len(tours)))]
        if not tour:
            return self._any(tours, count)
        begin = int(self.rng.integers(len(tour)))
        return tour[begin : begin + count]

    # insertion

    def _put_in(self, tours: Tours, out: Sequence[int], *, mixed: bool = True) -> Tours:
        """Insert turns one after the other, each where it costs least; costs are randomised, and long tours are penalised."""
        found = [list(tour) for tour in tours]
        order = [out[one] for one in self.rng.permutation(len(out)).tolist()] if mixed else list(out)
        blur = float(self.rng.choice([0.0, 0.0, 0.1, 0.3, 1.0])) if mixed else 0.0
        weight = float(self.rng.choice([0.0, 0.3, 1.0])) if mixed else 1.0
        loads = [self._load(tour) for tour in found]
        for turn in order:
            best = (math.inf, 0, 0, turn)
            for number, tour in enumerate(found):
                for way_round in self._ways_round(turn):
                    cost = self._costs(tour, way_round) + self.turn[way_round]
                    if len(found) > 1:
                        longer = np.maximum(loads[number] + cost - min(loads), 0.0)
                        cost = (cost if weight < 1.0 else 0.2 * cost) + (weight * longer if weight else 0.0)
                    if blur:
                        cost = cost * self.rng.uniform(1.0 - blur, 1.0 + blur, len(cost))
                    place = int(np.argmin(cost))
                    if cost[place] < best[0]:
                        best = (float(cost[place]), number, place, way_round)
            _, number, place, way_round = best
            found[number].insert(place, way_round)
            loads[number] = self._load(found[number])
        return found

    def _cost(self, tours: Tours) -> float:
        """Return the cost of the ways alone, which is fast: a worse order is usually rejected by it already (delayed acceptance)."""
        loads = [self._load(tour) for tour in tours if tour]
        return max(loads) + 1e-3 * sum(loads)

    def _load(self, tour: Sequence[int]) -> float:
        way = [self.edge, *tour, self.edge]
        ways = float(self.way[way[:-1], way[1:]].sum())
        return ways + float(self.turn[list(tour)].sum()) if tour else ways

    def _ways_round(self, turn: int) -> list[int]:
        unit = turn // 2
        if self.keeps_order or self.work.turns[2 * unit + 1] is None:
            return [2 * unit]
        return [2 * unit, 2 * unit + 1]

    def _costs(self, tour: Sequence[int], turn: int) -> NDArray[np.float64]:
        """Return the cost of a turn at each place of a tour; infinite if it is not allowed there."""
        before, after = np.array([self.edge, *tour]), np.array([*tour, self.edge])
        cost = np.asarray(self.way[before, turn] + self.way[turn, after] - self.way[before, after])
        cost = np.where(np.isnan(cost), math.inf, cost)
        if self.keeps_order:
            ranks = np.array([self.rank[one // 2] for one in tour])
            only = int(np.searchsorted(ranks, self.rank[turn // 2]))
            return np.where(np.arange(len(cost)) == only, cost, math.inf)
        groups = np.array([self.work.groups[one // 2] for one in tour])
        mine = self.work.groups[turn // 2]
        first, last = np.searchsorted(groups, mine, side="left"), np.searchsorted(groups, mine, side="right")
        at = np.arange(len(cost))
        return np.where((at >= first) & (at <= last), cost, math.inf)
