"""Continuing a previous plan: the steps of a drone are kept where they are still possible, and scheduled again where they are not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.dispatch.flight_kernels import (
    BEGIN,
    CHARGE,
    EMPTY,
    END,
    FLY,
    FROM,
    HOME,
    KIND,
    LOADED,
    ORDER,
    PAD,
    PHASE,
    SOC,
    SOC_AFTER,
    TO,
)
from skyway.planner.dispatch.plan_kernels import rebook, unbook

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.search import Search

    Stops = Mapping[tuple[int, int], tuple[int, float]]

LATE_S, SPARE, OVERLAP_S = 90.0, 0.005, 1.0
"""Steps are kept while the drone is no later than this, flights take at most this much more charge, and windows overlap by at most this."""
CHARGED_WAITING = (1.0, 0.6, 0.0)
"""Charges to which a drone charges while it waits, when it is scheduled again: the first feasible one is used."""


def hold(search: Search, drone: int, rows: NDArray[np.float64]) -> None:
    """Reserve the pads of some steps for a drone that holds none, until it is scheduled."""
    routes = search.routes
    charges = rows[(rows[:, KIND] == CHARGE) & (rows[:, PAD] >= 0)]
    kept = charges[:, [PAD, BEGIN, END]][: routes.window.shape[1]]
    routes.window[drone, : len(kept)], routes.windows[drone] = kept, len(kept)
    rebook(search.calendar, routes, drone)


def keep(search: Search, drone: int, route: Sequence[int], rows: NDArray[np.float64] | None, stops: Stops) -> bool:
    """Keep the planned steps of a drone whose pads are reserved; false, with nothing changed, if that is no longer possible.

    `stops` has a place and a charge by order and phase.
    """
    if rows is None or not _possible(search, drone, route, rows):
        return False
    routes, fleet, orders, weights = search.routes, search.problem.fleet, search.problem.orders, search.problem.weights
    routes.order[drone, : len(route)], routes.length[drone], routes.most[drone] = route, len(route), 1.0
    routes.time_s[drone, 0], routes.soc[drone, 0], routes.cost[drone, 0] = fleet.from_s[drone], fleet.soc[drone], 0.0
    flown = rows[rows[:, KIND] == FLY]
    used = flown[:, SOC] - flown[:, SOC_AFTER]
    for number, one in enumerate(route, 1):
        own = flown[:, ORDER] == one
        last = flown[own & (flown[:, PHASE] == LOADED)][-1]
        late_s = max(last[END] - orders.due_s[one], 0.0)
        cost = last[END] - orders.ready_s[one] + weights.lateness * late_s + weights.energy_s * used[own].sum()
        routes.time_s[drone, number], routes.soc[drone, number] = last[END], last[SOC_AFTER]
        routes.cost[drone, number] = routes.cost[drone, number - 1] + cost
    routes.total[drone] = routes.cost[drone, len(route)] + weights.energy_s * used[flown[:, PHASE] == HOME].sum()
    routes.total[drone] += weights.home * (rows[-1, END] - routes.time_s[drone, len(route)])
    search.steps[drone] = rows.copy()
    search.drone_of[list(route)] = drone
    _stop(search, route, _as_needed(route, stops))
    return True


def _possible(search: Search, drone: int, route: Sequence[int], rows: NDArray[np.float64]) -> bool:
    """Whether the planned steps of a drone are still possible."""
    fleet = search.problem.fleet
    if (
        not route
        or not len(rows)
        or len(route) > search.routes.order.shape[1]
        or (search.drone_of[list(route)] >= 0).any()
    ):
        return False
    first, last = rows[0], rows[-1]
    there = first[FROM] == fleet.place[drone] and last[TO] == fleet.home[drone] and last[END] <= fleet.to_s[drone]
    ready = first[BEGIN] >= fleet.from_s[drone] - LATE_S and first[SOC] <= fleet.soc[drone] + SPARE
    flown = rows[rows[:, KIND] == FLY]
    return (
        there
        and ready
        and set(rows[:, ORDER].astype(int).tolist()) - {-1} == set(route)
        and _flown(search, drone, flown)
        and all(_served(search, one, flown) for one in route)
        and _on_free_pads(search, drone, rows[rows[:, KIND] == CHARGE])
    )


def _flown(search: Search, drone: int, flown: NDArray[np.float64]) -> bool:
    """Whether flights take no more charge and time than planned."""
    flights, fleet = search.problem.flights, search.problem.fleet
    loaded = search.problem.orders.mode[fleet.type[drone], np.maximum(flown[:, ORDER].astype(int), 0)]
    mode = np.where(flown[:, PHASE] == LOADED, loaded, fleet.empty_mode[drone])
    slot = ((flown[:, BEGIN] - flights.start_s) / flights.slot_s).astype(int)
    at = mode, np.clip(slot, 0, flights.time_s.shape[1] - 1), flown[:, FROM].astype(int), flown[:, TO].astype(int)
    enough = flights.need[at] * fleet.scale[drone] <= flown[:, SOC] - flown[:, SOC_AFTER] + SPARE
    prompt = flights.time_s[at] <= flown[:, END] - flown[:, BEGIN] + LATE_S
    return bool((mode >= 0).all() and enough.all() and prompt.all())


def _served(search: Search, order: int, flown: NDArray[np.float64]) -> bool:
    """Whether an order is fetched at its origin after it is ready, and delivered before its latest time."""
    orders = search.problem.orders
    own = flown[(flown[:, ORDER] == order) & (flown[:, PHASE] == LOADED)]
    if not len(own):
        return False
    places = own[0, FROM] == orders.origin[order] and own[-1, TO] == orders.destination[order]
    return bool(places and own[0, BEGIN] >= orders.ready_s[order] - LATE_S and own[-1, END] <= orders.latest_s[order])


def _on_free_pads(search: Search, drone: int, charged: NDArray[np.float64]) -> bool:
    """Whether the pads of all charges are reserved for the drone and free of others."""
    calendar = search.calendar
    if search.routes.windows[drone] != len(charged):
        return False
    for pad, begin_s, end_s in charged[:, [PAD, BEGIN, END]]:
        filled = slice(0, calendar.filled[int(pad)])
        others = calendar.owner[int(pad), filled] != drone
        met = (calendar.start_s[int(pad), filled] < end_s - OVERLAP_S) & (
            calendar.end_s[int(pad), filled] > begin_s + OVERLAP_S
        )
        if (others & met).any():
            return False
    return True


def take(search: Search, drone: int, route: Sequence[int], stops: Stops) -> None:
    """Give a drone without orders the longest feasible beginning of a route, with its previous stops or without, whichever costs less."""
    wanted = [one for one in route if search.drone_of[one] < 0][: search.routes.order.shape[1]]
    while wanted:
        costs: dict[float, tuple[Stops, float]] = {}
        for most in CHARGED_WAITING:
            for had in (stops, _as_needed(wanted, stops), {}):
                if _changed(search, drone, wanted, had, most):
                    costs[float(search.routes.total[drone])] = had, most
            if costs:
                _changed(search, drone, wanted, *costs[min(costs)])
                search.drone_of[wanted] = drone
                return
        wanted.pop()
    search.routes.most[drone] = 1.0
    unbook(search.calendar, search.routes, drone)


def _changed(search: Search, drone: int, route: Sequence[int], stops: Stops, most: float) -> bool:
    _stop(search, route, stops)
    search.routes.most[drone] = most
    return search.change(drone, route)


def _stop(search: Search, orders: Sequence[int], stops: Stops) -> None:
    halts = search.routes.halts
    for one in orders:
        for phase in (EMPTY, LOADED, HOME):
            halts.place[one, phase], halts.soc[one, phase] = stops.get((one, phase), (-1, 0.0))


def _as_needed(orders: Sequence[int], stops: Stops) -> Stops:
    """Stops of some orders, with no more charge at departure than the next flight needs."""
    keys = ((one, phase) for one in orders for phase in (EMPTY, LOADED, HOME))
    return {key: (stops[key][0], 0.0) for key in keys if key in stops}
