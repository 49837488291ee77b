"""Kernel of the forward search: depth first, best first; candidates are evaluated as late as possible.

The path is a stack of frames, one a station. From the last one the search goes on to the neighbour n of least rank

    rank(n) = flight to n + wait there + recharge + min over stations m beyond n of
              (flight n to m + wait at m + factor * straight flight from m to the destination)

(all expected; `planner.lookahead.lookahead_kernels.rank`), and to the destination as soon as it is in reach. A station
without candidates is a dead end: it is remembered with its time, and the search goes back.

A rank is expensive to compute, so each candidate has a key that is first a bound from below: by its distance, by its
flight, by the tabled flights beyond it, and at last the rank itself. Only the candidate of least key is evaluated
further; when the least key is a rank, it is the least rank (as in branch and bound).

Source: Shahzaad, Bouguettaya and Mistry, "Robust Composition of Drone Delivery Services under Uncertainty", ICWS 2021,
Algorithm 1; what is repaired in it: docs/explanation/planners.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled_lean
from skyway.planner.lookahead.flight_kernels import least_time
from skyway.planner.lookahead.lookahead_kernels import (
    Flight,
    Stand,
    World,
    charge_time,
    earliest,
    held,
    rank,
    rank_bound,
    wait_at,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FOUND, EXHAUSTED, NEEDS_WAITS, DEAD_END = range(4)
"""What `search` returns: the path is in the frames; there is none; the waits of the node in the tally are needed, then
call again; the first dead end has been met, call again to go on."""
_FRESH, _BARE, _OPEN, _HOLDING = range(4)
"""Stages of a frame: candidates not listed yet; those in reach as the drone stands, those in reach after charging,
those that better wind brings into reach."""
_BOUNDED, _EVALUATED, _LOOKED, _RANKED, _PASSED, _USED, _CLOSED = range(7)
"""Stages of a candidate: its key is a bound from its distance; a bound from its flight; a bound from the flights beyond
it too; its rank; it is on the path already; it has been tried or is no place to land; it is out of reach."""
_DESTINATION_KEY = -1.0
_NONE, _UNKNOWN = -1, -2
"""Answers of `_best` that are no segment: there is none left; a wait is not known yet."""


class Frames(NamedTuple):
    """The path searched; frame i is its i-th station. Shape (nodes + 1,) each, `depth` (1,)."""

    node: NDArray[np.int64]
    stage: NDArray[np.int64]
    """Where, and the stage of its candidates."""
    arrive_s: NDArray[np.float64]
    soc: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    """When the drone arrives, with which charge, and when it comes onto a pad (infinite: it cannot charge)."""
    limited: NDArray[np.bool_]
    """Wind or charge closed a way at or beyond this station: only then can an earlier arrival fare better."""
    segment: NDArray[np.int64]
    charge_to: NDArray[np.float64]
    not_before_s: NDArray[np.float64]
    """Leg that led here."""
    depth: NDArray[np.int64]
    """Number of the last frame; -1 before the first."""


class Candidates(NamedTuple):
    """Candidates for the next stop, by segment: as no station is twice on the path, each is a candidate of at most one frame."""

    stage: NDArray[np.int64]
    """Shape (segments,). How far it is evaluated."""
    key: NDArray[np.float64]
    """Shape (segments,). Its rank, or a lower bound, s."""
    leave_s: NDArray[np.float64]
    mean_s: NDArray[np.float64]
    soc: NDArray[np.float64]
    charge_to: NDArray[np.float64]
    """Shape (segments,) each. The flight, see `Flight`."""


class Marks(NamedTuple):
    """Search state of nodes, shape (nodes,)."""

    on_path: NDArray[np.bool_]
    """It is on the path."""
    dead_s: NDArray[np.float64]
    """Whoever arrives then or later finds a dead end; infinite where none is known."""
    closed: NDArray[np.bool_]
    """Wind or charge closed a way out of it."""
    dead_ends: NDArray[np.int64]
    """Shape (1,). How many have been met."""
    seen: NDArray[np.bool_]
    queue: NDArray[np.int64]
    """Working space."""


class Start(NamedTuple):
    """Start of a search."""

    node: int
    """Node of the drone."""
    time_s: float
    soc: float
    """When, and with which charge."""
    in_flight: bool
    """The drone can neither wait nor charge there."""


@compiled_lean
def search(world: World, start: Start, frames: Frames, candidates: Candidates, marks: Marks) -> int:
    """Continue the search from the current frames; see the names of the answers.

    Exponential in the number of stations at worst; dead ends, which are remembered, and `_leave_cut_off` keep it far
    from that.

    Takes a world, frames and marks as `planner.lookahead` lays them out: as many frames as stops at most, one mark a
    node.
    """
    # The first call: the path is the start.
    if frames.depth[0] < 0:
        frames.depth[0] = 0
        _enter(frames, 0, start.node, start.time_s, start.soc)
        marks.on_path[start.node] = True
    while True:
        f = frames.depth[0]
        # The candidate of least rank; if a wait is unknown, it is requested and the search resumes here.
        if frames.stage[f] == _FRESH and not _list(world, start, frames, f, candidates):
            return NEEDS_WAITS
        chosen = _best(world, frames, f, candidates, marks)
        if chosen == _UNKNOWN:
            return NEEDS_WAITS
        # None left: hold for better wind once, then give the station up as a dead end.
        if chosen == _NONE:
            if frames.stage[f] != _HOLDING and not (f == 0 and start.in_flight):
                _list_held(world, frames, f, candidates, marks)
                continue
            first = marks.dead_ends[0] == 0
            _leave(frames, f, marks)
            _leave_cut_off(world, frames, marks)
            if frames.depth[0] < 0:
                return EXHAUSTED
            if first:
                return DEAD_END
            continue
        # Go on to it.
        candidates.stage[chosen] = _USED
        node = world.graph.head[chosen]
        arrive = candidates.leave_s[chosen] + candidates.mean_s[chosen]
        _enter(frames, f + 1, node, arrive, max(candidates.soc[chosen], 0.0))
        frames.segment[f + 1], frames.charge_to[f + 1] = chosen, candidates.charge_to[chosen]
        frames.not_before_s[f + 1] = candidates.leave_s[chosen] if frames.stage[f] == _HOLDING else -NEVER
        frames.depth[0] = f + 1
        marks.on_path[node] = True
        if node == world.need.destination:
            return FOUND


@compiled_lean
def _enter(frames: Frames, f: int, node: int, arrive_s: float, soc: float) -> None:
    """Begin frame f: at `node` from `arrive_s` on, with charge `soc`."""
    frames.node[f], frames.stage[f], frames.arrive_s[f], frames.soc[f] = node, _FRESH, arrive_s, soc
    frames.limited[f] = False


@compiled_lean
def _leave(frames: Frames, f: int, marks: Marks) -> None:
    """Give up a frame: its station is a dead end.

    Where neither wind nor charge closed a way, an earlier arrival would fare no better: it is one at any time.
    """
    node = frames.node[f]
    limited = frames.limited[f] or marks.closed[node]
    marks.on_path[node] = False
    marks.dead_s[node] = frames.arrive_s[f] if limited else -NEVER
    marks.dead_ends[0] += 1
    if f > 0:
        frames.limited[f - 1] |= limited
    frames.depth[0] = f - 1


@compiled_lean
def _leave_cut_off(world: World, frames: Frames, marks: Marks) -> None:
    """Give up the frames at the end of the path from which no chain of open stations leads to the destination any more.

    All their remaining options end in stations that are on the path or dead. As that does not depend on time, whoever
    comes to such a station earlier, on another path, may try again, and the frames below do not count as limited by it.
    """
    graph, need = world.graph, world.need
    seen = marks.seen
    seen[:] = False
    size = 0
    while frames.depth[0] >= 0:
        f = frames.depth[0]
        # Flood from the last station over open ones; where that reaches the destination, there is still a way.
        marks.queue[0] = frames.node[f]
        size = 1
        while size > 0:
            size -= 1
            node = marks.queue[size]
            for segment in range(graph.first[node], graph.first[node + 1]):
                other = graph.head[segment]
                if other == need.destination:
                    return
                blocked = marks.on_path[other] or marks.dead_s[other] == -NEVER or not graph.stops[other]
                if not blocked and not seen[other]:
                    seen[other] = True
                    marks.queue[size] = other
                    size += 1
        # No way: give the frame up, and try from the one before.
        node = frames.node[f]
        marks.on_path[node] = False
        marks.dead_s[node] = frames.arrive_s[f]
        marks.dead_ends[0] += 1
        frames.depth[0] = f - 1


@compiled_lean
def _stand(frames: Frames, f: int) -> Stand:
    """Where the drone is in a frame, and whether it may charge there."""
    pad = NEVER if frames.stage[f] == _BARE else frames.pad_s[f]
    return Stand(frames.node[f], frames.arrive_s[f], frames.soc[f], pad)


@compiled_lean
def _list(world: World, start: Start, frames: Frames, f: int, candidates: Candidates) -> bool:
    """List the candidates of a fresh frame; false where the wait there is not known yet.

    The drone may charge from its arrival plus the expected wait on, but nowhere without pads and not where it starts in
    flight.
    """
    node, graph = frames.node[f], world.graph
    frames.pad_s[f] = NEVER
    if graph.stops[node] and not (f == 0 and start.in_flight):
        wait = wait_at(world, node, frames.arrive_s[f])
        if math.isnan(wait):
            return False
        frames.pad_s[f] = frames.arrive_s[f] + wait
    if f == 0 and world.policy.full:  # leave as it is, if that reaches any station at all
        frames.stage[f] = _BARE
        _list_bounds(world, _stand(frames, f), candidates)
        for segment in range(graph.first[node], graph.first[node + 1]):
            if candidates.stage[segment] == _BOUNDED:
                _evaluate(world, frames, f, candidates, segment)
                if candidates.stage[segment] != _CLOSED:
                    return True
    frames.stage[f] = _OPEN
    _list_bounds(world, _stand(frames, f), candidates)
    return True


@compiled_lean
def _list_bounds(world: World, stand: Stand, candidates: Candidates) -> None:
    """List the segments that leave a station, with bounds from their lengths.

    key = (earliest take-off - now) + T + D, T the time of a flight over the segment at the greatest ground speed and D
    that of a straight flight on to the destination. The earliest take-off is after a full charge or, where just enough
    is charged, after what T needs at least.
    """
    need, policy, air = world.need, world.policy, world.ways.air
    charged = stand.time_s
    if policy.full and stand.pad_s < NEVER and stand.soc < 1.0:
        charged = stand.pad_s + charge_time(world, stand.node, stand.soc, 1.0)
    for segment in range(world.graph.first[stand.node], world.graph.first[stand.node + 1]):
        other = world.graph.head[segment]
        candidates.stage[segment] = _BOUNDED
        if other == need.destination:
            candidates.key[segment] = _DESTINATION_KEY
        elif world.graph.stops[other]:
            least = least_time(air, segment)
            # Rounded down, so that rounding never makes the bound too high.
            lacks = (1.0 - 1e-9) * (need.soc_fixed + need.soc_per_s * least + policy.reserve)
            leave = charged
            if not policy.full and lacks > stand.soc and stand.pad_s < NEVER:
                leave = stand.pad_s + charge_time(world, stand.node, stand.soc, lacks)
            candidates.key[segment] = leave - stand.time_s + least + least_time(world.direct.air, other)
        else:
            candidates.stage[segment] = _USED


@compiled_lean
def _list_held(world: World, frames: Frames, f: int, candidates: Candidates, marks: Marks) -> None:
    """List the stations that better wind brings into reach while the drone waits, charged."""
    node, graph = frames.node[f], world.graph
    # What was skipped is no longer a candidate; whether it was closed decides about the dead end.
    for segment in range(graph.first[node], graph.first[node + 1]):
        if candidates.stage[segment] == _PASSED:  # no need to hold for it, but is it in reach?
            _evaluate(world, frames, f, candidates, segment)
            marks.closed[node] |= candidates.stage[segment] == _CLOSED
            candidates.stage[segment] = _USED
    frames.stage[f] = _HOLDING
    # What is out of reach now: the first flight in better wind.
    for segment in range(graph.first[node], graph.first[node + 1]):
        if candidates.stage[segment] == _CLOSED:
            marks.closed[node] = True
            stand = _stand(frames, f)
            _put(world, stand, candidates, segment, held(world, stand, segment))


@compiled_lean
def _evaluate(world: World, frames: Frames, f: int, candidates: Candidates, segment: int) -> None:
    """Compute the flight of a candidate."""
    stand = _stand(frames, f)
    _put(world, stand, candidates, segment, earliest(world, stand, segment))


@compiled_lean
def _put(world: World, stand: Stand, candidates: Candidates, segment: int, flight: Flight) -> None:
    """Note the flight of a candidate, and the bound of its rank that follows from it.

    key = (touch-down - now) + straight flight on at the greatest ground speed + what is known of the stop: its wait,
    and a full charge.
    """
    if flight.leave_s == NEVER:
        candidates.stage[segment] = _CLOSED
        return
    candidates.leave_s[segment], candidates.mean_s[segment] = flight.leave_s, flight.mean_s
    candidates.soc[segment], candidates.charge_to[segment] = flight.soc, flight.charge_to
    other = world.graph.head[segment]
    if other == world.need.destination:
        candidates.stage[segment], candidates.key[segment] = _RANKED, _DESTINATION_KEY
        return
    arrive = flight.leave_s + flight.mean_s
    bound = arrive - stand.time_s + least_time(world.direct.air, other)
    if world.graph.wait_known[other]:
        bound += wait_at(world, other, arrive)
    if world.policy.full:
        bound += charge_time(world, other, flight.soc, 1.0)
    candidates.stage[segment], candidates.key[segment] = _EVALUATED, bound


@compiled_lean
def _turned_away(marks: Marks, node: int, candidates: Candidates, segment: int) -> bool:
    """Return whether a candidate is on the path already or known to be a dead end, whatever its rank."""
    if marks.on_path[node] or marks.dead_s[node] == -NEVER:
        return True
    if candidates.stage[segment] == _BOUNDED:
        return False
    late: bool = candidates.leave_s[segment] + candidates.mean_s[segment] >= marks.dead_s[node]
    return late


@compiled_lean
def _best(world: World, frames: Frames, f: int, candidates: Candidates, marks: Marks) -> int:
    """Candidate of least rank, each judged only as far as it takes to know it."""
    node, graph = frames.node[f], world.graph
    while True:
        # The candidate of least key; if that is a rank, the answer.
        least, best = NEVER, _NONE
        for segment in range(graph.first[node], graph.first[node + 1]):
            if candidates.stage[segment] <= _RANKED and candidates.key[segment] < least:
                least, best = candidates.key[segment], segment
        if best == _NONE or candidates.stage[best] == _RANKED:
            return best
        # On the path or dead: skipped, whatever its rank.
        other = graph.head[best]
        if _turned_away(marks, other, candidates, best):
            candidates.stage[best] = _PASSED
            frames.limited[f] |= math.isfinite(marks.dead_s[other])
            continue
        # Else one step of evaluation: flight, flights beyond, rank.
        if candidates.stage[best] == _BOUNDED:
            _evaluate(world, frames, f, candidates, best)
            continue
        arrive = candidates.leave_s[best] + candidates.mean_s[best]
        if candidates.stage[best] == _EVALUATED:
            bound = rank_bound(world, other, node, frames.arrive_s[f], arrive, candidates.soc[best])
            candidates.stage[best], candidates.key[best] = _LOOKED, max(candidates.key[best], bound)
            continue
        key = rank(world, other, node, frames.arrive_s[f], arrive, candidates.soc[best])
        if math.isnan(key):
            return _UNKNOWN
        candidates.stage[best], candidates.key[best] = _RANKED, key
