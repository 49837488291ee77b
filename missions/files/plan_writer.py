"""Writer of QGroundControl ``.plan`` files, with QGroundControl's own keys and versions."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from skyway.missions.autopilots.registry import default_family
from skyway.missions.files.jumps import refers_to
from skyway.missions.files.plan_reader import MISSION_VERSION, PLAN_VERSION, UNKNOWN_KEY, loads
from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, Frame, frame_name
from skyway.missions.items.commands import LOCATED_COMMANDS
from skyway.missions.items.coordinates import from_e7
from skyway.missions.items.mission import ABOVE_TERRAIN_MODE
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.geofence import Geofence
    from skyway.missions.items.mission import ComplexItem, Mission, MissionItem

MAV_TYPE_QUADROTOR = 2
_ALTITUDE_MODES = {"home": 1, "sea level": 2, "terrain": 4}
"""QGroundControl's number of an altitude reference."""


def dumps(document: MissionDocument) -> str:
    """Return the text of a ``.plan`` file.

    Items that an unchanged survey or corridor was expanded to are written as that survey or corridor.
    """
    fence, rally = document.fence, document.rally
    plan = {
        **document.extra,
        "fileType": "Plan",
        "version": PLAN_VERSION,
        "groundStation": "QGroundControl",
        "mission": _mission(document.mission),
        "geoFence": _fence(fence),
        "rallyPoints": {
            **rally.extra,
            "version": 2,
            "points": [[p.point.lat, p.point.lon, _or_null(p.altitude_m)] for p in rally.points],
        },
    }
    return json.dumps(plan, indent=4, sort_keys=True, allow_nan=False) + "\n"


def _mission(mission: Mission) -> dict[str, Any]:
    first_frame = next((item.frame for item in mission.items if item.is_located), Frame.GLOBAL_RELATIVE_ALT)
    needed = required(mission)
    unknown = [key for key, value in needed.items() if value is None]
    # QGroundControl refuses a plan without these keys: fill them in, and mark them as placeholders.
    filled = {key: value for key, value in needed.items() if value is not None}
    raw = {
        "globalPlanAltitudeMode": _ALTITUDE_MODES.get(frame_name(first_frame), 1),
        **mission.extra,
        "version": MISSION_VERSION,
        "items": _items(mission),
        **_stand_ins(mission),
        **filled,
    }
    return raw | {UNKNOWN_KEY: unknown} if unknown else raw


def required(mission: Mission) -> dict[str, Any]:
    """Return the fields that QGroundControl requires to open a plan; None is unknown."""
    home = mission.home
    return {
        "plannedHomePosition": [home.point.lat, home.point.lon, home.altitude_m] if home else None,
        "firmwareType": mission.firmware,
        "vehicleType": mission.vehicle_type,
        "cruiseSpeed": mission.cruise_speed_mps,
        "hoverSpeed": mission.hover_speed_mps,
    }


def _stand_ins(mission: Mission) -> dict[str, Any]:
    point = next((item.point for item in mission.items if item.point is not None), None)
    return {
        "plannedHomePosition": [point.lat, point.lon, 0] if point else [0, 0, 0],
        "firmwareType": default_family().firmware,
        "vehicleType": MAV_TYPE_QUADROTOR,
        "cruiseSpeed": 15,
        "hoverSpeed": 5,
    }


def _items(mission: Mission) -> list[Mapping[str, Any]]:
    written: list[Mapping[str, Any]] = []
    patterns = {c.first: c for c in mission.complex_items if _is_unchanged(c, mission.items)}
    number = 0
    while number < len(mission.items):
        pattern = patterns.get(number)
        if pattern is None:
            written.append(_item(mission.items[number], number))
            number += 1
        else:
            written.append(pattern.source)
            number += pattern.count
    return written


def _is_unchanged(pattern: ComplexItem, items: Sequence[MissionItem]) -> bool:
    """Whether the pattern still matches exactly the items that the mission has in its place."""
    alone = {"fileType": "Plan", "mission": {"items": [pattern.source]}}
    try:
        expanded = loads(json.dumps(alone)).mission.items
    except (InputError, ValueError, TypeError):
        return False
    here = tuple(items[pattern.first : pattern.first + pattern.count])
    return pattern.count > 0 and expanded == here and all(item.jump_target is None for item in here)


def _item(item: MissionItem, number: int) -> dict[str, Any]:
    target = refers_to(item)
    param1 = _or_null(item.param1) if target is None else target + 1
    raw = {
        **item.extra,
        "type": "SimpleItem",
        "autoContinue": item.autocontinue,
        "command": int(item.command),
        "doJumpId": number + 1,
        "frame": int(item.frame),
        "params": [
            param1,
            *(_or_null(value) for value in item.params[1:]),
            None if item.x is None else _short(from_e7(item.x)),
            None if item.y is None else _short(from_e7(item.y)),
            _or_null(item.z),
        ],
    }
    raw.update(_altitude(item))
    return raw


def _altitude(item: MissionItem) -> dict[str, Any]:
    """Return the altitude that QGroundControl shows for a located item; it must agree with parameter 7."""
    if item.command not in LOCATED_COMMANDS or item.frame not in GLOBAL_FRAMES or math.isnan(item.z):
        return {}
    kept = item.extra
    mode = _ALTITUDE_MODES[frame_name(item.frame)]
    above_terrain = kept.get("AMSLAltAboveTerrain")
    if item.was_planned_above_terrain and above_terrain == item.z:
        return {"AltitudeMode": ABOVE_TERRAIN_MODE}
    return {
        "Altitude": _short(item.z),
        "AltitudeMode": mode,
        "AMSLAltAboveTerrain": above_terrain if kept.get("Altitude") == item.z else None,
    }


def _fence(fence: Geofence) -> dict[str, Any]:
    raw: dict[str, Any] = {
        **fence.extra,
        "version": 2,
        "polygons": [
            {
                **polygon.extra,
                "version": 1,
                "inclusion": polygon.inclusion,
                "polygon": [[vertex.lat, vertex.lon] for vertex in polygon.vertices],
            }
            for polygon in fence.polygons
        ],
        "circles": [
            {
                **circle.extra,
                "version": 1,
                "inclusion": circle.inclusion,
                "circle": {
                    **circle.extra.get("circle", {}),
                    "center": [circle.center.lat, circle.center.lon],
                    "radius": circle.radius_m,
                },
            }
            for circle in fence.circles
        ],
    }
    if fence.return_point is not None:
        back = fence.return_point
        raw["breachReturn"] = [back.lat, back.lon, _or_null(fence.return_altitude_m)]
    return raw


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else _short(value)


def _short(value: float) -> float:
    """Write 3 rather than 3.0, as QGroundControl does."""
    return int(value) if value.is_integer() and abs(value) < 1e15 else value
