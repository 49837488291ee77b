"""Kernels that fly a drone's route of orders: to each package, with it, and home."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.dispatch.flight_kernels import CHARGE, EMPTY, HOME, LOADED, SLACK, fly, interpolated, note, pad_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.calendar_kernels import Calendar
    from skyway.planner.dispatch.flight_kernels import Trace
    from skyway.planner.dispatch.problem import Fleet, Flights, Orders, Weights


class Halts(NamedTuple):
    """Stops to charge that the search chose itself, beside those of the recurrence: one for each order and phase; those for home count at a drone's last order."""

    place: NDArray[np.int64]
    """A place with pads; -1 where there is none."""
    soc: NDArray[np.float64]
    """Charge with which the drone leaves it, at least. Shape (orders, 3) each, by phase: to the package, with it, and home."""


@compiled
def halt(
    flights: Flights, halts: Halts, calendar: Calendar, trace: Trace, drone: int, kind: int, scale: float, mode: int,
    order: int, phase: int, place: int, time_s: float, soc: float,
) -> tuple[float, float, float, int]:  # fmt: skip
    """Fly to the stop that was chosen for an order and phase, and charge there; returns (end, charge, charge taken, place).

    Where none was chosen, or it cannot be reached, nothing happens: the flight goes on from where the drone stands.
    """
    stop = halts.place[order, phase]
    if stop < 0:
        return time_s, soc, 0.0, place
    noted = -1 if phase == HOME else order
    kept = trace.filled[0]
    there_s, left, used = fly(flights, calendar, trace, drone, kind, scale, mode, mode, noted, phase, place, stop, time_s, soc)  # fmt: skip
    if not there_s < np.inf:
        trace.filled[0] = kept
        return time_s, soc, 0.0, place
    most = halts.soc[order, phase]
    if most > left + SLACK:
        curve = flights.curve_of[kind, stop]
        level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
        length_s = interpolated(level, at_s, most) - interpolated(level, at_s, left)
        begin_s, pad = pad_at(flights, calendar, stop, there_s, length_s, drone)
        note(trace, CHARGE, noted, phase, stop, stop, begin_s, begin_s + length_s, left, most, pad)
        there_s, left = begin_s + length_s, most
    return there_s, left, used, stop


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
    flights: Flights, fleet: Fleet, orders: Orders, weights: Weights, halts: Halts, calendar: Calendar, trace: Trace, drone: int,
    order: int, place: int, time_s: float, soc: float, most: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Fetch one package and deliver it; returns (delivery, charge, cost), infinite where it cannot.

    A drone that would be there before the package is ready charges where it stands, as long as that delays nothing, and from
    when it is full at the package; where there are no pads it waits at the one of both that has some. So it charges up to `most`.
    """
    kind, scale, empty = fleet.type[drone], fleet.scale[drone], fleet.empty_mode[drone]
    mode, origin, ready_s = orders.mode[kind, order], orders.origin[order], orders.ready_s[order]
    if mode < 0:
        return np.inf, 0.0, np.inf
    time_s, soc, before, place = halt(flights, halts, calendar, trace, drone, kind, scale, empty, order, EMPTY, place, time_s, soc)  # fmt: skip
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
    begin_s, left, between, place = halt(flights, halts, calendar, trace, drone, kind, scale, mode, order, LOADED, origin, begin_s, left)  # fmt: skip
    done_s, left, taken = fly(flights, calendar, trace, drone, kind, scale, mode, empty, order, LOADED, place, orders.destination[order], begin_s, left)  # fmt: skip
    late_s = max(done_s - orders.due_s[order], 0.0)
    if not done_s <= orders.latest_s[order] + SLACK:
        return np.inf, 0.0, np.inf
    cost = done_s - ready_s + weights.lateness * late_s + weights.energy_s * (before + used + between + taken)
    return done_s, left, cost


@compiled
def go_home(
    flights: Flights, fleet: Fleet, weights: Weights, halts: Halts, calendar: Calendar, trace: Trace, drone: int, last: int, place: int,
    time_s: float, soc: float,
) -> float:  # fmt: skip
    """Fly home after the last order; returns what it costs, infinite where the drone is not there in time."""
    kind, scale, empty = fleet.type[drone], fleet.scale[drone], fleet.empty_mode[drone]
    begin_s, soc, before, place = halt(flights, halts, calendar, trace, drone, kind, scale, empty, last, HOME, place, time_s, soc)  # fmt: skip
    done_s, _, used = fly(flights, calendar, trace, drone, kind, scale, empty, empty, -1, HOME, place, fleet.home[drone], begin_s, soc)  # fmt: skip
    if not (done_s <= fleet.to_s[drone] + SLACK and done_s < np.inf):
        return np.inf
    return weights.home * (done_s - time_s) + weights.energy_s * (before + used)
