"""Mission, fence and rally items as a vehicle stores them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""


class Command(IntEnum):
    """MAV_CMD numbers that the simulated autopilots know."""

    WAYPOINT = 16
    LOITER_UNLIM = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    LAND = 21
    TAKEOFF = 22
    LOITER_TO_ALT = 31
    SPLINE_WAYPOINT = 82
    DELAY = 93
    PAYLOAD_PLACE = 94
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_FLIGHT_TERMINATION = 185
    DO_LAND_START = 189
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_ROI = 201
    DO_FENCE_ENABLE = 207
    DO_GRIPPER = 211
    DO_SET_MISSION_CURRENT = 224
    PREFLIGHT_CALIBRATION = 241
    PREFLIGHT_STORAGE = 245
    PREFLIGHT_REBOOT_SHUTDOWN = 246
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    RUN_PREARM_CHECKS = 401
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    FENCE_RETURN_POINT = 5000
    FENCE_POLYGON_INCLUSION = 5001
    FENCE_POLYGON_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100
    DO_WINCH = 42600
    BATTERY_RESET = 42651


class Frame(IntEnum):
    """MAV_FRAME numbers in use."""

    GLOBAL = 0
    MISSION = 2
    RELATIVE = 3
    GLOBAL_INT = 5
    RELATIVE_INT = 6
    TERRAIN = 10
    TERRAIN_INT = 11


class Answer(IntEnum):
    """MAV_MISSION_RESULT: the answer to an upload or an item."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5 = 10
    INVALID_PARAM6 = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15


class Result(IntEnum):
    """MAV_RESULT: the answer to a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


RELATIVE_FRAMES = frozenset({Frame.RELATIVE, Frame.RELATIVE_INT, Frame.TERRAIN, Frame.TERRAIN_INT})


@dataclass(frozen=True, slots=True)
class Item:
    """One item."""

    command: int
    frame: int = Frame.RELATIVE
    """`command`, `frame`: MAV_CMD, MAV_FRAME."""
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    """`p1`, `p2`, `p3`, `p4`: parameters, NaN allowed where the autopilot allows it."""
    x: int = 0
    y: int = 0
    """`x`, `y`: latitude and longitude in 1e-7 degrees, or plain numbers in frame MISSION."""
    z: float = 0.0
    """Height in metres in the item's frame."""
    autocontinue: int = 1

    @property
    def lat(self) -> float:
        """Latitude, degrees."""
        return self.x * 1e-7

    @property
    def lon(self) -> float:
        """Longitude, degrees."""
        return self.y * 1e-7

    @property
    def has_position(self) -> bool:
        """Whether it names a place; 0, 0 means where the vehicle is."""
        return self.frame != Frame.MISSION and (self.x != 0 or self.y != 0)


NAV_COMMANDS = frozenset(
    {
        Command.WAYPOINT,
        Command.LOITER_UNLIM,
        Command.LOITER_TURNS,
        Command.LOITER_TIME,
        Command.RETURN_TO_LAUNCH,
        Command.LAND,
        Command.TAKEOFF,
        Command.LOITER_TO_ALT,
        Command.SPLINE_WAYPOINT,
        Command.DELAY,
        Command.PAYLOAD_PLACE,
    }
)
"""Commands that take time: the vehicle flies or waits until they are done."""
PLACED_COMMANDS = NAV_COMMANDS - {Command.RETURN_TO_LAUNCH, Command.DELAY}
"""Commands whose x, y and z are a place."""


@dataclass(frozen=True, slots=True)
class Home:
    """Where heights are counted from and the vehicle returns to; metres above mean sea level."""

    lat: float
    lon: float
    alt_m: float
