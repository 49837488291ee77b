"""Look-ahead kernels of the forward search: stations in reach, and their rank.

Times of flights are means over the members that can fly at once, charges are what all but a share epsilon of the
members need (`planner.lookahead.flight_kernels`). A flight over a segment is made at the first time t at which the
charge is enough:

    soc(t) >= charge(t) + reserve

`earliest` solves this in the wind of about now, `held` waits for another wind; `rank` and `beyond` are line 12 of
Algorithm 1 of Shahzaad, Bouguettaya and Mistry (ICWS 2021), and the functions with "bound" in their names are never
above them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from skyway.models.flight.kernels import NEVER, slot_end, slot_of
from skyway.models.jit.compiled import compiled_lean
from skyway.planner.lookahead.flight_kernels import (
    CHARGE,
    KNOWN,
    LONGEST,
    MEAN,
    Need,
    Ways,
    flight_lookahead,
    least_time,
    lower_time,
    mean_flight,
)
from skyway.planner.schedule.profile_kernels import interpolate

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAX_HOLD_S = 24 * 3600.0
"""How long a drone is held on the ground for wind that brings a station into reach."""
LAST_RESORT_S = 1e12
"""Rank of a station beyond which nothing is in reach at the moment: after all others, but not left out."""
FLIGHTS, MISSING = range(2)
"""Entries of `World.tally`: flights evaluated, and the node whose waits are requested but not yet forecast."""
_ROUNDS = 20  # the charge needed depends on when the drone leaves, and that on the charge


class Graph(NamedTuple):
    """The network as kernels read it, with chargers and expected waits."""

    first: NDArray[np.int64]
    head: NDArray[np.int64]
    """Segments that leave node n are ``first[n] : first[n + 1]``; where each leads."""
    stops: NDArray[np.bool_]
    """Shape (nodes,). Where a drone can recharge."""
    curve_of: NDArray[np.int64]
    """Shape (nodes,). Charging curve of each node."""
    curve_s: NDArray[np.float64]
    curve_soc: NDArray[np.float64]
    """Shape (curves, points) each. Charging curves; rows padded by repeating the last point."""
    wait_start_s: float
    wait_step_s: float
    """Grid of the waits."""
    wait_s: NDArray[np.float64]
    """Shape (nodes, times). Expected waits, filled where `wait_known`."""
    wait_known: NDArray[np.bool_]
    """Shape (nodes,). Which rows are filled."""


class Policy(NamedTuple):
    """Rules of a search for evaluating and charging."""

    full: bool
    """Each charge goes to 100 %, otherwise to what the next flight needs."""
    reserve: float
    """No landing below this charge."""
    factor: float
    """What a second of the remaining flight counts in the look-ahead."""


class World(NamedTuple):
    """All that a look-ahead reads."""

    ways: Ways
    direct: Ways
    """The segments, and straight flights from each node to the destination."""
    graph: Graph
    need: Need
    policy: Policy
    tally: NDArray[np.int64]
    """Shape (2,). See the entries' names in this module."""
    bound: NDArray[np.float64]
    """Shape (most segments that leave a node,). Working space."""


class Stand(NamedTuple):
    """A drone on the ground: where, since when, with which charge, and when it comes onto a pad (infinite: never)."""

    node: int
    time_s: float
    soc: float
    pad_s: float


class Flight(NamedTuple):
    """A flight that can be made."""

    leave_s: float
    """Earliest take-off that keeps the reserve; infinite where there is none."""
    charge: float
    """SoC that it takes in all but a share epsilon of the members."""
    mean_s: float
    """Expected time from take-off to touch-down."""
    charge_to: float
    """SoC to charge to before; NaN where the drone leaves as it is."""
    soc: float
    """SoC on landing in all but a share epsilon of the members."""


@compiled_lean
def wait_at(world: World, node: int, time_s: float) -> float:
    """Expected wait of an arrival, s, linear between grid points.

    NaN, and a note in the tally, where it is not known yet.
    """
    graph = world.graph
    if not graph.wait_known[node]:
        world.tally[MISSING] = node
        return math.nan
    x = (time_s - graph.wait_start_s) / graph.wait_step_s
    last = graph.wait_s.shape[1] - 1
    k = min(max(int(math.floor(x)), 0), last)
    wait: float = graph.wait_s[node, k]
    if 0.0 < x < last:
        wait += (x - k) * (graph.wait_s[node, k + 1] - wait)
    return wait


@compiled_lean
def charge_time(world: World, node: int, soc_from: float, soc_to: float) -> float:
    """Time on a pad of a node from one charge to a higher one; 0 where none is needed."""
    if soc_to <= soc_from:
        return 0.0
    curve = world.graph.curve_of[node]
    # F^-1(to) - F^-1(from), F the charging curve from empty.
    time, soc = world.graph.curve_s[curve], world.graph.curve_soc[curve]
    return interpolate(min(soc_to, 1.0), soc, time) - interpolate(max(soc_from, 0.0), soc, time)


@compiled_lean
def expected_flight(world: World, segment: int, time_s: float) -> tuple[float, float]:
    """Mean time, s, and charge of a flight over a segment from a time on; see `flight_lookahead`."""
    world.tally[FLIGHTS] += 1
    table, need, node = world.ways.table, world.need, world.graph.head[segment]
    slot = slot_of(world.ways.air, time_s)
    if slot < len(table) and table[slot, segment, KNOWN] > 0.0 and not (node == need.destination and need.needs_escape):
        longest = table[slot, segment, LONGEST]
        if longest > 0.0 and time_s + longest <= slot_end(world.ways.air, slot):  # the usual case, without a call
            return table[slot, segment, MEAN], table[slot, segment, CHARGE]
    mean, charge, _ = flight_lookahead(world.ways, need, segment, node, time_s)
    return mean, charge


@compiled_lean
def earliest(world: World, stand: Stand, segment: int) -> Flight:
    """Earliest flight over a segment in the wind of that time, after charging to full or to what it needs.

    What it needs depends on when it leaves, and that on what it needs: from t_0 = now, t_(k+1) = pad time + F^-1(c_k +
    reserve) - F^-1(soc), c_k the greatest charge(t_i) for i <= k, until t no longer grows.

    Takes a segment that begins where the drone stands, a finite time and a charge from 0 to 1.
    """
    full, reserve, pad, soc = world.policy.full, world.policy.reserve, stand.pad_s, stand.soc
    none = Flight(NEVER, NEVER, NEVER, math.nan, 0.0)
    # With the charge as it is or, where it charges to full, full.
    leave, have, to = stand.time_s, soc, math.nan
    if full and pad < NEVER:
        leave = pad + charge_time(world, stand.node, soc, 1.0) if soc < 1.0 else leave
        have = to = 1.0
    mean, charge = expected_flight(world, segment, leave)
    if charge <= have - reserve:
        return Flight(leave, charge, mean, to, have - charge)
    if pad == NEVER or full:
        return none
    # Charged to what the flight needs: t_(k+1) from c_k.
    for _ in range(_ROUNDS):
        if charge > 1.0 - reserve:
            break
        later = pad + charge_time(world, stand.node, soc, charge + reserve)
        if later <= leave + 1e-3:
            break
        leave = later
        mean, again = expected_flight(world, segment, leave)
        charge = max(charge, again)
    if charge > 1.0 - reserve:
        return none
    leave = pad + charge_time(world, stand.node, soc, charge + reserve)
    return Flight(leave, charge, mean, charge + reserve, reserve)


@compiled_lean
def held(world: World, stand: Stand, segment: int) -> Flight:
    """Earliest flight with a full battery (or, without a pad, with what there is) after waiting for better wind.

    From when it is charged, slot by slot, the first beginning with charge(t) <= soc - reserve, within `MAX_HOLD_S`;
    then, by bisection to half a second, the earliest such time in the slot before, for a flight may reach into the
    better slot.

    Takes what `earliest` takes.
    """
    pad, air = stand.pad_s, world.ways.air
    ready, limit = stand.time_s, stand.soc - world.policy.reserve
    if pad < NEVER:
        ready, limit = pad + charge_time(world, stand.node, stand.soc, 1.0), 1.0 - world.policy.reserve
    # Slot by slot.
    before, leave = ready, ready
    mean, charge = expected_flight(world, segment, leave)
    while charge > limit:
        before = leave
        leave = slot_end(air, slot_of(air, leave))
        if leave == NEVER or leave > ready + MAX_HOLD_S:
            return Flight(NEVER, NEVER, NEVER, math.nan, 0.0)
        mean, charge = expected_flight(world, segment, leave)
    while leave - before > 0.5:  # towards the earliest such time, which lies within the slot before
        middle = 0.5 * (before + leave)
        if expected_flight(world, segment, middle)[1] <= limit:
            leave = middle
        else:
            before = middle
    mean, charge = expected_flight(world, segment, leave)
    return Flight(leave, charge, mean, 1.0 if pad < NEVER else math.nan, (1.0 if pad < NEVER else stand.soc) - charge)


@compiled_lean
def _bounds_beyond(world: World, node: int, came_from: int, time_s: float) -> float:
    """Bound what `beyond` adds up for each segment that leaves a station, from what is tabled; returns the least.

    For station m: (mean flight, or that at the greatest ground speed) + factor * (lower bound of m's straight flight) + (wait
    at m for the earliest end, where known). Written to `world.bound`, infinite where m does not count.
    """
    graph, need, factor = world.graph, world.need, world.policy.factor
    table, air, direct = world.ways.table, world.ways.air, world.direct
    slot = slot_of(air, time_s)
    left = slot_end(air, slot) - time_s
    begin, least, bound = graph.first[node], NEVER, world.bound
    for row in range(graph.first[node + 1] - begin):
        segment, other = begin + row, graph.head[begin + row]
        bound[row] = NEVER
        if other == came_from or not (other == need.destination or graph.stops[other]):
            continue
        known = slot < len(table) and 0.0 < table[slot, segment, LONGEST] <= left
        flight = table[slot, segment, MEAN] if known else least_time(air, segment)
        bound[row] = flight
        if other != need.destination:
            there = time_s + flight
            rest = lower_time(direct, slot_of(air, there), other) if known else least_time(direct.air, other)
            bound[row] += factor * rest
            if graph.wait_known[other]:  # who arrives later is not served earlier
                bound[row] += wait_at(world, other, there)
        least = min(least, bound[row])
    return least


@compiled_lean
def beyond(world: World, node: int, came_from: int, time_s: float) -> tuple[float, float]:
    """Look from a station to the next-to-adjacent ones (Algorithm 1, line 12).

    Returns
    -------
    time_s : float
        Least of E[flight node to m] + E[wait at m] + factor E[flight m to destination], over stations m in reach of a
        full battery; infinite where there is none, NaN where a wait is not known yet.
    charge : float
        Charge that the flight to that m takes.
    """
    graph, need, factor = world.graph, world.need, world.policy.factor
    begin = graph.first[node]
    best, charge, bound = NEVER, NEVER, world.bound
    if _bounds_beyond(world, node, came_from, time_s) == NEVER:
        return best, charge
    while True:  # in the order of the bounds, so that few are computed
        # The station of least bound; when that is no less than the best so far, nothing is.
        row = 0
        for k in range(graph.first[node + 1] - begin):
            row = k if bound[k] < bound[row] else row
        if bound[row] >= best:
            return best, charge
        bound[row] = NEVER
        segment, other = begin + row, graph.head[begin + row]
        # Is it in reach of a full battery, and how long does it take from there?
        mean, taken = expected_flight(world, segment, time_s)
        if taken > 1.0 - world.policy.reserve:
            continue
        total = mean
        if other != need.destination:
            there = time_s + mean
            total += wait_at(world, other, there)
            if math.isnan(total):
                return math.nan, math.nan
            if total + factor * lower_time(world.direct, slot_of(world.direct.air, there), other) >= best:
                continue
            total += factor * mean_flight(world.direct, need, other, there)
        if total < best:
            best, charge = total, taken


@compiled_lean
def rank_bound(world: World, node: int, came_from: int, now_s: float, arrive_s: float, soc: float) -> float:
    """Bound a rank from below, from the tables alone.

    Arguments as of `rank`; what is unknown yet (the wait, and with it all that follows) is omitted.
    """
    leave = arrive_s
    if world.graph.wait_known[node]:
        leave += wait_at(world, node, arrive_s)
    elif not world.policy.full:
        return leave - now_s
    if world.policy.full:
        leave += charge_time(world, node, soc, 1.0)
    if not world.graph.wait_known[node]:
        return leave - now_s
    ahead = _bounds_beyond(world, node, came_from, leave)
    return leave + min(ahead, LAST_RESORT_S) - now_s


@compiled_lean
def rank(world: World, node: int, came_from: int, now_s: float, arrive_s: float, soc: float) -> float:
    """Time of Algorithm 1, line 12: to a station, there, and beyond it, s; NaN where a wait is not known yet.

    rank = (arrive - now) + wait + recharge + beyond, where `beyond` begins after the wait (and after a full charge) and
    the recharge is to 100 % or to what the flight beyond takes with the reserve. A station with nothing beyond it comes
    after all others.

    `node` is the station, `came_from` the one before, `now_s` the time there, `arrive_s` and `soc` the landing at
    `node`.
    """
    # Wait and, where each charge goes to 100 %, recharge.
    leave = arrive_s + wait_at(world, node, arrive_s)
    if math.isnan(leave):
        return leave
    if world.policy.full:
        leave += charge_time(world, node, soc, 1.0)
    # Beyond, and the charge for just that.
    ahead, charge = beyond(world, node, came_from, leave)
    if ahead == NEVER:
        return LAST_RESORT_S + leave - now_s
    if not world.policy.full:
        leave += charge_time(world, node, soc, charge + world.policy.reserve)
    return leave + ahead - now_s
