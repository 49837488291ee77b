"""The commands, outputs and programs that the documentation shows, and how to make its outputs again.

``python tests/cli/docs_pages.py`` runs every command of README.md and docs/, puts the real output into the blocks
marked ``<!-- output -->``, draws the pictures of docs/assets and writes docs/reference/commands.md.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import tempfile
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHELLS = ("console", "bash", "sh", "")
OUTPUT = "<!-- output -->"
_FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """One fenced block of a page: its language, text, place in the page, and the line before it."""

    language: str
    text: str
    start: int
    end: int
    mark: str

    @property
    def typed(self) -> list[str]:
        """Commands of skyway in the block, continued lines joined; whatever else is typed is not ours."""
        if self.language not in SHELLS:
            return []
        lines = textwrap.dedent(self.text).replace("\\\n", " ").splitlines()
        return [line for line in lines if line.startswith("skyway ")]


def pages() -> list[Path]:
    """Every page with text of ours, README first."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> list[Block]:
    """Fenced blocks of a page in order."""
    text = page.read_text()
    found = []
    for match in _FENCE.finditer(text):
        before = text[: match.start()].rstrip("\n").rsplit("\n", 1)[-1].strip()
        found.append(Block(match[1], match[2], match.start(2), match.end(2), before))
    return found


def arguments(command: str) -> list[str]:
    """Words of a command as a shell would make them, without ``skyway``."""
    return shlex.split(command, comments=True)[1:]


def shape(output: str) -> list[str]:
    """Output without what varies between machines: numbers and the width of columns."""
    text = re.sub(r"[+-]?\d+([.:,]\d+)*( ?ms\b| s\b)?", "#", re.sub("─+", "─", output))
    return [" ".join(line.split()) for line in text.strip().splitlines()]


def run(command: str) -> tuple[int, str, str]:
    """Run a command in this process; returns (exit code, stdout, stderr)."""
    from skyway.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    os.environ.pop("COLUMNS", None)  # as in a pipe: complete
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(arguments(command))
    return code, out.getvalue(), err.getvalue()


def refresh(page: Path) -> None:
    """Put real output into the marked blocks of a page, typed after the pages that it goes on with."""
    from docs_session import Reader, pages_before

    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        reader = Reader(Path(name), compares=False)
        for earlier in pages_before(page):
            reader.type_page(earlier)
        changes = reader.type_page(page)
    text = page.read_text()
    for block, output in reversed(changes):
        text = text[: block.start] + output.strip("\n") + "\n" + text[block.end :]
    page.write_text(text)


def draw_pictures() -> None:
    """Draw the pictures of the documentation with the commands that its pages show."""
    trip = "--from siuh-north --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00"
    assets = ROOT / "docs" / "assets"
    run(f"skyway plan {trip} --plot {assets}/newyork-plan.svg --force")
    run(f"skyway wind --depart 2013-07-10T14:00-04:00 --plot {assets}/newyork-wind.svg --force")
    run(f"skyway network --plot {assets}/newyork-network.svg --force")
    with tempfile.TemporaryDirectory() as folder:
        for command in (
            f"skyway demo -o {folder}",
            f"skyway report {folder}/journal.jsonl -o {folder}/page.html --plot {assets}/newyork-flight.svg --force",
        ):
            code, _, err = run(command)
            if code:
                raise SystemExit(f"{command}: exit {code}: {err}")


if __name__ == "__main__":
    import command_reference

    command_reference.PAGE.write_text(command_reference.page())
    draw_pictures()
    for one in pages():
        if "<!-- output -->" in one.read_text():
            refresh(one)
        print(os.fspath(one.relative_to(ROOT)))
