"""Independent parts of a mission, whose order is free: lines of surveys, and places of inspections.

A *unit* is flown unchanged: a line along which pictures are taken by distance or time, with the places straight before and after it, or a
place where pictures are taken or the vehicle stays. Between two units is a way without actions. Units are separated only where this is certain to have no
effect: they are joined where an action runs on the way (pictures, video, spraying), where a place between them is neither work nor straight ahead
(it may lead around a tower), and where a command waits or is relative to the item before. Where an item acts on the world
(a gripper, a winch, a jump), the order is kept, and the reason is reported.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.missions.items.commands import Command
from skyway.missions.recharge.item_roles import PICTURES, SPEED, VIDEO, is_no_region, role_of, state_key
from skyway.missions.recharge.pictures import NOT, ordered
from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.missions.items.mission import MissionItem
    from skyway.missions.recharge.work import Work

ALONG_DEG = 10.0
"""A place is straight before or after a line within this angle."""
ROI = "region of interest"
SPRAYER = "DO_SPRAYER"
RUNNING = (PICTURES, VIDEO, SPRAYER)
"""States that act as long as they are in force."""
_WAYS = (Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_LOITER_TURNS)
_HARMLESS = (
    Command.IMAGE_START_CAPTURE,
    Command.DO_DIGICAM_CONTROL,
    Command.PANORAMA_CREATE,
    Command.NAV_DELAY,
)
"""Events that only observe."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A run of steps of a mission that stay together."""

    first: int
    last: int
    """Numbers of its steps."""
    group: int
    """Units of one group may be put in any order; groups stay in theirs."""
    reversible: bool = False
    """A straight line with pictures by distance, which may be flown from its end, too."""


@dataclass(frozen=True, slots=True)
class Division:
    """The units of a mission, in its order; the parts before the first and after the last are flown at its beginning and end."""

    units: tuple[Unit, ...]
    kept: tuple[str, ...]
    """Reasons why the order is not freer."""

    @property
    def is_free(self) -> bool:
        """Whether anything may be put in another order."""
        groups = [unit.group for unit in self.units]
        return any(one == other for one, other in pairwise(groups)) or any(unit.reversible for unit in self.units)


def divided(work: Work) -> Division:
    """Divide the work of a mission into units."""
    return _Divider(work).division()


def nothing_runs(held: Mapping[str, MissionItem]) -> bool:
    """Whether the states in force do nothing on the way: no pictures by distance or time, no video, no spraying."""
    taking = NOT
    for item in held.values():
        taking = ordered(item, taking)
    video = held.get(VIDEO)
    films = video is not None and video.command == Command.VIDEO_START_CAPTURE
    sprays = any(key.startswith(SPRAYER) and item.param1 == 1.0 for key, item in held.items())
    return not taking and not films and not sprays


def lasting(held: Mapping[str, MissionItem]) -> dict[str, MissionItem]:
    """Return the states that must be the same wherever a unit is flown; speeds of steps are separate."""
    return {
        key: item
        for key, item in held.items()
        if key != SPEED and not key.startswith(RUNNING) and not is_no_region(item)
    }


def tidied(orders: Sequence[MissionItem], *, last: bool = True) -> list[MissionItem]:
    """Leave out the states that a unit commands at its end: they are for the next item, where they are commanded again."""
    kept = list(orders)
    while last and kept and role_of(kept[-1]) == "state" and not state_key(kept[-1]).startswith(RUNNING):
        kept.pop()
    return kept


def _with_what_lies_between(units: Sequence[Unit]) -> tuple[Unit, ...]:
    """Add the parts between groups as units of their own, across which no unit moves, and number the groups."""
    found: list[tuple[Unit, bool]] = []
    for unit, following in zip(units, (*units[1:], None), strict=False):
        found.append((unit, False))
        if following is not None and following.first > unit.last + 1:
            found.append((Unit(unit.last + 1, following.first - 1, unit.group), True))
    numbered: list[Unit] = []
    group = -1
    for number, (unit, alone) in enumerate(found):
        before = found[number - 1] if number else None
        if before is None or alone or before[1] or before[0].group != unit.group:
            group += 1
        numbered.append(replace(unit, group=group))
    return tuple(numbered)


class _Divider:
    """One pass over the steps of a mission."""

    def __init__(self, work: Work) -> None:
        self.work, self.items, self.steps, self.order = work, work.mission.items, work.steps, work.route.order
        self.count = len(self.steps)
        self.after = [self._orders_after(number) for number in range(self.count)]
        self.states = self._states()
        self.idle = [nothing_runs(held) for held in self.states]
        """For the way to each step: no action on it."""
        self.kept: dict[str, None] = {}

    def division(self) -> Division:
        if len([leg for leg in self.work.route.legs if leg.steps]) > 1:
            return Division((), ("it lands on the way: its order is kept",))
        fixed = [self._reason(number) for number in range(self.count)]
        units: list[Unit] = []
        begin = 0
        group = 0
        while begin < self.count:
            end = begin
            while end < self.count and fixed[end] is None:
                end += 1
            found = self._in_region(begin, end - 1) if end > begin else []
            if units and found:
                group += 1
            for first, last in found:
                here = units[-1] if units and units[-1].group == group else None
                if here is not None and (self._keys(here.first) != self._keys(first) or self._adds(here)):
                    group += 1
                    self._keep(f"from item {self._item(first)} on the commanded state differs")
                unit = Unit(first, last, group, self._is_reversible(first, last))
                if self._adds(unit) and units and units[-1].group == group:
                    group += 1
                    unit = replace(unit, group=group)
                    self._keep(f"item {self._item(first)} and the following items command irreversible actions")
                units.append(unit)
            begin = end + 1
            if end < self.count and end not in (0, self.count - 1):
                self._keep(f"item {self._item(end)} {fixed[end]}")
        return Division(_with_what_lies_between(units), tuple(self.kept))

    def _keep(self, why: str) -> None:
        self.kept[f"order kept: {why}"] = None

    def _item(self, step: int) -> int:
        return self.steps[step].item

    def _orders_after(self, number: int) -> list[MissionItem]:
        until = len(self.order) if number + 1 == self.count else self.steps[number + 1].taken
        return [self.items[one] for one in self.order[self.steps[number].taken + 1 : until]]

    def _states(self) -> list[dict[str, MissionItem]]:
        """Return the states in force on the way to each step."""
        found: list[dict[str, MissionItem]] = []
        held: dict[str, MissionItem] = {}
        begins = {step.taken: number for number, step in enumerate(self.steps)}
        for taken, number in enumerate(self.order):
            item = self.items[number]
            if taken in begins:
                found.append(dict(held))
            if role_of(item) == "way":
                held.pop("CONDITION_YAW", None)
            elif role_of(item) == "state":
                held.pop(state_key(item), None)
                held[state_key(item)] = item
        return found

    def _reason(self, number: int) -> str | None:
        """Return the reason why a step stays in its place; None if it may move."""
        item = self.items[self._item(number)]
        if item.command not in _WAYS:
            return f"is {item.name}"
        if self.order.count(self._item(number)) > 1:
            return "is flown to more than once (a jump)"
        if item.point is None:
            return "has no position"
        for order in self.after[number]:
            role = role_of(order)
            if role == "bound" or (role == "event" and order.command not in _HARMLESS):
                return f"is followed by {order.name}"
            if order.command == Command.CONDITION_YAW and order.param4 == 1.0:
                return "is followed by a turn by an angle"
        around = (number - 1, number + 1)
        if any(
            0 <= one < self.count and self.items[self._item(one)].command == Command.NAV_SPLINE_WAYPOINT
            for one in around
        ):
            return "is beside a curve"
        return None

    def _in_region(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return the units (first, last step) between two steps that may move."""
        works = self._works(begin, end)
        if begin > 0 and not self.idle[begin]:  # an action runs from before: it stays with that
            works = [one for one in works if one[0] > begin]
        if end + 1 < self.count and not self.idle[end + 1]:
            works = [one for one in works if one[1] < end]
        if not works:
            return []
        found = [(self._lead_in(works[0][0], begin - 1), works[0][1])]
        for first, last in works[1:]:
            before = found[-1][1]
            led_in = self._lead_in(first, before)
            led_out = self._lead_out(found[-1], before, led_in)
            waits = led_out + 1 == led_in and self._waits(led_out)
            if led_out + 1 == led_in and not waits:
                found[-1] = (found[-1][0], led_out)
                found.append((led_in, last))
            else:
                why = "a command waits there" if waits else "a waypoint between them may lead around an obstacle"
                self._keep(f"items {self._item(before)} and {self._item(first)} stay together: {why}")
                found[-1] = (found[-1][0], last)
        first, last = found[-1]
        found[-1] = (first, self._lead_out(found[-1], last, end + 1))
        return found

    def _works(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return runs of steps along which an action runs, and steps at which one happens."""
        found: list[tuple[int, int]] = []
        number = begin
        while number <= end:
            last = number
            while last + 1 <= end and not self.idle[last + 1]:
                last += 1
            at_place = self.steps[number].hold_s > 0.0 or any(role_of(one) == "event" for one in self.after[number])
            if last > number or at_place:
                found.append((number, last))
            number = last + 1
        return found

    def _waits(self, number: int) -> bool:
        """Whether a command after a step changes the onward way."""
        return any(role_of(one) == "condition" or one.command == Command.CONDITION_YAW for one in self.after[number])

    def _bearing(self, number: int) -> float | None:
        """Bearing of the way to a step; None if there is none."""
        if number < 1:
            return None
        length, bearing = geodesy.inverse(*self.work.places[number], *self.work.places[number + 1])
        return float(bearing) if float(length) > 0.5 else None

    def _straight(self, number: int, following: int) -> bool:
        """Whether two ways lead the same way."""
        one, other = self._bearing(number), self._bearing(following)
        return one is not None and other is not None and abs((one - other + 180.0) % 360.0 - 180.0) <= ALONG_DEG

    def _lead_in(self, first: int, after: int) -> int:
        """Return the step at which a line begins, the place straight before it included."""
        if first - 1 <= after or self.idle[min(first + 1, self.count - 1)] or not self.idle[first]:
            return first
        return first - 1 if self._straight(first, first + 1) and not self._waits(first - 1) else first

    def _lead_out(self, unit: tuple[int, int], last: int, before: int) -> int:
        """Return the step at which a line ends, the place straight behind it included."""
        if last + 1 >= before or unit[0] == unit[1] or self.idle[last]:
            return last
        return last + 1 if self._straight(last, last + 1) and not self._waits(last) else last

    def _keys(self, step: int) -> set[str]:
        """Return the states commanded on the way to a step, which another unit must be able to command again. Regions of interest can be ended."""
        return {key for key in lasting(self.states[step]) if key != ROI}

    def _adds(self, unit: Unit) -> bool:
        """Whether a unit starts a state that was not in force before it, and that no command ends."""
        inner = [
            one for step in range(unit.first, unit.last + 1) for one in tidied(self.after[step], last=step == unit.last)
        ]
        held = {state_key(one): one for one in inner if role_of(one) == "state"}
        return bool({key for key in lasting(held) if key not in (ROI, "CONDITION_YAW")} - self._keys(unit.first))

    def _is_reversible(self, first: int, last: int) -> bool:
        """Whether a unit is one line of pictures by distance, with nothing else on it."""
        steps = range(first, last + 1)
        if any(self.items[self._item(one)].command != Command.NAV_WAYPOINT or self.steps[one].hold_s for one in steps):
            return False
        live = [one for one in steps[1:] if not self.idle[one]]
        if not live or live != list(range(live[0], live[-1] + 1)):
            return False
        if not any(picture.item is None and first <= picture.step <= last for picture in self.work.pictures):
            return False  # a line shorter than its spacing
        begin, end = live[0] - 1, live[-1]
        for number in steps:
            orders = [one for one in self.after[number] if number != last or state_key(one) == PICTURES]
            if any(one.command != Command.DO_SET_CAM_TRIGG_DIST for one in orders):
                return False
            starts = [one for one in orders if one.param1 > 0.0]
            stops = [one for one in orders if one.param1 <= 0.0]
            if len(starts) != (number == begin) or (stops and number != end) or (number == end and len(stops) != 1):
                return False
        straight = all(self._straight(one, one + 1) for one in range(begin + 1, end))
        return straight and all(not self._waits(one) for one in steps)
