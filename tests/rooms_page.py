"""The page and the picture of the code's rooms, made from the code: ``python -m tests.rooms_page`` writes both again.

A room is a folder of modules. Which room imports which is read from the import statements that run (those for type checkers
do not count); everything else is docstrings.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests import rooms_picture

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "rooms.md"
PICTURE = ROOT / "docs" / "assets" / "rooms.svg"
FLOORS = ("skyway", "sim_stub", "link", "planner", "missions", "models")
"""From the top; the planner and the missions are on one level and know nothing of each other."""


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
        "The folders and modules of the code, generated from its docstrings. Allowed imports:",
        "[Architecture](../architecture.md).",
        "",
        "![Rooms by floor; an arrow leads from a room to one that it imports](../assets/rooms.svg)",
    ]
    for room, says in rooms(found).items():
        lines += ["", f"## {room}", "", says, "", "| module | contents |", "| --- | --- |"]
        lines += [f"| `{one.name.rpartition('.')[2]}` | {_cell(one.says)} |" for one in found if one.room == room]
    return "\n".join(lines) + "\n"


def picture() -> str:
    """The picture of the rooms as SVG."""
    return rooms_picture.picture(modules(), FLOORS)


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
