"""Execution of a mission, item by item."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.behaviours import Behaviour, Circle, Climb, Fly, Land, Wait
from skyway.sim_stub.autopilot.items import NAV_COMMANDS, RELATIVE_FRAMES, Command, Item
from skyway.sim_stub.autopilot.payload_place import Place
from skyway.sim_stub.plant.physics import Demand, offset_m

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot

_MAX_SKIPS = 255
"""Items that may be passed without flying before the mission counts as an endless loop."""


class MissionState(IntEnum):
    """MISSION_STATE of MISSION_CURRENT."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(slots=True)
class MissionRun:
    """Where a vehicle is in its mission."""

    items: list[Item] = field(default_factory=list)
    """In the vehicle's own numbering."""
    current: int = 0
    """The item in progress or next."""
    behaviour: Behaviour | Place | None = None
    """What the current item has it do; None before it starts."""
    pending: list[int] = field(default_factory=list)
    """DO and CONDITION items that run beside the current one."""
    state: MissionState = MissionState.NO_MISSION
    """As reported."""
    repeats: dict[int, int] = field(default_factory=dict)
    condition_s: float | None = None
    hold: Fly | None = None

    def reset(self) -> None:
        """Forget all progress."""
        self.current = 0
        self.behaviour = self.hold = None
        self.pending.clear()
        self.repeats.clear()
        self.condition_s = None
        self.state = MissionState.NOT_STARTED if self.items else MissionState.NO_MISSION

    def begin_again(self) -> None:
        """Forget how often jumps were taken, and that the mission is complete; the current item stays."""
        self.repeats.clear()
        if self.state == MissionState.COMPLETE:
            self.state = MissionState.NOT_STARTED

    def jump(self, index: int) -> None:
        """Make an item the current one; it starts at the next step."""
        self.current = index
        self.behaviour = None
        self.pending.clear()
        self.condition_s = None
        if self.state in (MissionState.COMPLETE, MissionState.UNKNOWN):
            self.state = MissionState.NOT_STARTED

    def pause(self) -> None:
        """Stop flying it, keep the place."""
        if self.state == MissionState.ACTIVE:
            self.state = MissionState.PAUSED
        self.behaviour = self.hold = None

    def step(self, pilot: Autopilot) -> Demand:
        """Fly the mission for one step."""
        if self.state in (MissionState.PAUSED, MissionState.COMPLETE):
            return self._hold(pilot)
        if self.behaviour is None:
            self._begin(pilot, self.current)
        if self.behaviour is None:
            return self._hold(pilot)
        behaviour = self.behaviour
        self.state = MissionState.ACTIVE
        self._run_pending(pilot)
        demand = behaviour.step(pilot)
        if behaviour.done and pilot.armed and self.behaviour is behaviour:
            pilot.item_done(self.current)
            if self.state == MissionState.ACTIVE and self.behaviour is behaviour:
                self._begin(pilot, self.current + 1)
        return demand

    def _hold(self, pilot: Autopilot) -> Demand:
        if pilot.body.grounded:
            return Demand(up_mps=-0.1)
        if self.hold is None:
            self.hold = pilot.hover_here()
        return self.hold.step(pilot)

    def _begin(self, pilot: Autopilot, index: int) -> None:
        """Find the next item that takes time and begin it, passing the others on the way."""
        self.behaviour = self.hold = None
        passed: list[int] = []
        for _ in range(_MAX_SKIPS):
            if index >= len(self.items):
                self._complete(pilot, passed)
                return
            item = self.items[index]
            if item.command == Command.DO_JUMP:
                index = self._jump_target(index, item)
                continue
            if item.command in NAV_COMMANDS:
                break
            if item.command == Command.COMPONENT_ARM_DISARM and item.p1 == 0.0:
                for number in passed:
                    pilot.execute(self.items[number])
                self.current = index + 1
                self.state = MissionState.ACTIVE
                pilot.disarm(force=False, by="mission")
                return
            passed.append(index)
            index += 1
        else:
            pilot.say(4, "Mission: endless loop")
            self._complete(pilot, [])
            return
        self.current = index
        self.pending = passed
        self.behaviour = self._behaviour(pilot, item, index)
        pilot.item_begun(index)

    def _complete(self, pilot: Autopilot, passed: list[int]) -> None:
        for index in passed:
            pilot.execute(self.items[index])
        self.state = MissionState.COMPLETE
        self.current = max(len(self.items) - 1, 0)
        pilot.mission_done()

    def _jump_target(self, index: int, item: Item) -> int:
        times = -1 if item.p2 < 0 else int(min(item.p2, 1e6))
        left = self.repeats.get(index, times)
        if left == 0:
            return index + 1
        self.repeats[index] = left - 1 if left > 0 else left
        return max(0, int(item.p1))

    def _run_pending(self, pilot: Autopilot) -> None:
        while self.pending:
            item = self.items[self.pending[0]] if self.pending[0] < len(self.items) else None
            if item is not None:
                if self.condition_s is None:
                    self.condition_s = pilot.sim_s
                    pilot.execute(item)
                if not self._holds(pilot, item, self.condition_s):
                    return
                self.condition_s = None
            self.pending.pop(0)

    def _holds(self, pilot: Autopilot, item: Item, since_s: float) -> bool:
        """Whether what an item waits for has come; those that wait for nothing are done."""
        match item.command:
            case Command.CONDITION_DELAY:
                return pilot.sim_s >= since_s + min(max(item.p1, 0.0), 1e7)
            case Command.CONDITION_DISTANCE:
                return not isinstance(self.behaviour, Fly) or self.behaviour.distance_m <= item.p1
            case Command.CONDITION_YAW:
                return pilot.yaw_reached()
            case _:
                return True

    def _behaviour(self, pilot: Autopilot, item: Item, index: int) -> Behaviour | Place:
        """What the item has the vehicle do."""
        body = pilot.body
        lat, lon = (item.lat, item.lon) if item.has_position else (pilot.lat, pilot.lon)
        altitude = self._altitude_m(pilot, item)
        radius = pilot.acceptance_m(item)
        match item.command:
            case Command.TAKEOFF:
                if body.grounded or not item.has_position:
                    return Climb(pilot.lat, pilot.lon, max(altitude, body.alt_m + 1.0))
                return Fly(lat, lon, altitude, radius)
            case Command.LAND:
                return Land(lat, lon)
            case Command.PAYLOAD_PLACE:
                return Place(lat, lon, max(item.p1, 0.0))
            case Command.RETURN_TO_LAUNCH:
                return pilot.return_home()
            case Command.DELAY:
                return Wait(pilot.sim_s + pilot.delay_s(item))
            case Command.LOITER_UNLIM:
                return Fly(lat, lon, altitude, radius, math.inf, _yaw(item.p4))
            case Command.LOITER_TURNS:
                wide_m, speed_mps = pilot.circling(abs(item.p3))
                return Circle(lat, lon, altitude, wide_m, speed_mps, item.p1, clockwise=item.p3 >= 0.0)
            case Command.LOITER_TIME:
                return Fly(lat, lon, altitude, radius, min(max(item.p1, 0.0), 1e7), _yaw(item.p4))
            case Command.LOITER_TO_ALT:
                return Fly(lat, lon, altitude, max(radius, 2.0))
            case _:
                stay = min(max(item.p1, 0.0), 1e7) if math.isfinite(item.p1) else 0.0
                through = 0.0 if stay > 0.0 else self._pass_mps(pilot, lat, lon, index)
                return Fly(
                    lat, lon, altitude, radius, stay, _yaw(item.p4 if pilot.KEEPS_HEADINGS else math.nan), through
                )

    @staticmethod
    def _altitude_m(pilot: Autopilot, item: Item) -> float:
        """Height above mean sea level; that of a relative frame counts from the present home."""
        height = item.z if math.isfinite(item.z) else 0.0
        if item.frame in RELATIVE_FRAMES:
            height += pilot.home_alt_m
        return max(-1000.0, min(20_000.0, height))

    def _pass_mps(self, pilot: Autopilot, lat: float, lon: float, index: int) -> float:
        """Speed at which a waypoint is passed: full on a straight course, 0 at a corner of 90 degrees."""
        following = self.items[index + 1 : index + 4]
        item = next((i for i in following if i.command in NAV_COMMANDS), None)
        if item is None or item.command not in (Command.WAYPOINT, Command.SPLINE_WAYPOINT):
            return 0.0
        if any(i.command == Command.DO_JUMP for i in following) or not item.has_position:
            return 0.0
        north, east = offset_m(pilot.lat, pilot.lon, lat, lon)
        next_north, next_east = offset_m(lat, lon, item.lat, item.lon)
        lengths = math.hypot(north, east) * math.hypot(next_north, next_east)
        if lengths <= 0.0:
            return 0.0
        return max(0.0, (north * next_north + east * next_east) / lengths) * pilot.cruise_mps


def _yaw(degrees: float) -> float | None:
    return degrees if math.isfinite(degrees) else None
