"""Structure scans: rings around a building, layer by layer.

Source: ``StructureScanComplexItem::appendMissionItems`` of QGroundControl. It enters at the first vertex, turns the
camera to the building, flies each layer as a closed ring with pictures, and leaves where it came.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.json_fields import fault, flag, mapping, quantity
from skyway.missions.patterns.geometry import is_clockwise, offset, to_place, to_plane
from skyway.missions.patterns.items import MAX_BUILT, corners, item, trigger, waypoint

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.patterns.items import Place

CAMERA_TO_THE_RIGHT_DEG = 90


def structure_scan(source: Mapping[str, Any], file: str, field: str) -> list[Mapping[str, Any]]:
    """Return the items of a structure scan of version 3.

    Raises
    ------
    InputError
        A setting is missing or impossible, the number of layers contradicts the heights, or there would be too many
        items.
    """
    camera, seen = mapping(source.get("CameraCalc"), file, f"{field}.CameraCalc"), f"{field}.CameraCalc"
    layer_m = quantity(camera, "AdjustedFootprintFrontal", file, seen, positive=True)
    step_m = quantity(camera, "AdjustedFootprintSide", file, seen, least=0.0)
    bottom, top = (quantity(source, key, file, field) for key in ("ScanBottomAlt", "StructureHeight"))
    layers = max(1, math.ceil((top - bottom) / layer_m))
    told = quantity(source, "Layers", file, field)
    if told != layers:
        remedy = f"its heights make {layers}: open and save the plan in QGroundControl"
        raise fault("is not the number of layers of this structure scan", file, f"{field}.Layers", told, remedy)
    ring = _ring(source, quantity(camera, "DistanceToSurface", file, seen), file, field)
    if layers * (len(ring) + 2) > MAX_BUILT:
        raise fault(f"expands to more than {MAX_BUILT} items", file, field, remedy="scan fewer layers")
    frame = Frame.GLOBAL_RELATIVE_ALT
    door = waypoint(frame, ring[0], quantity(source, "EntranceAltitude", file, field))
    aim = [0, 0, 0, 0, quantity(source, "GimbalPitch", file, field), 0, CAMERA_TO_THE_RIGHT_DEG]
    items = [door, item(Command.DO_SET_ROI_WPNEXT_OFFSET, Frame.MISSION, aim)]
    downwards = flag(source, "StartFromTop", file, field)
    for layer in range(layers):
        height = top - (layer + 0.5) * layer_m if downwards else bottom + (layer + 0.5) * layer_m
        first, *others = (waypoint(frame, corner, height) for corner in ring)
        items += [first, trigger(step_m), *others, trigger(0, at_once=False)]
    return [*items, item(Command.DO_SET_ROI_NONE, Frame.MISSION), door]


def _ring(source: Mapping[str, Any], distance_m: float, file: str, field: str) -> list[Place]:
    """Return the corners of a layer, closed: the building, clockwise, moved outwards."""
    building = corners(source, "polygon", 3, file, field)
    shape = to_plane(building, building[0])
    if not is_clockwise(shape):
        shape = shape[::-1]
    moved = offset(shape, distance_m, closed=True)
    if moved is None:
        remedy = "open the plan in QGroundControl and draw the structure again"
        raise fault("has a point twice, or on a straight edge", file, f"{field}.polygon", remedy=remedy)
    ring = [to_place(float(x), float(y), building[0]) for x, y in moved]
    return [*ring, ring[0]]
