"""The route that a mission flies: items in the order flown, with jumps followed and holds counted.

Endless jumps are followed once and reported, and then left as if a person had ended them: the items after them are checked
too. The number of steps is bounded for any file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import RELATIVE_FRAMES, TERRAIN_FRAMES
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.models.composition.release import hover_s

if TYPE_CHECKING:
    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.mission import Mission, MissionItem

MAX_REPEATED_STEPS = 20_000
"""Steps followed beyond the number of items, if jumps repeat some."""
DEFAULT_SPEED_MPS = 5.0
"""Speed if neither the mission nor its file gives one: PX4's default; ArduPilot's is 10."""


CIRCLE_RADIUS_M, CIRCLE_DEGPS, CIRCLE_MPS2 = 10.0, 20.0, 2.5
"""ArduPilot's defaults of a LOITER_TURNS: radius where the item gives 0 (CIRCLE_RADIUS), greatest rate (CIRCLE_RATE), and the
acceleration of which a circle may take half (WPNAV_ACCEL)."""


@dataclass(frozen=True, slots=True)
class Step:
    """A place the vehicle goes to."""

    item: int
    """Number of the item that commands it."""
    point: Point
    height_m: float
    """Above home; NaN if it cannot be determined from the file."""
    speed_mps: float
    """Commanded ground speed on the way there."""
    hold_s: float = 0.0
    """Time spent in the air on arrival; infinite for a loiter without end."""
    taken: int = 0
    """Place of the item in `Route.order`."""


@dataclass(slots=True)
class RouteLeg:
    """One flight, from the ground to the next landing (or to where the mission ends)."""

    item_from: int
    item_to: int
    """Numbers of the first and last item."""
    start: Point | None
    """Where it begins; None is unknown."""
    steps: list[Step] = field(default_factory=list)
    landing: str = "none"
    """``land``, ``return`` (to launch) or ``none``."""
    released: bool = False
    """Whether the package is released after this leg."""
    released_after: int | None = None
    """Number of steps that are flown with it, if it is released in the air."""

    def payloads_kg(self, payload_kg: float) -> list[float]:
        """Package carried on the way to each step, if there is one at the start."""
        with_it = len(self.steps) if self.released_after is None else self.released_after
        return [payload_kg] * with_it + [0.0] * (len(self.steps) - with_it)

    ground_hold_s: float | None = 0.0
    """Time on the ground afterwards; None if a person or arming ends it; 0 if the next leg follows at once."""

    @property
    def next_ground_m(self) -> float:
        """Height of the ground at its end, in the heights of the next flight: 0 if home moved there (disarmed)."""
        if self.ground_hold_s is None or not self.steps or self.landing != "land":
            return 0.0
        height = self.steps[-1].height_m
        return 0.0 if math.isnan(height) else height


@dataclass(frozen=True, slots=True)
class Route:
    """The route of a mission as flown."""

    legs: tuple[RouteLeg, ...]
    """In flying order."""
    endless_jumps: tuple[int, ...]
    """Items that jump back forever."""
    is_cut: bool
    """True if jumps repeat so often that the rest was omitted."""
    order: tuple[int, ...] = ()
    """Numbers of the items in the order in which they are taken, jumps left out: the mission unrolled."""

    @property
    def ends_in_endless_jump(self) -> bool:
        """Whether an endless jump comes after the last place: no later item could end the flight."""
        return bool(self.endless_jumps) and bool(self.legs) and self.legs[-1].item_to < max(self.endless_jumps)

    @property
    def steps(self) -> list[Step]:
        """All places in order."""
        return [step for leg in self.legs for step in leg.steps]


def fly(mission: Mission, *, autopilot: Family | None = None, laps: int = 1) -> Route:
    """Follow a mission from its first item to its end; endless jumps are followed a number of times.

    The autopilot matters: ArduPilot ignores the place of a TAKEOFF, and keeps its height for an altitude of 0. Without a home it
    returns to the first place.
    """
    return _Walk(mission, autopilot, laps).run()


def _circles_s(item: MissionItem, speed_mps: float) -> float:
    """Duration of a LOITER_TURNS, as ArduPilot flies it: no autopilot else flies it with a multirotor."""
    radius = abs(item.param3) if math.isfinite(item.param3) and item.param3 != 0 else CIRCLE_RADIUS_M
    fastest_mps = min(max(speed_mps, 0.1), math.sqrt(0.5 * CIRCLE_MPS2 * radius), math.radians(CIRCLE_DEGPS) * radius)
    turns = item.param1 if item.param1 > 0 else 0.0
    return turns * 2.0 * math.pi * radius / fastest_mps


class _Walk:
    """One pass through a mission."""

    def __init__(self, mission: Mission, autopilot: Family | None, laps: int) -> None:
        self.mission = mission
        self.laps = laps
        self.zero_means_as_it_is = autopilot is not None and autopilot.zero_means_as_it_is
        self.home = mission.home
        self.launch: Point | None = mission.home.point if mission.home else None
        self.speed_mps = self.default_speed_mps = mission.hover_speed_mps or DEFAULT_SPEED_MPS
        self.at: Point | None = self.launch
        self.height_m = 0.0
        self.legs: list[RouteLeg] = []
        self.leg: RouteLeg | None = None
        self.order: list[int] = []
        self.repeats: dict[int, int] = {}
        self.endless: dict[int, None] = {}
        self.tags = {
            int(item.param1): number
            for number, item in enumerate(mission.items)
            if item.command == Command.JUMP_TAG and math.isfinite(item.param1)
        }

    def run(self) -> Route:
        items = self.mission.items
        number, count = 0, 0
        most = len(items) + MAX_REPEATED_STEPS
        while 0 <= number < len(items) and count < most:
            count += 1
            item = items[number]
            target = self._jump(number, item)
            if target is None:
                self.order.append(number)
                if self._act(number, item):
                    break
                target = number + 1
            number = target
        if self.leg is not None:
            self.legs.append(self.leg)
        return Route(tuple(self.legs), tuple(self.endless), count >= most, tuple(self.order))

    def _jump(self, number: int, item: MissionItem) -> int | None:
        """Return the target of a jump, None if the mission continues with the next item; an endless one is taken `laps` times."""
        if item.command == Command.DO_JUMP:
            target = item.jump_target
        elif item.command == Command.DO_JUMP_TAG and math.isfinite(item.param1):
            target = self.tags.get(int(item.param1))
        else:
            return None
        if target is None or not 0 <= target < len(self.mission.items) or not math.isfinite(item.param2):
            return None
        done = self.repeats.get(number, 0)
        if item.param2 < 0:
            if done >= self.laps:
                self.endless[number] = None
                return None
        elif done >= item.param2:
            self.repeats[number] = 0
            return None
        self.repeats[number] = done + 1
        return target

    def _act(self, number: int, item: MissionItem) -> bool:
        """Take one item; return True where the mission ends with it."""
        command = item.command
        if command == Command.DO_CHANGE_SPEED:
            self._change_speed(item)
        elif command == Command.NAV_RETURN_TO_LAUNCH:
            self._return(number)
            return True
        elif command == Command.NAV_DELAY:
            self._delay(item)
        elif command == Command.DO_GRIPPER and item.param2 == 0:
            self._last_leg_released()
        elif command == Command.DO_WINCH and item.param2 == 1 and item.param3 > 0:
            self._released_here()
        elif command == Command.COMPONENT_ARM_DISARM and item.param1 == 0:
            if self.leg is None and self.legs:
                self.legs[-1].ground_hold_s = None
        elif item.is_flown_to:
            self._go(number, item)
            return command == Command.NAV_LOITER_UNLIM
        return False

    def _change_speed(self, item: MissionItem) -> None:
        if item.param1 in (0.0, 1.0) and item.param2 > 0:
            self.speed_mps = item.param2
        elif item.param2 == -2.0:
            self.speed_mps = self.default_speed_mps

    def _last_leg_released(self) -> None:
        leg = self.leg or (self.legs[-1] if self.legs else None)
        if leg is not None:
            leg.released = True

    def _released_here(self) -> None:
        """The package is released in the air, at the most recent place."""
        if self.leg is not None and self.leg.steps:
            self.leg.released_after = self.leg.released_after or len(self.leg.steps)

    def _delay(self, item: MissionItem) -> None:
        seconds = item.param1 if item.param1 > 0 else 0.0
        if self.leg is None:
            if self.legs and self.legs[-1].ground_hold_s is not None:
                self.legs[-1].ground_hold_s += seconds
        elif self.leg.steps:
            last = self.leg.steps[-1]
            self.leg.steps[-1] = replace(last, hold_s=last.hold_s + seconds)

    def _return(self, number: int) -> None:
        leg = self._open(number)
        leg.item_to = number
        leg.landing = "return"
        if self.launch is not None:
            step = Step(number, self.launch, self.height_m, self.speed_mps, taken=len(self.order) - 1)
            leg.steps.append(step)
        self._close(leg)

    def _go(self, number: int, item: MissionItem) -> None:
        leg = self._open(number)
        leg.item_to = number
        point = item.point or self.at
        if item.command in TAKEOFF_COMMANDS and self.zero_means_as_it_is:
            point = self.at or point
        if point is None:
            return
        if leg.start is None:
            leg.start = point
        if self.launch is None:
            self.launch = point
        self.height_m = self._height(item)
        hold_s = self._hold_s(item)
        leg.steps.append(Step(number, point, self.height_m, self.speed_mps, hold_s, len(self.order) - 1))
        self.at = point
        if item.command == Command.NAV_PAYLOAD_PLACE:
            self._released_here()
        if item.command in LAND_COMMANDS:
            leg.landing = "land"
            self._close(leg)

    def _open(self, number: int) -> RouteLeg:
        if self.leg is None:
            self.leg = RouteLeg(number, number, self.at)
        return self.leg

    def _close(self, leg: RouteLeg) -> None:
        self.legs.append(leg)
        self.leg = None

    def _height(self, item: MissionItem) -> float:
        on_the_way = item.command not in TAKEOFF_COMMANDS and item.command not in LAND_COMMANDS
        if item.z == 0 and on_the_way and self.zero_means_as_it_is:
            return self.height_m
        if item.frame in RELATIVE_FRAMES or item.frame in TERRAIN_FRAMES:
            return item.z
        if self.home is None or self.home.altitude_m is None:
            return math.nan
        return item.z - self.home.altitude_m

    def _hold_s(self, item: MissionItem) -> float:
        if item.command in TAKEOFF_COMMANDS or item.command in LAND_COMMANDS:
            return 0.0
        if item.command == Command.NAV_LOITER_UNLIM:
            return math.inf
        if item.command == Command.NAV_PAYLOAD_PLACE:
            return hover_s("place")  # it descends slowly until the package stands, releases it, and climbs back
        if item.command == Command.NAV_LOITER_TURNS:
            return _circles_s(item, self.speed_mps)
        if item.command in (Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TIME):
            return item.param1 if item.param1 > 0 else 0.0
        return 0.0
