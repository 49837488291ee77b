"""The effect of messages of other ground stations on a vehicle, and which of them pass."""

from __future__ import annotations

from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Collection

    from skyway.link.wire.messages import Message


class Permission(StrEnum):
    """Messages of other ground stations that are passed to the vehicles."""

    NONE = "none"
    """They read: telemetry, parameters, missions, logs."""
    PILOT = "pilot"
    """They also fly: modes, arming, manual control, reposition, camera."""
    ALL = "all"
    """They also change missions, fences, parameters and files."""


class Effect(StrEnum):
    """Effect of a message on a vehicle."""

    READ = "read"
    """It requests data, or announces a station."""
    PILOT = "pilot"
    """It flies the vehicle, like a pilot."""
    CHANGE = "change"
    """It changes the contents of the vehicle, or anything else."""
    RATE = "rate"
    """It changes the rate of a message that we set ourselves."""


_READS = frozenset(
    (
        "HEARTBEAT", "NAMED_VALUE_INT", "PING", "TIMESYNC", "STATUSTEXT", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_EXT_REQUEST_READ",
        "PARAM_EXT_REQUEST_LIST", "MISSION_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "LOG_REQUEST_LIST",
        "LOG_REQUEST_DATA", "LOG_REQUEST_END", "AUTOPILOT_VERSION_REQUEST", "FENCE_FETCH_POINT", "RALLY_FETCH_POINT",
    )
)  # fmt: skip
_FLIES = frozenset(
    (
        "SET_MODE", "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT",
        "SET_ATTITUDE_TARGET", "GPS_RTCM_DATA", "GPS_INJECT_DATA", "TERRAIN_DATA", "COMMAND_CANCEL", "CHANGE_OPERATOR_CONTROL",
        "MOUNT_CONTROL", "DIGICAM_CONTROL", "GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_MANAGER_SET_PITCHYAW",
        "GIMBAL_MANAGER_SET_MANUAL_CONTROL",
    )
)  # fmt: skip
_COMMANDS = frozenset(("COMMAND_LONG", "COMMAND_INT"))
_READING_COMMANDS = frozenset((410, 510, 512, 519, 520, 521, 522, 525, 526, 527))
"""Of MAV_CMD: home position, message intervals and messages, versions, capabilities, camera information."""
_FLYING_COMMANDS = frozenset(
    (
        16, 17, 18, 19, 20, 21, 22, 34, 84, 85, 92, 176, 178, 185, 186, 192, 193, 195, 196, 197, 201, 205, 208, 252, 400, 32100,
        *range(530, 538), *range(1000, 1004), *range(2000, 2006), *range(2500, 2506),
    )
)  # fmt: skip
"""Of MAV_CMD: destination, modes, speed, landing, arming, termination, region of interest, gimbal and camera, operator control."""
SET_INTERVAL = 511
_TRANSFER = "FILE_TRANSFER_PROTOCOL"
_OPCODE_AT = 3
_READING_OPCODES = frozenset((0, 1, 2, 3, 4, 5, 14, 15))
"""Of MAVLink FTP: sessions, listings, reading, checksums."""
_HEARTBEAT_STREAMS = frozenset((1, 3, 4))
"""Groups of REQUEST_DATA_STREAM without messages that we request: raw sensors, remote control, raw controller."""


def effect(message: Message, ours: Collection[int] = ()) -> Effect:
    """Return the effect of a message of another station; `ours` are the ids of messages whose rate we keep."""
    name = message.name
    if name in _READS:
        return Effect.READ
    if name in _COMMANDS:
        number = message["command"]
        if number == SET_INTERVAL:
            return Effect.RATE if int(message["param1"]) in ours else Effect.READ
        return (
            Effect.READ
            if number in _READING_COMMANDS
            else Effect.PILOT
            if number in _FLYING_COMMANDS
            else Effect.CHANGE
        )
    if name == "REQUEST_DATA_STREAM":
        return Effect.READ if message["req_stream_id"] in _HEARTBEAT_STREAMS or not ours else Effect.RATE
    if name == _TRANSFER:
        return Effect.READ if message["payload"][_OPCODE_AT] in _READING_OPCODES else Effect.CHANGE
    return Effect.PILOT if name in _FLIES else Effect.CHANGE


def passes(does: Effect, allowed: Permission) -> bool:
    """Whether a message with this effect passes."""
    if does is Effect.READ:
        return True
    if does is Effect.RATE:
        return False
    return allowed is Permission.ALL or (allowed is Permission.PILOT and does is Effect.PILOT)


def order(message: Message) -> str:
    """Return the MAVLink name of a command, with its subject."""
    name = message.name
    if name in _COMMANDS:
        return command_name(message["command"])
    if name in ("PARAM_SET", "PARAM_EXT_SET"):
        return f"{name} {message['param_id']}"
    return name


@cache
def command_name(number: int) -> str:
    """Return the name of a command, as MAVLink has it, without its prefix."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    found: Any = dialect.enums["MAV_CMD"].get(number)
    return f"command {number}" if found is None else str(found.name).removeprefix("MAV_CMD_")
