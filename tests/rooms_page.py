"""The page and the picture of the code's rooms, made from the code: ``python -m tests.rooms_page`` writes both again.

A room is a folder of modules. Which room imports which is read from the import statements that run (those for type checkers
do not count); everything else is docstrings.
"""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "rooms.md"
PICTURE = ROOT / "docs" / "assets" / "rooms.svg"
FLOORS = ("skyway", "sim_stub", "link", "planner", "missions", "models")
"""From the top; the planner and the missions are on one level and know nothing of each other."""
COLOURS = {
    "skyway": "#d9e3f0",
    "sim_stub": "#e6ddf0",
    "link": "#dcefe2",
    "planner": "#f6e7cf",
    "missions": "#f3dcdc",
    "models": "#e4e4e4",
}
BOX_W, BOX_H, GAP, LEFT, PER_ROW = 148, 30, 14, 110, 6
STEP = BOX_H + 20
"""From one row to the next."""


@dataclass(frozen=True)
class Module:
    """One file: its name without the leading ``skyway.``, its room, its docstring's first sentence, what it imports of ours."""

    name: str
    room: str
    says: str
    imports: tuple[str, ...]


@cache
def modules() -> list[Module]:
    """Every module of the package."""
    files = {
        _name(path): path for floor in FLOORS for path in sorted((ROOT / floor).rglob("*.py")) if _ours(path, floor)
    }
    return [_module(name, path, files) for name, path in files.items()]


def rooms(found: list[Module]) -> dict[str, str]:
    """Rooms with modules, and what each is for."""
    named = sorted({one.room for one in found}, key=lambda room: (FLOORS.index(room.split(".")[0]), room))
    return {room: _sentence(ROOT.joinpath(*room.split("."), "__init__.py")) for room in named}


def page() -> str:
    """The page: a table of modules for each room."""
    found = modules()
    lines = [
        "# Rooms",
        "",
        "Where a concept lives: the folders of the code, made from its docstrings. What may import what:",
        "[Architecture](../architecture.md).",
        "",
        "![Rooms by floor; an arrow leads from a room to one that it imports](../assets/rooms.svg)",
    ]
    for room, says in rooms(found).items():
        lines += ["", f"## {room}", "", says, "", "| module | what |", "| --- | --- |"]
        lines += [f"| `{one.name.rpartition('.')[2]}` | {_cell(one.says)} |" for one in found if one.room == room]
    return "\n".join(lines) + "\n"


def picture() -> str:
    """The picture: rooms in rows by floor, with an arrow for each import between rooms of one floor."""
    found = modules()
    edges = _edges(found)
    counts = Counter(one.room for one in found)
    places, rows, y = {}, [], 10
    for floor in FLOORS:
        levels = _levels([room for room in rooms(found) if room.split(".")[0] == floor], edges)
        rows.append((floor, y, len(levels)))
        for level, mine in enumerate(levels):
            for number, room in enumerate(mine):
                places[room] = LEFT + number * (BOX_W + GAP), y + 8 + level * STEP
        y += 16 + len(levels) * STEP
    width = max(x for x, _ in places.values()) + BOX_W + GAP
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {y}" font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="#ffffff"/>',
        (
            '<defs><marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" markerHeight="6" orient="auto">'
            '<path d="M0 0L8 4L0 8z" fill="#5a6b7b"/></marker></defs>'
        ),
    ]
    for floor, top, count in rows:
        height = 8 + count * STEP
        out.append(
            f'<rect x="4" y="{top}" width="{width - 8}" height="{height}" rx="6" fill="{COLOURS[floor]}" opacity="0.45"/>'
        )
        out.append(f'<text x="14" y="{top + 26}" font-weight="bold">{floor}</text>')
    out += [_arrow(places[a], places[b]) for a, b in sorted(edges)]
    for room, (x, top) in places.items():
        short = room.partition(".")[2] or room
        out.append(
            f'<rect x="{x}" y="{top}" width="{BOX_W}" height="{BOX_H}" rx="4" fill="{COLOURS[room.split(".")[0]]}" stroke="#5a6b7b"/>'
        )
        out.append(
            f'<text x="{x + 8}" y="{top + 21}">{escape(short)} <tspan fill="#5a6b7b">{counts[room]}</tspan></text>'
        )
    return "\n".join([*out, "</svg>"]) + "\n"


def _edges(found: list[Module]) -> set[tuple[str, str]]:
    """Pairs of rooms of one floor, the first of which imports the second."""
    room_of = {one.name: one.room for one in found}
    pairs = {(one.room, room_of[other]) for one in found for other in one.imports}
    return {(a, b) for a, b in pairs if a != b and a.split(".")[0] == b.split(".")[0]}


def _levels(mine: list[str], edges: set[tuple[str, str]]) -> list[list[str]]:
    """Rooms above all that they import, as low as that lets them stand; the top level first."""
    height = dict.fromkeys(mine, 0)
    for _ in mine:
        for room in mine:
            height[room] = max((height[b] + 1 for a, b in edges if a == room and b in height), default=0)
    wanted = sorted({min(one, len(mine)) for one in height.values()}, reverse=True)
    rows = [[room for room in mine if min(height[room], len(mine)) == level] for level in wanted]
    return [row[k : k + PER_ROW] for row in rows for k in range(0, len(row), PER_ROW)]


def _arrow(a: tuple[int, int], b: tuple[int, int]) -> str:
    """A curve from the edge of one box to that of another."""
    (ax, ay), (bx, by) = a, b
    if ay == by:  # side by side: over the top
        x1, x2 = ax + BOX_W // 2, bx + BOX_W // 2 + (14 if ax < bx else -14)
        lift = 10 + abs(ax - bx) // 40
        return _curve(f"M{x1} {ay}C{x1} {ay - lift} {x2} {by - lift} {x2} {by}")
    down = by > ay
    x1, y1 = ax + BOX_W // 2, ay + (BOX_H if down else 0)
    x2, y2 = bx + BOX_W // 2 - 14, by + (0 if down else BOX_H)
    bend = 14 if down else -14
    return _curve(f"M{x1} {y1}C{x1} {y1 + bend} {x2} {y2 - bend} {x2} {y2}")


def _curve(path: str) -> str:
    return f'<path d="{path}" fill="none" stroke="#5a6b7b" stroke-width="0.9" opacity="0.7" marker-end="url(#a)"/>'


def _ours(path: Path, floor: str) -> bool:
    parts = path.relative_to(ROOT).parts
    return (
        "__pycache__" not in parts
        and path.name not in ("__init__.py", "__main__.py")
        and not (floor == "skyway" and parts[1] in FLOORS)
    )


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def _module(name: str, path: Path, files: dict[str, Path]) -> Module:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typed = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.dump(branch.test)
        for node in ast.walk(branch)
    }
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and id(node) not in typed:
            base = (
                node.module.removeprefix("skyway.")
                if node.module.split(".")[1:2] and node.module.split(".")[1] in FLOORS
                else node.module
            )
            found |= {one for alias in node.names for one in (f"{base}.{alias.name}", base) if one in files}
    return Module(name, name.rpartition(".")[0], _sentence(path), tuple(sorted(found)))


def _sentence(path: Path) -> str:
    """First sentence of a file's docstring."""
    says = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(says.split("\n\n")[0].split())


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def refresh() -> None:
    """Write both files."""
    PAGE.write_text(page(), encoding="utf-8")
    PICTURE.write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    refresh()
