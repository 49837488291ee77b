"""Structure scans: rings around a building, layer by layer.

Source: ``StructureScanComplexItem::appendMissionItems`` of QGroundControl. It enters at the first vertex, turns the
camera to the building, flies each layer as a closed ring with pictures, and leaves at the point of entry.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.patterns.geometry import is_clockwise, offset, to_place, to_plane
from skyway.missions.patterns.items import MAX_BUILT, corners, item, trigger, waypoint

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.json_fields import JsonField
    from skyway.missions.patterns.items import Place

CAMERA_TO_THE_RIGHT_DEG = 90


def structure_scan(source: JsonField) -> list[Mapping[str, Any]]:
    """Return the items of a structure scan of version 3.

    Raises an `InputError` if a setting is missing or impossible, if the number of layers contradicts the heights, or
    if there would be too many items.
    """
    camera = source["CameraCalc"]
    layer_m = camera["AdjustedFootprintFrontal"].quantity(positive=True)
    step_m = camera["AdjustedFootprintSide"].quantity(least=0.0)
    bottom, top = (source[key].quantity() for key in ("ScanBottomAlt", "StructureHeight"))
    layers = max(1, math.ceil((top - bottom) / layer_m))
    told = source["Layers"].quantity()
    if told != layers:
        remedy = f"its heights make {layers}: open and save the plan in QGroundControl"
        raise source["Layers"].fault("is not the number of layers of this structure scan", told, remedy)
    ring = _ring(source["polygon"], camera["DistanceToSurface"].quantity())
    if layers * (len(ring) + 2) > MAX_BUILT:
        raise source.fault(f"expands to more than {MAX_BUILT} items", remedy="scan fewer layers")
    frame = Frame.GLOBAL_RELATIVE_ALT
    door = waypoint(frame, ring[0], source["EntranceAltitude"].quantity())
    aim = [0, 0, 0, 0, source["GimbalPitch"].quantity(), 0, CAMERA_TO_THE_RIGHT_DEG]
    items = [door, item(Command.DO_SET_ROI_WPNEXT_OFFSET, Frame.MISSION, aim)]
    downwards = source["StartFromTop"].flag()
    for layer in range(layers):
        height = top - (layer + 0.5) * layer_m if downwards else bottom + (layer + 0.5) * layer_m
        first, *others = (waypoint(frame, corner, height) for corner in ring)
        items += [first, trigger(step_m), *others, trigger(0, at_once=False)]
    return [*items, item(Command.DO_SET_ROI_NONE, Frame.MISSION), door]


def _ring(polygon: JsonField, distance_m: float) -> list[Place]:
    """Return the corners of a layer, closed: the building, clockwise, moved outwards."""
    building = corners(polygon, 3)
    shape = to_plane(building, building[0])
    if not is_clockwise(shape):
        shape = shape[::-1]
    moved = offset(shape, distance_m, closed=True)
    if moved is None:
        remedy = "open the plan in QGroundControl and draw the structure again"
        raise polygon.fault("has a point twice, or on a straight edge", remedy=remedy)
    ring = [to_place(float(x), float(y), building[0]) for x, y in moved]
    return [*ring, ring[0]]
