"""PX4's storage and feasibility check of missions (mavlink_mission.cpp; 1.16 and main)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.items import FENCE, MISSION, RELATIVE_FRAMES, Answer, Command, Frame, Item
from skyway.sim_stub.plant.physics import offset_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.sim_stub.autopilot.fence import Fence

MAX_ITEMS = {0: 2000, 1: 64, 2: 32}
_GLOBAL = {
    Frame.GLOBAL: Frame.GLOBAL,
    Frame.GLOBAL_INT: Frame.GLOBAL,
    Frame.RELATIVE: Frame.RELATIVE,
    Frame.RELATIVE_INT: Frame.RELATIVE,
}
_PLACED = frozenset(
    {
        Command.WAYPOINT,
        Command.LOITER_UNLIM,
        Command.LOITER_TIME,
        Command.LAND,
        Command.TAKEOFF,
        Command.LOITER_TO_ALT,
        Command.FENCE_RETURN_POINT,
        Command.FENCE_POLYGON_INCLUSION,
        Command.FENCE_POLYGON_EXCLUSION,
        Command.FENCE_CIRCLE_INCLUSION,
        Command.FENCE_CIRCLE_EXCLUSION,
        Command.RALLY_POINT,
        Command.COMPONENT_ARM_DISARM,
    }
)
_PLAIN = frozenset(
    {
        Command.DO_JUMP,
        Command.DO_GRIPPER,
        Command.DO_WINCH,
        Command.DO_CHANGE_SPEED,
        Command.DO_SET_HOME,
        Command.DO_LAND_START,
        Command.DELAY,
        Command.RETURN_TO_LAUNCH,
        Command.COMPONENT_ARM_DISARM,
        80,  # NAV_ROI
        187,  # DO_SET_ACTUATOR
        196,  # DO_SET_ROI_WPNEXT_OFFSET
        197,  # DO_SET_ROI_NONE
        200,  # DO_CONTROL_VIDEO
        Command.DO_SET_ROI,
        203,  # DO_DIGICAM_CONTROL
        204,  # DO_MOUNT_CONFIGURE
        205,  # DO_MOUNT_CONTROL
        206,  # DO_SET_CAM_TRIGG_DIST
        212,  # DO_AUTOTUNE_ENABLE
        214,  # DO_SET_CAM_TRIGG_INTERVAL
        260,  # OBLIQUE_SURVEY
        530,  # SET_CAMERA_MODE
        532,  # SET_CAMERA_FOCUS
        534,  # SET_CAMERA_SOURCE
        1000,  # DO_GIMBAL_MANAGER_PITCHYAW
        1001,  # DO_GIMBAL_MANAGER_CONFIGURE
        2000,  # IMAGE_START_CAPTURE
        2001,  # IMAGE_STOP_CAPTURE
        2003,  # DO_TRIGGER_CONTROL
        2500,  # VIDEO_START_CAPTURE
        2501,  # VIDEO_STOP_CAPTURE
        3000,  # DO_VTOL_TRANSITION
    }
)
_LOOK_AT = frozenset({80, 195, Command.DO_SET_ROI, 212})
"""Accepted with a position, and nothing that is flown to: regions of interest, and autotuning."""
_FENCE_COMMANDS = frozenset(range(5000, 5005))
_KEPT: dict[int, tuple[int, ...]] = {
    # Which of p1..p4 survive in an item with a position; the rest come back as 0.
    Command.WAYPOINT: (1, 2, 4),
    Command.LOITER_UNLIM: (3, 4),
    Command.LOITER_TIME: (1, 2, 3, 4),
    Command.LAND: (2, 4),
    Command.TAKEOFF: (4,),
    Command.LOITER_TO_ALT: (1, 2, 4),
    Command.FENCE_POLYGON_INCLUSION: (1,),
    Command.FENCE_POLYGON_EXCLUSION: (1,),
    Command.FENCE_CIRCLE_INCLUSION: (1,),
    Command.FENCE_CIRCLE_EXCLUSION: (1,),
    Command.COMPONENT_ARM_DISARM: (1,),
}


def accept(item: Item, kind: int) -> Item | Answer:
    """Take an item of a kind of mission as PX4 does: keep what it keeps, or the code it refuses with."""
    if item.frame in _GLOBAL:
        if item.command not in _PLACED | _LOOK_AT:
            return Answer.UNSUPPORTED
    elif item.frame == Frame.MISSION:
        if item.command == Command.CONDITION_DELAY:  # kept as NAV_DELAY, since PX4 has nothing that waits in flight
            return replace(item, command=Command.DELAY)
        if item.command not in _PLAIN:
            return Answer.UNSUPPORTED
    else:
        return Answer.UNSUPPORTED_FRAME
    if kind == MISSION and (item.command in _FENCE_COMMANDS or item.command == Command.RALLY_POINT):
        return Answer.ERROR
    if kind == FENCE:
        if item.command not in _FENCE_COMMANDS:
            return Answer.ERROR
        polygon = item.command in (Command.FENCE_POLYGON_INCLUSION, Command.FENCE_POLYGON_EXCLUSION)
        if polygon and not item.p1 >= 3:
            return Answer.ERROR
    if item.frame == Frame.MISSION:
        return item
    kept = _KEPT.get(item.command, ())
    given = (item.p1, item.p2, item.p3, item.p4)
    p1, p2, p3, p4 = (value if n in kept else 0.0 for n, value in enumerate(given, start=1))
    return replace(item, frame=_GLOBAL[Frame(item.frame)], p1=p1, p2=p2, p3=p3, p4=p4)


def present(item: Item, *, as_int: bool) -> Item:
    """Give an item back as PX4 does: NaN as 0, and the _INT frames in INT messages."""
    p1, p2, p3, p4 = (0.0 if math.isnan(value) else value for value in (item.p1, item.p2, item.p3, item.p4))
    frame = item.frame
    if as_int and frame in (Frame.GLOBAL, Frame.RELATIVE):
        frame = Frame.RELATIVE_INT if frame == Frame.RELATIVE else Frame.GLOBAL_INT
    return replace(item, frame=frame, p1=p1, p2=p2, p3=p3, p4=p4)


def infeasible(
    items: Sequence[Item], fence: Fence, home_alt_m: float | None, near: tuple[float, float], first_m: float
) -> str | None:
    """Explain why an accepted mission cannot be flown, or None.

    The vehicle is `near` a latitude and longitude; the first waypoint may be `first_m` away (MIS_DIST_1WP), 0 or less
    is any distance.
    """
    if not items:
        return "No valid mission available"
    flown = [item for item in items if item.command in _PLACED and item.command != Command.COMPONENT_ARM_DISARM]
    for number, item in enumerate(flown):
        if item.command == Command.TAKEOFF and number > 0:
            return "Mission rejected: takeoff is not the first waypoint item"
    for number, item in enumerate(items):
        if item.command == Command.DO_JUMP and not 0 <= item.p1 < len(items):
            return f"Mission rejected: DO_JUMP at {number + 1} leads outside the mission"
        if item.command in _PLACED and item.frame != Frame.MISSION and not math.isfinite(item.z):
            return f"Mission rejected: waypoint {number + 1} has no altitude"
    placed = [item for item in flown if item.has_position]
    if placed and first_m > 0.0:
        away = math.hypot(*offset_m(*near, placed[0].lat, placed[0].lon))
        if away > first_m:
            return f"First waypoint too far away: {away:.0f} m"
    for item in placed:
        if fence.breached(item.lat, item.lon, any_inclusion=True):
            return "Geofence violation for waypoint"
        low = item.frame not in RELATIVE_FRAMES and home_alt_m is not None and item.z < home_alt_m
        if low and item.command == Command.TAKEOFF:
            return "Mission rejected: takeoff altitude too low"
    return None
