"""Whether a mission is complete in itself: take-off first, a landing, jumps that lead somewhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from missions.commands import LOCATED_COMMANDS, TAKEOFF_COMMANDS, Command
from missions.finding import Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from missions.checks.route import Route
    from missions.mission import Mission, MissionItem

_NAN_ALLOWED = {
    Command.NAV_WAYPOINT: {4},
    Command.NAV_LAND: {4},
    Command.NAV_TAKEOFF: {4},
    Command.NAV_VTOL_TAKEOFF: {4},
    Command.NAV_VTOL_LAND: {3, 4},
}
_NO_NAN: set[int] = set()


def check_structure(mission: Mission, route: Route) -> Iterator[Finding]:
    """Check take-off, landing, jumps and parameters that are not numbers."""
    if not mission.items:
        yield Finding("info", None, "no-mission", "there are no mission items")
        return
    yield from _takeoff(mission)
    yield from _landing(mission, route)
    yield from _jumps(mission)
    for number in route.endless_jumps:
        target = mission.items[number].jump_target
        yield Finding(
            "warning",
            number,
            "endless-jump",
            f"jumps back to item {target} for ever: only a person or a failsafe ends the flight",
            "give the jump a number of repeats",
        )
    if route.is_cut:
        yield Finding(
            "warning",
            None,
            "too-many-repeats",
            "the jumps repeat so often that only the beginning of the flight was checked",
            "lower the numbers of repeats",
        )
    for number, item in enumerate(mission.items):
        yield from _not_numbers(number, item)


def _takeoff(mission: Mission) -> Iterator[Finding]:
    flown = [(number, item) for number, item in enumerate(mission.items) if item.is_flown_to]
    if not flown:
        yield Finding("warning", None, "no-positions", "the mission goes nowhere: no item has a position")
        return
    first_number, first = flown[0]
    if first.command in TAKEOFF_COMMANDS:
        return
    later = next((number for number, item in flown if item.command in TAKEOFF_COMMANDS), None)
    if later is None:
        yield Finding(
            "warning",
            first_number,
            "no-takeoff",
            "there is no TAKEOFF: PX4 climbs by itself, ArduPilot stays on the ground",
            "begin with a TAKEOFF",
        )
    else:
        yield Finding(
            "error",
            later,
            "takeoff-not-first",
            f"the TAKEOFF comes after the position of item {first_number}",
            "put the TAKEOFF first",
        )


def _landing(mission: Mission, route: Route) -> Iterator[Finding]:
    if any(leg.landing != "none" for leg in route.legs[-1:]) or not route.legs:
        return
    last = route.legs[-1].item_to
    if route.endless_jumps:
        return
    if mission.items[last].command == Command.NAV_LOITER_UNLIM:
        message = "loiters without end: the mission never lands"
        yield Finding("error", last, "never-lands", message, "land, or return to launch, after it")
        return
    yield Finding(
        "error",
        last,
        "no-landing",
        "the mission ends in the air: there is no LAND or RETURN_TO_LAUNCH after this item",
        "add a LAND",
    )


def _jumps(mission: Mission) -> Iterator[Finding]:
    tags = {item.param1 for item in mission.items if item.command == Command.JUMP_TAG}
    for number, item in enumerate(mission.items):
        target = item.jump_target
        if item.command == Command.DO_JUMP_TAG and item.param1 not in tags:
            message = f"jumps to tag {item.param1:g}, which no item has"
            yield Finding("error", number, "jump-target", message, "add a JUMP_TAG, or remove the jump")
        if item.command == Command.DO_JUMP and target is None:
            yield Finding("error", number, "jump-target", "jumps to no item: its target is not a number")
        if target is None or (item.command == Command.DO_SET_MISSION_CURRENT and target == -1):
            continue
        if not 0 <= target < len(mission):
            message = f"jumps to item {target}, and there are items 0 to {len(mission) - 1}"
            yield Finding("error", number, "jump-target", message, "correct the target")
        elif target == number:
            yield Finding("error", number, "jump-target", "jumps to itself", "correct the target")


def _not_numbers(number: int, item: MissionItem) -> Iterator[Finding]:
    allowed = _NAN_ALLOWED.get(Command(item.command), _NO_NAN) if item.command in _NAN_ALLOWED else _NO_NAN
    wrong = [i for i, value in enumerate(item.params, start=1) if math.isnan(value) and i not in allowed]
    if wrong:
        names = ", ".join(f"param{i}" for i in wrong)
        yield Finding(
            "info",
            number,
            "parameter-not-given",
            f"{item.name} leaves {names} open: ArduPilot refuses that, so it is sent as 0",
            "write 0",
        )
    for name, value in (("param5", item.param5_or_zero), ("param6", item.param6_or_zero)):
        if item.command not in LOCATED_COMMANDS and not value.is_integer():
            message = f"{name} of {item.name} is {value:g}, and travels to the vehicle as {round(value)}"
            yield Finding("warning", number, "fraction-lost", message, "use a whole number")
    if item.is_located and item.is_flown_to and math.isnan(item.z):
        yield Finding("error", number, "no-altitude", f"{item.name} has no altitude", "give it one")
