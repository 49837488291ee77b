"""Kernels of one flight towards a goal, over stops to charge at: which ones, how much charge, which pad when.

The recurrence of one flight towards a goal, from a place at time t with charge s: among the goal and all stops j take the one with the
least  a_j + w_j + max(0, D_j - pace min(s_j - reserve, e_j)), where a_j is the arrival after the wait for a pad and the charge that the
flight needs, w_j the wait for a pad there, D_j the least time from j to the goal with all charging, s_j the charge left at j, and e_j that
of a flight from j to the goal without a landing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.calendar_kernels import free_from

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.calendar_kernels import Calendar
    from skyway.planner.dispatch.problem import Flights

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


class Trace(NamedTuple):
    """What a drone does, written down; with no rows nothing is."""

    rows: NDArray[np.float64]
    """Shape (rows, 10), see the column names."""
    filled: NDArray[np.int64]
    """Shape (1,)."""


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
    slot: int, place: int, goal: int, time_s: float, soc: float, patient: bool,
) -> int:  # fmt: skip
    """Where to fly next on the way to a goal; -1 where nothing can be reached in this slot. Who is patient flies to the goal as soon as it can be reached."""
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
            if patient:
                return goal
            score = come_s - LEFTOVER * pace * (left - least)
        else:
            saved = min(
                left - reserve, flights.need[mode, slot, stop, goal] * scale
            )  # what is left beyond the way saves no time
            score = come_s + max(flights.to_go_s[mode, slot, stop, goal] - pace * saved, 0.0)
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

    At a goal without pads so much is left that the drone, then in the mode `after`, gets to a pad. Who does not arrive, since stops with free pads lead it
    to and fro, flies again patiently.
    """
    kept = trace.filled[0]
    for patient in (False, True):
        trace.filled[0] = kept
        there_s, left, used = flown(flights, calendar, trace, drone, kind, scale, mode, after, order, phase, place, goal, time_s, soc, patient)  # fmt: skip
        if there_s < np.inf:
            break
    return there_s, left, used


@compiled
def flown(
    flights: Flights, calendar: Calendar, trace: Trace, drone: int, kind: int, scale: float, mode: int, after: int,
    order: int, phase: int, place: int, goal: int, time_s: float, soc: float, patient: bool,
) -> tuple[float, float, float]:  # fmt: skip
    """One way of flying from a place to a goal."""
    floor = flights.reserve + flights.escape[after, goal] * scale
    slots = flights.time_s.shape[1]
    used = 0.0
    for _ in range(2 * len(flights.stops) + slots + 2):
        if place == goal:
            return time_s, soc, used
        slot = slot_at(flights, time_s)
        stop = next_stop(flights, calendar, drone, kind, scale, mode, floor, slot, place, goal, time_s, soc, patient)
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
