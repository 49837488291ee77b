"""Kernels of expected flight times and required charges over a forecast.

A flight that ends in the slot of its departure takes the same time whenever in the slot it leaves, and one that the
wind holds leaves with a later slot. So both are computed once for each segment and slot (`Ways.table`), and only
flights across the end of a slot are flown in every member each time.

With T_m the flight time in member m, of probability p_m: mean = sum p_m T_m / sum p_m over the members that can
fly at once, charge = the (1 - epsilon) quantile of k + c T_m over those that can fly at all, P(hold) = the share of
these that cannot fly at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from skyway.models.flight.kernels import (
    NEVER,
    along_across,
    flyable,
    forward_mps,
    land,
    leg,
    next_flight,
    slot_end,
    slot_of,
)
from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

KNOWN, MEAN, LONGEST, CHARGE, P_HOLD = range(5)
"""Columns of a table of `Ways`: 1 where the row is filled; mean time of the members that can fly at once (where none
can: the mean touch-down, POSIX seconds); the longest such time (0 where none can); charge taken in all but a share
epsilon of the members; probability that the wind holds it."""


class Need(NamedTuple):
    """What decides whether a flight can be made."""

    soc_per_s: float
    soc_fixed: float
    """A flight of T seconds with the package costs ``soc_fixed + soc_per_s * T``."""
    empty_per_s: float
    empty_fixed: float
    """The same on the way on: without it, unless the way on with it is to be sure."""
    epsilon: float
    """Share of the members that may need more."""
    destination: int
    """Node where the package is left."""
    escapes: NDArray[np.int64]
    """Segments of the flights on from a destination without pads, -1 after each flight; empty where none is needed."""
    needs_escape: bool
    """Whether one is needed."""
    dwell_s: float
    """Time from touch-down at the destination to the flight on."""


class Ways(NamedTuple):
    """Possible flights, one for each segment of `air`, with cached results."""

    air: SegmentWind
    """Segments and wind."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    """Shape (slots, sites, members) each. The wind again, in the order in which all members are looked at together."""
    probability: NDArray[np.float64]
    """Shape (members,). Of the members."""
    table: NDArray[np.float64]
    """Shape (slots, segments, 5). See the column names of this module; with no slots, nothing is kept."""
    lower_s: NDArray[np.float64]
    """Shape (slots, segments). The mean time is not below this, whenever in the slot a flight leaves; 0 where it is not
    computed yet."""
    fresh: NDArray[np.float64]
    """Shape (5,). Working space: a row that is not kept."""
    rows: NDArray[np.float64]
    """Shape (rows, members). Working space: wind north and east, ground speed, take-off, touch-down, least and greatest
    speed."""


WORKING_ROWS = 7
"""Rows of working space."""
_NORTH, _EAST, _SPEED, _OFF, _DOWN, _SLOWEST, _FASTEST = range(WORKING_ROWS)
_SLOTS_AHEAD = 4  # in which a flight is looked for bounds of its time
NOWHERE = -1
"""Node of a flight whose end does not matter."""


@compiled
def escape_cost(air: SegmentWind, member: int, need: Need, time_s: float) -> float:
    """Least charge that takes the drone on from the destination to a station; infinite where none is in reach.

    Takes a member of the air and a finite time, that of the touch-down; no escapes cost infinitely much.
    """
    best = NEVER
    begin = 0
    for end in range(len(need.escapes)):
        if need.escapes[end] < 0:
            off, down = next_flight(air, member, need.escapes[begin:end], time_s + need.dwell_s)
            begin = end + 1
            if down < NEVER:
                best = min(best, need.empty_fixed + need.empty_per_s * (down - off))
    return best


@compiled_lean
def _speeds(ways: Ways, slot: int, segment: int, out: NDArray[np.float64]) -> None:
    """Ground speeds of a segment in a slot in every member, m/s: `segment_speed`, all together."""
    air = ways.air
    if air.shut[slot, air.shut_of[segment]]:
        out[:] = 0.0
        return
    north, east = ways.rows[_NORTH], ways.rows[_EAST]
    north[:] = 0.0
    east[:] = 0.0
    for site in range(air.weight.shape[1]):
        weight = air.weight[segment, site]
        site_north, site_east = ways.north[slot, site], ways.east[slot, site]
        for member in range(len(out)):
            north[member] += weight * site_north[member]
            east[member] += weight * site_east[member]
    # The wind triangle of each member.
    cos, sin = air.cos_bearing[segment], air.sin_bearing[segment]
    for member in range(len(out)):
        along, across = along_across(north[member], east[member], cos, sin)
        forward = forward_mps(air.airspeed_mps, across)
        square = north[member] * north[member] + east[member] * east[member]
        flies = flyable(along, forward, square, air.wind_limit_mps)
        out[member] = min(along + forward, air.max_ground_speed_mps) if flies else 0.0


@compiled_lean
def _fill(ways: Ways, need: Need, slot: int, segment: int, row: NDArray[np.float64]) -> None:
    """Fill a row of the table: what holds for every flight that ends in the slot in which it leaves, or is held.

    At ground speed v_m member m takes T_m = climb + descent + d / v_m. The mean is over the members that fly at once,
    sum p_m T_m / sum p_m, or, where none does, that of the touch-downs of those that fly later; the charge is the (1 -
    epsilon) quantile over all that fly at all.
    """
    air, probability = ways.air, ways.probability
    speeds = ways.rows[_SPEED]
    _speeds(ways, slot, segment, speeds)
    charge = ways.rows[_DOWN]
    fixed, length = air.climb_s + air.descent_s, air.distance_m[segment]
    mass = now_sum = longest = held_mass = held_sum = 0.0
    later = slot_end(air, slot)
    for member in range(len(probability)):
        # A member that flies at once.
        if speeds[member] > 0.0:
            spent = fixed + length / speeds[member]
            mass += probability[member]
            now_sum += probability[member] * spent
            longest = max(longest, spent)
            charge[member] = need.soc_fixed + need.soc_per_s * spent
            continue
        charge[member] = NEVER
        # A member whose wind holds it: it leaves with a later slot.
        if later < NEVER:
            off, down = leg(air, member, segment, later)
            if down < NEVER:
                held_mass += probability[member]
                held_sum += probability[member] * down
                charge[member] = need.soc_fixed + need.soc_per_s * (down - off)
    flown = mass + held_mass
    row[KNOWN], row[LONGEST] = 1.0, longest
    if flown <= 0.0:
        row[MEAN], row[CHARGE], row[P_HOLD] = NEVER, NEVER, 1.0
        return
    row[MEAN] = now_sum / mass if mass > 0.0 else held_sum / held_mass
    row[CHARGE] = _quantile(charge, probability, flown * (1.0 - need.epsilon) - 1e-12)
    row[P_HOLD] = 1.0 - mass / flown


@compiled_lean
def lower_time(ways: Ways, slot: int, segment: int) -> float:
    """Lower bound of the mean time of a flight, whenever in the slot it leaves."""
    if slot >= len(ways.lower_s):
        return least_time(ways.air, segment)
    if ways.lower_s[slot, segment] == 0.0:
        ways.lower_s[slot, segment] = _lower(ways, slot, segment)
    return ways.lower_s[slot, segment]


@compiled_lean
def _lower(ways: Ways, slot: int, segment: int) -> float:
    """Work the bound out: the speeds of the slots that a flight may touch are at most each member's fastest.

    A member is sure to fly at once if its slowest speed brings it down in the slots considered. Other members may be
    among those that do: they count where they lower the mean.
    """
    air, probability = ways.air, ways.probability
    speed, slowest, fastest = ways.rows[_SPEED], ways.rows[_SLOWEST], ways.rows[_FASTEST]
    fixed, length, least = air.climb_s + air.descent_s, air.distance_m[segment], least_time(air, segment)
    begin = slot_end(air, slot)
    span = NEVER if begin == NEVER else 0.0
    ahead = 0
    # Least and greatest speed of each member in this slot and the next ones, until they hold twice the least flight.
    _speeds(ways, slot, segment, slowest)
    for member in range(len(speed)):
        fastest[member] = slowest[member]
    while span < 2.0 * least and ahead < _SLOTS_AHEAD:
        ahead += 1
        _speeds(ways, slot + ahead, segment, speed)
        for member in range(len(speed)):
            slowest[member] = min(slowest[member], speed[member])
            fastest[member] = max(fastest[member], speed[member]) if fastest[member] > 0.0 else 0.0
        span = slot_end(air, slot + ahead) - begin
    # The members that are sure to fly at once, each at its fastest.
    mass = total = 0.0
    for member in range(len(speed)):
        if slowest[member] > 0.0 and fixed + length / slowest[member] <= span:
            mass += probability[member]
            total += probability[member] * (fixed + length / fastest[member])
            fastest[member] = 0.0
    if mass == 0.0:
        return least
    # Those that may: a member that takes less than the mean so far lowers it.
    changed = True
    while changed:
        changed = False
        for member in range(len(speed)):
            shortest = min(fixed + length / fastest[member], max(span, least)) if fastest[member] > 0.0 else NEVER
            if shortest * mass < total:
                mass += probability[member]
                total += probability[member] * shortest
                fastest[member] = 0.0
                changed = True
    return total / mass


@compiled_lean
def _look_up(ways: Ways, need: Need, slot: int, segment: int) -> None:
    """Fill a row of the table, if it is not; where no table is kept, the fresh row."""
    if slot >= len(ways.table):
        _fill(ways, need, slot, segment, ways.fresh)
    elif ways.table[slot, segment, KNOWN] == 0.0:
        _fill(ways, need, slot, segment, ways.table[slot, segment])


@compiled_lean
def flight_lookahead(ways: Ways, need: Need, segment: int, node: int, time_s: float) -> tuple[float, float, float]:
    """Expectation of a one-segment flight to `node` over the forecast.

    By the table where the flight of every member that flies at once ends in the slot of its departure; else flown in
    every member.

    Takes a segment that leads to the node, and a finite time.

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
    slot = slot_of(ways.air, time_s)
    escapes = node == need.destination and need.needs_escape
    if not escapes:
        _look_up(ways, need, slot, segment)
        row = ways.table[slot, segment] if slot < len(ways.table) else ways.fresh
        # No member flies at once: the table has the mean touch-down. Else the mean time, if all are down in the slot.
        if row[LONGEST] == 0.0:
            return row[MEAN] - time_s, row[CHARGE], row[P_HOLD]
        if time_s + row[LONGEST] <= slot_end(ways.air, slot):
            return row[MEAN], row[CHARGE], row[P_HOLD]
    return _flown(ways, need, segment, node, time_s)


@compiled_lean
def _flown(ways: Ways, need: Need, segment: int, node: int, time_s: float) -> tuple[float, float, float]:
    """Fly in every member: what `flight_lookahead` returns."""
    air, probability = ways.air, ways.probability
    escapes = node == need.destination and need.needs_escape
    off, down = ways.rows[_OFF], ways.rows[_DOWN]
    for member in range(len(probability)):
        off[member], down[member] = leg(air, member, segment, time_s)
    mean, flown, now = _mean(probability, time_s, off, down)
    if flown <= 0.0:
        return NEVER, NEVER, 1.0
    charge = down
    for member in range(len(probability)):
        if down[member] < NEVER:
            taken = need.soc_fixed + need.soc_per_s * (down[member] - off[member])
            if escapes:
                taken += escape_cost(air, member, need, down[member])
            charge[member] = taken
    return mean, _quantile(charge, probability, flown * (1.0 - need.epsilon) - 1e-12), 1.0 - now / flown


@compiled_lean
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
        # Flown at once, or held until later.
        if off[member] <= time_s:
            now_mass += probability[member]
            now_sum += probability[member] * (down[member] - time_s)
        else:
            held_mass += probability[member]
            held_sum += probability[member] * (down[member] - time_s)
    if now_mass > 0.0:
        return now_sum / now_mass, now_mass + held_mass, now_mass
    return (held_sum / held_mass if held_mass > 0.0 else NEVER), held_mass, 0.0


@compiled_lean
def mean_flight(ways: Ways, need: Need, segment: int, time_s: float) -> float:
    """Mean time to touch-down over the members that can fly at once; over all where none can."""
    air, probability = ways.air, ways.probability
    slot = slot_of(air, time_s)
    end = slot_end(air, slot)
    # By the table, if every flight that starts at once may end in the slot.
    if time_s + least_time(air, segment) <= end:
        _look_up(ways, need, slot, segment)
        row = ways.table[slot, segment] if slot < len(ways.table) else ways.fresh
        if row[LONGEST] == 0.0:
            return row[MEAN] - time_s
        if time_s + row[LONGEST] <= end:
            return row[MEAN]
    # Else flown in every member.
    mass = total = 0.0
    for member in range(len(probability)):
        down = land(air, member, (segment,), time_s)
        if down < NEVER:
            mass += probability[member]
            total += probability[member] * (down - time_s)
    return total / mass if mass > 0.0 else _flown(ways, need, segment, NOWHERE, time_s)[0]


@compiled_lean
def least_time(air: SegmentWind, segment: int) -> float:
    """Time of a flight that nothing beats, at the greatest ground speed."""
    return air.climb_s + air.descent_s + air.distance_m[segment] / air.max_ground_speed_mps


@compiled_lean
def _quantile(values: NDArray[np.float64], probability: NDArray[np.float64], mass: float) -> float:
    """Least value at or below which at least `mass` lies; infinite values carry none.

    `values` and `probability` have shape (members,). What is omitted becomes infinite in `values`. Epsilon is small,
    so that hardly any value is omitted: the greatest, one by one, without sorting.
    """
    greatest = -NEVER
    total = 0.0
    lightest = NEVER
    for k in range(len(values)):
        if values[k] < NEVER:
            greatest = max(greatest, values[k])
            total += probability[k]
            lightest = min(lightest, probability[k])
    if total - lightest < mass:  # the usual case: not even the lightest member can be omitted
        return greatest
    while True:  # omit the greatest as long as the others make up the mass
        last = 0
        for k in range(len(values)):
            if values[k] < NEVER and (values[last] == NEVER or values[k] > values[last]):
                last = k
        total -= probability[last]
        if total < mass:
            return values[last]
        values[last] = NEVER
