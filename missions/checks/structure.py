"""Check of a mission's structure: take-off, landing, jump targets."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, Frame
from skyway.missions.items.commands import (
    FLOWN_COMMANDS,
    LOCATED_COMMANDS,
    PLAIN_PARAM5_COMMANDS,
    TAKEOFF_COMMANDS,
    YAW_COMMANDS,
    Command,
    is_scaled,
)
from skyway.missions.items.finding import Finding
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.route import Route
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.mission import Mission, MissionItem

ALTITUDE_TOLERANCE_M = 0.1
MOUNT_MODE_GPS_POINT = 4
_PLAIN_ALTITUDE_MODES = (0, 1, 2)
"""Altitude modes of QGroundControl in which its own altitude equals the one of the parameters."""


def check_structure(document: MissionDocument, route: Route, autopilot: Family | None = None) -> Iterator[Finding]:
    """Check take-off, landing, jumps and parameters that are not numbers; these are told unless the autopilot takes them."""
    mission = document.mission
    if not mission.items:
        yield Finding("info", None, "no-mission", f"there are no mission items; {_beside(document)}")
        return
    if not mission.is_for_the_surface:
        yield from _takeoff(mission)
        yield from _landing(mission, route)
    yield from _jumps(mission)
    yield from _never_reached(mission, route)
    for number in route.endless_jumps:
        target = mission.items[number].jump_target
        message = f"jumps back to item {target} without end: only a person or a failsafe ends the flight"
        yield Finding("warning", number, "endless-jump", message, "give the jump a number of repeats")
    if route.is_cut:
        message = "too many repeats of jumps: only the beginning of the flight was checked"
        yield Finding("warning", None, "too-many-repeats", message, "reduce the numbers of repeats")
    for pattern in mission.complex_items:
        if pattern.is_built:
            message = (
                f"its {pattern.count} items are built from the settings of the pattern, as QGroundControl builds them:"
                " a few metres may differ"
            )
            yield Finding("info", pattern.first, "pattern-built", message, "open and save the plan in QGroundControl")
    sends_zeros = autopilot is None or autopilot.refuses_open_parameters
    for number, item in enumerate(mission.items):
        if sends_zeros:
            yield from _open_parameters(number, item)
        yield from _not_numbers(number, item)
        yield from _waits_until(number, item)
        if _has_a_place_in_no_global_frame(item):
            message = f"{item.name} has a place in frame {item.frame:d}: autopilots refuse it, or misread the place"
            yield Finding("error", number, "not-global", message, "give it in frame 0, 3 or 10: latitude and longitude")


def _waits_until(number: int, item: MissionItem) -> Iterator[Finding]:
    """Report a delay until a time of day: how long it lasts is not in the file."""
    if item.command == Command.NAV_DELAY and item.param1 < 0 and max(item.param2, item.param3, item.param4) >= 0:
        hours, minutes, seconds = (max(int(value), 0) if math.isfinite(value) else 0 for value in item.params[1:])
        message = f"waits until {hours:02}:{minutes:02}:{seconds:02} UTC: time and energy of this wait are not counted"
        yield Finding("warning", number, "wait-not-counted", message, "wait on the ground, or for a number of seconds")


def _beside(document: MissionDocument) -> str:
    """Tell what was checked of a file without mission items."""
    areas, points = len(document.fence.areas), len(document.rally)
    held = [f"the fence of {counted(areas, 'area')}"] if areas else []
    held += [counted(points, "rally point")] if points else []
    return f"checked {' and '.join(held)}" if held else "nothing was checked"


def _has_a_place_in_no_global_frame(item: MissionItem) -> bool:
    if item.command not in LOCATED_COMMANDS or item.frame in GLOBAL_FRAMES:
        return False
    # the frame of commands without a place: ArduPilot flies to coordinates there, above sea level; PX4 refuses them
    return item.frame != Frame.MISSION or (item.command in FLOWN_COMMANDS and bool(item.x or item.y))


def _never_reached(mission: Mission, route: Route) -> Iterator[Finding]:
    """Report places that the mission never reaches: after a return, a loiter without end, or a jump over them."""
    reached = {step.item for step in route.steps}
    placed = [n for n, item in enumerate(mission.items) if item.is_flown_to and item.point is not None]
    left_out = [number for number in placed if number not in reached]
    if left_out and not route.is_cut:
        message = f"{len(left_out)} items with a position are never reached, and were not checked"
        yield Finding(
            "warning", left_out[0], "never-reached", message, "remove them, or what ends the mission before them"
        )


def _takeoff(mission: Mission) -> Iterator[Finding]:
    flown = [
        (number, item)
        for number, item in enumerate(mission.items)
        if item.is_flown_to or item.command in TAKEOFF_COMMANDS
    ]
    if not flown:
        yield Finding("warning", None, "no-positions", "the mission goes nowhere: no item has a position")
        return
    later = next((number for number, item in flown if item.command in TAKEOFF_COMMANDS), None)
    # an item without a position ("here") leads nowhere: a TAKEOFF after it is still the first
    placed = [(number, item) for number, item in flown if item.point is not None or item.command in TAKEOFF_COMMANDS]
    first_number, first = (placed or flown)[0]
    if first.command in TAKEOFF_COMMANDS:
        return
    if later is None:
        message = "there is no TAKEOFF: PX4 climbs by itself, ArduPilot stays on the ground"
        yield Finding("warning", first_number, "no-takeoff", message, "begin with a TAKEOFF")
    else:
        message = f"the TAKEOFF comes after the position of item {first_number}"
        yield Finding("error", later, "takeoff-not-first", message, "put the TAKEOFF first")


def _landing(mission: Mission, route: Route) -> Iterator[Finding]:
    if any(leg.landing != "none" for leg in route.legs[-1:]) or not route.legs:
        return
    last = route.legs[-1].item_to
    if route.ends_in_endless_jump:
        return
    if mission.items[last].command == Command.NAV_LOITER_UNLIM:
        message = "endless loiter: the mission never lands"
        yield Finding("error", last, "never-lands", message, "land, or return to launch, after it")
        return
    message = "the mission ends in the air: there is no LAND or RETURN_TO_LAUNCH after this item"
    yield Finding("error", last, "no-landing", message, "add a LAND")


def _jumps(mission: Mission) -> Iterator[Finding]:
    tags = {item.param1 for item in mission.items if item.command == Command.JUMP_TAG}
    for number, item in enumerate(mission.items):
        target = item.jump_target
        if item.command == Command.DO_JUMP_TAG and item.param1 not in tags:
            message = f"jumps to tag {item.param1:g}, which does not exist"
            yield Finding("error", number, "jump-target", message, "add a JUMP_TAG, or remove the jump")
        if item.command == Command.DO_JUMP and target is None:
            yield Finding("error", number, "jump-target", "its jump target is not a number")
        if target is None or (item.command == Command.DO_SET_MISSION_CURRENT and target == -1):
            continue
        if not 0 <= target < len(mission):
            message = f"jumps to item {target}, and there are items 0 to {len(mission) - 1}"
            yield Finding("error", number, "jump-target", message, "correct the target")
        elif target == number:
            yield Finding("error", number, "jump-target", "jumps to itself", "correct the target")


def _uses_plain_param5(item: MissionItem) -> bool:
    """Whether parameters 5 and 6 mean something other than a place."""
    if item.command == Command.DO_MOUNT_CONTROL:
        return item.z == MOUNT_MODE_GPS_POINT
    unnamed = not isinstance(item.command, Command)
    return item.command in PLAIN_PARAM5_COMMANDS or (unnamed and not is_scaled(item.command, item.frame))


def _open_parameters(number: int, item: MissionItem) -> Iterator[Finding]:
    free = ((3,) if item.command == Command.NAV_VTOL_LAND else ()) + ((4,) if item.command in YAW_COMMANDS else ())
    wrong = [i for i, value in enumerate(item.params, start=1) if math.isnan(value) and i not in free]
    if wrong:
        names = ", ".join(f"param{i}" for i in wrong)
        message = f"{item.name} leaves {names} open: ArduPilot refuses that, so it is sent as 0"
        yield Finding("info", number, "parameter-not-given", message, "write 0")


def _not_numbers(number: int, item: MissionItem) -> Iterator[Finding]:
    for name, value in (("param5", item.param5_or_zero), ("param6", item.param6_or_zero)):
        if _uses_plain_param5(item) and not value.is_integer():
            message = f"{name} of {item.name} is {value:g}, and travels to the vehicle as {round(value)}"
            yield Finding("warning", number, "fraction-lost", message, "use a whole number")
    shown = item.extra.get("Altitude")
    plain = item.is_located and item.extra.get("AltitudeMode") in _PLAIN_ALTITUDE_MODES and math.isfinite(item.z)
    plain = plain and not item.was_planned_above_terrain
    low, high = item.z - ALTITUDE_TOLERANCE_M, item.z + ALTITUDE_TOLERANCE_M  # `shown` may be whole, of any length
    if plain and isinstance(shown, (int, float)) and not low <= shown <= high:
        message = (
            f"the altitude is {item.z:g} m in the parameters, and QGroundControl shows and edits {str(shown)[:12]} m"
        )
        yield Finding("warning", number, "altitude-disagrees", message, "open and save the plan in QGroundControl")
    half = (item.x is None) != (item.y is None)
    if half and item.is_located and (item.x or item.y):
        lacking = "latitude" if item.x is None else "longitude"
        message = f"{item.name} has no {lacking}: ArduPilot takes such a place as here, or as one far away"
        yield Finding("error", number, "half-a-place", message, "give both, or 0 and 0")
    if item.is_located and item.is_flown_to and math.isnan(item.z):
        yield Finding("error", number, "no-altitude", f"{item.name} has no altitude", "give it one")
