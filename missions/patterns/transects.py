"""Surveys and corridor scans, expanded to items as in QGroundControl.

Surveys of versions 2 and 3 never hold them, later ones and corridors hold an empty list where a program wrote them.
Sources: ``SurveyComplexItem``, ``CorridorScanComplexItem`` and ``TransectStyleComplexItem`` of QGroundControl. Patterns
that need more than the file are not built: heights computed above terrain, and settings that contradict each other.
Newer QGroundControl for PX4 marks the ends of a transect by gates on the way; waypoints stand at the same places here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.patterns.geometry import line_count, offset, sweep, to_place, to_plane
from skyway.missions.patterns.items import MAX_BUILT, corners, one_photo, trigger, waypoint
from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.missions.items.json_fields import JsonField
    from skyway.missions.patterns.items import Place

HOVER_S = 4
"""Time QGroundControl hovers for a picture."""
CLOSEST_TRANSECTS_M = {"survey": 0.3, "CorridorScan": 0.5}
"""Below this spacing QGroundControl flies one transect."""
ONE_TRANSECT_M = 100_000.0
TOP_RIGHT = 1
MANUAL = "Manual"
"""Prefix of the name of "no camera": only this one may be flown at heights above the sea."""
_FRAMES = {1: Frame.GLOBAL_RELATIVE_ALT, 2: Frame.GLOBAL, 4: Frame.GLOBAL_TERRAIN_ALT}
"""By the altitude mode of QGroundControl; 3 computes heights from a terrain model."""
_DISAGREES = 0.01


@dataclass(frozen=True, slots=True)
class Transects:
    """Settings of a survey or corridor."""

    spacing_m: float
    trigger_m: float
    """Between transects, and between pictures along one; no trigger distance, no pictures."""
    altitude_m: float
    """In the reference of `frame`."""
    frame: Frame
    turnaround_m: float
    """Extension beyond the ends of each transect."""
    entry: int
    """Corner to begin at: 0 to 3."""
    hovers: bool
    """Whether it stops for each picture."""
    photographs_turns: bool
    """Whether pictures are taken in turns, too."""


def survey(source: JsonField) -> list[Mapping[str, Any]]:
    """Return the items of a survey of any version; an `InputError` for wrong settings, or too many items."""
    if source["version"].value in (2, 3):
        settings, angle, again = _settings_of_version_3(source)
    else:
        settings = _settings(source, "survey")
        angle = source["angle"].quantity()
        again = source["TransectStyleComplexItem"]["Refly90Degrees"].flag()
    polygon = corners(source["polygon"], 3)
    shape = to_plane(polygon, polygon[0])
    _limit(line_count(shape, settings.spacing_m), source)
    angle = angle - 180.0 if angle > 90.0 else angle + 180.0 if angle < -90.0 else angle
    alternate = source.get("flyAlternateTransects", missing=False).flag()
    flown: list[list[Place]] = []
    for heading in (angle, angle + 90.0) if again else (angle,):
        swept = sweep(shape, heading, settings.spacing_m)
        lines = [[to_place(float(x), float(y), polygon[0]) for x, y in line] for line in swept]
        lines = _entered(lines, settings.entry, reverse_lines=(1, 3), reverse_points=(2, 3))
        if flown and lines:
            lines = _nearest_first(lines, flown[-1][-1])
        flown += _lawnmower(lines[::2] + lines[1::2][::-1] if alternate else lines)
    if not flown:
        raise source["polygon"].fault("is not a polygon: no line crosses it")
    return _items(flown, settings, source)


def corridor(source: JsonField) -> list[Mapping[str, Any]]:
    """Return the items of a corridor scan; `InputError` as `survey`."""
    settings = _settings(source, "CorridorScan")
    width = source["CorridorWidth"].quantity(least=0.0)
    polyline = corners(source["polyline"], 2)
    shape = to_plane(polyline, polyline[0])
    _limit(width / settings.spacing_m * len(polyline), source)
    count = math.ceil(width / settings.spacing_m) if width > 0.0 else 1
    lines = []
    for number in range(count):
        beside = 0.0 if count == 1 else width / 2.0 - (number + 0.5) * settings.spacing_m
        moved = offset(shape, beside, closed=False)
        if moved is None:
            raise source["polyline"].fault("has a point twice in a row")
        lines.append([to_place(float(x), float(y), polyline[0]) for x, y in moved])
    return _items(_lawnmower(_entered(lines, settings.entry, (1, 3), (2, 3))), settings, source)


def _settings(source: JsonField, kind: str) -> Transects:
    style = source["TransectStyleComplexItem"]
    camera = style["CameraCalc"]
    mode = camera["DistanceMode"]
    if style["FollowTerrain"].value:
        mode = mode.of(3)
    elif "DistanceMode" not in camera:
        mode = mode.of(1 if camera["DistanceToSurfaceRelative"].flag() else 2)
    frame = _frame(mode)
    if frame == Frame.GLOBAL and not str(camera.get("CameraName", MANUAL).value).startswith(MANUAL):
        problem = "not supported: a pattern above sea level with a camera (QGroundControl flies it above home)"
        raise mode.fault(problem, mode.value, "open the plan in QGroundControl, and save it")
    return Transects(
        _spacing(camera["AdjustedFootprintSide"].quantity(least=0.0), kind),
        camera["AdjustedFootprintFrontal"].quantity(least=0.0),
        camera["DistanceToSurface"].quantity(),
        frame,
        style["TurnAroundDistance"].quantity(),
        _entry(source["EntryPoint" if kind == "CorridorScan" else "entryLocation"]),
        style["HoverAndCapture"].flag(),
        style["CameraTriggerInTurnAround"].flag(),
    )


def _settings_of_version_3(source: JsonField) -> tuple[Transects, float, bool]:
    """Return the settings, the angle, and whether it is flown again at a right angle, of a survey of version 2 or 3."""
    grid = source["grid"]
    if not grid["relativeAltitude"].flag():
        remedy = "open the plan in QGroundControl, set the altitude, and save it"
        problem = "not supported: a survey of version 3 above sea level (QGroundControl reads it as above home)"
        raise grid["relativeAltitude"].fault(problem, grid["relativeAltitude"].value, remedy)
    spacing = grid["spacing"].quantity(least=0.0)
    distance = source["cameraTriggerDistance"].quantity(least=0.0)
    altitude = grid["altitude"].quantity()
    if not source["manualGrid"].flag():
        _agree(source, altitude)
    hovers = source.get("hoverAndCapture", missing=False).flag()
    settings = Transects(
        _spacing(spacing, "survey"),
        distance,
        altitude,
        Frame.GLOBAL_RELATIVE_ALT,
        grid["turnAroundDistance"].quantity(),
        _entry(grid.get("entryLocation", missing=TOP_RIGHT)),
        hovers,
        source.get("cameraTriggerInTurnaround", missing=True).flag() and not hovers,
    )
    return settings, grid["angle"].quantity(), source.get("refly90Degrees", missing=False).flag()


def _agree(source: JsonField, altitude: float) -> None:
    """Refuse a spacing that differs from the camera's at this height: QGroundControl uses the camera's, not the file's."""
    camera = source["camera"]
    keys = ("focalLength", "sensorWidth", "resolutionWidth", "resolutionHeight")
    focal, sensor, wide, high = (camera[key].quantity(positive=True) for key in keys)
    pixel_m = altitude * sensor / (wide * focal)
    footprint = [wide * pixel_m, high * pixel_m]
    if not camera["orientationLandscape"].flag():
        footprint.reverse()
    side_key = "imageSizeOverlap" if "imageSizeOverlap" in camera else "imageSideOverlap"
    overlaps = [int(camera[key].quantity()) for key in (side_key, "imageFrontalOverlap")]
    for told, full, overlap in zip(
        (source["grid"]["spacing"], source["cameraTriggerDistance"]), footprint, overlaps, strict=True
    ):
        worked_out = full * (100 - overlap) / 100.0
        if abs(worked_out - told.number()) > _DISAGREES * max(abs(told.number()), abs(worked_out)):
            remedy = f"the camera gives {worked_out:.4g} m at this height: open and save the plan in QGroundControl"
            raise told.fault("contradicts the camera of the survey", told.number(), remedy)


def _spacing(value: float, kind: str) -> float:
    return value if value >= CLOSEST_TRANSECTS_M[kind] else ONE_TRANSECT_M


def _frame(mode: JsonField) -> Frame:
    if isinstance(mode.value, (int, float)) and mode.value in _FRAMES:
        return _FRAMES[int(mode.value)]
    if mode.value == 3:
        problem = "not supported: a pattern above terrain without the items it expands to"
        raise mode.fault(problem, 3, "open and save the plan in QGroundControl: it knows the terrain")
    raise mode.fault("is an unknown altitude mode", mode.value, "known: 1, 2 and 4")


def _entry(corner: JsonField) -> int:
    return int(corner.quantity())  # others than 1 to 3 are the corner 0 to QGroundControl


def _entered(
    lines: list[list[Place]], entry: int, reverse_lines: tuple[int, int], reverse_points: tuple[int, int]
) -> list[list[Place]]:
    if entry in reverse_points:
        lines = [line[::-1] for line in lines]
    return lines[::-1] if entry in reverse_lines else lines


def _nearest_first(lines: list[list[Place]], here: Place) -> list[list[Place]]:
    """Begin where three of the four outer ends are nearest; QGroundControl leaves the fourth out."""
    ends = (lines[0][0], lines[0][-1], lines[-1][0])
    away = [geodesy.distance_m(*here, *end) for end in ends]
    nearest = away.index(min(away))
    if nearest == 2:
        return lines[::-1]
    return [line[::-1] for line in lines] if nearest == 1 else lines


def _lawnmower(lines: Sequence[list[Place]]) -> list[list[Place]]:
    return [line[::-1] if number % 2 else line for number, line in enumerate(lines)]


def _limit(count: float, source: JsonField) -> None:
    if count > MAX_BUILT:
        remedy = "make the area smaller, or the spacing wider"
        raise source.fault(f"expands to more than {MAX_BUILT} items", remedy=remedy)


def _items(lines: Sequence[list[Place]], settings: Transects, source: JsonField) -> list[Mapping[str, Any]]:
    """Return the items along the transects: waypoints, pictures at the ends or on the way, turns."""
    takes = settings.trigger_m > 0.0
    hovers = takes and settings.hovers
    through = takes and not hovers and settings.photographs_turns
    turns = settings.turnaround_m > 0.0
    items: list[Mapping[str, Any]] = []

    def fly(spot: Place, distance: float | None = None) -> None:
        items.append(waypoint(settings.frame, spot, settings.altitude_m))
        if distance is not None:
            items.append(trigger(distance))

    for number, line in enumerate(lines):
        first, last = number == 0, number == len(lines) - 1
        if turns:
            fly(_beyond(line[1], line[0], settings.turnaround_m), settings.trigger_m if through and first else None)
        if hovers:
            for spot in (line[0], *_stops(line, settings.trigger_m, source), *line[1:]):
                items += [waypoint(settings.frame, spot, settings.altitude_m, HOVER_S), one_photo()]
        else:
            fly(line[0], settings.trigger_m if takes else None)
            for spot in line[1:-1]:
                fly(spot)
            ends = takes and (not through or (last and not turns))
            fly(line[-1], 0 if ends else None)
        if turns:
            fly(_beyond(line[-2], line[-1], settings.turnaround_m), 0 if through and last else None)
        _limit(len(items), source)
    return items


def _beyond(before: Place, end: Place, length_m: float) -> Place:
    """Return the place at a distance beyond the end of a line, in its direction."""
    return geodesy.direct(*end, geodesy.bearing_deg(*end, *before) + 180.0, length_m)


def _stops(line: list[Place], step_m: float, source: JsonField) -> list[Place]:
    """Return the places of hovering for pictures between the ends of a survey's transect."""
    length = geodesy.distance_m(*line[0], *line[-1])
    _limit(2.0 * length / step_m, source)
    if len(line) > 2 or step_m >= length:
        return []
    bearing = geodesy.bearing_deg(*line[0], *line[-1])
    return [geodesy.direct(*line[0], bearing, step_m * number) for number in range(1, math.floor(length / step_m) + 1)]
