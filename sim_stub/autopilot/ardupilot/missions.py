"""ArduPilot's storage of mission items (AP_Mission.cpp, MissionItemProtocol*.cpp; Copter 4.6)."""

from __future__ import annotations

import math
from dataclasses import replace

from skyway.sim_stub.autopilot.items import FENCE, PLACED_COMMANDS, RALLY, Answer, Command, Frame, Item
from skyway.sim_stub.autopilot.parameters import as_float32

MAX_ITEMS = {0: 724, 1: 255, 2: 64}
_FRAMES = {
    Frame.GLOBAL: Frame.GLOBAL,
    Frame.MISSION: Frame.GLOBAL,
    Frame.GLOBAL_INT: Frame.GLOBAL,
    Frame.RELATIVE: Frame.RELATIVE,
    Frame.RELATIVE_INT: Frame.RELATIVE,
    Frame.TERRAIN: Frame.TERRAIN,
    Frame.TERRAIN_INT: Frame.TERRAIN,
}
_NAN_ALLOWED_P4 = frozenset({Command.WAYPOINT, Command.LAND, Command.TAKEOFF})
_STORED_IN_LOCATION = PLACED_COMMANDS | {Command.DO_SET_HOME, Command.DO_LAND_START, 195, Command.DO_SET_ROI}
_P1_WHOLE = frozenset(
    {
        Command.WAYPOINT,
        Command.SPLINE_WAYPOINT,
        Command.LOITER_TIME,
        Command.LOITER_TURNS,
        Command.LAND,
        Command.TAKEOFF,
        Command.DO_JUMP,
        Command.DO_SET_HOME,
        Command.DO_SET_ROI,
        Command.DO_FENCE_ENABLE,
        Command.DO_GRIPPER,
    }
)
_DONE_ELSEWHERE = (
    # Cameras, servos, relays: kept, and nothing that moves the vehicle.
    182,  # DO_REPEAT_RELAY
    184,  # DO_REPEAT_SERVO
    195,  # DO_SET_ROI_LOCATION
    197,  # DO_SET_ROI_NONE
    202,  # DO_DIGICAM_CONFIGURE
    203,  # DO_DIGICAM_CONTROL
    208,  # DO_PARACHUTE
    213,  # NAV_SET_YAW_SPEED
    216,  # DO_SPRAYER
    218,  # DO_AUX_FUNCTION
    531,  # SET_CAMERA_ZOOM
    532,  # SET_CAMERA_FOCUS
    534,  # SET_CAMERA_SOURCE
    1000,  # DO_GIMBAL_MANAGER_PITCHYAW
    2000,  # IMAGE_START_CAPTURE
    2001,  # IMAGE_STOP_CAPTURE
    2500,  # VIDEO_START_CAPTURE
    2501,  # VIDEO_STOP_CAPTURE
)
_KEPT: dict[int, tuple[int, ...]] = {
    # Which of p1..p4 are stored at all; the rest come back as 0.
    Command.WAYPOINT: (1,),
    Command.SPLINE_WAYPOINT: (1,),
    Command.LOITER_UNLIM: (3,),
    Command.LOITER_TURNS: (1, 3, 4),
    Command.LOITER_TIME: (1, 3, 4),
    Command.LOITER_TO_ALT: (2, 4),
    Command.RETURN_TO_LAUNCH: (),
    Command.LAND: (1,),
    Command.TAKEOFF: (1,),
    Command.DELAY: (1, 2, 3, 4),
    Command.PAYLOAD_PLACE: (1,),
    Command.CONDITION_DELAY: (1,),
    Command.CONDITION_DISTANCE: (1,),
    Command.CONDITION_YAW: (1, 2, 3, 4),
    Command.DO_JUMP: (1, 2),
    Command.DO_CHANGE_SPEED: (1, 2, 3),
    Command.DO_SET_HOME: (1,),
    Command.DO_LAND_START: (),
    Command.DO_SET_ROI: (1,),
    Command.DO_FENCE_ENABLE: (1,),
    Command.DO_GRIPPER: (1, 2),
    Command.DO_WINCH: (1, 2, 3, 4),
    181: (1, 2),  # DO_SET_RELAY
    183: (1, 2),  # DO_SET_SERVO
    **dict.fromkeys(_DONE_ELSEWHERE, (1, 2, 3, 4)),
    205: (1, 2, 3),  # DO_MOUNT_CONTROL
    206: (1,),  # DO_SET_CAM_TRIGG_DIST
}
_MAX_ALTITUDE_M = 83_000.0
_INVALID_PARAM = (
    Answer.INVALID_PARAM1,
    Answer.INVALID_PARAM2,
    Answer.INVALID_PARAM3,
    Answer.INVALID_PARAM4,
)


def accept(item: Item, kind: int) -> Item | Answer:
    """Take an item as ArduPilot does: what it stores, or the code it refuses with."""
    if kind == FENCE:
        return item if 5000 <= item.command <= 5004 else Answer.UNSUPPORTED
    if kind == RALLY:
        if item.command != Command.RALLY_POINT:
            return Answer.UNSUPPORTED
        return replace(item, frame=_FRAMES[Frame(item.frame)] if _known(item) else Frame.RELATIVE)
    if item.command not in _KEPT:
        return Answer.UNSUPPORTED
    for number, answer in enumerate(_INVALID_PARAM, start=1):
        nan = math.isnan(getattr(item, f"p{number}"))
        if nan and not (number == 4 and item.command in _NAN_ALLOWED_P4):
            return answer
    if item.command in _STORED_IN_LOCATION:
        if abs(item.x) > 900_000_000:
            return Answer.INVALID_PARAM5
        if abs(item.y) > 1_800_000_000:
            return Answer.INVALID_PARAM6
        if math.isnan(item.z) or abs(item.z) >= _MAX_ALTITUDE_M:
            return Answer.INVALID_PARAM7
        if not _known(item):
            return Answer.UNSUPPORTED_FRAME
    return _stored(item)


def _circle_m(radius_m: float) -> float:
    """Radius of turns as it is kept: whole metres in a byte, tens of metres beyond; negative is anticlockwise."""
    size = abs(radius_m)
    kept = math.floor(size + 0.5) if size <= 255.0 else min(math.floor(size / 10.0 + 0.5), 255) * 10
    return math.copysign(float(kept), radius_m)


def _known(item: Item) -> bool:
    return item.frame in _FRAMES


def _stored(item: Item) -> Item:
    kept = _KEPT[item.command]
    given = (item.p1, item.p2, item.p3, item.p4)
    p1, p2, p3, p4 = (
        value if number in kept and not math.isnan(value) else 0.0 for number, value in enumerate(given, start=1)
    )
    if item.command in _P1_WHOLE:
        p1 = float(int(max(-32768.0, min(65535.0, p1))))
    if item.command == Command.LAND:
        p4 = 1.0
    if item.command == Command.LOITER_TURNS:
        p1, p3 = max(0.0, min(p1, 255.0)), _circle_m(p3)
    if item.command == Command.LOITER_TIME:
        p3 = -1.0 if p3 < 0 else 1.0
    if item.command not in _STORED_IN_LOCATION:
        return Item(item.command, Frame.GLOBAL, p1, p2, p3, p4)
    centimetres = int(as_float32(item.z * 100.0))
    frame = _FRAMES[Frame(item.frame)]
    return Item(item.command, frame, p1, p2, p3, p4, item.x, item.y, centimetres / 100.0)
