"""The missions that a mission is cut into: one for each battery.

Each except the first begins on a pad: it climbs, flies to the place where the work was left, repeats the commands in force there, and continues. Each except the
last stops running actions (pictures, video, spraying) and lands on a pad. Between, the items are those of the mission, jumps
unrolled; heights above home count from the pad, since home moves there when it is armed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import RELATIVE_FRAMES, TERRAIN_FRAMES, Frame
from skyway.missions.items.commands import LAND_COMMANDS, LOCATED_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.recharge.item_roles import PICTURES, SPEED, is_no_region, role_of
from skyway.missions.recharge.pad_ways import STEADY_S
from skyway.missions.recharge.pictures import NOT, ordered
from skyway.missions.recharge.spans import spans_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.route import Step
    from skyway.missions.recharge.bent_ways import Via
    from skyway.missions.recharge.pad_ways import PadWays, TransitRules
    from skyway.missions.recharge.spans import Cut, Done, Span
    from skyway.missions.recharge.work import Work, WorkPoint

EXACT_M = 1.0
"""Acceptance radius of places where the work is left and resumed."""


class PartBuilder:
    """Makes the missions of one work for one autopilot."""

    def __init__(self, work: Work, ways: PadWays, rules: TransitRules, family: Family) -> None:
        self.work, self.ways, self.rules, self.family = work, ways, rules, family
        if work.mission.home is None:
            raise ValueError("a mission without a home cannot be cut")
        self.home = work.mission.home
        self.step_of: dict[int, Step] = {step.taken: step for step in work.steps}
        first = work.steps[1].taken if len(work.steps) > 1 else len(work.route.order)
        items = (work.mission.items[number] for number in work.route.order[:first])
        self._orders_speed = any(item.command == Command.DO_CHANGE_SPEED for item in items)
        self.number_of = {step.taken: number for number, step in enumerate(work.steps)}

    def flights(self, cuts: Sequence[Cut], begin: tuple[int, int] | None = None) -> list[Mission]:
        """Return the mission of every flight from the ground to the next pad, or to the end."""
        return [self.flight(span) for span in spans_of(cuts, begin)]

    def flight(self, span: Span) -> Mission:
        """Return the mission of one flight."""
        if span.only_moves and span.begin is not None and span.end is not None:
            return self._from_pad_to_pad(span.begin[1], span.end[1])
        items = [item for item, _ in self._items(span)]
        return self._of(items, None if span.begin is None else span.begin[1])

    def reaches(self, span: Span) -> tuple[Done | None, ...]:
        """Return for each item of a flight the progress of the work when it is reached; None if it is not a place of the work."""
        if span.only_moves:
            return (None,) * len(self.flight(span).items)
        return tuple(done for _, done in self._items(span))

    def whole(self, flights: list[Mission]) -> tuple[Mission, tuple[int, ...]]:
        """Join flights to one mission that lands and disarms on every pad; return it and the first item of each flight.

        Heights count from the pad where it was armed. An autopilot that stays in its mission continues when it is armed again, without
        a TAKEOFF; another one begins each flight with its TAKEOFF, if that was made the current item before arming.
        """
        items, begins = list(flights[0].items), [0]
        for flight in flights[1:]:
            takeoff, speed, above, *rest = flight.items
            if takeoff.command != Command.NAV_TAKEOFF:
                raise ValueError("a flight from a pad begins with a take-off")
            items += self.family.disarm()
            begins.append(len(items))
            items += [above, speed, *rest] if self.family.stays_in_mission_after_landing else flight.items
        return replace(flights[0], items=tuple(items)), tuple(begins)

    def ground_m(self, pad: int | None) -> float:
        """Height of the ground at the start of a flight, above the home of the mission."""
        return 0.0 if pad is None else self.ways.ground_m[pad]

    def _items(self, span: Span) -> Iterator[tuple[MissionItem, Done | None]]:
        """Yield the items of a flight, each with the progress of the work when it is reached."""
        begin, end = span.begin, span.end
        ground = self.ground_m(None if begin is None else begin[1])
        first = 0
        if begin is not None:
            point = self.work.points[begin[0]]
            yield from ((item, None) for item in self._departure(*begin))
            yield from self._resumed(point, ground)
            first = point.taken
        until = len(self.work.route.order) if end is None else self.work.points[end[0]].taken
        for taken in range(first, until):
            step = self.number_of.get(taken)
            done = None if step is None else (step, 1.0)
            yield from ((item, done) for item in self._written(taken, ground))
            if begin is None and step == 0 and not self._orders_speed:
                # vehicles are set to the greatest speed of all flights, not to that of the file
                yield self._speed(self.work.points[0].speed_mps), None
        if end is not None:
            yield from self._left(self.work.points[end[0]], ground)
            yield from ((item, None) for item in self._to_pad(*end, ground))

    def _from_pad_to_pad(self, pad: int, following: int) -> Mission:
        ground = self.ground_m(pad)
        level = float(self.ways.between_level_m[pad, following])
        items = [
            self._over_pad(Command.NAV_TAKEOFF, pad, level, ground),
            self._speed(self.rules.speed_mps),
            self._over_pad(Command.NAV_WAYPOINT, pad, level, ground),
            *self._bends(self.ways.between_via.get((pad, following), ()), level - ground),
            self._over_pad(Command.NAV_WAYPOINT, following, level, ground),
            self._land(following, ground),
        ]
        return self._of(items, pad)

    def _of(self, items: list[MissionItem], pad: int | None) -> Mission:
        whole = self.work.mission
        home = self.home
        if pad is not None:
            station = self.ways.pads[pad]
            sea = None if home.altitude_m is None else round(home.altitude_m + self.ways.ground_m[pad], 2)
            home = Home(Point.of_degrees(station.lat, station.lon), sea)
        return Mission(
            tuple(items),
            home,
            whole.cruise_speed_mps,
            whole.hover_speed_mps,
            self.family.firmware,
            whole.vehicle_type,
        )

    def _departure(self, point: int, pad: int) -> Iterator[MissionItem]:
        """Climb above the pad and fly to above the point where the work continues."""
        level, ground = float(self.ways.back_level_m[point, pad]), self.ground_m(pad)
        here = self.work.points[point]
        lat, lon, _ = self.work.at(here.step, here.resume_share)
        yield self._over_pad(Command.NAV_TAKEOFF, pad, level, ground)
        yield self._speed(self.rules.speed_mps)
        yield self._over_pad(Command.NAV_WAYPOINT, pad, level, ground)
        yield from self._bends(self.ways.back_via.get((point, pad), ()), level - ground)
        yield self._place(Command.NAV_WAYPOINT, lat, lon, level - ground, self._transit_frame)

    def _resumed(self, point: WorkPoint, ground: float) -> Iterator[tuple[MissionItem, Done | None]]:
        """Resume the work, with all states in force there."""
        yield self._work_place(point, point.resume_share, ground, STEADY_S), (point.step, point.resume_share)
        held = self.work.state(point)
        yield self._speed(point.speed_mps), None
        for key, item in held.items():
            if key != SPEED and not key.startswith(PICTURES) and not _is_nothing(item):
                yield self._shifted(item, ground), None
        taking = self.work.taking(point)
        if not taking:
            return
        if point.next_share is not None:
            yield self._work_place(point, point.next_share, ground, 0.0), (point.step, point.next_share)
        pictures = held[PICTURES]
        # not at once: the picture of this place has been taken
        yield (replace(pictures, param3=0.0) if pictures.command == Command.DO_SET_CAM_TRIGG_DIST else pictures), None
        if pictures.command == Command.DO_SET_CAM_TRIGG_INTERVAL:
            yield MissionItem(Command.DO_TRIGGER_CONTROL, Frame.MISSION, 1.0), None

    def _left(self, point: WorkPoint, ground: float) -> Iterator[tuple[MissionItem, Done | None]]:
        """Fly as far as the work of this flight, and stop running actions."""
        if point.share < 1.0:
            yield self._work_place(point, point.share, ground, 0.0), (point.step, point.share)
        yield from ((item, None) for item in orders_off(self.work.state(point).values()))

    def _to_pad(self, point: int, pad: int, ground: float) -> Iterator[MissionItem]:
        level = float(self.ways.level_m[point, pad])
        here = self.work.points[point]
        yield self._speed(self.rules.speed_mps)
        yield self._place(Command.NAV_WAYPOINT, here.lat, here.lon, level - ground, self._transit_frame)
        yield from self._bends(self.ways.via.get((point, pad), ()), level - ground)
        yield self._over_pad(Command.NAV_WAYPOINT, pad, level, ground)
        yield self._land(pad, ground)

    def _bends(self, via: Via, height_m: float) -> Iterator[MissionItem]:
        """Fly around the obstacles of the straight way."""
        for lat, lon in via:
            yield self._place(Command.NAV_WAYPOINT, lat, lon, height_m, self._transit_frame)

    def _written(self, taken: int, ground: float) -> Iterator[MissionItem]:
        """Yield an item of the work in the form for a flight from a ground."""
        number = self.work.route.order[taken]
        item, step = self.work.mission.items[number], self.step_of.get(taken)
        if role_of(item) == "mark":
            return
        if item.command == Command.NAV_RETURN_TO_LAUNCH and step is not None:
            # launch is a different place for every flight except the first
            home = self.home.point
            yield self._place(Command.NAV_WAYPOINT, home.lat, home.lon, step.height_m - ground)
            yield self._place(Command.NAV_LAND, home.lat, home.lon, -ground)
            return
        if step is not None:
            keeps_height = item.z == 0.0 and item.command not in TAKEOFF_COMMANDS | LAND_COMMANDS
            if item.point is None:
                item = replace(item, x=step.point.lat_e7, y=step.point.lon_e7)
            if keeps_height and self.family.zero_means_as_it_is and item.frame not in TERRAIN_FRAMES:
                item = replace(item, frame=Frame.GLOBAL_RELATIVE_ALT, z=step.height_m)
        yield self._shifted(item, ground)

    def _shifted(self, item: MissionItem, ground: float) -> MissionItem:
        """Convert a height above home to one above the ground of take-off."""
        counts = (item.command in LOCATED_COMMANDS and item.frame in RELATIVE_FRAMES) or (
            item.command == Command.CONDITION_CHANGE_ALT
        )
        if not counts or ground == 0.0 or math.isnan(item.z):
            return item
        return replace(item, z=round(item.z - ground, 2), extra={})

    def _work_place(self, point: WorkPoint, share: float, ground: float, hold_s: float) -> MissionItem:
        """Return a waypoint on the way of the work."""
        lat, lon, height = self.work.at(point.step, share)
        item = self.work.mission.items[self.work.steps[point.step].item]
        terrain = item.frame in TERRAIN_FRAMES
        frame = Frame.GLOBAL_TERRAIN_ALT if terrain else Frame.GLOBAL_RELATIVE_ALT
        found = self._place(Command.NAV_WAYPOINT, lat, lon, height if terrain else height - ground, frame)
        return replace(found, param1=hold_s, param2=EXACT_M)

    @property
    def _transit_frame(self) -> Frame:
        return Frame.GLOBAL_TERRAIN_ALT if self.ways.above_terrain else Frame.GLOBAL_RELATIVE_ALT

    def _over_pad(self, command: Command, pad: int, level_m: float, ground: float) -> MissionItem:
        station = self.ways.pads[pad]
        if command == Command.NAV_TAKEOFF or not self.ways.above_terrain:
            return self._place(command, station.lat, station.lon, level_m - ground)
        return self._place(command, station.lat, station.lon, level_m, self._transit_frame)

    def _land(self, pad: int, ground: float) -> MissionItem:
        station = self.ways.pads[pad]
        return self._place(Command.NAV_LAND, station.lat, station.lon, self.ways.ground_m[pad] - ground)

    def _place(
        self, command: Command, lat: float, lon: float, height_m: float, frame: Frame = Frame.GLOBAL_RELATIVE_ALT
    ) -> MissionItem:
        point = Point.of_degrees(lat, lon)
        yaw = self.family.open_yaw_deg
        z = round(height_m, 2) + 0.0
        return MissionItem(command, frame, param4=yaw, x=point.lat_e7, y=point.lon_e7, z=z)

    def _speed(self, speed_mps: float) -> MissionItem:
        return MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, round(speed_mps, 2), -1.0)


def orders_off(items: Iterable[MissionItem]) -> tuple[MissionItem, ...]:
    """Return the commands that stop actions which some items start and no command ends: pictures, video, spraying; each once."""
    found: dict[tuple[int, float], MissionItem] = {}
    for item in items:
        off: MissionItem | None = None
        if item.command == Command.DO_SET_CAM_TRIGG_INTERVAL and ordered(item, NOT):
            off = MissionItem(Command.DO_TRIGGER_CONTROL, Frame.MISSION)
        elif item.command == Command.IMAGE_START_CAPTURE and ordered(item, NOT):
            off = MissionItem(Command.IMAGE_STOP_CAPTURE, Frame.MISSION, item.param1)
        elif ordered(item, NOT) or (item.command == Command.DO_SPRAYER and item.param1 == 1.0):
            off = MissionItem(item.command, Frame.MISSION)
        elif item.command == Command.VIDEO_START_CAPTURE:
            off = MissionItem(Command.VIDEO_STOP_CAPTURE, Frame.MISSION, item.param1)
        if off is not None:
            found[off.command, off.param1] = off
    return tuple(found.values())


def _is_nothing(item: MissionItem) -> bool:
    """Whether a command only ends something: a new flight begins without it."""
    return item.command in (Command.VIDEO_STOP_CAPTURE, Command.IMAGE_STOP_CAPTURE) or is_no_region(item)


def completed(mission: Mission, *, lands: bool, takes_off_m: float | None) -> tuple[Mission, tuple[str, ...]]:
    """Add a take-off and a return to launch to a mission that lacks them, with notes; heights above home."""
    items, notes = list(mission.items), []
    if takes_off_m is not None and mission.home is not None:
        point = mission.home.point
        takeoff = MissionItem(
            Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=round(takes_off_m, 2)
        )
        # jumps use item numbers of the unchanged mission
        items = [takeoff, *(_later(item) for item in items)]
        notes.append("there was no TAKEOFF: one was added")
    if not lands:
        items.append(MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION))
        notes.append("the mission ended in the air: it returns to launch")
    if not notes:
        return mission, ()
    return replace(mission, items=tuple(items), complex_items=()), tuple(notes)


def _later(item: MissionItem) -> MissionItem:
    return item if item.jump_target is None or item.param1 < 0 else replace(item, param1=item.param1 + 1.0)
