"""Flights between the places of a dispatch problem: how long they take and what charge they need, by slot of the forecast.

The speeds, waits and margins are those in which `robust` composes routes (`planner.problem.mean_value`): each segment at the speed whose flight
time is the mean of the members', each station with the strangers' expected wait. A flight between two places overflies stations on the
fastest way of the slot in which it begins; its time includes that on the ground before and after it (`flight_times`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration
from skyway.models.base.units import S_PER_H
from skyway.models.composition.composition import State
from skyway.models.orders.fitting import TOLERATED_KG
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.planner.dispatch.flight_times import air_times, charge_of, fixed_s, shortest_m
from skyway.planner.dispatch.problem import DispatchProblem, Fleet, Flights, Orders, Weights, escapes, to_go
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.mean_value import energy_margin
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import DEFAULT_EPSILON, DEFAULT_RESERVE_SOC, Request
from skyway.planner.problem.speeds import MeanSpeeds

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.orders.order import Order
    from skyway.models.queues.opening_hours import Closures
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.parameters.dispatch import DispatchParameters
    from skyway.planner.parameters.planner import PlannerParameters

MAX_BYTES = 3e9
"""Largest size of the tables of flights, bytes."""
AFTER_S = 4 * S_PER_H
"""Time after the last due time for which winds are computed, s."""


Leg = tuple[str, str, str]
"""A type of drone, and the stations from and to which it flies."""


@dataclass(frozen=True)
class Laid:
    """A dispatch problem, and the meaning of its numbers."""

    problem: DispatchProblem
    places: tuple[int, ...]
    """Node of the network of each place."""
    modes: tuple[tuple[str, float], ...]
    """Type of drone, and mass of the package, of each mode."""


def lay_out_problem(
    work: Work,
    depart: datetime,
    forecast: WindEnsemble,
    parameters: PlannerParameters,
    *,
    holds: Sequence[Hold] = (),
    reserve: float = DEFAULT_RESERVE_SOC,
    margins: bool = True,
    margin_of: Mapping[str, DepartureMargin] | None = None,
    promised: Collection[str] = (),
    closed: Mapping[Leg, float] | None = None,
    seen: PadsSeen = NOTHING_SEEN,
    loads_kg: Sequence[float] = (),
) -> Laid:
    """Build the arrays of a dispatch problem from a time on, in a forecast; `holds` are bookings of others, `promised` are orders promised before.

    Without margins flights need the charge of the model, not the charge that keeps the reserve in all but few cases; `margin_of` gives the margins of
    drone types instead of the usual one (`planner.dispatch.departure_margin`). `closed` has legs that are closed until a time, POSIX seconds.
    Waits for pads are expected from what is `seen` of them on; `loads_kg` has masses that are carried beside those of the orders.

    An `InputError` refuses what is too far ahead for the forecast, or too large.
    """
    scenario, network = work.scenario, work.scenario.network
    begin_s = depart.timestamp()
    end_s = max([begin_s, *(one.due.timestamp() for one in work.orders)]) + AFTER_S
    if end_s - begin_s > HORIZON_H * S_PER_H:
        remedy = f"orders that are due within {HORIZON_H - 4} h"
        raise InputError("reaches beyond the forecast", field="due", value=duration(end_s - begin_s), remedy=remedy)
    named = {network.index[one] for order in work.orders for one in (order.origin, order.destination)}
    named |= {network.index[one] for drone in work.vehicles for one in (drone.place, drone.home)}
    stops = {node for node, station in enumerate(network.stations) if station.pads and not station.flyover}
    places = tuple(sorted(stops | named))
    place_of = {node: number for number, node in enumerate(places)}
    types = [drone for drone in scenario.drones if any(one.type == drone.id for one in work.vehicles)]
    modes = _modes(types, [*(one.mass_kg for one in work.orders), *loads_kg], parameters.dispatch.payload_classes)
    problems = [mode_problem(work, depart, forecast, parameters, drone, mass, seen=seen) for drone, mass in modes]
    air = problems[0].air
    slots = int(min(np.ceil((end_s - air.start_s) / air.slot_s), air.north.shape[1]))
    if len(modes) * slots * len(places) ** 2 * 24.0 > MAX_BYTES:
        found = f"{len(places)} places, {slots} slots of wind, {len(modes)} classes of packages"
        raise InputError("is too large", field="orders", value=found, remedy="dispatch fewer hours or places at once")
    pads = _usable(problems[0], places, begin_s, end_s, parameters.dispatch.pads_busy)
    where = np.flatnonzero(pads > 0)
    times, needs, ways = [], [], []
    pace = {
        drone.id: max(_pace_s(problem, places, where) for problem in problems if problem.drone is drone)
        for drone in types
    }
    for problem, (drone, _) in zip(problems, modes, strict=True):
        air_s = _air_times(problem, places, slots, parameters.robust.speed_hours)
        margin: float | NDArray[np.float64] = 0.0
        if margins and margin_of is not None and drone.id in margin_of:
            margin = margin_of[drone.id].of(_speeds(problem, places, air_s))
        elif margins:
            margin = energy_margin(parameters.dispatch.margin, USUAL_ERRORS.energy_of(drone), problem.epsilon)
        need = np.where(np.isfinite(air_s), charge_of(problem, air_s) * (1.0 + margin), np.inf)
        need = np.where(need <= 1.0 - reserve, need, np.inf)
        for (of_type, origin, destination), until_s in (closed or {}).items():
            ends = place_of.get(network.index.get(origin, -1)), place_of.get(network.index.get(destination, -1))
            if of_type == drone.id and None not in ends:
                until = int(np.ceil((until_s - air.start_s) / air.slot_s - 1e-9))
                need[: min(max(until, 0), slots - 1), ends[0], ends[1]] = np.inf
        times.append(np.where(np.isfinite(need), parameters.dispatch.ground_s + air_s, np.inf))
        needs.append(need)
        ways.append(to_go(times[-1], need, where, pace[drone.id], 1.0 - reserve))
    need = np.stack(needs)
    curves = [next(one for one in problems if one.drone is drone) for drone in types]
    curve_of, curve_s, curve_soc = _charging(curves, places)
    flights = Flights(
        time_s=np.stack(times),
        need=need,
        to_go_s=np.stack(ways),
        escape=escapes(need, where),
        start_s=float(air.start_s),
        slot_s=float(air.slot_s),
        pads=pads,
        first_pad=np.cumsum(pads) - pads,
        stops=where,
        curve_of=curve_of,
        curve_s=curve_s,
        curve_soc=curve_soc,
        pace_s=np.array([pace[drone.id] for drone in types]),
        wait_s=_strangers(problems[0], places, where),
        wait_step_s=float(problems[0].waits.step_s),
        reserve=reserve,
    )
    kind = {drone.id: number for number, drone in enumerate(types)}
    empty = {drone.id: number for number, (drone, mass) in reversed(list(enumerate(modes))) if mass == 0.0}
    fleet = Fleet(
        type=np.array([kind[one.type] for one in work.vehicles], dtype=np.int64),
        empty_mode=np.array([empty[one.type] for one in work.vehicles], dtype=np.int64),
        place=np.array([place_of[network.index[one.place]] for one in work.vehicles], dtype=np.int64),
        home=np.array([place_of[network.index[one.home]] for one in work.vehicles], dtype=np.int64),
        soc=np.array([one.soc for one in work.vehicles]),
        from_s=np.array([max(begin_s, one.available_from.timestamp() if one.available_from else begin_s) for one in work.vehicles]),
        to_s=np.array([one.available_to.timestamp() if one.available_to else np.inf for one in work.vehicles]),
        scale=np.array([1.0 / one.battery_health for one in work.vehicles]),
    )  # fmt: skip
    orders = _orders(work, begin_s, place_of, types, modes, parameters, promised)
    weigh = parameters.dispatch
    weights = Weights(weigh.lateness, weigh.energy_s, weigh.home)
    taken = _taken(holds, work, place_of, flights, problems[0].closures)
    return Laid(
        DispatchProblem(flights, fleet, orders, weights, taken), places, tuple((one.id, mass) for one, mass in modes)
    )


def latest_s(order: Order, weigh: DispatchParameters, *, promised: bool) -> float:
    """Return the latest delivery time of an order, POSIX seconds: a promised order is delivered late rather than never."""
    return order.due.timestamp() + (weigh.promised_late_s if promised else weigh.max_late_s)


def _modes(types: Sequence[Drone], masses: Sequence[float], classes: int) -> list[tuple[Drone, float]]:
    """Modes: each drone type empty, and with each class of packages that it may carry."""
    found = []
    for drone in types:
        steps = np.linspace(0.0, drone.max_payload_kg, classes + 1)[1:] if drone.max_payload_kg > 0.0 else np.empty(0)
        used = {float(steps[_class_of(mass, steps)]) for mass in masses if mass <= drone.max_payload_kg and len(steps)}
        found += [(drone, 0.0), *((drone, mass) for mass in sorted(used))]
    return found


def _class_of(mass_kg: float, steps: NDArray[np.float64]) -> int:
    return min(int(np.searchsorted(steps, mass_kg - 1e-9)), len(steps) - 1)


def mode_problem(
    work: Work, depart: datetime, forecast: WindEnsemble, parameters: PlannerParameters, drone: Drone, mass_kg: float, members: int | None = None,
    seen: PadsSeen = NOTHING_SEEN,
) -> Problem:  # fmt: skip
    """Return the problem of one drone with a package, in a forecast reduced to a number of members, by default that of `robust`."""
    stations = work.scenario.network.stations
    start = work.vehicles[0].place
    other = next((one.id for one in stations if one.id != start and not one.flyover), start)
    state = State(depart, start, None, 1.0, busy_pads=seen.busy, pads_free_s=seen.free_s)
    request = Request(state=state, destination=other, payload_kg=mass_kg, drone=drone.id, epsilon=DEFAULT_EPSILON)  # fmt: skip
    return Problem(work.scenario, request, drone, forecast, parameters=parameters).thinned(
        members or parameters.robust.members
    )


def _air_times(problem: Problem, places: Sequence[int], slots: int, hours: float) -> NDArray[np.float64]:
    """Time in the air of a flight without a landing between places by the slot in which it begins, s, shape (slots, places, places)."""
    speeds = MeanSpeeds(problem.air, problem.probability, max(hours, slots * problem.air.slot_s / S_PER_H))
    return air_times(problem, places, speeds.over(0, slots - 1, np.arange(len(problem.network.tail))))


def _speeds(problem: Problem, places: Sequence[int], air_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean ground speed of flights between places, m/s, in the shape of their times in the air: over the shortest path."""
    far_m, along_s = shortest_m(problem, places), np.maximum(air_s - fixed_s(problem), 1.0)
    return np.where(np.isfinite(far_m) & np.isfinite(air_s), far_m / along_s, np.inf)


def _pace_s(problem: Problem, places: Sequence[int], where: NDArray[np.int64]) -> float:
    """Time to charge a whole battery at the fastest rate of the median pad, s."""
    slopes = [time[1] / soc[1] for time, soc in (problem.curve(places[number]) for number in where)]
    return float(np.median(slopes))


def _charging(
    curves: Sequence[Problem], places: Sequence[int]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Charging curve of each drone type at each place, and the curves: times and charges."""
    points = max(problem.padded_curves[0].shape[1] for problem in curves)
    times, levels, of, first = [], [], [], 0
    for problem in curves:
        time_s, soc = problem.padded_curves
        width = (0, 0), (0, points - time_s.shape[1])
        times.append(np.pad(time_s, width, mode="edge"))
        levels.append(np.pad(soc, width, mode="edge"))
        of.append(first + problem.curve_of[list(places)])
        first += len(time_s)
    return np.array(of, dtype=np.int64), np.concatenate(times), np.concatenate(levels)


def _strangers(problem: Problem, places: Sequence[int], where: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean waits for pads because of strangers, shape (places, times), from the beginning of the forecast."""
    nodes = [places[number] for number in where]
    waits = problem.waits
    waits.need(nodes)
    found = np.zeros((len(places), waits.wait_s.shape[1]))
    found[where] = waits.wait_s[nodes]
    lead = max(round((waits.start_s - problem.air.start_s) / waits.step_s), 0)
    return np.ascontiguousarray(np.concatenate((np.repeat(found[:, :1], lead, axis=1), found), axis=1))


def _orders(work: Work, begin_s: float, place_of: dict[int, int], types: Sequence[Drone], modes: Sequence[tuple[Drone, float]], parameters: PlannerParameters, promised: Collection[str]) -> Orders:  # fmt: skip
    weigh, index = parameters.dispatch, work.scenario.network.index
    values = [one.value for one in work.orders if one.value]
    usual = sum(values) / len(values) if values else 1.0
    number = {(drone.id, mass): place for place, (drone, mass) in enumerate(modes)}
    mode = np.full((len(types), len(work.orders)), -1, dtype=np.int64)
    for row, drone in enumerate(types):
        steps = np.linspace(0.0, drone.max_payload_kg, weigh.payload_classes + 1)[1:]
        for column, order in enumerate(work.orders):
            if order.mass_kg <= drone.max_payload_kg + TOLERATED_KG and drone.max_payload_kg > 0.0:
                mode[row, column] = number[drone.id, float(steps[_class_of(order.mass_kg, steps)])]
    worth = [1.0 if one.value is None else min(max(one.value / usual, 0.25), 4.0) for one in work.orders]
    return Orders(
        origin=np.array([place_of[index[one.origin]] for one in work.orders], dtype=np.int64),
        destination=np.array([place_of[index[one.destination]] for one in work.orders], dtype=np.int64),
        ready_s=np.array([max(one.ready.timestamp(), begin_s) for one in work.orders], dtype=np.float64),
        due_s=np.array([one.due.timestamp() for one in work.orders], dtype=np.float64),
        refusal_s=np.array(
            [
                weigh.refusal_s * weigh.priority_factor ** (one.priority + (one.id in promised)) * share
                for one, share in zip(work.orders, worth, strict=True)
            ],
            dtype=np.float64,
        ),
        mode=mode,
        latest_s=np.array([latest_s(one, weigh, promised=one.id in promised) for one in work.orders], dtype=np.float64),
    )  # fmt: skip


def _usable(problem: Problem, places: Sequence[int], begin_s: float, end_s: float, busy: float) -> NDArray[np.int64]:
    """Number of pads of each place with which the fleet plans, shape (places,): those that strangers leave free of a share of them, at least one."""
    hours = int(np.ceil((end_s - begin_s) / S_PER_H)) + 1
    found, rest = [], 0.5
    for node in places:
        count = int(problem.network.pads[node])
        arrivals, charging = problem.load.hourly(node, begin_s, hours)
        rest += max(
            busy * count - float((arrivals * charging).mean()), 0.0
        )  # what is rounded off here counts at the next place
        found.append(min(max(int(rest), 1), count) if count else 0)
        rest -= found[-1]
    return np.array(found, dtype=np.int64)


def _taken(
    holds: Sequence[Hold], work: Work, place_of: dict[int, int], flights: Flights, closed: Mapping[int, Closures]
) -> tuple[tuple[int, float, float], ...]:
    """Windows in which pads are held by others, or closed, by the number of the pad among all; disjoint.

    Stations or pads that the scenario does not have are ignored.
    """
    index = work.scenario.network.index
    found: dict[int, list[tuple[float, float]]] = {}
    for hold in holds:
        place = place_of.get(index.get(hold.window.station, -1))
        if place is not None and hold.window.pad <= flights.pads[place]:
            pad = int(flights.first_pad[place]) + hold.window.pad - 1
            found.setdefault(pad, []).append((hold.window.opens.timestamp(), hold.window.closes.timestamp()))
    for node, closures in closed.items():
        if node in place_of:
            first = int(flights.first_pad[place_of[node]])
            for pad in range(first, first + int(flights.pads[place_of[node]])):
                found.setdefault(pad, []).extend((begin, end) for begin, end in closures.closed_s.tolist())
    return tuple((pad, begin, end) for pad in sorted(found) for begin, end in _merged(found[pad]))


def _merged(windows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Overlapping windows merged."""
    merged: list[tuple[float, float]] = []
    for begin, end in sorted(windows):
        if merged and begin <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(merged[-1][1], end)
        else:
            merged.append((begin, end))
    return merged
