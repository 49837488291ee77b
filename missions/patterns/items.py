"""Common parts of pattern items: vertices, and the items that a plan file stores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.json_fields import JsonField

Place = tuple[float, float]
"""Latitude and longitude, degrees."""
MAX_BUILT = 20_000
"""Limit of items for one pattern; no autopilot holds as many."""


def corners(line: JsonField, least: int) -> list[Place]:
    """Read the vertices of a polygon or a line, `least` or more."""
    points = line.elements()
    if not least <= len(points) <= MAX_BUILT:
        raise line.fault(f"does not have {least} to {MAX_BUILT} points", len(points))
    return [(point.lat, point.lon) for point in (one.place() for one in points)]


def item(command: Command, frame: Frame, params: list[Any] | None = None) -> Mapping[str, Any]:
    """Return one item; without parameters all seven are 0."""
    return {"command": int(command), "frame": int(frame), "autoContinue": True, "params": params or [0] * 7}


def waypoint(frame: Frame, place: Place, altitude_m: float, hold_s: float = 0) -> Mapping[str, Any]:
    """Return a waypoint that leaves the yaw to the vehicle."""
    return item(Command.NAV_WAYPOINT, frame, [hold_s, 0, 0, None, *place, altitude_m])


def trigger(distance_m: float, *, at_once: bool = True) -> Mapping[str, Any]:
    """Return the command to take a picture at a distance interval, metres; 0 ends it."""
    return item(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, [distance_m, 0, int(at_once), 0, 0, 0, 0])


def one_photo() -> Mapping[str, Any]:
    """Return the command to take one picture now."""
    return item(Command.IMAGE_START_CAPTURE, Frame.MISSION, [0, 0, 1, 0, None, None, None])
