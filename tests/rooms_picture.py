"""The picture of the rooms: a band for each floor, in it a box for each room, with an arrow to each room that it imports.

An import that follows along other arrows is not drawn (transitive reduction); what is left can be followed by eye. Rooms inside a
room are lines of its box. Columns lead from importers on the left to the imported on the right.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tests.rooms_page import Module

COLOURS = {
    "skyway": "#d9e3f0",
    "sim_stub": "#e6ddf0",
    "link": "#dcefe2",
    "planner": "#f6e7cf",
    "missions": "#f3dcdc",
    "models": "#e4e4e4",
}
INK, SOFT = "#1f2a35", "#5a6b7b"
LEFT, BOX_W, COLUMN = 104, 124, 144
LINE, HEAD, GAP, PAD = 18, 30, 10, 10
CAPTION = 26

Edges = set[tuple[str, str]]


@dataclass(frozen=True)
class Box:
    """A room's place in the picture, and its lines of text."""

    x: int
    y: int
    height: int
    lines: tuple[str, ...]


def picture(modules: Sequence[Module], floors: Sequence[str]) -> str:
    """The picture as SVG."""
    top = {one.name: ".".join(one.room.split(".")[:2]) for one in modules}
    pairs = {(top[one.name], top[other]) for one in modules for other in one.imports}
    counts = Counter(one.room for one in modules)
    bands, y, columns = [], CAPTION, 0
    for floor in floors:
        rooms = sorted({room for room in top.values() if room.split(".")[0] == floor})
        edges = reduced({(a, b) for a, b in pairs if a != b and a in rooms and b in rooms})
        levels = ordered(levelled(rooms, edges), edges)
        boxes = _boxes(levels, edges, counts, y + PAD)
        height = max(box.y + box.height for box in boxes.values()) + PAD - y
        bands.append((floor, y, height, boxes, edges))
        y, columns = y + height + 6, max(columns, len(levels))
    width = LEFT + columns * COLUMN
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {y}" font-family="sans-serif" font-size="16" fill="{INK}">',
        '<rect width="100%" height="100%" fill="#ffffff"/>',
        (
            '<defs><marker id="a" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto-start-reverse">'
            f'<path d="M0 0L8 4L0 8z" fill="{SOFT}"/></marker></defs>'
        ),
        (
            f'<text x="8" y="18" font-size="15" fill="{SOFT}">Rooms and their numbers of modules. A floor imports only floors below it; '
            "inside a floor arrows lead to what is imported.</text>"
        ),
    ]
    for floor, start, height, boxes, edges in bands:
        out += _band(floor, start, height, width)
        out += [
            _arrow(boxes[a], boxes[b], double=(b, a) in edges) for a, b in sorted(edges) if (b, a) not in edges or a < b
        ]
        out += [line for room, box in boxes.items() for line in _box(box, COLOURS[room.split(".")[0]])]
    return "\n".join([*out, "</svg>"]) + "\n"


def reduced(edges: Edges) -> Edges:
    """Edges without those that a path of other edges implies; edges of a ring stay."""
    below = {a: _reached(a, edges) for a, _ in edges}

    def ring(a: str, b: str) -> bool:
        return b in below.get(a, ()) and a in below.get(b, ())

    def implied(a: str, b: str) -> bool:
        return any(b in below.get(c, ()) and not ring(b, c) and not ring(a, c) for first, c in edges if first == a)

    return {(a, b) for a, b in edges if ring(a, b) or not implied(a, b)}


def levelled(rooms: Iterable[str], edges: Edges) -> list[list[str]]:
    """Rooms by the longest path to a room that imports nothing, the longest first; rooms of a ring side by side."""
    below = {room: _reached(room, edges) for room in rooms}
    height = dict.fromkeys(below, 0)
    for _ in height:
        for a, b in edges:
            ring = a in below[b]
            height[a] = max(height[a], height[b] + (not ring))
    return [[room for room in height if height[room] == level] for level in range(max(height.values()), -1, -1)]


def ordered(levels: list[list[str]], edges: Edges) -> list[list[str]]:
    """Each level in the order of what imports its rooms, so that few arrows cross."""
    place: dict[str, float] = {}
    rings = {a for a, b in edges if (b, a) in edges}
    for rooms in levels:
        above = {room: [place[a] for a, b in edges if b == room and a in place] for room in rooms}
        rooms.sort(
            key=lambda room: (sum(above[room]) / len(above[room]) if above[room] else 0.0, room not in rings, room)
        )
        place |= {room: number / len(rooms) for number, room in enumerate(rooms)}
    return levels


def _reached(start: str, edges: Edges) -> set[str]:
    found: set[str] = set()
    waiting = [start]
    while waiting:
        here = waiting.pop()
        for a, b in edges:
            if a == here and b not in found:
                found.add(b)
                waiting.append(b)
    return found


def _boxes(levels: list[list[str]], edges: Edges, counts: Counter[str], top: int) -> dict[str, Box]:
    """Boxes in columns; what a column further left than the next imports stands below all between, for a straight arrow."""
    column_of = {room: column for column, rooms in enumerate(levels) for room in rooms}
    boxes: dict[str, Box] = {}
    for column, rooms in enumerate(levels):
        y = top
        first = {room: min([column_of[a] for a, b in edges if b == room], default=column) for room in rooms}
        for room in sorted(rooms, key=lambda room: -first[room] - 1 if first[room] >= column - 1 else 0):
            between = [box.y + box.height + GAP for one, box in boxes.items() if first[room] < column_of[one] < column]
            y = max([y, *between])
            inside = [f"{one[len(room) + 1 :]} {counts[one]}" for one in sorted(counts) if one.startswith(f"{room}.")]
            if "." not in room:  # modules of the floor itself; its rooms have their own boxes
                lines = (f"*.py {counts[room]}",)
            else:
                lines = (f"{room.rpartition('.')[2]} {counts[room] or ''}".strip(), *inside)
            height = HEAD + LINE * (len(lines) - 1) + (4 if len(lines) > 1 else 0)
            boxes[room] = Box(LEFT + column * COLUMN, y, height, lines)
            y += height + GAP
    return boxes


def _band(floor: str, y: int, height: int, width: int) -> list[str]:
    return [
        f'<rect x="4" y="{y}" width="{width - 8}" height="{height}" rx="6" fill="{COLOURS[floor]}" opacity="0.45"/>',
        f'<text x="14" y="{y + PAD + 18}" font-weight="bold">{floor}</text>',
    ]


def _box(box: Box, colour: str) -> list[str]:
    lines = [
        f'<rect x="{box.x}" y="{box.y}" width="{BOX_W}" height="{box.height}" rx="4" fill="{colour}" stroke="{SOFT}"/>',
    ]
    for number, text in enumerate(box.lines):
        name, _, count = text.partition(" ")
        x, size = (box.x + 16, 14) if number else (box.x + 8, 16)
        lines.append(
            f'<text x="{x}" y="{box.y + 21 + number * LINE}" font-size="{size}">'
            f'{escape(name)} <tspan fill="{SOFT}" font-size="14">{count}</tspan></text>'
        )
    return lines


def _arrow(a: Box, b: Box, *, double: bool) -> str:
    """A curve from the right edge of one box to the left edge of another, or between neighbours of a column."""
    if a.x == b.x:
        first, second = (a, b) if a.y < b.y else (b, a)
        path = f"M{a.x + BOX_W // 2} {first.y + first.height}V{second.y}"
    else:
        x1, y1, x2, y2 = a.x + BOX_W, a.y + HEAD // 2, b.x, b.y + HEAD // 2
        bend = (
            COLUMN - BOX_W
        )  # the whole bend lies between two columns, so that a long arrow runs straight in its room's row
        path = f"M{x1} {y1}C{x1 + bend} {y1} {x1} {y2} {x1 + bend} {y2}H{x2}"
    start = ' marker-start="url(#a)"' if double else ""
    return f'<path d="{path}" fill="none" stroke="{SOFT}" stroke-width="1.2"{start} marker-end="url(#a)"/>'
