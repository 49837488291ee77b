"""Kernels of a plan: where an order fits into the routes, and how routes and the calendar of pads change."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.calendar_kernels import Calendar, book
from skyway.planner.dispatch.flight_kernels import BEGIN, CHARGE, END, KIND, PAD, Trace
from skyway.planner.dispatch.route_kernels import Halts, go_home, serve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import Fleet, Flights, Orders, Weights


class Routes(NamedTuple):
    """The orders of each drone in their order, and how it stands before each of them."""

    order: NDArray[np.int64]
    """Shape (drones, most)."""
    length: NDArray[np.int64]
    """Shape (drones,)."""
    time_s: NDArray[np.float64]
    soc: NDArray[np.float64]
    cost: NDArray[np.float64]
    """Shape (drones, most + 1) each: time, charge and cost so far before each order, and after the last one."""
    total: NDArray[np.float64]
    """Shape (drones,): cost of a route, with the way home."""
    window: NDArray[np.float64]
    """Shape (drones, windows, 3): pad, start and end of each window of a pad."""
    windows: NDArray[np.int64]
    """Shape (drones,)."""
    most: NDArray[np.float64]
    """Shape (drones,): up to which charge a drone charges while it waits for a package."""
    halts: Halts
    gap_s: float
    """Time between the windows of two drones on one pad, s: windows stand in the calendar longer by so much on both sides."""


@compiled
def place_before(fleet: Fleet, orders: Orders, routes: Routes, drone: int, position: int) -> int:
    """Where a drone is before an order of its route."""
    return fleet.place[drone] if position == 0 else orders.destination[routes.order[drone, position - 1]]


@compiled
def insertions(
    flights: Flights, fleet: Fleet, orders: Orders, weights: Weights, calendar: Calendar, routes: Routes, trace: Trace,
    order: int, drones: NDArray[np.int64], added: NDArray[np.float64], position: NDArray[np.int64],
) -> None:  # fmt: skip
    """Find for each of some drones where an order fits best into its route: what that adds to the cost, and the position.

    `added`, infinite where it does not fit, and `position` have the shape (drones,). The trace has no rows.

    Takes an order and drones of the fleet, any number of them, and routes that `lay_out` has flown.
    """
    for number in range(len(drones)):
        drone = drones[number]
        length = routes.length[drone]
        added[number], position[number] = np.inf, -1
        if length >= routes.order.shape[1]:
            continue
        for begin in range(length + 1):
            place = place_before(fleet, orders, routes, drone, begin)
            time_s, soc, cost = routes.time_s[drone, begin], routes.soc[drone, begin], routes.cost[drone, begin]
            for step in range(begin, length + 1):
                one = order if step == begin else routes.order[drone, step - 1]
                time_s, soc, more = serve(flights, fleet, orders, weights, routes.halts, calendar, trace, drone, one, place, time_s, soc, routes.most[drone])  # fmt: skip
                cost += more
                place = orders.destination[one]
                if not cost - routes.total[drone] < added[number]:
                    break
            if not cost - routes.total[drone] < added[number]:
                continue
            last = order if begin == length else routes.order[drone, length - 1]
            cost += go_home(flights, fleet, weights, routes.halts, calendar, trace, drone, last, place, time_s, soc)
            if cost - routes.total[drone] < added[number]:
                added[number], position[number] = cost - routes.total[drone], begin


@compiled
def unbook(calendar: Calendar, routes: Routes, drone: int) -> None:
    """Take all windows of a drone out of the calendar.

    Takes a drone of the routes, whose windows lie on pads of the calendar.
    """
    for number in range(routes.windows[drone]):
        pad, start_s = int(routes.window[drone, number, 0]), routes.window[drone, number, 1]
        count = calendar.filled[pad]
        kept, found = 0, False
        for place in range(count):
            if (
                not found
                and calendar.owner[pad, place] == drone
                and calendar.start_s[pad, place] == start_s - routes.gap_s
            ):
                found = True
                continue
            if kept != place:
                calendar.start_s[pad, kept] = calendar.start_s[pad, place]
                calendar.end_s[pad, kept] = calendar.end_s[pad, place]
                calendar.owner[pad, kept] = calendar.owner[pad, place]
            kept += 1
        calendar.filled[pad] = kept
    routes.windows[drone] = 0


@compiled
def rebook(calendar: Calendar, routes: Routes, drone: int) -> bool:
    """Write all windows of a drone into the calendar; false where there is no room.

    Takes a drone as `unbook` does.
    """
    for number in range(routes.windows[drone]):
        pad = int(routes.window[drone, number, 0])
        begin_s, end_s = routes.window[drone, number, 1] - routes.gap_s, routes.window[drone, number, 2] + routes.gap_s
        if not book(calendar, pad, begin_s, end_s, drone):
            return False
    return True


@compiled
def lay_out(
    flights: Flights, fleet: Fleet, orders: Orders, weights: Weights, calendar: Calendar, routes: Routes, trace: Trace, drone: int
) -> bool:  # fmt: skip
    """Fly the route of a drone from its beginning and book its pads; false, with nothing booked, where it cannot.

    The trace has rows; what the drone does is in it afterwards.

    Takes a drone of the fleet, whose route is of orders that are known.
    """
    unbook(calendar, routes, drone)
    trace.filled[0] = 0
    place, time_s, soc, cost = fleet.place[drone], fleet.from_s[drone], fleet.soc[drone], 0.0
    for step in range(routes.length[drone]):
        routes.time_s[drone, step], routes.soc[drone, step], routes.cost[drone, step] = time_s, soc, cost
        one = routes.order[drone, step]
        time_s, soc, more = serve(
            flights,
            fleet,
            orders,
            weights,
            routes.halts,
            calendar,
            trace,
            drone,
            one,
            place,
            time_s,
            soc,
            routes.most[drone],
        )
        cost += more
        place = orders.destination[one]
        if not cost < np.inf:
            return False
    end = routes.length[drone]
    routes.time_s[drone, end], routes.soc[drone, end], routes.cost[drone, end] = time_s, soc, cost
    if end > 0:
        last = routes.order[drone, end - 1]
        cost += go_home(flights, fleet, weights, routes.halts, calendar, trace, drone, last, place, time_s, soc)
    routes.total[drone] = cost
    if not cost < np.inf or trace.filled[0] > len(trace.rows):
        return False
    for row in range(trace.filled[0]):
        if trace.rows[row, KIND] == CHARGE:
            count = routes.windows[drone]
            if count >= routes.window.shape[1]:
                routes.windows[drone] = 0
                return False
            routes.window[drone, count, 0] = trace.rows[row, PAD]
            routes.window[drone, count, 1] = trace.rows[row, BEGIN]
            routes.window[drone, count, 2] = trace.rows[row, END]
            routes.windows[drone] = count + 1
    return rebook(calendar, routes, drone)
