"""Rooms: small, shown on a page that is made from the code."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from tests import rooms_page

MAX_MODULES = 15
ROOT = Path(__file__).parents[2]
FILE = re.compile(
    r"(?<![\w./-])((?:tests|models|planner|missions|link|sim_stub|skyway|benchmarks|docs)/[\w/.-]+\.(?:py|md|toml|json))"
)
MODULE = re.compile(r"`(?:skyway\.)?((?:models|planner|missions|link|sim_stub)(?:\.\w+)+)`")
PATTERNS = ("NAME", "NNNN")
"""What stands for a name in the recipes of CONTRIBUTING."""


def test_the_page_and_the_picture_of_the_rooms_are_those_of_the_code():
    remedy = "run: python -m tests.rooms_page"
    assert rooms_page.PAGE.read_text(encoding="utf-8") == rooms_page.page(), remedy
    assert rooms_page.PICTURE.read_text(encoding="utf-8") == rooms_page.picture(), remedy


def test_no_room_has_grown_too_large_to_look_over():
    counts = Counter(one.room for one in rooms_page.modules())
    assert counts
    assert {room: count for room, count in counts.items() if count > MAX_MODULES} == {}


def test_every_room_and_every_module_says_what_it_is_for():
    found = rooms_page.modules()
    assert [room for room, says in rooms_page.rooms(found).items() if not says] == []
    assert [one.name for one in found if not one.says] == []


def _is_there(module: str) -> bool:
    """Whether a dotted path names a module, a room, or something that a module or room holds."""
    parts = module.split(".")
    for count in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:count])
        if path.with_suffix(".py").exists():
            return True
        if path.is_dir():
            return count == len(parts) or parts[count] in (path / "__init__.py").read_text(encoding="utf-8")
    return False


def test_files_and_modules_that_pages_name_exist():
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    texts = {page.relative_to(ROOT): page.read_text(encoding="utf-8") for page in pages}
    living = {page: text for page, text in texts.items() if "Status: superseded" not in text}
    files = {(page, name) for page, text in living.items() for name in FILE.findall(text)}
    modules = {(page, name) for page, text in living.items() for name in MODULE.findall(text)}
    assert len(files) > 20
    assert len(modules) > 50
    gone = [one for one in files if not (ROOT / one[1]).exists() and not any(word in one[1] for word in PATTERNS)]
    gone += [one for one in modules if not _is_there(one[1])]
    assert gone == []
