"""Read and write QGC WPL 110 text (``.waypoints``): Mission Planner, MAVProxy and QGroundControl.

A row is index, current, frame, command, four parameters, latitude, longitude, altitude, autocontinue. Row 0 is home
in files of ground stations (a WAYPOINT, or command 0 of old Mission Planner, above sea level); exports of PX4 and
MAVSDK start with the first item instead. Numbers of rows count home where it is there: item 0 of ours is row 1.
Fence points (5000 to 5004) and rally points (5100) may stand among the items.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from missions import fence_items
from missions.commands import (
    GLOBAL_FRAMES,
    INDEX_COMMANDS,
    LOCATED_COMMANDS,
    Command,
    Frame,
    command_of,
    frame_of,
)
from missions.coordinates import Point, to_e7
from missions.document import MissionDocument
from missions.json_fields import MAX_FLOAT32, MAX_PARAM
from missions.mission import NOTHING, Home, Mission, MissionItem
from models.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

HEADER = "QGC WPL 110"
MAX_ROWS = 100_000
MAX_FAULTS = 20


@dataclass(frozen=True, slots=True)
class _Row:
    line: int
    index: int
    item: MissionItem


def loads(text: str, file: str = "waypoints") -> MissionDocument:
    """Read the text of a ``.waypoints`` file; comment lines (``#``) are kept with the item that follows.

    Raises
    ------
    InputError
        Another version, rows that are not twelve numbers, coordinates out of range, fences whose vertex counts
        disagree, or jumps to a row number that several rows have; every fault is listed.
    """
    lines = text.splitlines()
    header = lines[0].split() if lines else []
    if header[:2] != ["QGC", "WPL"]:
        remedy = f"the first line of a waypoint file is {HEADER}"
        raise InputError(Fault("is not a waypoint file", file, 1, None, lines[0] if lines else "", remedy))
    if header[2:] not in (["110"], ["120"]):
        version = " ".join(header[2:])
        raise InputError(Fault("not supported: version of the waypoint file", file, 1, None, version, HEADER))
    rows = _read_rows(lines, file)
    home, rows = _split_home(rows, header[2] == "110")
    fence_rows = [row for row in rows if fence_items.is_fence_item(row.item)]
    rally_rows = [row for row in rows if fence_items.is_rally_item(row.item)]
    mission_rows = [
        row for row in rows if not fence_items.is_fence_item(row.item) and row.item.command != Command.NAV_RALLY_POINT
    ]
    return MissionDocument(
        Mission(_resolve_jumps(mission_rows, file), home),
        fence_items.to_fence([row.item for row in fence_rows], file),
        fence_items.to_rally([row.item for row in rally_rows], file),
    )


def _read_rows(lines: Sequence[str], file: str) -> list[_Row]:
    if len(lines) > 2 * MAX_ROWS:
        raise InputError(Fault(f"has more than {2 * MAX_ROWS} lines", file, None, None, len(lines)))
    rows: list[_Row] = []
    faults: list[Fault] = []
    comment: list[str] = []
    for line, text in enumerate(lines[1:], start=2):
        if not text or text.isspace():
            continue
        if text.lstrip().startswith("#"):
            comment.append(text.lstrip()[1:].strip())
            continue
        try:
            rows.append(_read_row(text, line, file, comment))
        except InputError as error:
            faults += error.faults
            if len(faults) >= MAX_FAULTS:
                break
        comment = []
        if len(rows) > MAX_ROWS:
            raise InputError(Fault(f"has more than {MAX_ROWS} items", file))
    if faults:
        raise InputError(faults)
    return rows


def _read_row(text: str, line: int, file: str, comment: list[str]) -> _Row:
    cells = text.split()
    if len(cells) != 12:
        raise InputError(Fault("is not a row of 12 numbers", file, line, None, len(cells)))
    index = _whole(cells[0], 2**31 - 1, "index", line, file)
    frame = frame_of(_whole(cells[2], 255, "frame", line, file))
    command = command_of(_whole(cells[3], 65535, "command", line, file))
    autocontinue = _whole(cells[11], 255, "autocontinue", line, file) != 0
    try:
        a, b, c, d, x, y, z = (float(cell) for cell in cells[4:11])
    except ValueError:
        raise InputError(Fault("has a parameter that is not a number", file, line, None, cells[4:11])) from None
    for value in (a, b, c, d, z):
        if abs(value) > MAX_FLOAT32:
            raise InputError(Fault("is too large for a mission", file, line, None, value))
    if command in LOCATED_COMMANDS and frame in GLOBAL_FRAMES:
        if abs(x) > 90.0:
            raise InputError(Fault("latitude is not between -90 and 90", file, line, None, x))
        if abs(y) > 180.0:
            raise InputError(Fault("longitude is not between -180 and 180", file, line, None, y))
    elif abs(x) > MAX_PARAM or abs(y) > MAX_PARAM:
        raise InputError(Fault("is too large for a mission", file, line, None, (x, y)))
    item = MissionItem(
        command,
        frame,
        a,
        b,
        c,
        d,
        None if math.isnan(x) else to_e7(x),
        None if math.isnan(y) else to_e7(y),
        z,
        autocontinue,
        {"comment": "\n".join(comment)} if comment else NOTHING,
    )
    return _Row(line, index, item)


def _whole(cell: str, most: int, field: str, line: int, file: str) -> int:
    if cell.isascii() and cell.isdigit() and len(cell) < 11:
        value = int(cell)
    else:
        try:
            number = float(cell)
        except ValueError:
            number = math.nan
        value = int(number) if number.is_integer() else -1
    if not 0 <= value <= most:
        raise InputError(Fault(f"is not a whole number from 0 to {most}", file, line, field, cell))
    return value


def _split_home(rows: list[_Row], home_first: bool) -> tuple[Home | None, list[_Row]]:  # noqa: FBT001
    """Take row 0 as home where a ground station wrote it so."""
    if not rows or not home_first:
        return None, rows
    first = rows[0].item
    is_home = first.command in (0, Command.NAV_WAYPOINT) and first.frame in (Frame.GLOBAL, Frame.GLOBAL_INT)
    if not is_home or rows[0].index != 0:
        return None, rows
    if first.x is None or first.y is None or (first.x == 0 and first.y == 0):
        return None, rows[1:]
    return Home(Point(first.x, first.y), None if math.isnan(first.z) else first.z), rows[1:]


def _resolve_jumps(rows: Sequence[_Row], file: str) -> tuple[MissionItem, ...]:
    """Turn row numbers into item numbers; a jump that leads nowhere stays out of range."""
    items = [row.item for row in rows]
    if not any(item.command in INDEX_COMMANDS for item in items):
        return tuple(items)
    numbers: dict[int, int] = {}
    repeated: set[int] = set()
    for number, row in enumerate(rows):
        if row.index in numbers:
            repeated.add(row.index)
        numbers[row.index] = number
    first_index = rows[0].index if rows else 0
    for number, row in enumerate(rows):
        wanted = row.item.jump_target
        if wanted is None or (row.item.command == Command.DO_SET_MISSION_CURRENT and wanted < 0):
            continue
        if wanted in repeated:
            problem = f"the jump is ambiguous: several rows have number {wanted}"
            raise InputError(Fault(problem, file, row.line))
        target = numbers.get(wanted, wanted - min(first_index, 1))
        if wanted not in numbers and 0 <= target < len(items):
            target += len(items)
        items[number] = replace(row.item, param1=float(target))
    return tuple(items)


def dumps_mission(document: MissionDocument) -> str:
    """Return the text of the mission: home in row 0 always, as QGroundControl and Mission Planner expect it."""
    rows = [_home_row(document.mission.home)]
    for number, item in enumerate(document.mission.items, start=1):
        target = item.jump_target
        refers = target is not None and not (item.command == Command.DO_SET_MISSION_CURRENT and target < 0)
        row_item = replace(item, param1=float(target + 1)) if target is not None and refers else item
        rows.append(_row(number, row_item))
    return "\n".join([HEADER, *rows]) + "\n"


def dumps_fence(document: MissionDocument) -> str:
    """Return the text of the fence, as Mission Planner keeps it in a file of its own."""
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
