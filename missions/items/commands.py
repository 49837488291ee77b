"""MAVLink mission commands by name: the subset of MAV_CMD that missions use.

Source: MAVLink common and ardupilotmega message definitions. A light table of our own, because importing a MAVLink
library for the names alone would cost every command line a third of a second.
"""

from __future__ import annotations

from enum import IntEnum

from skyway.missions.items.altitude_frames import GLOBAL_FRAMES


class Command(IntEnum):
    """What an item orders (MAV_CMD without its prefix)."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LAND_LOCAL = 23
    NAV_TAKEOFF_LOCAL = 24
    NAV_FOLLOW = 25
    NAV_CONTINUE_AND_CHANGE_ALT = 30
    NAV_LOITER_TO_ALT = 31
    DO_FOLLOW = 32
    DO_ORBIT = 34
    NAV_ARC_WAYPOINT = 36
    NAV_ROI = 80
    NAV_PATHPLANNING = 81
    NAV_SPLINE_WAYPOINT = 82
    NAV_ALTITUDE_WAIT = 83
    NAV_VTOL_TAKEOFF = 84
    NAV_VTOL_LAND = 85
    NAV_GUIDED_ENABLE = 92
    NAV_DELAY = 93
    NAV_PAYLOAD_PLACE = 94
    CONDITION_DELAY = 112
    CONDITION_CHANGE_ALT = 113
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_SET_RELAY = 181
    DO_REPEAT_RELAY = 182
    DO_SET_SERVO = 183
    DO_REPEAT_SERVO = 184
    DO_FLIGHTTERMINATION = 185
    DO_CHANGE_ALTITUDE = 186
    DO_SET_ACTUATOR = 187
    DO_RETURN_PATH_START = 188
    DO_LAND_START = 189
    DO_RALLY_LAND = 190
    DO_GO_AROUND = 191
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_REVERSE = 194
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_WPNEXT_OFFSET = 196
    DO_SET_ROI_NONE = 197
    DO_SET_ROI_SYSID = 198
    DO_CONTROL_VIDEO = 200
    DO_SET_ROI = 201
    DO_DIGICAM_CONFIGURE = 202
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONFIGURE = 204
    DO_MOUNT_CONTROL = 205
    DO_SET_CAM_TRIGG_DIST = 206
    DO_FENCE_ENABLE = 207
    DO_PARACHUTE = 208
    DO_MOTOR_TEST = 209
    DO_INVERTED_FLIGHT = 210
    DO_GRIPPER = 211
    DO_AUTOTUNE_ENABLE = 212
    NAV_SET_YAW_SPEED = 213
    DO_SET_CAM_TRIGG_INTERVAL = 214
    DO_SET_RESUME_REPEAT_DIST = 215
    DO_SPRAYER = 216
    DO_SEND_SCRIPT_MESSAGE = 217
    DO_AUX_FUNCTION = 218
    DO_MOUNT_CONTROL_QUAT = 220
    DO_GUIDED_LIMITS = 222
    DO_ENGINE_CONTROL = 223
    DO_SET_MISSION_CURRENT = 224
    OBLIQUE_SURVEY = 260
    COMPONENT_ARM_DISARM = 400
    SET_CAMERA_MODE = 530
    SET_CAMERA_ZOOM = 531
    SET_CAMERA_FOCUS = 532
    SET_CAMERA_SOURCE = 534
    JUMP_TAG = 600
    DO_JUMP_TAG = 601
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    DO_GIMBAL_MANAGER_CONFIGURE = 1001
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    DO_TRIGGER_CONTROL = 2003
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501
    PANORAMA_CREATE = 2800
    DO_VTOL_TRANSITION = 3000
    CONDITION_GATE = 4501
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100
    PAYLOAD_PREPARE_DEPLOY = 30001
    PAYLOAD_CONTROL_DEPLOY = 30002
    WAYPOINT_USER_1 = 31000
    WAYPOINT_USER_2 = 31001
    WAYPOINT_USER_3 = 31002
    WAYPOINT_USER_4 = 31003
    WAYPOINT_USER_5 = 31004
    SPATIAL_USER_1 = 31005
    SPATIAL_USER_2 = 31006
    SPATIAL_USER_3 = 31007
    SPATIAL_USER_4 = 31008
    SPATIAL_USER_5 = 31009
    USER_1 = 31010
    USER_2 = 31011
    USER_3 = 31012
    USER_4 = 31013
    USER_5 = 31014
    DO_WINCH = 42600
    NAV_SCRIPT_TIME = 42702
    NAV_ATTITUDE_TIME = 42703


_COMMANDS = {int(command): command for command in Command}

LOCATED_COMMANDS = frozenset(
    {
        Command.NAV_WAYPOINT,
        Command.NAV_LOITER_UNLIM,
        Command.NAV_LOITER_TURNS,
        Command.NAV_LOITER_TIME,
        Command.NAV_LAND,
        Command.NAV_TAKEOFF,
        Command.NAV_FOLLOW,
        Command.NAV_LOITER_TO_ALT,
        Command.DO_ORBIT,
        Command.NAV_ARC_WAYPOINT,
        Command.NAV_ROI,
        Command.NAV_PATHPLANNING,
        Command.NAV_SPLINE_WAYPOINT,
        Command.NAV_VTOL_TAKEOFF,
        Command.NAV_VTOL_LAND,
        Command.NAV_PAYLOAD_PLACE,
        Command.DO_SET_HOME,
        Command.DO_RETURN_PATH_START,
        Command.DO_LAND_START,
        Command.DO_REPOSITION,
        Command.DO_SET_ROI_LOCATION,
        Command.DO_SET_ROI,
        Command.CONDITION_GATE,
        Command.NAV_FENCE_RETURN_POINT,
        Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        Command.NAV_FENCE_CIRCLE_INCLUSION,
        Command.NAV_FENCE_CIRCLE_EXCLUSION,
        Command.NAV_RALLY_POINT,
        Command.PAYLOAD_PREPARE_DEPLOY,
        Command.WAYPOINT_USER_1,
        Command.WAYPOINT_USER_2,
        Command.WAYPOINT_USER_3,
        Command.WAYPOINT_USER_4,
        Command.WAYPOINT_USER_5,
        Command.SPATIAL_USER_1,
        Command.SPATIAL_USER_2,
        Command.SPATIAL_USER_3,
        Command.SPATIAL_USER_4,
        Command.SPATIAL_USER_5,
    }
)
"""Commands whose parameters 5, 6 and 7 are a latitude, a longitude and an altitude."""

PLAIN_PARAM5_COMMANDS = frozenset(
    {
        Command.DO_SET_ACTUATOR,
        Command.DO_SET_ROI_WPNEXT_OFFSET,
        Command.DO_DIGICAM_CONFIGURE,
        Command.DO_DIGICAM_CONTROL,
        Command.DO_MOUNT_CONFIGURE,
        Command.DO_GIMBAL_MANAGER_PITCHYAW,
        Command.OBLIQUE_SURVEY,
        Command.PANORAMA_CREATE,
        Command.NAV_ATTITUDE_TIME,
    }
)
"""Commands that use parameter 5 or 6 as a plain number; of the others only located ones use them."""

FENCE_COMMANDS = frozenset(
    {
        Command.NAV_FENCE_RETURN_POINT,
        Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        Command.NAV_FENCE_CIRCLE_INCLUSION,
        Command.NAV_FENCE_CIRCLE_EXCLUSION,
    }
)
TAKEOFF_COMMANDS = frozenset({Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF})
LAND_COMMANDS = frozenset({Command.NAV_LAND, Command.NAV_VTOL_LAND})
FLOWN_COMMANDS = frozenset(
    {
        Command.NAV_WAYPOINT,
        Command.NAV_LOITER_UNLIM,
        Command.NAV_LOITER_TURNS,
        Command.NAV_LOITER_TIME,
        Command.NAV_LAND,
        Command.NAV_TAKEOFF,
        Command.NAV_LOITER_TO_ALT,
        Command.NAV_ARC_WAYPOINT,
        Command.NAV_SPLINE_WAYPOINT,
        Command.NAV_VTOL_TAKEOFF,
        Command.NAV_VTOL_LAND,
        Command.NAV_PAYLOAD_PLACE,
        Command.WAYPOINT_USER_1,
        Command.WAYPOINT_USER_2,
        Command.WAYPOINT_USER_3,
        Command.WAYPOINT_USER_4,
        Command.WAYPOINT_USER_5,
    }
)
"""Located commands that move the vehicle there; the others only point at a place."""

INDEX_COMMANDS = frozenset({Command.DO_JUMP, Command.DO_SET_MISSION_CURRENT})
"""Commands whose parameter 1 is the number of another item."""


def is_scaled(command: int, frame: int) -> bool:
    """Whether parameters 5 and 6 travel in units of 1e-7 degree.

    They do for located commands, and, as QGroundControl sends them, for commands without a name here in a global frame.
    """
    return command in LOCATED_COMMANDS or (command not in _COMMANDS and frame in GLOBAL_FRAMES)


def command_of(number: int) -> int:
    """Return the named command of a number, or the number itself where we have no name."""
    return _COMMANDS.get(number, number)


def command_name(number: int) -> str:
    """What people call a command: ``NAV_LAND``, or ``MAV_CMD 43003`` where we have no name."""
    command = _COMMANDS.get(number)
    return f"MAV_CMD {number}" if command is None else command.name
