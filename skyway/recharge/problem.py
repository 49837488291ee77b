"""A mission and pads as the problem of a fixed route: the cost of every hop in the winds of the forecast."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.energy import fly_leg, p_within
from skyway.missions.checks.weather import ForecastWind
from skyway.missions.recharge.pad_ways import bent_hops, hops_between_pads, hops_from_pads, hops_to_pads
from skyway.missions.recharge.work_hops import times_and_charges, work_hops
from skyway.models.base.units import S_PER_H
from skyway.models.drones.time_belief import GROUND_S
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.kernels import Slots
from skyway.models.queues.waiting_times import STEP_S, forecast_waits
from skyway.planner.fixed_route.battery_packs import PackPool, swap_stops
from skyway.planner.fixed_route.charging_stops import FixedRoute, charging_stops
from skyway.planner.fixed_route.pad_windows import ALWAYS, NEVER
from skyway.planner.fixed_route.sharing import on_windows
from skyway.planner.fixed_route.way_kernels import Hops as RouteHops

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.hops import Hops
    from skyway.missions.recharge.pad_ways import PadWays, TransitRules
    from skyway.missions.recharge.work import Work
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.network.station import Station
    from skyway.models.queues.load import PadLoad
    from skyway.planner.fixed_route.charging_stops import ChargingPlan
    from skyway.planner.fixed_route.pad_windows import Window
    from skyway.planner.fixed_route.sharing import Stay

MAX_SLOTS = 24
"""Number of slots of a forecast that are considered; the last one continues."""
AT_ONCE_S = 1e-3
MORE_SURE, MOST_MORE = 1.02, 1.2
"""Least and greatest factor of additional charge of flights if one of them does not keep the reserve with the required probability."""
LEAST_P = 0.5
MOST_SURE, BISECTIONS = 4.0, 12
EPSILON = 0.001
"""A flight may miss the reserve with this probability; the same as in checks."""


@dataclass(frozen=True, slots=True)
class PadQueues:
    """Other drones at the pads: their load, and the time of the first take-off."""

    load: PadLoad
    stations: tuple[Station, ...]
    """In the order of the load."""
    depart_s: float


@dataclass(frozen=True, slots=True)
class RechargeOptions:
    """Options of a cut; manoeuvres are included."""

    conditions: FlightConditions
    transit: TransitRules
    queues: PadQueues | None = None
    epsilon: float = EPSILON
    level_ground: bool = False
    laps: int = 1
    """Number of repetitions of endless jumps."""
    swap_s: float | None = None
    """Duration of a change of batteries, which replaces charging."""
    packs: int | None = None
    """Number of batteries, the drone's included; None: as many as required."""
    chargers: int = 1
    """Chargers for removed packs, if `packs` is given."""
    single: bool = False
    """Whether all flights are also written as one mission."""
    seed: int = 0
    windows: Mapping[str, tuple[Window, ...]] = field(default_factory=dict)
    """By the id of a pad, when it can be used, seconds after the first take-off; always if it is absent."""
    reorder: bool = False
    """Whether independent parts may be reordered."""
    ground_s: float = GROUND_S
    """Time at each stop, before the take-off: in addition to waiting, charging and changing the battery."""
    window_slack_s: float = 0.0
    """Stops end this long before the window of their pad: charging may take longer."""
    held: tuple[Stay, ...] = ()
    """Bookings of others by numbered pad; pads by their place among all."""

    def __post_init__(self) -> None:
        if not self.conditions.manoeuvres:
            object.__setattr__(self, "conditions", replace(self.conditions, manoeuvres=True))


@dataclass(frozen=True, eq=False, slots=True)
class RechargeProblem:
    """The fixed route of a mission, and its inputs."""

    work: Work
    ways: PadWays
    options: RechargeOptions
    hops: RouteHops
    slots: Slots
    curves: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]
    waits: tuple[NDArray[np.float64], ...]
    p_free: tuple[NDArray[np.float64], ...] = field(default=())
    """Probability that an arrival finds a free pad, at the points of `waits`."""

    @property
    def usable(self) -> tuple[tuple[int, Window], ...]:
        """Pads with the times in which each can be used: one for each window; the first pad without times if none can be used."""
        windows = self.options.windows
        found = tuple(
            (number, window) for number, pad in enumerate(self.ways.pads) for window in windows.get(pad.id, (ALWAYS,))
        )
        return found or ((0, NEVER),)

    def route(self, sure_ratio: float) -> FixedRoute:
        """Return the route with a multiple of the modelled charge of each flight.

        Its pads are those of `usable`.
        """
        conditions = self.options.conditions
        can_leave = np.array([point.hinders is None for point in self.work.points])
        route = FixedRoute(
            self.hops,
            self.slots,
            can_leave,
            self.curves,
            self.waits,
            0.0,
            conditions.soc_start,
            conditions.reserve_soc,
            1.0,
            sure_ratio,
        )
        if not self.options.windows:
            return route
        less_s = self.options.ground_s + self.options.window_slack_s
        return on_windows(route, [(pad, (first, last - less_s)) for pad, (first, last) in self.usable])

    def stops(self, sure_ratio: float) -> ChargingPlan | None:
        """Return the stops with which the mission ends first, or None if none let it end; their pads are those of `ways`."""
        pool, route = pool_of(self.options), self.route(sure_ratio)
        plan = charging_stops(route) if pool is None else swap_stops(route, pool)
        if plan is None:
            return None
        return self.told(plan)

    def told(self, plan: ChargingPlan, first: int = 0) -> ChargingPlan:
        """Return a plan of `route` with pads of `ways` and points that begin at `first`; in its hops, a way from a pad begins with the time on the ground."""
        stops = tuple(
            replace(
                stop,
                position=first + stop.position,
                pad=self.usable[stop.pad][0],
                leave_s=stop.leave_s + self.options.ground_s,
            )
            for stop in plan.stops
        )
        return replace(plan, stops=stops)


def slots_of(conditions: FlightConditions) -> Slots:
    """Return the times of changes of the wind, in seconds after the first take-off; one slot if it does not change."""
    weather = conditions.weather
    if not isinstance(weather, ForecastWind):
        return Slots(0.0, S_PER_H, 1)
    ensemble = weather.ensemble
    first = max(ensemble.slot_at(weather.depart_s), 0)
    count = max(1, min(ensemble.slots - first, MAX_SLOTS))
    return Slots(ensemble.start_s + first * ensemble.slot_s - weather.depart_s, ensemble.slot_s, count)


def problem_of(work: Work, ways: PadWays, options: RechargeOptions) -> RechargeProblem:
    """Compute time and charge of every hop of a mission, to its pads and back."""
    conditions, transit = options.conditions, options.transit
    slots = slots_of(conditions)
    at_s = slots.start_s + slots.slot_s * (np.arange(slots.length, dtype=np.float64) + 0.5)
    on_work, payload = work_hops(work, conditions)
    points, pads = len(work.points), len(ways.pads)
    carried = np.concatenate((payload, payload[-1:]))

    def table(hops: Hops, kg: NDArray[np.float64], *shape: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        times, charges = times_and_charges(hops, kg, conditions, at_s)
        return (
            np.ascontiguousarray(times.reshape(len(at_s), *shape)),
            np.ascontiguousarray(charges.reshape(len(at_s), *shape)),
        )

    def add_bends(
        values: tuple[NDArray[np.float64], NDArray[np.float64]], hops: Hops, owner: NDArray[np.int64]
    ) -> None:
        if not len(owner):
            return
        kg = np.full(len(owner), float(carried.max()))
        for whole, parts in zip(values, times_and_charges(hops, kg, conditions, at_s), strict=True):
            for row, more in zip(whole.reshape(len(at_s), -1), parts, strict=True):
                np.add.at(row, owner, more)

    heaviest = np.full(pads * pads, float(carried.max()), dtype=np.float64)
    to_pads = table(hops_to_pads(work, ways, transit, conditions), np.repeat(carried, pads), points, pads)
    from_pads = table(hops_from_pads(work, ways, transit, conditions), np.repeat(carried, pads), points, pads)
    between = table(hops_between_pads(ways, transit, conditions), heaviest, pads, pads)
    add_bends(to_pads, *bent_hops(work, ways, transit, back=False))
    add_bends(from_pads, *bent_hops(work, ways, transit, back=True))
    add_bends(between, *bent_hops(None, ways, transit, back=False))
    from_pads = from_pads[0] + options.ground_s, from_pads[1]
    between = between[0] + options.ground_s, between[1]
    found = RouteHops(
        *table(on_work, payload, points - 1),
        *to_pads,
        *from_pads,
        *between,
        np.arange(points),
    )
    curves = tuple(conditions.drone.charging_curve(pad.recharge_power_w).piecewise() for pad in ways.pads)
    waits, free = _waits(ways.pads, options.queues)
    if options.swap_s is not None:  # after such a wait a full battery is ready
        curves = tuple((np.array([0.0, AT_ONCE_S]), np.array([0.0, 1.0])) for _ in ways.pads)
        waits = tuple(wait + np.array([0.0, options.swap_s]) for wait in waits)
    return RechargeProblem(work, ways, options, found, slots, curves, waits, free)


def _waits(
    pads: tuple[Station, ...], queues: PadQueues | None
) -> tuple[tuple[NDArray[np.float64], ...], tuple[NDArray[np.float64], ...]]:
    """Return the expected wait at each pad by arrival, seconds after the first take-off; none if no others are known."""
    waits, free = [np.zeros((1, 2)) for _ in pads], [np.ones(1) for _ in pads]
    if queues is None:
        return tuple(waits), tuple(free)
    numbers = {station.id: number for number, station in enumerate(queues.stations)}
    counts = np.array([station.pads for station in queues.stations], dtype=np.int64)
    wanted = {place: numbers[pad.id] for place, pad in enumerate(pads) if pad.id in numbers}  # no others use a van
    found = forecast_waits(queues.load, counts, list(wanted.values()), queues.depart_s, float(MAX_SLOTS), {})
    for place, number in wanted.items():
        wait = found[number].wait_s
        waits[place] = np.column_stack((STEP_S * np.arange(len(wait), dtype=np.float64), wait))
        free[place] = found[number].p_free
    return tuple(waits), tuple(free)


def pool_of(options: RechargeOptions) -> PackPool | None:
    """Return the packs and chargers; None if batteries are charged on the pad, or as many as required."""
    if options.swap_s is None or options.packs is None:
        return None
    curve = options.conditions.drone.charging_curve().piecewise()
    return PackPool(options.packs, options.chargers, options.swap_s, *curve)


def sure_ratio_of(options: RechargeOptions, work: Work | None = None) -> float:
    """Return the charge of a flight at the allowed failure probability, over the model's.

    The share of manoeuvres in it is that in some given work; without that, none.
    """
    turns = 0.0 if work is None else _share_of_turns(work, options.conditions)
    return max(1.0, sure_of(options.conditions.drone.energy_belief, options.epsilon, turns))


def sure_of(belief: EnergyBelief, epsilon: float, turns: float) -> float:
    """Return the charge of a flight at some failure probability, over the model's; `turns` is the share of manoeuvres in that."""
    if not math.isfinite(epsilon):
        return 1.0
    low = high = belief.quantile(1.0 - epsilon)
    if not turns > 0.0:
        return high
    one = np.ones(1)
    while float(p_within(one, turns, high, belief)[0]) < 1.0 - epsilon and high < MOST_SURE:
        low, high = high, 1.1 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if float(p_within(one, turns, middle, belief)[0]) < 1.0 - epsilon:
            low = middle
        else:
            high = middle
    return high


def _share_of_turns(work: Work, conditions: FlightConditions) -> float:
    """Return the share of manoeuvres in the energy of some work."""
    clock_s, kg = np.zeros(len(conditions.weather.probability)), conditions.payload_kg
    flown = [fly_leg(work.mission, leg, conditions, kg, clock_s, 0.0) for leg in work.route.legs if leg.steps]
    energy_j = sum(float(np.median(one.energy_j)) for one in flown)
    turns_j = FlightPower.of(conditions.drone, kg).cruise_w * sum(one.turns_s for one in flown)
    return turns_j / energy_j if energy_j > 0.0 else 0.0


def surer(sure_ratio: float, least: float, options: RechargeOptions) -> float:
    """Return the charge factor of a flight whose reserve holds only with a probability of `least`."""
    belief = options.conditions.drone.energy_belief
    lacks = belief.quantile(1.0 - options.epsilon) / belief.quantile(min(max(least, LEAST_P), 1.0 - options.epsilon))
    return sure_ratio * min(max(lacks, MORE_SURE), MOST_MORE)
