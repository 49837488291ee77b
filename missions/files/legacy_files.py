"""Reader of old text files of MAVProxy and Mission Planner: fences and rally points."""

from __future__ import annotations

from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FencePolygon, Geofence
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import Fault, InputError, refuse

MAX_LINES = 100_000


def loads_fence(text: str, file: str = "fence") -> MissionDocument:
    """Read an old fence: the first line is the return point, the polygon repeats its first vertex at the end.

    An `InputError` lists lines that are not two numbers, coordinates out of range, or fewer than three vertices.
    """
    points: list[Point] = []
    faults: list[Fault] = []
    for line, cells in _lines(text, file):
        point = _point(cells, line, file, faults) if len(cells) == 2 else None
        if len(cells) != 2:
            faults.append(Fault("is not a line of latitude and longitude", file, line, None, " ".join(cells)))
        if point is not None:
            points.append(point)
    vertices = points[1:]
    if len(vertices) > 1 and vertices[0] == vertices[-1]:
        vertices = vertices[:-1]
    if not faults and len(vertices) < 3:
        remedy = "a return point, then at least three vertices"
        faults.append(Fault("is not a fence", file, None, None, f"{len(points)} points", remedy))
    refuse(faults[:20])
    return MissionDocument(fence=Geofence((FencePolygon(tuple(vertices)),), return_point=points[0]))


def loads_rally(text: str, file: str = "rally") -> MissionDocument:
    """Read old rally points: ``RALLY lat lon altitude break_altitude landing_direction flags``.

    An `InputError` lists lines of another form, and coordinates out of range.
    """
    points: list[RallyPoint] = []
    faults: list[Fault] = []
    for line, cells in _lines(text, file):
        if cells[0] != "RALLY" or len(cells) != 7:
            form = "RALLY latitude longitude altitude break-altitude landing-direction flags"
            faults.append(Fault("is not a rally line", file, line, None, " ".join(cells), form))
            continue
        point = _point(cells[1:3], line, file, faults)
        numbers = _numbers(cells[3:], line, file, faults)
        if point is not None and numbers is not None:
            altitude, break_altitude, direction, flags = numbers
            extra = {"breakAltitude": break_altitude, "landDirection": direction, "flags": flags}
            points.append(RallyPoint(point, altitude, extra))
    refuse(faults[:20])
    return MissionDocument(rally=RallyPoints(tuple(points)))


def _lines(text: str, file: str) -> list[tuple[int, list[str]]]:
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise InputError(f"has more than {MAX_LINES} lines", file, None, None, len(lines))
    split = ((number, line.split()) for number, line in enumerate(lines, start=1))
    return [(number, cells) for number, cells in split if cells and not cells[0].startswith("#")]


def _numbers(cells: list[str], line: int, file: str, faults: list[Fault]) -> list[float] | None:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        faults.append(Fault("is not a line of numbers", file, line, None, " ".join(cells)))
        return None
    if any(not abs(value) < 1e9 for value in values):
        faults.append(Fault("has a number out of range", file, line, None, " ".join(cells)))
        return None
    return values


def _point(cells: list[str], line: int, file: str, faults: list[Fault]) -> Point | None:
    values = _numbers(cells, line, file, faults)
    if values is None:
        return None
    lat, lon = values
    if abs(lat) > 90.0 or abs(lon) > 180.0:
        faults.append(Fault("is not a latitude and a longitude", file, line, None, " ".join(cells)))
        return None
    return Point.of_degrees(lat, lon)
