"""A mission with its units in another order: every state restored, every picture at its place.

A way that the mission does not have is at the height of the ways to pads: no lower than the highest place of the mission, or the height required by a terrain model.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from skyway.missions.items.altitude_frames import TERRAIN_FRAMES, Frame
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import MissionItem
from skyway.missions.recharge.item_roles import SPEED, role_of, state_key
from skyway.missions.recharge.units import ROI, lasting, tidied
from skyway.missions.recharge.work import SAME_PICTURE_M
from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from skyway.missions.items.mission import Mission
    from skyway.missions.recharge.units import Division, Unit
    from skyway.missions.recharge.work import Picture, Work

EXACT_M = 1.0
HIGHER_M = 0.5
"""A smaller excess of height is ignored."""
HEAD, TAIL = -1, -2
"""In place of a unit: the part before the first one, and the part after the last."""


class Spot(NamedTuple):
    """A place in the air, height above home."""

    lat: float
    lon: float
    height_m: float


class Turn(NamedTuple):
    """A unit with its direction: from its beginning, or from its end."""

    unit: int
    reverse: bool = False


@dataclass(frozen=True, slots=True)
class Reordered:
    """A mission, and the ranges of its items for each turn, head and tail included."""

    mission: Mission
    items: tuple[tuple[int, int], ...]
    """From, until: of the head, of each turn, and of the tail."""


class Reorderer:
    """Writes a mission in other orders. `level_m` returns the height of a way between two spots."""

    def __init__(
        self, work: Work, division: Division, level_m: Callable[[Spot, Spot], float], *, keeps_height_of_zero: bool
    ) -> None:
        self.work, self.division, self.level_m, self.zero = work, division, level_m, keeps_height_of_zero
        self.items, self.steps, self.order = work.mission.items, work.steps, work.route.order
        self.step_of = {step.taken: number for number, step in enumerate(work.steps)}
        self.picture_steps = [one.step for one in work.pictures]
        self.head_until = work.steps[division.units[0].first].taken
        self.tail_step = division.units[-1].last + 1
        self.tail_from = self._taken(self.tail_step)
        self.terrain = any(self.items[step.item].frame in TERRAIN_FRAMES for step in work.steps)

    def original(self) -> list[Turn]:
        """Return the order of the mission itself."""
        return [Turn(number) for number in range(len(self.division.units))]

    def reordered(self, tour: Sequence[Turn], *, events: bool = True) -> Reordered:
        """Return the mission with its units in an order; without `events`, single events before and after them are omitted."""
        head = [self._written(taken) for taken in range(self.head_until)]
        head = [one for one in tidied(head) if role_of(one) != "mark" and (events or role_of(one) != "event")]
        written = list(head)
        ranges = [(0, len(written))]
        before, read = Turn(HEAD), 0
        held: dict[str, MissionItem] = {}
        for turn in (*tour, Turn(TAIL)):
            held = self._held(written[read:], held)
            read = len(written)
            written += self._way(before, turn, held)
            begin = len(written)
            if turn.unit == TAIL:
                rest = [self._written(taken) for taken in range(self.tail_from, len(self.order))]
                written += [one for one in rest if role_of(one) != "mark" and (events or role_of(one) != "event")]
            else:
                written += self._turn(turn)
            ranges.append((begin, len(written)))
            before = turn
        mission = replace(self.work.mission, items=tuple(written), complex_items=())
        return Reordered(mission, tuple(ranges))

    def begins(self, turn: Turn) -> Spot:
        """Return where a unit begins in its direction; for the tail, its first place."""
        if turn.unit == TAIL:
            return self._spot(min(self.tail_step, len(self.steps) - 1))
        unit = self._unit(turn)
        if not turn.reverse:
            return self._spot(unit.first)
        _, end = self._core(unit)
        return self._spot(unit.last) if unit.last > end else self._at(self._pictures(unit)[-1])

    def ends(self, turn: Turn) -> Spot:
        """Return where a unit ends in its direction; for the head, the place before the first unit."""
        if turn.unit == HEAD:
            return self._spot(self.division.units[0].first - 1)
        unit = self._unit(turn)
        if not turn.reverse:
            return self._spot(unit.last)
        begin, _ = self._core(unit)
        return self._spot(unit.first) if unit.first < begin else self._beyond(unit)

    def is_own(self, before: Turn, turn: Turn) -> bool:
        """Whether the mission itself has the way between two turns."""
        if before.reverse or turn.reverse:
            return False
        last = len(self.division.units) - 1
        after = 0 if before.unit == HEAD else TAIL if before.unit == last else before.unit + 1
        return turn.unit == after

    def speed_mps(self, turn: Turn) -> float:
        """Return the commanded speed of the way to a turn."""
        step = self.tail_step if turn.unit == TAIL else self._unit(turn).first
        return self.steps[min(step, len(self.steps) - 1)].speed_mps

    def _unit(self, turn: Turn) -> Unit:
        return self.division.units[turn.unit]

    def _taken(self, step: int) -> int:
        return self.steps[step].taken if step < len(self.steps) else len(self.order)

    def _spot(self, step: int) -> Spot:
        return Spot(*self.work.places[step + 1], self.work.heights_m[step + 1])

    def _at(self, picture: Picture) -> Spot:
        return Spot(*self.work.at(picture.step, picture.share))

    @staticmethod
    def _held(items: Iterable[MissionItem], before: Mapping[str, MissionItem]) -> dict[str, MissionItem]:
        """Return the states in force after some items, given those before."""
        held = dict(before)
        for item in items:
            if role_of(item) == "way":
                held.pop("CONDITION_YAW", None)
            elif role_of(item) == "state":
                held.pop(state_key(item), None)
                held[state_key(item)] = item
        return held

    @cached_property
    def _targets(self) -> dict[int, dict[str, MissionItem]]:
        """Return the states in force where each unit and the tail begin, by their first step."""
        found: dict[int, dict[str, MissionItem]] = {}
        held: dict[str, MissionItem] = {}
        read = 0
        for step in sorted({self.tail_step, *(unit.first for unit in self.division.units)}):
            until = self._taken(step)
            held = self._held((self.items[one] for one in self.order[read:until]), held)
            found[step], read = held, until
        return found

    def _way(self, before: Turn, turn: Turn, held: Mapping[str, MissionItem]) -> list[MissionItem]:
        """Repeat the states in force for a turn, and fly to it; `held` are those in force now."""
        step = self.tail_step if turn.unit == TAIL else self._unit(turn).first
        target = self._targets[step]
        wanted, known = lasting(target), lasting(held)
        found = [item for key, item in wanted.items() if known.get(key) != item]
        if ROI in known and ROI not in wanted:
            found.append(MissionItem(Command.DO_SET_ROI_NONE, Frame.MISSION))
        if step < len(self.steps):
            speed, now = self.steps[step].speed_mps, held.get(SPEED)
            default = self.work.mission.hover_speed_mps
            if speed != (default if now is None else now.param2) and (now is not None or SPEED in target or default):
                found.append(MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, round(speed, 2), -1.0))
        if self.is_own(before, turn):
            return found
        here, there = self.ends(before), self.begins(turn)
        level = self.level_m(here, there)
        if level > here.height_m + HIGHER_M:
            found.append(self._place(here._replace(height_m=level)))
        returns = step < len(self.steps) and self.items[self.steps[step].item].command == Command.NAV_RETURN_TO_LAUNCH
        if level > there.height_m + HIGHER_M and not returns:
            found.append(self._place(there._replace(height_m=level)))
        return found

    def _turn(self, turn: Turn) -> list[MissionItem]:
        unit = self._unit(turn)
        return self._backwards(unit) if turn.reverse else self._forwards(unit)

    def _forwards(self, unit: Unit) -> list[MissionItem]:
        """Write a unit unchanged, its first picture by distance at its place, whatever the last picture before it."""
        begin, until = self.steps[unit.first].taken, self._taken(unit.last + 1)
        first = next((taken for taken in range(begin, until) if _by_distance(self.items[self.order[taken]])), None)
        late: dict[int, list[MissionItem]] = {}
        dropped = None
        now: MissionItem | None = None
        if first is not None and self.items[self.order[first]].param3 != 1.0:
            step = max(number for taken, number in self.step_of.items() if taken <= first)
            pictures = [one for one in self._pictures(unit) if one.step > step]
            if pictures:
                at = self._at(pictures[0])
                now = replace(self.items[self.order[first]], param3=1.0, extra={})
                if geodesy.distance_m(at.lat, at.lon, *self.work.places[step + 1]) > SAME_PICTURE_M:
                    dropped = first
                    late[self.steps[pictures[0].step].taken] = [self._exact(at, pictures[0].step), now]
        found: list[MissionItem] = []
        for taken in range(begin, until):
            found += late.get(taken, [])
            if taken != dropped:
                found.append(now if now is not None and taken == first else self._written(taken))
        tail = [one for one in found if role_of(one) != "mark"]
        return tidied(tail)

    def _backwards(self, unit: Unit) -> list[MissionItem]:
        """Write a line from its end: the last picture at once, and so on until half a spacing beyond the first."""
        begin, end = self._core(unit)
        pictures = self._pictures(unit)
        found = [self._written(self.steps[step].taken) for step in range(unit.last, end, -1)]
        found.append(self._exact(self._at(pictures[-1]), pictures[-1].step))
        orders = [self.items[one] for one in self.order[self.steps[begin].taken : self._taken(begin + 1)]]
        found.append(replace(next(one for one in orders if _by_distance(one)), param3=1.0, extra={}))
        inside = range(min(end, pictures[-1].step) - 1, begin, -1)
        found += [self._written(self.steps[step].taken) for step in inside]
        found.append(self._exact(self._beyond(unit), begin + 1))
        found.append(MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION))
        return [*found, *(self._written(self.steps[step].taken) for step in range(begin - 1, unit.first - 1, -1))]

    def _core(self, unit: Unit) -> tuple[int, int]:
        """Return the steps from and to which a line takes its pictures."""
        on = range(unit.first, unit.last + 1)
        begin = next(step for step in on if any(_by_distance(one) for one in self._orders(step)))
        return begin, next(
            step for step in on if step > begin and any(_ends_pictures(one) for one in self._orders(step))
        )

    def _orders(self, step: int) -> list[MissionItem]:
        return [self.items[one] for one in self.order[self.steps[step].taken + 1 : self._taken(step + 1)]]

    def _pictures(self, unit: Unit) -> list[Picture]:
        """Return the pictures of a unit on its ways, including those that a command takes at once where a line begins."""
        begin, until = bisect_left(self.picture_steps, unit.first), bisect_right(self.picture_steps, unit.last)
        return [one for one in self.work.pictures[begin:until] if not self._is_event(one)]

    def _is_event(self, picture: Picture) -> bool:
        return picture.item is not None and not _by_distance(self.items[picture.item])

    def _beyond(self, unit: Unit) -> Spot:
        """Return the place half a spacing beyond the first picture of a line."""
        begin, _ = self._core(unit)
        first = self._at(self._pictures(unit)[0])
        every_m = next(one.param1 for one in self._orders(begin) if _by_distance(one))
        _, bearing = geodesy.inverse(*self.work.places[begin + 2], *self.work.places[begin + 1])
        lat, lon = geodesy.direct(first.lat, first.lon, float(bearing), every_m / 2.0)
        return Spot(float(lat), float(lon), first.height_m)

    def _written(self, taken: int) -> MissionItem:
        """Return an item in a form that may follow any other: places and heights relative to the item before are made explicit."""
        item, number = self.items[self.order[taken]], self.step_of.get(taken)
        if number is None or item.command == Command.NAV_RETURN_TO_LAUNCH:
            return item
        step = self.steps[number]
        keeps_height = item.z == 0.0 and item.command not in TAKEOFF_COMMANDS | LAND_COMMANDS
        if item.point is None:
            item = replace(item, x=step.point.lat_e7, y=step.point.lon_e7)
        if keeps_height and self.zero and item.frame not in TERRAIN_FRAMES:
            item = replace(item, frame=Frame.GLOBAL_RELATIVE_ALT, z=step.height_m)
        return item

    def _exact(self, spot: Spot, step: int) -> MissionItem:
        """Return a waypoint on the way to a step."""
        item = self._place(spot)
        terrain = self.items[self.steps[step].item].frame in TERRAIN_FRAMES
        frame = Frame.GLOBAL_TERRAIN_ALT if terrain else Frame.GLOBAL_RELATIVE_ALT
        return replace(item, frame=frame, param2=EXACT_M)

    def _place(self, spot: Spot) -> MissionItem:
        point = Point.of_degrees(spot.lat, spot.lon)
        frame = Frame.GLOBAL_TERRAIN_ALT if self.terrain else Frame.GLOBAL_RELATIVE_ALT
        yaw = next((item.param4 for item in self.items if item.command == Command.NAV_WAYPOINT), 0.0)
        return MissionItem(
            Command.NAV_WAYPOINT, frame, param4=yaw, x=point.lat_e7, y=point.lon_e7, z=round(spot.height_m, 2) + 0.0
        )


def _by_distance(item: MissionItem) -> bool:
    return item.command == Command.DO_SET_CAM_TRIGG_DIST and item.param1 > 0.0


def _ends_pictures(item: MissionItem) -> bool:
    return item.command == Command.DO_SET_CAM_TRIGG_DIST and item.param1 <= 0.0
