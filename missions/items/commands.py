"""MAVLink mission commands by name: the subset of MAV_CMD that missions use.

Source: MAVLink common and ardupilotmega message definitions. A light table of our own, because importing a MAVLink
library for the names alone would cost every command line a third of a second.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Self

from skyway.missions.items.altitude_frames import GLOBAL_FRAMES

_FLOWN, _PLACE, _NUMBERS = "flown to", "place", "numbers"


class Command(IntEnum):
    """Command of an item (MAV_CMD without its prefix)."""

    last_params: str
    """Meaning of parameters 5, 6 and 7: ``flown to`` and ``place``, a latitude, a longitude and an altitude, the former
    of a place that the vehicle goes to, the latter of one that it only points at; ``numbers``, parameter 5 or 6 is a
    plain number; empty, they are unused."""

    def __new__(cls, number: int, last_params: str = "") -> Self:
        """Make a member of its number and the meaning of its last parameters."""
        command = int.__new__(cls, number)
        command._value_, command.last_params = number, last_params
        return command

    NAV_WAYPOINT = 16, _FLOWN
    NAV_LOITER_UNLIM = 17, _FLOWN
    NAV_LOITER_TURNS = 18, _FLOWN
    NAV_LOITER_TIME = 19, _FLOWN
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21, _FLOWN
    NAV_TAKEOFF = 22, _FLOWN
    NAV_LAND_LOCAL = 23
    NAV_TAKEOFF_LOCAL = 24
    NAV_FOLLOW = 25, _PLACE
    NAV_CONTINUE_AND_CHANGE_ALT = 30
    NAV_LOITER_TO_ALT = 31, _FLOWN
    DO_FOLLOW = 32
    DO_ORBIT = 34, _PLACE
    NAV_ARC_WAYPOINT = 36, _FLOWN
    NAV_ROI = 80, _PLACE
    NAV_PATHPLANNING = 81, _PLACE
    NAV_SPLINE_WAYPOINT = 82, _FLOWN
    NAV_ALTITUDE_WAIT = 83
    NAV_VTOL_TAKEOFF = 84, _FLOWN
    NAV_VTOL_LAND = 85, _FLOWN
    NAV_GUIDED_ENABLE = 92
    NAV_DELAY = 93
    NAV_PAYLOAD_PLACE = 94, _FLOWN
    CONDITION_DELAY = 112
    CONDITION_CHANGE_ALT = 113
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179, _PLACE
    DO_SET_RELAY = 181
    DO_REPEAT_RELAY = 182
    DO_SET_SERVO = 183
    DO_REPEAT_SERVO = 184
    DO_FLIGHTTERMINATION = 185
    DO_CHANGE_ALTITUDE = 186
    DO_SET_ACTUATOR = 187, _NUMBERS
    DO_RETURN_PATH_START = 188, _PLACE
    DO_LAND_START = 189, _PLACE
    DO_RALLY_LAND = 190
    DO_GO_AROUND = 191
    DO_REPOSITION = 192, _PLACE
    DO_PAUSE_CONTINUE = 193
    DO_SET_REVERSE = 194
    DO_SET_ROI_LOCATION = 195, _PLACE
    DO_SET_ROI_WPNEXT_OFFSET = 196, _NUMBERS
    DO_SET_ROI_NONE = 197
    DO_SET_ROI_SYSID = 198
    DO_CONTROL_VIDEO = 200
    DO_SET_ROI = 201, _PLACE
    DO_DIGICAM_CONFIGURE = 202, _NUMBERS
    DO_DIGICAM_CONTROL = 203, _NUMBERS
    DO_MOUNT_CONFIGURE = 204, _NUMBERS
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
    OBLIQUE_SURVEY = 260, _NUMBERS
    COMPONENT_ARM_DISARM = 400
    SET_CAMERA_MODE = 530
    SET_CAMERA_ZOOM = 531
    SET_CAMERA_FOCUS = 532
    SET_CAMERA_SOURCE = 534
    JUMP_TAG = 600
    DO_JUMP_TAG = 601
    DO_GIMBAL_MANAGER_PITCHYAW = 1000, _NUMBERS
    DO_GIMBAL_MANAGER_CONFIGURE = 1001
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    DO_TRIGGER_CONTROL = 2003
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501
    PANORAMA_CREATE = 2800, _NUMBERS
    DO_VTOL_TRANSITION = 3000
    CONDITION_GATE = 4501, _PLACE
    NAV_FENCE_RETURN_POINT = 5000, _PLACE
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001, _PLACE
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002, _PLACE
    NAV_FENCE_CIRCLE_INCLUSION = 5003, _PLACE
    NAV_FENCE_CIRCLE_EXCLUSION = 5004, _PLACE
    NAV_RALLY_POINT = 5100, _PLACE
    PAYLOAD_PREPARE_DEPLOY = 30001, _PLACE
    PAYLOAD_CONTROL_DEPLOY = 30002
    WAYPOINT_USER_1 = 31000, _FLOWN
    WAYPOINT_USER_2 = 31001, _FLOWN
    WAYPOINT_USER_3 = 31002, _FLOWN
    WAYPOINT_USER_4 = 31003, _FLOWN
    WAYPOINT_USER_5 = 31004, _FLOWN
    SPATIAL_USER_1 = 31005, _PLACE
    SPATIAL_USER_2 = 31006, _PLACE
    SPATIAL_USER_3 = 31007, _PLACE
    SPATIAL_USER_4 = 31008, _PLACE
    SPATIAL_USER_5 = 31009, _PLACE
    USER_1 = 31010
    USER_2 = 31011
    USER_3 = 31012
    USER_4 = 31013
    USER_5 = 31014
    DO_WINCH = 42600
    NAV_SCRIPT_TIME = 42702
    NAV_ATTITUDE_TIME = 42703, _NUMBERS


_COMMANDS = {int(command): command for command in Command}

FLOWN_COMMANDS = frozenset(command for command in Command if command.last_params == _FLOWN)
LOCATED_COMMANDS = frozenset(command for command in Command if command.last_params in (_FLOWN, _PLACE))
PLAIN_PARAM5_COMMANDS = frozenset(command for command in Command if command.last_params == _NUMBERS)
FENCE_COMMANDS = frozenset(command for command in Command if command.name.startswith("NAV_FENCE_"))
TAKEOFF_COMMANDS = frozenset({Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF})
LAND_COMMANDS = frozenset({Command.NAV_LAND, Command.NAV_VTOL_LAND})
YAW_COMMANDS = TAKEOFF_COMMANDS | LAND_COMMANDS | {Command.NAV_WAYPOINT}
"""Commands whose fourth parameter may be NaN: a yaw that the vehicle chooses; elsewhere ArduPilot refuses that."""
INDEX_COMMANDS = frozenset({Command.DO_JUMP, Command.DO_SET_MISSION_CURRENT})
"""Commands whose parameter 1 is the number of another item."""


def kept_params(commands: dict[tuple[int, ...], str]) -> dict[int, tuple[int, ...]]:
    """Return which of parameters 1 to 4 an autopilot keeps, by command, from the names of commands by the kept parameters."""
    return {Command[name]: kept for kept, names in commands.items() for name in names.split()}


def is_scaled(command: int, frame: int) -> bool:
    """Whether parameters 5 and 6 travel in units of 1e-7 degree.

    They do for located commands, and, as QGroundControl sends them, for commands without a name here in a global frame.
    """
    return command in LOCATED_COMMANDS or (command not in _COMMANDS and frame in GLOBAL_FRAMES)


def command_of(number: int) -> int:
    """Return the named command of a number, or the number itself if it has no name here."""
    return _COMMANDS.get(number, number)


def command_name(number: int) -> str:
    """Common name of a command: ``NAV_LAND``, or ``MAV_CMD 43003`` if it has no name here."""
    command = _COMMANDS.get(number)
    return f"MAV_CMD {number}" if command is None else command.name
