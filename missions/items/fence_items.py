"""Fences and rally points as mission items."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import FENCE_COMMANDS, Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

HOME_CIRCLE = 5005
"""A circle around home wherever it is, of the newest ArduPilot; we have no fence for it."""

COMMANDS = FENCE_COMMANDS | {HOME_CIRCLE, Command.NAV_RALLY_POINT}
"""Commands that belong to a fence or to rally points, not to a mission."""

CLAIMED_COUNT = "claimedVertexCount"
"""Key in `FencePolygon.extra`: the stated number of vertices of a polygon, if it was wrong."""

_POLYGONS = {
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {Command.NAV_FENCE_CIRCLE_INCLUSION: True, Command.NAV_FENCE_CIRCLE_EXCLUSION: False}


def from_fence(fence: Geofence) -> tuple[MissionItem, ...]:
    """Return the items of a fence; each vertex carries the number of vertices of its polygon."""
    items = []
    if fence.return_point is not None:
        items.append(_item(Command.NAV_FENCE_RETURN_POINT, fence.return_point, 0.0, fence.return_altitude_m))
    for polygon in fence.polygons:
        command = _named(_POLYGONS, polygon.inclusion)
        count = float(len(polygon.vertices))
        items += [_item(command, vertex, count) for vertex in polygon.vertices]
    for circle in fence.circles:
        items.append(_item(_named(_CIRCLES, circle.inclusion), circle.center, circle.radius_m))
    return tuple(items)


def from_rally(rally: RallyPoints) -> tuple[MissionItem, ...]:
    """Return the items of rally points, with heights above home."""
    items = (_item(Command.NAV_RALLY_POINT, p.point, 0.0, p.altitude_m) for p in rally.points)
    return tuple(replace(item, frame=Frame.GLOBAL_RELATIVE_ALT) for item in items)


def _item(command: Command, point: Point, param1: float, z: float = 0.0) -> MissionItem:
    return MissionItem(command, Frame.GLOBAL, param1, x=point.lat_e7, y=point.lon_e7, z=z, autocontinue=False)


def _named(table: dict[Command, bool], inclusion: bool) -> Command:  # noqa: FBT001  a look-up, not a switch
    return next(command for command, value in table.items() if value is inclusion)


def to_fence(items: Sequence[MissionItem], file: str = "fence") -> Geofence:
    """Make a fence from its items.

    A polygon whose vertices carry another count than there are is kept unchanged and marked with the count it
    claims (`CLAIMED_COUNT`): vehicles acknowledge such a fence and it is invalid afterwards, so the checks call it an
    error.

    An `InputError` names an item that is not a fence item, a polygon with fewer than three vertices, or a circle without a
    radius.
    """
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    return_point, return_altitude = None, 0.0
    position = 0
    while position < len(items):
        item = items[position]
        if item.command == Command.NAV_FENCE_RETURN_POINT:
            return_point, return_altitude = _point(item, position, file), item.z
            position += 1
        elif item.command in _POLYGONS:
            polygons.append(_polygon(items, position, file))
            position += len(polygons[-1].vertices)
        elif item.command in _CIRCLES:
            if not item.param1 > 0:
                raise InputError("a fence circle has no radius", file, None, f"item {position}")
            center = _point(item, position, file)
            circles.append(FenceCircle(center, item.param1, _CIRCLES[Command(item.command)]))
            position += 1
        elif item.command == HOME_CIRCLE:
            remedy = "use a circle with its own centre (5003)"
            problem = "not supported: a fence circle around wherever home is"
            raise InputError(problem, file, None, f"item {position}", HOME_CIRCLE, remedy)
        else:
            raise InputError(f"{item.name} is not part of a fence", file, None, f"item {position}")
    return Geofence(tuple(polygons), tuple(circles), return_point, return_altitude)


def _polygon(items: Sequence[MissionItem], first: int, file: str) -> FencePolygon:
    head = items[first]
    alike = 0
    while first + alike < len(items) and _same_polygon(items[first + alike], head):
        alike += 1
        if alike == head.param1:
            break
    if alike < 3:
        remedy = "each vertex carries the number of vertices of its polygon, at least 3"
        raise InputError("a fence polygon with fewer than 3 vertices", file, None, f"item {first}", alike, remedy)
    vertices = tuple(_point(item, first + i, file) for i, item in enumerate(items[first : first + alike]))
    claimed = {} if alike == head.param1 else {CLAIMED_COUNT: head.param1}
    return FencePolygon(vertices, _POLYGONS[Command(head.command)], claimed)


def _same_polygon(item: MissionItem, head: MissionItem) -> bool:
    return item.command == head.command and item.param1 == head.param1


def to_rally(items: Sequence[MissionItem], file: str = "rally") -> RallyPoints:
    """Make rally points from their items; any other item is an `InputError`."""
    points = []
    for position, item in enumerate(items):
        if item.command != Command.NAV_RALLY_POINT:
            raise InputError(f"{item.name} is not a rally point", file, None, f"item {position}")
        points.append(RallyPoint(_point(item, position, file), 0.0 if math.isnan(item.z) else item.z))
    return RallyPoints(tuple(points))


def _point(item: MissionItem, position: int, file: str) -> Point:
    if item.x is None or item.y is None:
        raise InputError("has no coordinates", file, None, f"item {position}")
    if abs(item.param5) > 90.0 or abs(item.param6) > 180.0:
        value = (item.param5, item.param6)
        raise InputError("is not a place on Earth", file, None, f"item {position}", value)
    return Point(item.x, item.y)


def is_fence_item(item: MissionItem) -> bool:
    """Whether an item belongs to a fence rather than a mission."""
    return item.command in FENCE_COMMANDS or item.command == HOME_CIRCLE


def is_rally_item(item: MissionItem) -> bool:
    """Whether an item is a rally point."""
    return item.command == Command.NAV_RALLY_POINT


def merge(fence: Geofence, other: Geofence) -> Geofence:
    """Return a fence with the areas of both."""
    point = fence.return_point or other.return_point
    height = fence.return_altitude_m if fence.return_point else other.return_altitude_m
    return replace(
        fence,
        polygons=(*fence.polygons, *other.polygons),
        circles=(*fence.circles, *other.circles),
        return_point=point,
        return_altitude_m=height,
    )
