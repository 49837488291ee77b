"""Reader and writer of QGC WPL 110 text (``.waypoints``): Mission Planner, MAVProxy and QGroundControl.

A row is index, current, frame, command, four parameters, latitude, longitude, altitude, autocontinue, between blanks,
tabs or commas. Row 0 is home for every ground station, whatever its frame: a WAYPOINT, or command 0 of old Mission
Planner; a take-off or fence point there cannot be home and is the first item (exports of PX4 and MAVSDK). Numbers of rows count home if it is present: item 0
of ours is row 1. Fence points (5000 to 5004) and rally points (5100) may stand among the items.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from skyway.missions.files.jumps import refers_to, resolved
from skyway.missions.items import fence_items
from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, Frame, frame_of
from skyway.missions.items.commands import LOCATED_COMMANDS, Command, command_of
from skyway.missions.items.coordinates import Point, to_e7
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.json_fields import MAX_FLOAT32, MAX_PARAM
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.fields import finite

if TYPE_CHECKING:
    from collections.abc import Sequence

HEADER = "QGC WPL 110"
MAX_ROWS = 100_000
MAX_FAULTS = 20
_WHOLE = {"index": (0, 2**31 - 1), "frame": (2, 255), "command": (3, 65535), "autocontinue": (11, 255)}
"""Whole numbers of a row: which cell, and the largest."""
_FLOATS = ("param1", "param2", "param3", "param4", "latitude", "longitude", "altitude")


class _Row(NamedTuple):
    line: int
    number: int
    item: MissionItem


def loads(text: str, file: str = "waypoints") -> MissionDocument:
    """Read the text of a ``.waypoints`` file; comment lines (``#``) are kept with the item that follows.

    An `InputError` lists every fault: another version, rows that are not twelve numbers, coordinates out of range,
    fences whose vertex counts disagree, or jumps to a row number that several rows have.
    """
    lines = text.splitlines()
    header = lines[0].split() if lines else []
    if header[:2] != ["QGC", "WPL"]:
        remedy = f"the first line of a waypoint file is {HEADER}"
        raise InputError("is not a waypoint file", file, 1, None, lines[0] if lines else "", remedy)
    if header[2:] not in (["110"], ["120"]):
        version = " ".join(header[2:])
        raise InputError("not supported: version of the waypoint file", file, 1, None, version, HEADER)
    rows = _read_rows(lines, file)
    home, rows = _split_home(rows, file) if header[2] == "110" else (None, rows)
    strays = [row for row in rows if row.item.command in fence_items.COMMANDS]
    fence_rows = [row.item for row in strays if fence_items.is_fence_item(row.item)]
    rally_rows = [row.item for row in strays if fence_items.is_rally_item(row.item)]
    mission_rows = [row for row in rows if row.item.command not in fence_items.COMMANDS] if strays else rows

    def ambiguous(index: int, wanted: int) -> InputError:
        return InputError(f"the jump is ambiguous: several rows have number {wanted}", file, mission_rows[index].line)

    numbers = [row.number for row in mission_rows]
    items = resolved([row.item for row in mission_rows], numbers, min(numbers[0], 1) if numbers else 0, ambiguous)
    return MissionDocument(
        Mission(items, home),
        fence_items.to_fence(fence_rows, file),
        fence_items.to_rally(rally_rows, file),
    )


def _read_rows(lines: Sequence[str], file: str) -> list[_Row]:
    if len(lines) > 2 * MAX_ROWS:
        raise InputError(f"has more than {2 * MAX_ROWS} lines", file, None, None, len(lines))
    rows: list[_Row] = []
    faults: list[Fault] = []
    comment: list[str] = []
    for line, text in enumerate(lines[1:], start=2):
        cells = text.replace(",", " ").split()
        if not cells:
            continue
        if cells[0].startswith("#"):
            comment.append(text.lstrip()[1:].strip())
            continue
        try:
            rows.append(_read_row(cells, line, file, comment))
        except InputError as error:
            faults += error.faults
            if len(faults) >= MAX_FAULTS:
                break
        comment = []
        if len(rows) > MAX_ROWS:
            raise InputError(f"has more than {MAX_ROWS} items", file)
    refuse(faults)
    return rows


def _read_row(cells: list[str], line: int, file: str, comment: list[str]) -> _Row:
    if len(cells) != 12:  # Mission Planner takes 11 or more, and cannot know which one is missing
        remedy = f"index, current, frame, command, {', '.join(_FLOATS)}, autocontinue; decimals with a point"
        raise InputError("is not a row of 12 numbers", file, line, None, len(cells), remedy)
    try:
        index, frame, command, autocontinue = int(cells[0]), int(cells[2]), int(cells[3]), int(cells[11])
        a, b, c, d, x, y, z = map(float, cells[4:11])
        plain = 0 <= index < 2**31 and 0 <= frame < 256 and 0 <= command < 65536 and 0 <= autocontinue < 256
        plain = plain and abs(a) + abs(b) + abs(c) + abs(d) + abs(z) <= MAX_FLOAT32  # no NaN either
    except ValueError:
        plain = False
    if not plain:
        index, frame, command, autocontinue = _whole_cells(cells, line, file)
        a, b, c, d, x, y, z = _float_cells(cells, line, file)
    if command in LOCATED_COMMANDS and frame in GLOBAL_FRAMES:
        if abs(x) > 90.0:
            hint = "are latitude and longitude exchanged?" if abs(x) <= 180.0 and abs(y) <= 90.0 else None
            raise InputError("latitude is not between -90 and 90", file, line, None, x, hint)
        if abs(y) > 180.0:
            raise InputError("longitude is not between -180 and 180", file, line, None, y)
    elif abs(x) > MAX_PARAM or abs(y) > MAX_PARAM:
        field, value = ("latitude", x) if abs(x) > MAX_PARAM else ("longitude", y)
        raise InputError("is too large for a mission", file, line, field, value)
    item = MissionItem(
        command_of(command),
        frame_of(frame),
        a,
        b,
        c,
        d,
        to_e7(x) if x == x else None,  # noqa: PLR0124  NaN
        to_e7(y) if y == y else None,  # noqa: PLR0124  NaN
        z,
        autocontinue != 0,
        {"comment": "\n".join(comment)} if comment else {},
    )
    return _Row(line, index, item)


def _whole_cells(cells: Sequence[str], line: int, file: str) -> list[int]:
    """Take index, frame, command and autocontinue where some are written as 3.0, are not numbers, or out of range."""
    values = []
    for field, (column, most) in _WHOLE.items():
        number = finite(cells[column])
        if number is None or not number.is_integer():
            raise InputError("is not a whole number", file, line, field, cells[column])
        if not 0 <= number <= most:
            raise InputError(f"is not from 0 to {most}", file, line, field, int(number))
        values.append(int(number))
    return values


def _float_cells(cells: Sequence[str], line: int, file: str) -> list[float]:
    values = []
    for field, cell in zip(_FLOATS, cells[4:11], strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise InputError("is not a number", file, line, field, cell, "write 0 or NaN for none") from None
        if abs(values[-1]) > MAX_FLOAT32:
            raise InputError("is too large for a mission", file, line, field, values[-1])
    return values


def _split_home(rows: list[_Row], file: str) -> tuple[Home | None, list[_Row]]:
    """Take row 0 as home; its altitude is the height of the ground if it is above sea level."""
    if not rows:
        return None, rows
    first = rows[0].item
    if first.command not in (0, Command.NAV_WAYPOINT) or rows[0].number != 0:
        return None, rows
    if first.x is None or first.y is None or (first.x == 0 and first.y == 0):
        return None, rows[1:]
    if abs(first.param5) > 90.0 or abs(first.param6) > 180.0:
        raise InputError("home is not a place on Earth", file, rows[0].line, None, (first.param5, first.param6))
    known = first.frame in (Frame.GLOBAL, Frame.GLOBAL_INT) and not math.isnan(first.z)
    return Home(Point(first.x, first.y), first.z if known else None), rows[1:]


def dumps_mission(document: MissionDocument) -> str:
    """Return the text of the mission: home in row 0 always, as QGroundControl and Mission Planner expect it."""
    rows = [_home_row(document.mission.home)]
    for number, item in enumerate(document.mission.items, start=1):
        target = refers_to(item)
        rows.append(_row(number, item if target is None else replace(item, param1=float(target + 1))))
    return "\n".join([HEADER, *rows]) + "\n"


def dumps_fence(document: MissionDocument) -> str:
    """Return the text of the fence in Mission Planner's separate file."""
    return _dumps(document.mission.home, fence_items.from_fence(document.fence))


def dumps_rally(document: MissionDocument) -> str:
    """Return the text of the rally points, as Mission Planner keeps them in a file of their own."""
    return _dumps(document.mission.home, fence_items.from_rally(document.rally))


def _dumps(home: Home | None, items: Sequence[MissionItem]) -> str:
    rows = [_home_row(home), *(_row(number, item) for number, item in enumerate(items, start=1))]
    return "\n".join([HEADER, *rows]) + "\n"


def _home_row(home: Home | None) -> str:
    if home is None:
        return "0\t1\t0\t16\t0\t0\t0\t0\t0\t0\t0\t1"
    altitude = "NaN" if home.altitude_m is None else _number(home.altitude_m)
    return f"0\t1\t0\t16\t0\t0\t0\t0\t{home.point.lat:.7f}\t{home.point.lon:.7f}\t{altitude}\t1"


def _row(number: int, item: MissionItem) -> str:
    cells = [
        str(number),
        "0",
        str(int(item.frame)),
        str(int(item.command)),
        *(_number(value) for value in item.params),
        "NaN" if item.x is None else f"{item.param5:.7f}",
        "NaN" if item.y is None else f"{item.param6:.7f}",
        _number(item.z),
        str(int(item.autocontinue)),
    ]
    return "\t".join(cells)


def _number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    text = f"{value:.6f}"
    return text if float(text) == value else repr(value)
