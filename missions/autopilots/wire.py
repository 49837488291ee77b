"""Conversion between mission items and the fields of MISSION_ITEM_INT."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import frame_of
from skyway.missions.items.commands import LOCATED_COMMANDS, Command, command_of, is_scaled
from skyway.missions.items.coordinates import E7
from skyway.missions.items.fence_items import from_fence, from_rally, to_fence, to_rally
from skyway.missions.items.mission import MissionItem
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.items.geofence import Geofence
    from skyway.missions.items.rally import RallyPoints

MISSION_TYPE_MISSION = 0
MISSION_TYPE_FENCE = 1
MISSION_TYPE_RALLY = 2
_INT32_MAX = 2**31 - 1


@dataclass(frozen=True, slots=True)
class WireItem:
    """The fields of a MISSION_ITEM_INT message, addresses aside.

    Attributes
    ----------
    seq : int
        The autopilot's own number.
    frame, command, current, autocontinue : int
        As in the message.
    param1, param2, param3, param4, z : float
        As in the message.
    x, y : int
        1e-7 degree for a place, the plain value otherwise.
    mission_type : int
        0 mission, 1 fence, 2 rally points.
    """

    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float
    mission_type: int = MISSION_TYPE_MISSION


def to_wire(item: MissionItem, number: int, *, shift: int = 0, current: int = 0, mission_type: int = 0) -> WireItem:
    """Convert one item to the wire; a place that is not given becomes 0, 0: "here" for take-off, landing, loiter.

    The autopilot's number is ours plus `shift`. An `InputError`, which names ours, refuses a located item without an
    altitude, and a plain value that 32 bits do not hold.
    """
    scaled = is_scaled(item.command, item.frame)
    if item.command in LOCATED_COMMANDS and math.isnan(item.z):
        raise InputError("has no altitude", field=f"item {number}", remedy="give each position an altitude")
    return WireItem(
        number + shift,
        int(item.frame),
        int(item.command),
        current,
        int(item.autocontinue),
        *item.params,
        _integer(item.x, scaled, number),
        _integer(item.y, scaled, number),
        0.0 if math.isnan(item.z) else item.z,
        mission_type,
    )


def _integer(value: int | None, scaled: bool, number: int) -> int:  # noqa: FBT001  two units, one wire field
    if value is None:
        return 0
    plain = value if scaled else round(value / E7)
    if abs(plain) > _INT32_MAX:
        raise InputError("is too large for MAVLink", field=f"item {number}", value=value)
    return plain


def from_wire(wire: WireItem) -> MissionItem:
    """Convert one item from the wire."""
    command = command_of(wire.command)
    scaled = is_scaled(command, wire.frame)
    return MissionItem(
        command,
        frame_of(wire.frame),
        wire.param1,
        wire.param2,
        wire.param3,
        wire.param4,
        wire.x if scaled else wire.x * E7,
        wire.y if scaled else wire.y * E7,
        wire.z,
        bool(wire.autocontinue),
    )


def fence_to_wire(fence: Geofence) -> tuple[WireItem, ...]:
    """Convert a fence to the wire; the same for both autopilots."""
    items = enumerate(from_fence(fence))
    return tuple(to_wire(item, seq, mission_type=MISSION_TYPE_FENCE) for seq, item in items)


def fence_from_wire(items: Sequence[WireItem]) -> Geofence:
    """Convert a fence from the wire."""
    return to_fence([from_wire(item) for item in items])


def rally_to_wire(rally: RallyPoints) -> tuple[WireItem, ...]:
    """Convert rally points to the wire; the same for both autopilots."""
    items = enumerate(from_rally(rally))
    return tuple(to_wire(item, seq, mission_type=MISSION_TYPE_RALLY) for seq, item in items)


def rally_from_wire(items: Sequence[WireItem]) -> RallyPoints:
    """Convert rally points from the wire."""
    return to_rally([from_wire(item) for item in items])


def no_such_command(item: MissionItem) -> str:
    """Describe that an autopilot has no such command; for an unnamed one, that no known version has it."""
    return f"it has no {item.name}" if isinstance(item.command, Command) else f"no known version has {item.name}"
