"""Landing patterns: the items flown by QGroundControl, whose files contain only places and options.

Source: ``LandingComplexItem::appendMissionItems`` of QGroundControl, and the two older classes that it replaced.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.patterns.items import item

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.json_fields import JsonField

LANDINGS = {"fwLandingPattern": Command.NAV_LAND, "vtolLandingPattern": Command.NAV_VTOL_LAND}
HEADING_REQUIRED = 1
LEAVE_ON_TANGENT = 1
AIRSPEED = 0
THROTTLE_AS_IT_IS = -1


def expand(kind: str, source: JsonField) -> list[Mapping[str, Any]]:
    """Return the items of a landing pattern in a plan file: land start, speed, cameras off, approach, landing.

    Raises an `InputError` if a place, the radius, the speed or a choice is missing or impossible.
    """
    key = "landingApproachCoordinate" if "landingApproachCoordinate" in source else "loiterCoordinate"
    approach, landing = _place(source[key]), _place(source["landCoordinate"])
    radius, clockwise = source["loiterRadius"].quantity(), source["loiterClockwise"].flag()
    both, raw = source["altitudesAreRelative"].value, source.mapping()
    items = [item(Command.DO_LAND_START, Frame.MISSION)]
    if source.get("useDoChangeSpeed", missing=False).flag():
        speed_mps = source["finalApproachSpeed"].quantity(positive=True)
        items.append(item(Command.DO_CHANGE_SPEED, Frame.MISSION, [AIRSPEED, speed_mps, THROTTLE_AS_IT_IS, 0, 0, 0, 0]))
    if raw.get("stopTakingPhotos"):
        items += [item(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION), item(Command.IMAGE_STOP_CAPTURE, Frame.MISSION)]
    if raw.get("stopVideoPhotos"):
        items.append(item(Command.VIDEO_STOP_CAPTURE, Frame.MISSION))
    high = _frame(raw.get("loiterAltitudeRelative") if both is None else both, source)
    if raw.get("useLoiterToAlt", True):
        turn = [HEADING_REQUIRED, radius if clockwise else -radius, 0, LEAVE_ON_TANGENT]
        items.append(item(Command.NAV_LOITER_TO_ALT, high, [*turn, *approach]))
    else:
        items.append(item(Command.NAV_WAYPOINT, high, [0, 0, 0, None, *approach]))
    low = _frame(raw.get("landingAltitudeRelative") if both is None else both, source)
    items.append(item(LANDINGS[kind], low, [0, 0, 0, 0, *landing]))
    return items


def _place(triple: JsonField) -> list[Any]:
    if len(triple.elements()) != 3:
        raise triple.fault("is not [latitude, longitude, altitude]", triple.value)
    return list(triple.value)


def _frame(relative: object, source: JsonField) -> Frame:
    if not isinstance(relative, bool):
        raise source["altitudesAreRelative"].fault("is neither true nor false", relative)
    return Frame.GLOBAL_RELATIVE_ALT if relative else Frame.GLOBAL
