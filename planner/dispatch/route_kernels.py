"""Kernels that fly a drone's route of orders: which stops, how much charge, which pad when.

The recurrence of one flight towards a goal, from a place at time t with charge s: among the goal and all stops j take the one with the
least  a_j + w_j + max(0, D_j - pace (s_j - reserve)), where a_j is the arrival after the wait for a pad and the charge that the
flight needs, w_j the wait for a pad there, D_j the least time from j to the goal with all charging, and s_j the charge left at j.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import Fleet, Flights, Orders, Weights

FLY, CHARGE = 0, 1
KIND, ORDER, PHASE, FROM, TO, BEGIN, END, SOC, SOC_AFTER, PAD = range(10)
"""Columns of a trace; of a charge FROM and TO are its place."""
EMPTY, LOADED, HOME = range(3)
"""Phases: to the package, with it, and back."""
LEFTOVER = 0.3
"""What charge that is left at the goal counts, as a share of the time that it took to charge."""
SLACK = 1e-9
TYPICAL = 0.3
"""Charge for which a pad is looked for at the next stop."""


class Calendar(NamedTuple):
    """Windows in which pads are taken, by pad in order of time."""

    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    owner: NDArray[np.int64]
    """Shape (pads, windows) each: from when to when, and by which drone; -1 is none of ours."""
    filled: NDArray[np.int64]
    """Shape (pads,)."""


class Trace(NamedTuple):
    """What a drone does, written down; with no rows nothing is."""

    rows: NDArray[np.float64]
    """Shape (rows, 10), see the column names."""
    filled: NDArray[np.int64]
    """Shape (1,)."""


@compiled
def free_from(calendar: Calendar, pad: int, time_s: float, length_s: float, drone: int) -> float:
    """Earliest time from which a pad is free for so long, as far as others take it."""
    low, high = 0, calendar.filled[pad]
    while low < high:  # the first window that ends after the time
        middle = (low + high) // 2
        if calendar.end_s[pad, middle] > time_s:
            high = middle
        else:
            low = middle + 1
    for number in range(low, calendar.filled[pad]):
        if calendar.owner[pad, number] == drone:
            continue
        if calendar.start_s[pad, number] >= time_s + length_s - SLACK:
            break
        time_s = max(time_s, calendar.end_s[pad, number])
    return time_s


@compiled
def pad_at(flights: Flights, calendar: Calendar, place: int, time_s: float, length_s: float, drone: int) -> tuple[float, int]:  # fmt: skip
    """Earliest time at a place from which a pad is free for so long, after the strangers, and that pad."""
    column = int((time_s - flights.start_s) / flights.wait_step_s)
    column = min(max(column, 0), flights.wait_s.shape[1] - 1)
    time_s += flights.wait_s[place, column]
    best, found = np.inf, -1
    for pad in range(flights.first_pad[place], flights.first_pad[place] + flights.pads[place]):
        begin = free_from(calendar, pad, time_s, length_s, drone)
        if begin < best:
            best, found = begin, pad
    return best, found


@compiled
def interpolated(x: NDArray[np.float64], y: NDArray[np.float64], at: float) -> float:
    """Linear between points, constant beyond."""
    if at <= x[0]:
        return y[0]
    for number in range(1, len(x)):
        if at <= x[number]:
            if x[number] <= x[number - 1]:
                return y[number]
            return y[number - 1] + (y[number] - y[number - 1]) * (at - x[number - 1]) / (x[number] - x[number - 1])
    return y[-1]


@compiled
def slot_at(flights: Flights, time_s: float) -> int:
    """Slot of a time; the first one before, the last one after."""
    slot = int((time_s - flights.start_s) / flights.slot_s)
    return min(max(slot, 0), flights.time_s.shape[1] - 1)


@compiled
def note(trace: Trace, kind: int, order: int, phase: int, begin: int, end: int, from_s: float, to_s: float, soc: float, after: float, pad: int) -> None:  # fmt: skip
    """Write a row, where there is room."""
    row = trace.filled[0]
    if row < len(trace.rows):
        trace.rows[row, KIND], trace.rows[row, ORDER], trace.rows[row, PHASE] = kind, order, phase
        trace.rows[row, FROM], trace.rows[row, TO] = begin, end
        trace.rows[row, BEGIN], trace.rows[row, END] = from_s, to_s
        trace.rows[row, SOC], trace.rows[row, SOC_AFTER], trace.rows[row, PAD] = soc, after, pad
    trace.filled[0] = row + 1


@compiled
def next_stop(
    flights: Flights, calendar: Calendar, drone: int, kind: int, scale: float, mode: int, floor: float,
    slot: int, place: int, goal: int, time_s: float, soc: float,
) -> int:  # fmt: skip
    """Where to fly next on the way to a goal; -1 where nothing can be reached in this slot."""
    has_pads = flights.pads[place] > 0
    curve = flights.curve_of[kind, place]
    level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
    pace, reserve = flights.pace_s[kind], flights.reserve
    pad_s = pad_at(flights, calendar, place, time_s, 0.0, drone)[0] if has_pads else time_s
    have_s = interpolated(level, at_s, soc)
    best, found = np.inf, -1
    for number in range(len(flights.stops) + 1):
        stop = goal if number == 0 else flights.stops[number - 1]
        if stop == place or (number > 0 and stop == goal):
            continue
        takes, least = flights.need[mode, slot, place, stop] * scale, floor if stop == goal else reserve
        wanted = takes + least
        if not wanted <= 1.0 + SLACK or (not has_pads and wanted > soc + SLACK):
            continue
        come_s = time_s + flights.time_s[mode, slot, place, stop]
        if wanted > soc:
            come_s += pad_s - time_s + interpolated(level, at_s, min(wanted, 1.0)) - have_s
        left = max(soc, wanted) - takes
        if stop == goal:
            score = come_s - LEFTOVER * pace * (left - least)
        else:
            score = come_s + max(flights.to_go_s[mode, slot, stop, goal] - pace * (left - reserve), 0.0)
            if score < best:  # it will want a pad there
                score += pad_at(flights, calendar, stop, come_s, TYPICAL * pace, drone)[0] - come_s
        if score < best:
            best, found = score, stop
    return found


@compiled
def fly(
    flights: Flights, calendar: Calendar, trace: Trace, drone: int, kind: int, scale: float, mode: int, after: int,
    order: int, phase: int, place: int, goal: int, time_s: float, soc: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Fly from a place to a goal, charging on the way; returns (arrival, charge, charge taken), infinite where it cannot.

    At a goal without pads so much is left that the drone, then in the mode `after`, gets to a pad.
    """
    floor = flights.reserve + flights.escape[after, goal] * scale
    slots = flights.time_s.shape[1]
    used = 0.0
    for _ in range(2 * len(flights.stops) + slots + 2):
        if place == goal:
            return time_s, soc, used
        slot = slot_at(flights, time_s)
        stop = next_stop(flights, calendar, drone, kind, scale, mode, floor, slot, place, goal, time_s, soc)
        if stop < 0:
            if slot >= slots - 1:
                break
            time_s = max(flights.start_s + (slot + 1) * flights.slot_s, time_s)  # hold for better wind
            if slot_at(flights, time_s) == slot:  # rounding
                time_s += SLACK * abs(time_s)
            continue
        least = floor if stop == goal else flights.reserve
        curve = flights.curve_of[kind, place]
        level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
        leave_s, begin_s, pad, charged = time_s, time_s, -1, soc
        for _again in range(4):  # the charge may last into a slot in which the flight takes more
            takes = flights.need[mode, slot, place, stop] * scale
            wanted = min(takes + least, 1.0)
            if wanted > charged + SLACK and flights.pads[place] > 0:
                length_s = interpolated(level, at_s, wanted) - interpolated(level, at_s, soc)
                begin_s, pad = pad_at(flights, calendar, place, time_s, length_s, drone)
                leave_s, charged = begin_s + length_s, wanted
            now = slot_at(flights, leave_s)
            if now == slot:
                break
            slot = now
        takes = flights.need[mode, slot, place, stop] * scale
        if not takes + least <= charged + 1e-6:  # closed by then, or too far on what can be charged
            if slot >= slots - 1 or not leave_s > time_s:
                break
            time_s = leave_s
            if pad >= 0:
                note(trace, CHARGE, order, phase, place, place, begin_s, leave_s, soc, charged, pad)
                soc = charged
            continue
        if pad >= 0:
            note(trace, CHARGE, order, phase, place, place, begin_s, leave_s, soc, charged, pad)
        time_s = leave_s + flights.time_s[mode, slot, place, stop]
        note(trace, FLY, order, phase, place, stop, leave_s, time_s, charged, charged - takes, mode)
        soc = charged - takes
        used += takes
        place = stop
    return np.inf, 0.0, np.inf


@compiled
def longest_gap(flights: Flights, calendar: Calendar, place: int, time_s: float, until_s: float, drone: int) -> tuple[float, float, int]:  # fmt: skip
    """Longest time within two instants in which one pad of a place is free: beginning, end and pad; -1 where none is."""
    column = int((time_s - flights.start_s) / flights.wait_step_s)
    column = min(max(column, 0), flights.wait_s.shape[1] - 1)
    time_s += flights.wait_s[place, column]
    best, begin_s, end_s, found = SLACK, until_s, until_s, -1
    for pad in range(flights.first_pad[place], flights.first_pad[place] + flights.pads[place]):
        free_s = time_s
        for number in range(calendar.filled[pad] + 1):
            last = number == calendar.filled[pad]
            if not last and (calendar.owner[pad, number] == drone or calendar.end_s[pad, number] <= free_s):
                continue
            taken_s = until_s if last else min(calendar.start_s[pad, number], until_s)
            if taken_s - free_s > best:
                best, begin_s, end_s, found = taken_s - free_s, free_s, taken_s, pad
            if taken_s >= until_s:
                break
            free_s = calendar.end_s[pad, number]
    return begin_s, end_s, found


@compiled
def charge_while_waiting(
    flights: Flights, calendar: Calendar, trace: Trace, drone: int, kind: int, order: int, place: int, time_s: float, until_s: float, soc: float,
    most: float,
) -> tuple[float, float]:  # fmt: skip
    """Charge up to `most` where a drone waits anyway, as far as a pad is free; returns the charge and the time then."""
    if flights.pads[place] == 0 or soc >= most - SLACK:
        return soc, time_s
    curve = flights.curve_of[kind, place]
    level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
    full_s = interpolated(level, at_s, most) - interpolated(level, at_s, soc)
    begin_s, end_s, pad = longest_gap(flights, calendar, place, time_s, until_s, drone)
    if pad < 0:
        return soc, until_s
    length_s = min(full_s, end_s - begin_s)
    charged = min(interpolated(at_s, level, interpolated(level, at_s, soc) + length_s), 1.0)
    note(trace, CHARGE, order, EMPTY, place, place, begin_s, begin_s + length_s, soc, charged, pad)
    return charged, begin_s + length_s


@compiled
def serve(
    flights: Flights, fleet: Fleet, orders: Orders, weights: Weights, calendar: Calendar, trace: Trace, drone: int, order: int,
    place: int, time_s: float, soc: float, most: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Fetch one package and deliver it; returns (delivery, charge, cost), infinite where it cannot.

    A drone that would be there before the package is ready charges where it stands, as long as that delays nothing, and from
    when it is full at the package; where there are no pads it waits at the one of both that has some. So it charges up to `most`.
    """
    kind, scale, empty = fleet.type[drone], fleet.scale[drone], fleet.empty_mode[drone]
    mode, origin, ready_s = orders.mode[kind, order], orders.origin[order], orders.ready_s[order]
    if mode < 0:
        return np.inf, 0.0, np.inf
    kept = trace.filled[0]
    there_s, left, used = fly(flights, calendar, trace, drone, kind, scale, empty, mode, order, EMPTY, place, origin, time_s, soc)  # fmt: skip
    delay_s, charged = 0.0, soc
    for _ in range(4):  # what is charged meanwhile need not be charged again, so that the flight may begin still later
        if there_s >= ready_s - SLACK or flights.pads[place] == 0 or charged >= most - SLACK:
            break
        delay_s += ready_s - there_s
        trace.filled[0] = kept
        charged, until_s = charge_while_waiting(flights, calendar, trace, drone, kind, order, place, time_s, time_s + delay_s, soc, most)  # fmt: skip
        if charged < most - SLACK or flights.pads[origin] == 0:
            until_s = time_s + delay_s
        there_s, left, used = fly(flights, calendar, trace, drone, kind, scale, empty, mode, order, EMPTY, place, origin, until_s, charged)  # fmt: skip
    if not there_s < np.inf:
        return np.inf, 0.0, np.inf
    if there_s < ready_s - SLACK:
        left, _ = charge_while_waiting(
            flights, calendar, trace, drone, kind, order, origin, there_s, ready_s, left, most
        )
    begin_s = max(there_s, ready_s)
    done_s, left, taken = fly(flights, calendar, trace, drone, kind, scale, mode, empty, order, LOADED, origin, orders.destination[order], begin_s, left)  # fmt: skip
    late_s = max(done_s - orders.due_s[order], 0.0)
    if not late_s <= weights.max_late_s + SLACK:
        return np.inf, 0.0, np.inf
    cost = done_s - ready_s + weights.lateness * late_s + weights.energy_s * (used + taken)
    return done_s, left, cost


@compiled
def go_home(
    flights: Flights, fleet: Fleet, weights: Weights, calendar: Calendar, trace: Trace, drone: int, place: int, time_s: float, soc: float,
) -> float:  # fmt: skip
    """Fly home; returns what it costs, infinite where the drone is not there in time."""
    kind, empty = fleet.type[drone], fleet.empty_mode[drone]
    done_s, _, used = fly(flights, calendar, trace, drone, kind, fleet.scale[drone], empty, empty, -1, HOME, place, fleet.home[drone], time_s, soc)  # fmt: skip
    return weights.energy_s * used if done_s <= fleet.to_s[drone] + SLACK and done_s < np.inf else np.inf
