"""The units of a mission as a problem of free order: the cost of each in either direction, and the ways between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.areas import leaves_fence
from skyway.missions.checks.hops import Hops
from skyway.missions.recharge.pad_ways import LOWEST_M, STEADY_S
from skyway.missions.recharge.reordered import HEAD, TAIL, Reorderer, Spot, Turn
from skyway.missions.recharge.units import divided
from skyway.missions.recharge.work import work_of
from skyway.missions.recharge.work_hops import times_and_charges
from skyway.models.base import geodesy
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.way_heights import level_over_m
from skyway.planner.fixed_route.orders import FreeOrder, Stretch
from skyway.recharge.problem import problem_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.missions.recharge.reordered import Reordered
    from skyway.missions.recharge.units import Division
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeOptions, RechargeProblem

MAX_UNITS = 400
"""More units are not reordered: their ways are too many to be computed."""


@dataclass(frozen=True, eq=False, slots=True)
class OrderTables:
    """A mission as units, its writer, and the problem of their order."""

    division: Division
    writer: Reorderer
    free: FreeOrder


class _Levels:
    """Height of ways that a mission does not have: that of ways to pads."""

    def __init__(self, ready: Prepared, options: RechargeOptions, highest_m: float) -> None:
        home = ready.document.mission.home
        self.home_m = 0.0 if home is None else home.altitude_m or 0.0
        self.floor_m, self.over = max(highest_m, options.transit.height_m or 0.0), options.transit.over

    def table(self, ends: Sequence[Spot], begins: Sequence[Spot]) -> NDArray[np.float64]:
        """Heights above home of the ways from each spot to each other one; NaN if the ground is unknown."""
        to = np.array(begins)
        level = np.maximum(np.maximum(np.array(ends)[:, None, 2], to[None, :, 2]), self.floor_m)
        if self.over is None:
            return np.asarray(level)
        for number, here in enumerate(ends):
            top = level_over_m((here.lat, here.lon), to[:, 0], to[:, 1], self.over) - self.home_m
            level[number] = np.where(np.isnan(top), np.nan, np.maximum(level[number], top))
        return np.asarray(level)

    def of(self, here: Spot, there: Spot) -> float:
        """Height of one way."""
        return float(self.table([here], [there])[0, 0])


def tables_of(ready: Prepared, options: RechargeOptions, sure_ratio: float, *, drones: int = 1) -> OrderTables | None:
    """Compute the units of a mission with their time and charge; None if it has none, or more than the limit."""
    work = ready.work(options)
    division = divided(work)
    if not division.units or len(division.units) > MAX_UNITS:
        return None
    levels = _Levels(ready, options, max(step.height_m for step in work.steps))
    keeps = any(family.zero_means_as_it_is for family in ([ready.by] if ready.by else ready.families))
    writer = Reorderer(work, division, levels.of, keeps_height_of_zero=keeps)
    both = [
        _Flown(ready, options, written)
        for written in (
            writer.reordered(writer.original()),
            writer.reordered([Turn(number, unit.reversible) for number, unit in enumerate(division.units)]),
        )
    ]
    forwards, backwards = both
    turns: list[Stretch | None] = []
    for number, unit in enumerate(division.units):
        turns += [forwards.stretch(1 + number), backwards.stretch(1 + number) if unit.reversible else None]
    way_s, way_soc = _ways(ready, options, writer, forwards, levels)
    visit_s, visit_soc = _visit(options, writer, forwards.problem, levels.floor_m)
    counts = [forwards.problem.ways.pads[pad].pads for pad, _ in forwards.problem.usable]
    free = FreeOrder(
        forwards.problem.route(sure_ratio),
        forwards.stretch(0),
        forwards.stretch(1 + len(division.units)),
        tuple(turns),
        tuple(unit.group for unit in division.units),
        way_s,
        way_soc,
        tuple(counts),
        drones,
        visit_s,
        visit_soc,
    )
    return OrderTables(division, writer, free)


class _Flown:
    """A mission in one order: its hops, and the points of each turn, head and tail."""

    def __init__(self, ready: Prepared, options: RechargeOptions, written: Reordered) -> None:
        self.work = work_of(written.mission, ready.by, only=ready.only)
        self.problem: RechargeProblem = problem_of(self.work, ready.ways(self.work, options), options)
        self.route = self.problem.route(1.0)
        item_of = [self.work.steps[point.step].item if point.step >= 0 else 0 for point in self.work.points]
        self.range: list[tuple[int, int]] = []
        for number, (begin, until) in enumerate(written.items):
            own = [one for one, item in enumerate(item_of) if begin <= item < until]
            if number and own:  # the way to it is not part of it
                first = self.work.points[own[0]].step
                own = [one for one in own if self.work.points[one].step > first or self.work.points[one].share == 1.0]
            self.range.append((own[0], own[-1] + 1))

    def stretch(self, number: int) -> Stretch:
        """Return the positions and hops of a turn; of the head for 0, of the tail for the last number."""
        begin, until = self.range[number]
        hops = self.route.hops
        return Stretch(
            hops.work_s[:, begin : until - 1],
            hops.work_soc[:, begin : until - 1],
            hops.to_s[:, begin:until],
            hops.to_soc[:, begin:until],
            hops.from_s[:, begin:until],
            hops.from_soc[:, begin:until],
            self.route.can_leave[begin:until],
        )

    def hold_s(self, number: int) -> float:
        """Time spent where a stretch begins."""
        return self.work.steps[self.work.points[self.range[number][0]].step].hold_s

    def way(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Time and charge by slot of the way from one stretch to the next."""
        begin, until = self.range[number][1] - 1, self.range[number + 1][0]
        hops = self.route.hops
        return hops.work_s[:, begin:until].sum(axis=1), hops.work_soc[:, begin:until].sum(axis=1)


def _ways(
    ready: Prepared, options: RechargeOptions, writer: Reorderer, forwards: _Flown, levels: _Levels
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time and charge of the ways between all turns, shape (slots, turns + 1, turns + 1); infinite if a way is not allowed."""
    units = writer.division.units
    turns = [Turn(number, reverse) for number in range(len(units)) for reverse in (False, True)]
    there_is = np.array([not turn.reverse or units[turn.unit].reversible for turn in turns])
    ends = [writer.ends(turn if there else Turn(turn.unit)) for turn, there in zip(turns, there_is, strict=True)]
    begins = [writer.begins(turn if there else Turn(turn.unit)) for turn, there in zip(turns, there_is, strict=True)]
    ends.append(writer.ends(Turn(HEAD)))
    begins.append(writer.begins(Turn(TAIL)))
    speeds = np.array([writer.speed_mps(turn) for turn in (*turns, Turn(TAIL))])
    holds = np.array([*(0.0 if turn.reverse else forwards.hold_s(1 + turn.unit) for turn in turns), 0.0])
    size = len(turns) + 1
    here, there = np.array(ends)[:, None, :], np.array(begins)[None, :, :]
    lat, lon = (np.broadcast_to(here[..., axis], (size, size)).ravel() for axis in (0, 1))
    to_lat, to_lon = (np.broadcast_to(there[..., axis], (size, size)).ravel() for axis in (0, 1))
    level = levels.table(ends, begins)
    climb = (level - here[..., 2]).ravel() / options.conditions.climb_rate_mps
    descent = (level - there[..., 2]).ravel() / options.conditions.descent_rate_mps
    length, bearing = geodesy.inverse(lat, lon, to_lat, to_lon)
    middle = geodesy.midpoint(lat, lon, bearing, length)
    hops = Hops(
        *middle, length, bearing, np.tile(np.maximum(speeds, 0.1), size), np.tile(holds, size), climb, descent,
        np.ones(size * size, dtype=bool), level.ravel(),
    )  # fmt: skip
    slots = forwards.problem.slots
    at_s = slots.start_s + slots.slot_s * (np.arange(slots.length, dtype=np.float64) + 0.5)
    kg = np.full(size * size, options.conditions.payload_kg)
    times, charges = (
        one.reshape(len(at_s), size, size) for one in times_and_charges(hops, kg, options.conditions, at_s)
    )
    # the landing of the mission is in the original way to its tail
    own_s, own_soc = forwards.way(len(units))
    before = 2 * (len(units) - 1)
    times[:, :-1, -1] += np.maximum(own_s - times[:, before, -1], 0.0)[:, None]
    charges[:, :-1, -1] += np.maximum(own_soc - charges[:, before, -1], 0.0)[:, None]
    shut = _shut(ready, options, lat, lon, to_lat, to_lon).reshape(size, size) | ~np.isfinite(level)
    same = np.repeat(np.arange(len(units)), 2)
    shut[:-1, :-1] |= same[:, None] == same[None, :]
    shut[:-1] |= ~there_is[:, None]
    shut[:, :-1] |= ~there_is[None, :]
    times[:, shut] = math.inf
    charges[:, shut] = 0.0
    for number in range(len(units) + 1):  # ways of the mission itself
        one = size - 1 if number == 0 else 2 * (number - 1)
        other = size - 1 if number == len(units) else 2 * number
        times[:, one, other], charges[:, one, other] = forwards.way(number)
    return np.ascontiguousarray(times), np.ascontiguousarray(charges)


def _shut(
    ready: Prepared,
    options: RechargeOptions,
    lat: NDArray[np.float64],
    lon: NDArray[np.float64],
    to_lat: NDArray[np.float64],
    to_lon: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether straight ways leave the fence or enter a zone."""
    ends = np.stack((np.column_stack((lon, lat)), np.column_stack((to_lon, to_lat))), axis=1)
    shut = np.zeros(len(lat), dtype=bool)
    for every in {family.within_every_inclusion_area for family in ready.families}:
        shut |= leaves_fence(ends, ready.document.fence, every=every)
    if options.transit.zones is not None:
        from skyway.models.airspace.ways import at_any_height

        shut |= np.asarray(options.transit.zones.crossed_by(at_any_height(lat, lon, to_lat, to_lon)))
    return shut


def _visit(
    options: RechargeOptions, writer: Reorderer, problem: RechargeProblem, floor_m: float
) -> tuple[float, float]:
    """Minimum time and charge of leaving the work for a pad and coming back, from any place between the units."""
    import shapely

    conditions, speed = (
        options.conditions,
        min(options.transit.speed_mps, options.conditions.drone.max_ground_speed_mps),
    )
    power = FlightPower.of(conditions.drone, 0.0)
    places = np.array(writer.work.places)
    lat0, lon0 = places.mean(axis=0)
    north, east = geodesy.local_offsets_m(places[:, 0], places[:, 1], lat0, lon0)
    hull = shapely.MultiPoint(np.column_stack((east, north))).convex_hull
    best = (math.inf, math.inf)
    for pad, ground in zip(problem.ways.pads, problem.ways.ground_m, strict=True):
        pad_north, pad_east = geodesy.local_offsets_m(pad.lat, pad.lon, lat0, lon0)
        # a plane is inaccurate for distant places
        away_s = 2.0 * 0.99 * float(hull.distance(shapely.Point(float(pad_east), float(pad_north)))) / speed
        up = max(floor_m, ground + LOWEST_M) - ground
        climb_s, descent_s = up / conditions.climb_rate_mps, up / conditions.descent_rate_mps
        seconds = away_s + climb_s + descent_s + STEADY_S
        joule = power.cruise_w * (away_s + STEADY_S) + power.climb_w * climb_s + power.descent_w * descent_s
        best = min(best[0], seconds), min(best[1], joule / power.battery_j)
    return best
