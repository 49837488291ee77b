"""Compiled expectations over the forecast: how long a flight takes, and what charge it needs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.compiled import compiled
from models.flight_kernels import NEVER, leg, segment_speed, slot_end, slot_of
from planner.profile_kernels import interpolate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.flight import Air


class Need(NamedTuple):
    """What decides whether a flight can be made.

    Attributes
    ----------
    soc_per_s, soc_fixed : float
        Cost of a flight with the package.
    empty_per_s, empty_fixed : float
        Cost of a flight without it.
    epsilon : float
        Share of the members that may need more.
    destination : int
        Node where the package is left.
    escapes : ndarray of int
        Segments of the flight on from a destination without pads; empty where none is needed.
    needs_escape : bool
        Whether one is needed.
    """

    soc_per_s: float
    soc_fixed: float
    empty_per_s: float
    empty_fixed: float
    epsilon: float
    destination: int
    escapes: NDArray[np.int64]
    needs_escape: bool


class Speeds(NamedTuple):
    """Ground speeds already worked out, so that a segment met again in the same slot costs nothing.

    Attributes
    ----------
    value : ndarray, shape (slots, segments, members)
        Filled where known; memory that is never touched is never taken.
    known : ndarray of bool, shape (slots, segments)
        Which rows are filled. With no slots, nothing is kept.
    """

    value: NDArray[np.float64]
    known: NDArray[np.bool_]


@compiled
def escape_cost(air: Air, member: int, need: Need, time_s: float) -> float:
    """Least charge that takes the empty drone from the destination to a station; infinite where none is in reach."""
    best = NEVER
    for segment in need.escapes:
        off, down = leg(air, member, segment, time_s)
        if down < NEVER:
            best = min(best, need.empty_fixed + need.empty_per_s * (down - off))
    return best


@compiled
def _row(air: Air, speeds: Speeds, slot: int, segment: int) -> NDArray[np.float64]:
    """Ground speeds of a segment in a slot, shape (members,)."""
    kept = slot < len(speeds.known)
    if kept and speeds.known[slot, segment]:
        return speeds.value[slot, segment]
    members = air.north.shape[0]
    row = speeds.value[slot, segment] if kept else np.empty(members)
    for member in range(members):
        row[member] = segment_speed(air, member, slot, segment)
    if kept:
        speeds.known[slot, segment] = True
    return row


@compiled
def _fly_all(
    air: Air, speeds: Speeds, segment: int, time_s: float, off: NDArray[np.float64], down: NDArray[np.float64]
) -> None:
    """Take-off and touch-down of a one-segment flight in every member, held where the wind asks for it."""
    slot = slot_of(air, time_s)
    end = slot_end(air, slot)
    over = time_s + air.climb_s
    here = _row(air, speeds, slot, segment)
    following = here
    if end < NEVER:
        following = _row(air, speeds, slot + 1, segment)
    later = slot_end(air, slot + 1) if end < NEVER else NEVER
    length = air.distance_m[segment]
    for member in range(air.north.shape[0]):
        speed = here[member]
        if speed > 0.0 and over < end:
            landed = over + length / speed + air.descent_s
            if landed <= end:
                off[member], down[member] = time_s, landed
                continue
            after = following[member]
            left = length - speed * (end - over)
            landed = end + left / after + air.descent_s if after > 0.0 else NEVER
            if left > 0.0 and landed <= later:
                off[member], down[member] = time_s, landed
                continue
        off[member], down[member] = leg(air, member, segment, time_s)


@compiled
def flight_outlook(
    air: Air,
    speeds: Speeds,
    probability: NDArray[np.float64],
    need: Need,
    segment: int,
    node: int,
    time_s: float,
) -> tuple[float, float, float]:
    """Expectation of a one-segment flight to `node` over the forecast.

    Returns
    -------
    mean_s : float
        Mean time from `time_s` to touch-down over the members that can fly at once; over those held by the wind when
        none can; infinite when none ever can.
    charge : float
        SoC that the flight takes (with the escape from the destination) in all but a share epsilon of the members.
    p_hold : float
        Probability that the wind holds it.
    """
    members = len(probability)
    off, down = np.empty(members), np.empty(members)
    _fly_all(air, speeds, segment, time_s, off, down)
    mean, flown, now = _mean(probability, time_s, off, down)
    if flown <= 0.0:
        return NEVER, NEVER, 1.0
    charge = down
    for member in range(members):
        if down[member] < NEVER:
            taken = need.soc_fixed + need.soc_per_s * (down[member] - off[member])
            if node == need.destination and need.needs_escape:
                taken += escape_cost(air, member, need, down[member])
            charge[member] = taken
    return mean, _quantile(charge, probability, flown * (1.0 - need.epsilon) - 1e-12), 1.0 - now / flown


@compiled
def _mean(
    probability: NDArray[np.float64], time_s: float, off: NDArray[np.float64], down: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Mean time to touch-down, and the probability that it is flown at all and that it is flown at once."""
    now_mass = 0.0
    now_sum = 0.0
    held_mass = 0.0
    held_sum = 0.0
    for member in range(len(probability)):
        if down[member] == NEVER:
            continue
        if off[member] <= time_s:
            now_mass += probability[member]
            now_sum += probability[member] * (down[member] - time_s)
        else:
            held_mass += probability[member]
            held_sum += probability[member] * (down[member] - time_s)
    if now_mass > 0.0:
        return now_sum / now_mass, now_mass + held_mass, now_mass
    return (held_sum / held_mass if held_mass > 0.0 else NEVER), held_mass, 0.0


@compiled
def mean_flight(air: Air, speeds: Speeds, probability: NDArray[np.float64], segment: int, time_s: float) -> float:
    """Mean time to touch-down over the members that can fly at once; over all where none can."""
    off, down = np.empty(len(probability)), np.empty(len(probability))
    _fly_all(air, speeds, segment, time_s, off, down)
    return _mean(probability, time_s, off, down)[0]


@compiled
def _quantile(values: NDArray[np.float64], probability: NDArray[np.float64], mass: float) -> float:
    """Least value at or below which at least `mass` lies; infinite values carry none."""
    greatest = -NEVER
    total = 0.0
    lightest = NEVER
    for k in range(len(values)):
        if values[k] < NEVER:
            greatest = max(greatest, values[k])
            total += probability[k]
            lightest = min(lightest, probability[k])
    if total - lightest < mass:  # the usual case: not even the lightest member can be left out
        return greatest
    share = 0.0
    for k in np.argsort(values):
        share += probability[k]
        if share >= mass:
            return values[k]
    return greatest


@compiled
def wait_at(start_s: float, step_s: float, wait_s: NDArray[np.float64], node: int, time_s: float) -> float:
    """Expected wait of an arrival, linear between grid points."""
    x = (time_s - start_s) / step_s
    last = wait_s.shape[1] - 1
    if x <= 0.0:
        return wait_s[node, 0]
    if x >= last:
        return wait_s[node, last]
    k = int(math.floor(x))
    return wait_s[node, k] + (x - k) * (wait_s[node, k + 1] - wait_s[node, k])


class Graph(NamedTuple):
    """The network as kernels read it, and the expected waits at its nodes."""

    first: NDArray[np.int64]
    head: NDArray[np.int64]
    has_pads: NDArray[np.bool_]
    wait_start_s: float
    wait_step_s: float
    wait_s: NDArray[np.float64]


@compiled
def charge_time(curve_s: NDArray[np.float64], curve_soc: NDArray[np.float64], soc_from: float, soc_to: float) -> float:
    """Time on a pad from one charge to a higher one; 0 where none is needed."""
    if soc_to <= soc_from:
        return 0.0
    return interpolate(min(soc_to, 1.0), curve_soc, curve_s) - interpolate(max(soc_from, 0.0), curve_soc, curve_s)


@compiled
def least_time(air: Air, segment: int) -> float:
    """Time of a flight that nothing beats, at the greatest ground speed."""
    return air.climb_s + air.descent_s + air.distance_m[segment] / air.max_ground_speed_mps


@compiled
def _least_beyond(direct: Air, need: Need, node: int, remaining_factor: float) -> float:
    """Lower bound of what `beyond` adds for a next-to-adjacent station."""
    if node == need.destination:
        return 0.0
    return remaining_factor * least_time(direct, node)


@compiled
def beyond(
    air: Air,
    direct: Air,
    speeds: tuple[Speeds, Speeds],
    probability: NDArray[np.float64],
    graph: Graph,
    need: Need,
    node: int,
    came_from: int,
    time_s: float,
    budget: float,
    remaining_factor: float,
) -> tuple[float, float]:
    """Look from a station to the next-to-adjacent ones (Algorithm 1, line 12).

    Returns
    -------
    time_s : float
        Least of E[flight node to m] + E[wait at m] + `remaining_factor` E[flight m to destination], over stations m in
        reach with `budget` of charge; infinite where there is none.
    charge : float
        Charge that the flight to that m takes.
    """
    best, charge = NEVER, NEVER
    for segment in range(graph.first[node], graph.first[node + 1]):
        other = graph.head[segment]
        if other == came_from:
            continue
        if least_time(air, segment) + _least_beyond(direct, need, other, remaining_factor) >= best:
            continue
        mean, taken, _ = flight_outlook(air, speeds[0], probability, need, segment, other, time_s)
        if taken > budget:
            continue
        total = mean
        if other != need.destination:
            there = time_s + mean
            total += wait_at(graph.wait_start_s, graph.wait_step_s, graph.wait_s, other, there)
            total += remaining_factor * mean_flight(direct, speeds[1], probability, other, there)
        if total < best:
            best, charge = total, taken
    return best, charge


LEAVE, CHARGE, MEAN, CHARGE_TO, SOC, RANK, FINAL = range(7)
"""Columns of what `options` returns: take-off, SoC taken, mean time to touch-down, SoC to charge to, SoC on landing,
rank, and 1 where the rank is final or 0 where it is only a lower bound of it."""
LAST_RESORT_S = 1e12
"""Rank of a station beyond which nothing is in reach at the moment: after all others, but not left out."""
_ROUNDS = 20  # the charge needed depends on when the drone leaves, and that on the charge


@compiled
def options(
    air: Air,
    direct: Air,
    speeds: tuple[Speeds, Speeds],
    probability: NDArray[np.float64],
    graph: Graph,
    need: Need,
    node: int,
    state: tuple[float, float, float],
    policy: tuple[bool, float, float],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Evaluate every segment that leaves a station: can it be flown with the reserve now, and how good is it.

    Parameters
    ----------
    node : int
        Where the drone stands.
    state : (time_s, soc, pad_s)
        Since when, with which charge, and when it comes onto a pad (infinite: never).
    policy : (full, reserve, remaining_factor)
        Whether each charge goes to 100 %; the reserve; the factor of the remaining flight, see `beyond`.
    curve_s, curve_soc : ndarray
        Charging curve, taken to be the same at all stations while looking ahead.

    Returns
    -------
    ndarray, shape (segments leaving, 7)
        See the column names of this module. Rank is infinite where the station is out of reach. Ranks are final for
        the best station and all that could have been better; the others' are lower bounds (see `rank`).
    """
    now, soc, pad = state
    full, reserve, factor = policy
    begin, end = graph.first[node], graph.first[node + 1]
    out = np.full((end - begin, 7), NEVER)
    for row in range(end - begin):
        segment = begin + row
        other = graph.head[segment]
        leave = now
        to = math.nan
        if full and pad < NEVER:
            if soc < 1.0:
                leave = pad + charge_time(curve_s, curve_soc, soc, 1.0)
            to = 1.0
        mean, charge, _ = flight_outlook(air, speeds[0], probability, need, segment, other, leave)
        have = 1.0 if full and pad < NEVER else soc
        if charge > have - reserve:
            if pad == NEVER or full:
                continue
            for _ in range(_ROUNDS):
                if charge > 1.0 - reserve:
                    break
                later = pad + charge_time(curve_s, curve_soc, soc, charge + reserve)
                if later <= leave + 1e-3:
                    break
                leave = later
                mean, again, _ = flight_outlook(air, speeds[0], probability, need, segment, other, leave)
                charge = max(charge, again)
            if charge > 1.0 - reserve:
                continue
            leave = pad + charge_time(curve_s, curve_soc, soc, charge + reserve)
            to = charge + reserve
            have = to
        out[row, LEAVE], out[row, CHARGE], out[row, MEAN], out[row, CHARGE_TO] = leave, charge, mean, to
        out[row, SOC] = have - charge
        if other == need.destination:
            out[row, RANK] = -1.0
        elif graph.has_pads[other]:
            # Beyond it lies at least one flight more, towards or to the destination.
            least = min(least_time(direct, other), factor * direct.distance_m[other] / direct.max_ground_speed_mps)
            out[row, RANK] = leave + mean - now + least
    best = NEVER
    for row in np.argsort(out[:, RANK]):
        other = graph.head[begin + row]
        out[row, FINAL] = 1.0
        if out[row, RANK] == NEVER or other == need.destination:
            best = min(best, out[row, RANK])
        elif out[row, RANK] < best:
            arrival = (now, out[row, LEAVE] + out[row, MEAN], out[row, SOC])
            place = (node, other)
            out[row, RANK] = rank(
                air, direct, speeds, probability, graph, need, place, arrival, policy, curve_s, curve_soc
            )
            best = min(best, out[row, RANK])
        else:
            out[row, FINAL] = 0.0
    return out


@compiled
def rank(
    air: Air,
    direct: Air,
    speeds: tuple[Speeds, Speeds],
    probability: NDArray[np.float64],
    graph: Graph,
    need: Need,
    place: tuple[int, int],
    state: tuple[float, float, float],
    policy: tuple[bool, float, float],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> float:
    """Time of Algorithm 1, line 12: to a station, there, and beyond it; the destination comes before all others."""
    came_from, node = place
    now, arrive, soc = state
    full, reserve, factor = policy
    if node == need.destination:
        return -1.0
    if not graph.has_pads[node]:
        return NEVER
    leave = arrive + wait_at(graph.wait_start_s, graph.wait_step_s, graph.wait_s, node, arrive)
    if full:
        leave += charge_time(curve_s, curve_soc, soc, 1.0)
    ahead, charge = beyond(air, direct, speeds, probability, graph, need, node, came_from, leave, 1.0 - reserve, factor)
    if ahead == NEVER:
        return LAST_RESORT_S + leave - now
    if not full:
        leave += charge_time(curve_s, curve_soc, soc, charge + reserve)
    return leave + ahead - now
