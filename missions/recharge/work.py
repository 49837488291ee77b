"""The work of a mission: every point at which it may be left and resumed, and the state there.

The route is that of the checks (`missions.checks.route`): jumps followed, holds counted. Points are the items with a place,
and points on straight legs between them, so that a leg that is longer than a battery can be left on the way. Where pictures are taken
every so many metres or seconds, a leg is left half-way between two of them, and resumed at the place of the first, so that none
is lost and none is taken twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.missions.checks.route import MAX_REPEATED_STEPS, fly
from skyway.missions.items.altitude_frames import frame_name
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.recharge.item_roles import role_of, state_key
from skyway.missions.recharge.pictures import NOT, Taking, along_leg, ordered, restarts, takes_one, within
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.route import Route, Step
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.mission import Mission, MissionItem

Place = tuple[float, float]
"""Latitude and longitude, degrees."""
EVERY_S = 15.0
"""Approximate number of points at which a leg may be left."""
LEAST_LEFT_M = 4.0
"""A leg is not left nearer than this to its end, but at the end."""
RUN_UP_M = 40.0
"""Before a place where pictures begin the work is not left nearer than this: it is flown through as fast, and from the same side, as without a cut."""
SAME_PICTURE_M = 0.05


class Picture(NamedTuple):
    """A picture: its place, the step whose way it is on, and the share of the leg; the item, if one commands it."""

    lat: float
    lon: float
    step: int
    share: float
    item: int | None = None


@dataclass(frozen=True, slots=True)
class WorkPoint:
    """A point of the work: the mission as far as here is done."""

    lat: float
    lon: float
    height_m: float
    """Above the home of the mission."""
    step: int
    """The step that leads here, -1 at the start; its leg is flown as far as `share`."""
    share: float
    taken: int
    """Number of items of the unrolled mission that are done."""
    speed_mps: float
    """Commanded on the way on."""
    hinders: int | None = None
    """Number of the item that prevents leaving it here; None if it may be left."""
    resume_share: float = 1.0
    """Where the leg is resumed: at the place of the last picture, otherwise at `share`."""
    next_share: float | None = None
    """Where pictures at a time interval begin again."""
    on_ground: bool = False


@dataclass(frozen=True, slots=True)
class Work:
    """A mission as its points, in order, and its pictures."""

    mission: Mission
    route: Route
    steps: tuple[Step, ...]
    places: tuple[Place, ...]
    """Where each step begins; the last entry is where the last one ends."""
    heights_m: tuple[float, ...]
    """Likewise, above home."""
    points: tuple[WorkPoint, ...]
    pictures: tuple[Picture, ...]

    def at(self, step: int, share: float) -> tuple[float, float, float]:
        """Return latitude, longitude and height above home of a point on the way to a step."""
        place = self.places[0] if step < 0 else _between(self.places[step], self.places[step + 1], share)
        return (*place, self.height_m(step, share))

    def height_m(self, step: int, share: float) -> float:
        """Return the height above home of a point on the way to a step."""
        if step < 0:
            return self.heights_m[0]
        return self.heights_m[step] + share * (self.heights_m[step + 1] - self.heights_m[step])

    def state(self, point: WorkPoint) -> dict[str, MissionItem]:
        """Return the states in force at a point: the latest command of each kind, in the given order."""
        held: dict[str, MissionItem] = {}
        for number in self.route.order[: point.taken]:
            item = self.mission.items[number]
            if role_of(item) == "way":
                held.pop("CONDITION_YAW", None)  # a heading is in force on one way only
            elif role_of(item) == "state":
                held.pop(state_key(item), None)
                held[state_key(item)] = item
        return held

    def taking(self, point: WorkPoint) -> Taking:
        """Return how pictures are taken at a point."""
        found = NOT
        for number in self.route.order[: point.taken]:
            found = ordered(self.mission.items[number], found)
        return found


def work_of(
    mission: Mission,
    family: Family | None = None,
    *,
    laps: int = 1,
    only: bool = True,
    last_picture: Place | None = None,
) -> Work:
    """Return the work of a mission as flown by a family of autopilots, endless jumps followed `laps` times.

    `only`: no other family flies it, too; otherwise it is not left where their ways differ.
    `last_picture`: place of the last picture before it.

    Raises an `InputError` if its home is unknown, if it never ends, if a height is unknown, or if there is nothing to fly.
    """
    if mission.home is None:
        remedy = (
            "set the planned home in the ground station, or give --home lat,lon: heights and the way back count from it"
        )
        raise InputError("the mission's home is unknown", field="mission", remedy=remedy)
    route = fly(mission, autopilot=family, laps=laps)
    if route.is_cut:
        raise too_many_repeats()
    steps = tuple(route.steps)
    if not steps:
        raise InputError("the mission goes nowhere: no item has a position", field="mission")
    for step in steps:
        if math.isinf(step.hold_s):
            name = mission.items[step.item].name
            raise InputError(f"item {step.item} ({name}) never ends", remedy="give it a time, or remove it")
        if math.isnan(step.height_m):
            remedy = "set the altitude of the planned home: heights above sea level count from it (--home-elevation)"
            raise InputError(f"the height of item {step.item} above home is unknown", remedy=remedy)
    return _Reading(mission, route, steps, only=only, last=last_picture).work()


def too_many_repeats() -> InputError:
    """Return the error of a mission whose jumps are not followed to their end."""
    told = f"the jumps of the mission repeat too often: more than {MAX_REPEATED_STEPS} steps"
    return InputError(told, field="mission", remedy="reduce the numbers of repeats")


class _Reading:
    """One pass over the steps of a mission."""

    def __init__(
        self, mission: Mission, route: Route, steps: tuple[Step, ...], *, only: bool, last: Place | None
    ) -> None:
        self.mission, self.route, self.steps, self.only = mission, route, steps, only
        firsts = {id(leg.steps[0]): leg.start for leg in route.legs if leg.steps}
        places: list[Place] = []
        heights: list[float] = []
        before: Point | None = mission.home.point if mission.home else None
        height = 0.0
        for step in steps:
            start = firsts.get(id(step), before) or step.point
            places.append((start.lat, start.lon))
            heights.append(height)
            before, height = step.point, step.height_m
            if mission.items[step.item].command == Command.NAV_RETURN_TO_LAUNCH:
                height = 0.0
        self.places = (*places, (steps[-1].point.lat, steps[-1].point.lon))
        self.heights = (*heights, height)
        self.taking = NOT
        self.last = last
        self.since_s = 0.0
        """Time since the last picture of those at a time interval."""
        self.restarted = max((n for n, one in enumerate(route.order) if restarts(mission.items[one])), default=-1)
        self.pictures: list[Picture] = []
        self.points: list[WorkPoint] = []
        self.bound: int | None = None

    def work(self) -> Work:
        order, items = self.route.order, self.mission.items
        self._orders(0, self.steps[0].taken, -1)
        lat, lon = self.places[0]
        hinders = self.bound if self.bound is not None else self.steps[0].item
        self.points.append(WorkPoint(lat, lon, 0.0, -1, 1.0, 0, self.steps[0].speed_mps, hinders, on_ground=True))
        for number, step in enumerate(self.steps):
            last = number == len(self.steps) - 1
            until = len(order) if last else self.steps[number + 1].taken
            run = [items[one] for one in order[step.taken + 1 : until]]
            self._leg(number, step, RUN_UP_M if self._begin_pictures(run) else LEAST_LEFT_M)
            done = self._left_behind(run)
            self._orders(step.taken + 1, step.taken + 1 + done, number)
            begins = self._begin_pictures(run[done:]) and not self.taking
            self._item(number, step, step.taken + 1 + done, last=last, begins=begins)
            self._orders(step.taken + 1 + done, until, number)
        return Work(
            self.mission,
            self.route,
            self.steps,
            self.places,
            self.heights,
            tuple(self.points),
            tuple(self.pictures),
        )

    @staticmethod
    def _begin_pictures(run: Sequence[MissionItem]) -> bool:
        """Whether some of the commands at a place start pictures."""
        return any(ordered(item, NOT) for item in run)

    def _left_behind(self, run: Sequence[MissionItem]) -> int:
        """Return the number of commands at a place that are done before it is left: its events, and those until no pictures are taken."""
        least, taking = 0, self.taking
        for index, item in enumerate(run):
            if role_of(item) in ("condition", "bound"):
                break
            if role_of(item) == "event":
                least = index + 1
        best = None
        for index in range(len(run) + 1):
            if index >= least and not taking:
                best = index
                break
            if index < len(run):
                if role_of(run[index]) in ("condition", "bound"):
                    break
                taking = ordered(run[index], taking)
        return least if best is None else best

    def _orders(self, begin: int, end: int, step: int) -> None:
        """Apply the commands at a place."""
        lat, lon = self.places[step + 1] if step >= 0 else self.places[0]
        for taken in range(begin, end):
            number = self.route.order[taken]
            item = self.mission.items[number]
            if role_of(item) == "bound" and self.bound is None:
                self.bound = number
            before, self.taking = self.taking, ordered(item, self.taking)
            goes_on = self.taking.every_s > 0.0 and before.paused and not self.taking.paused
            if takes_one(item) or goes_on:
                self.pictures.append(Picture(lat, lon, step, 1.0, number))
                self.last, self.since_s = (lat, lon), 0.0
            if self.taking and self.last is None:
                self.last = (lat, lon)

    def _leg(self, number: int, step: Step, run_up_m: float) -> None:
        """Fly to a step: the pictures on the way, and the points at which it may be left, none nearer to its end than `run_up_m`."""
        item = self.mission.items[step.item]
        if role_of(item) == "bound" and self.bound is None:
            self.bound = step.item
        start, end = self.places[number], self.places[number + 1]
        length = geodesy.distance_m(*start, *end)
        shares = self._pictures(number, step, start, end, length)
        if not self._is_straight(number, item) or length < 2.0 * LEAST_LEFT_M:
            return
        least_share = max(EVERY_S * step.speed_mps, LEAST_LEFT_M) / length
        if self.taking:
            self._between_pictures(number, step, shares, length, least_share)
            return
        count = math.floor(1.0 / least_share)
        for index in range(1, count):
            if (1.0 - index / count) * length < run_up_m:
                break
            self._inside(number, step, index / count, index / count, None)

    def _pictures(self, number: int, step: Step, start: Place, end: Place, length: float) -> list[float]:
        """Take the pictures of a leg; return their shares of it."""
        taking = self.taking
        if not taking:
            return []
        if taking.every_s > 0.0:
            shares = self._by_time(taking.every_s, length / step.speed_mps, step.hold_s)
        elif length < 0.01:
            return []
        else:
            plane = [_plane(place, start) for place in (start, end, self.last or start)]
            shares = list(along_leg((plane[0][0], plane[0][1]), plane[1], plane[2], taking.every_m))
        for (lat, lon), share in zip(_all_between(start, end, shares), shares, strict=True):
            self.pictures.append(Picture(lat, lon, number, share))
            self.last = (lat, lon)
        return shares

    def _by_time(self, every_s: float, way_s: float, hold_s: float) -> list[float]:
        """Return the shares of a leg at which pictures at a time interval are due; those of the stay at its end are at its end."""
        at_s = within(self.since_s, every_s, way_s + hold_s)
        self.since_s += way_s + hold_s - len(at_s) * every_s
        return [min(one / way_s, 1.0) if way_s > 0.0 else 1.0 for one in at_s]

    def _is_straight(self, number: int, item: MissionItem) -> bool:
        """Whether the way to a step is a straight line that may be left: no curve, no take-off or landing, no command that waits."""
        if self.bound is not None or item.command != Command.NAV_WAYPOINT or not number or self._paused(number - 1):
            return False
        before = self.steps[number - 1]
        begin = self.mission.items[before.item]
        if begin.command in LAND_COMMANDS or begin.command == Command.NAV_SPLINE_WAYPOINT:
            return False
        aside_m = geodesy.distance_m(*self.places[number - 1], *self.places[number])
        if not self.only and begin.command in TAKEOFF_COMMANDS and aside_m > 1.0:
            return False  # an autopilot that climbs at its position flies another way from there
        run = [self.mission.items[one] for one in self.route.order[before.taken + 1 : self.steps[number].taken]]
        if any(role_of(one) == "condition" for one in run):
            return False
        if any(one.command == Command.CONDITION_YAW and one.param4 == 1.0 for one in run):
            return False  # relative to a heading that it does not have again
        same_reference = frame_name(begin.frame) == frame_name(item.frame)
        return same_reference or frame_name(item.frame) != "terrain" != frame_name(begin.frame)

    def _between_pictures(
        self, number: int, step: Step, shares: Sequence[float], length: float, least_share: float
    ) -> None:
        """Points half-way between two pictures, no more than necessary."""
        last = 0.0
        every_s = self.taking.every_s > 0.0
        for index, share in enumerate(shares):
            following = shares[index + 1] if index + 1 < len(shares) and shares[index + 1] < 1.0 else None
            middle = 0.5 * (share + (1.0 if following is None else following))
            if following is None and every_s:
                continue
            if middle - last < least_share or (1.0 - middle) * length < LEAST_LEFT_M or middle <= share:
                continue
            self._inside(number, step, middle, share, following if every_s else None)
            last = middle

    def _inside(self, number: int, step: Step, share: float, resume: float, following: float | None) -> None:
        lat, lon = _between(self.places[number], self.places[number + 1], share)
        height = self.heights[number] + share * (self.heights[number + 1] - self.heights[number])
        self.points.append(
            WorkPoint(lat, lon, height, number, share, step.taken, step.speed_mps, None, resume, following)
        )

    def _item(self, number: int, step: Step, taken: int, *, last: bool, begins: bool) -> None:
        item = self.mission.items[step.item]
        lat, lon = self.places[number + 1]
        on_ground = item.command in LAND_COMMANDS or item.command == Command.NAV_RETURN_TO_LAUNCH
        ahead = step if last else self.steps[number + 1]
        hinders = self._hinders(number, ahead, (lat, lon), on_ground=on_ground)
        if begins and hinders is None:
            hinders = step.item  # the first picture is taken where the vehicle passes, on its way there
        height = self.heights[number + 1]
        self.points.append(
            WorkPoint(lat, lon, height, number, 1.0, taken, ahead.speed_mps, hinders, on_ground=on_ground)
        )

    def _paused(self, number: int) -> bool:
        """Whether pictures were stopped that a command after a step resumes."""
        return self.taking.paused and self.steps[number].taken < self.restarted

    def _hinders(self, number: int, ahead: Step, here: Place, *, on_ground: bool) -> int | None:
        """Return the item that prevents leaving the mission at a step, None if there is none."""
        step = self.steps[number]
        item = self.mission.items[step.item]
        if self.bound is not None:
            return self.bound
        if on_ground or item.command in TAKEOFF_COMMANDS:
            return step.item
        curve = Command.NAV_SPLINE_WAYPOINT
        if curve in (item.command, self.mission.items[ahead.item].command) and not step.hold_s:
            return step.item  # the form of a curve depends on the places before and after it
        if self._paused(number):
            return step.item
        if self.taking and (self.last is None or geodesy.distance_m(*self.last, *here) > SAME_PICTURE_M):
            return step.item
        if self.taking and self.taking.every_s > 0.0:
            return step.item
        return None


def _plane(place: Place, origin: Place) -> tuple[float, float]:
    """Metres east and north of an origin."""
    north, east = geodesy.local_offsets_m(place[0], place[1], *origin)
    return float(east), float(north)


def _between(start: Place, end: Place, share: float) -> Place:
    """Return the place at a share of a straight way."""
    if share in (0.0, 1.0):
        return end if share else start
    length, bearing = geodesy.way(*start, *end)
    return geodesy.direct(*start, bearing, share * length)


def _all_between(start: Place, end: Place, shares: Sequence[float]) -> list[Place]:
    """Return the places at shares of a straight way."""
    length, bearing = geodesy.way(*start, *end)
    count = len(shares)
    lat, lon = geodesy.ahead(
        np.full(count, start[0]),
        np.full(count, start[1]),
        np.full(count, bearing),
        np.array(shares) * length,
    )
    places = zip(lat.tolist(), lon.tolist(), strict=True)
    return [start if share == 0.0 else end if share == 1.0 else at for share, at in zip(shares, places, strict=True)]
