"""Tours of a fleet as problems: for the drones of one type at one station, its orders, all pads, and flights that are feasible in every hour of the plan.

A leg has the longest time and the greatest energy of any hour in which it may be flown, so a tour is feasible whenever its legs begin. Its energy grows
linearly with the mass on board, up to that of the heaviest load: the true energy is convex, so it is not above that. A station charges up to `level` at the slowest
rate below that, so no charge takes longer than planned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.calendar_kernels import Calendar, book
from skyway.planner.tours.problem import NO_DEPOT, Arcs, Charging, Pads, Vehicles, Visits, lay_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.orders.fitting import Work
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.dispatch.problem import Flights
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.tours.problem import Tours

HOME_S = 3600.0
"""A tour is home at most this time after its last order is due, s."""
FORBIDDEN = 1e6
"""Energy per kilogram if nothing can be carried."""
Taken = tuple[int, float, float]
"""A booked window of a pad: the pad's number among all, begin and end, POSIX seconds."""


@dataclass(frozen=True)
class Group:
    """Drones of one type at one station, and the orders there."""

    place: int
    """Place of the station in the dispatch problem."""
    drones: tuple[int, ...]
    orders: tuple[int, ...]
    """Numbers of the orders among all."""
    tours: Tours
    """Times in seconds from `begin_s`; energy is charge above the reserve, of a new battery; customer i is the
    order i - 1."""
    begin_s: float
    waits_s: NDArray[np.float64]
    """Shape (stations,): mean wait for a pad because of other drones, which the legs to a station include, s."""


def group_of(work: Work, laid: Laid, drones: Sequence[int], orders: Sequence[int], begin_s: float, taken: Sequence[Taken], parameters: PlannerParameters) -> Group:  # fmt: skip
    """Lay out the tours of some drones of one type at one station, for the orders there.

    Parameters
    ----------
    work : Work
        Orders and drones.
    laid : Laid
        All flights, drones and orders; its modes include the type with its full load.
    drones, orders : sequence of int
        Numbers; the drones stand at the station where all of the orders begin.
    begin_s : float
        Earliest beginning, POSIX seconds.
    taken : sequence of Taken
        Windows booked by others.
    parameters : PlannerParameters
        Parameters of the planners.
    """
    problem = laid.problem
    flights, wanted = problem.flights, problem.orders
    at, which = np.array(sorted(drones, key=lambda one: _likeness(laid, one, begin_s))), np.array(orders)
    place = int(problem.fleet.place[at[0]])
    places = np.concatenate(([place], wanted.destination[which], flights.stops))
    last_s = float(wanted.due_s[which].max()) + HOME_S
    arcs = _arcs(laid, work.vehicles[at[0]].type, places, begin_s, last_s)
    count, every = len(which), len(places)
    waits = _longest_waits(flights, begin_s, last_s)
    for table in (arcs.cost, arcs.time):
        table[0, :, count + 1 :] += waits
    due = np.concatenate(([last_s], wanted.due_s[which], np.full(len(flights.stops), last_s))) - begin_s
    demand, refusal, release = np.zeros(every), np.zeros(every), np.zeros(every)
    demand[1 : count + 1] = [work.orders[one].mass_kg for one in orders]
    refusal[1 : count + 1] = wanted.refusal_s[which]
    release[1 : count + 1] = wanted.ready_s[which] - begin_s
    visits = Visits(np.zeros(every), due, np.zeros(every), demand, refusal, release)
    health = 1.0 / problem.fleet.scale[at]
    budget = (1.0 - flights.reserve) * float(health.min())
    level = min((parameters.tours.level - flights.reserve) * float(health.min()), budget)
    charging = Charging(_slowest(flights, int(problem.fleet.type[at[0]]), parameters.tours.level), level, budget)
    payload = max(mass for drone, mass in laid.modes if drone == work.vehicles[at[0]].type)
    vehicles = _vehicles(laid, at, payload, begin_s, last_s)
    pads = Pads(flights.first_pad[flights.stops], flights.pads[flights.stops], _calendar(flights, taken, begin_s))
    tours, _ = lay_out(arcs, visits, np.arange(count + 1, every), vehicles, charging, pads, NO_DEPOT, alike=places)
    return Group(place, tuple(at.tolist()), tuple(which.tolist()), tours, begin_s, waits)


def _likeness(laid: Laid, drone: int, begin_s: float) -> tuple[float, ...]:
    """Return the properties by which drones of one type differ: availability and charge."""
    fleet = laid.problem.fleet
    energy = (fleet.soc[drone] - laid.problem.flights.reserve) / fleet.scale[drone]
    return max(float(fleet.from_s[drone]) - begin_s, 0.0), float(fleet.to_s[drone]), -float(energy)


def _vehicles(laid: Laid, drones: NDArray[np.int64], payload: float, begin_s: float, last_s: float) -> Vehicles:
    fleet = laid.problem.fleet
    alike = [_likeness(laid, int(one), begin_s) for one in drones]
    kind = np.cumsum([number > 0 and alike[number] != alike[number - 1] for number in range(len(alike))])
    return Vehicles(
        np.array([one[0] for one in alike]), np.minimum(fleet.to_s[drones], last_s) - begin_s, np.maximum([-one[2] for one in alike], 0.0),
        np.full(len(drones), payload), kind.astype(np.int64),
    )  # fmt: skip


def _arcs(laid: Laid, type_id: str, places: NDArray[np.int64], begin_s: float, last_s: float) -> Arcs:
    """Legs between some places in the worst of their hours, shape (1, places, places)."""
    flights = laid.problem.flights
    slots = slice(_slot(flights, begin_s), _slot(flights, last_s) + 1)
    modes = [(mass, number) for number, (drone, mass) in enumerate(laid.modes) if drone == type_id]
    pair = np.ix_(places, places)
    need = {mass: flights.need[number, slots].max(axis=0)[pair] for mass, number in sorted(modes)}
    time_s = np.zeros((len(places), len(places)))
    for mass, number in modes:
        slower = flights.time_s[number, slots].max(axis=0)[pair]
        time_s = np.where(np.isfinite(need[mass]), np.maximum(time_s, slower), time_s)
    empty = need[0.0]
    lift = np.full(empty.shape, FORBIDDEN)
    budget = 1.0 - flights.reserve
    loads = sorted(mass for mass in need if mass > 0.0)
    for mass in loads:
        flown = np.isfinite(need[mass])
        full = mass == loads[-1]
        with np.errstate(invalid="ignore"):
            rise = (
                (need[mass] if full else budget) - empty
            ) / mass  # beyond the heaviest load that can be flown no charge is left
        lift = np.where(flown, np.maximum(rise, 0.0), lift)
    same = places[:, None] == places[None]
    time_s, empty, lift = (np.where(same, 0.0, table) for table in (time_s, empty, lift))
    with np.errstate(invalid="ignore"):
        cost = np.where(np.isfinite(empty), time_s + laid.problem.weights.energy_s * empty, np.inf)
    return Arcs(*(np.ascontiguousarray(table[None]) for table in (cost, time_s, empty, lift)))


def _slot(flights: Flights, time_s: float) -> int:
    return int(np.clip((time_s - flights.start_s) // flights.slot_s, 0, flights.time_s.shape[1] - 1))


def _longest_waits(flights: Flights, begin_s: float, last_s: float) -> NDArray[np.float64]:
    """Longest mean wait for pads because of other drones at each stop, s."""
    first, last = (int((time - flights.start_s) / flights.wait_step_s) for time in (begin_s, last_s))
    columns = slice(max(first, 0), max(last, 0) + 1)
    waits = flights.wait_s[flights.stops, columns]
    longest: NDArray[np.float64] = waits.max(axis=1) if waits.shape[1] else flights.wait_s[flights.stops, -1]
    return longest


def _slowest(flights: Flights, kind: int, level: float) -> float:
    """Charging time of a whole battery at the slowest rate of any stop below a level, s."""
    slowest = 0.0
    for curve in np.unique(flights.curve_of[kind, flights.stops]):
        soc, time_s = flights.curve_soc[curve], flights.curve_s[curve]
        risen = np.diff(soc) > 0.0
        used = risen & (soc[:-1] < level - 1e-9)
        slowest = max(slowest, float((np.diff(time_s)[used] / np.diff(soc)[used]).max()))
    return slowest


def _calendar(flights: Flights, taken: Sequence[Taken], begin_s: float) -> Calendar:
    pads = int(flights.pads.sum())
    depth = int(np.bincount([pad for pad, _, _ in taken], minlength=pads).max(initial=0)) + 1
    shape = pads, depth
    calendar = Calendar(
        np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros(pads, dtype=np.int64)
    )
    for pad, from_s, to_s in taken:
        book(calendar, pad, from_s - begin_s, to_s - begin_s, -1)
    return calendar
