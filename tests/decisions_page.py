"""The index of decision records, made from the records: ``python -m tests.decisions_page`` writes it again."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "decisions"
PAGE = FOLDER / "index.md"
_TITLE = re.compile(r"# (\d+)\. (.+)")
_STATUS = re.compile(
    r"Status: (accepted|superseded by \[\d+\]\(\S+\)|partly superseded by \[\d+\]\(\S+\)) \([A-Z][a-z]+ \d{4}\)\."
)


@dataclass(frozen=True)
class Record:
    """One decision record."""

    file: str
    number: int
    title: str
    status: str


def records() -> list[Record]:
    """Every record in order; a `ValueError` names one whose first lines are not title and status."""
    return [_record(path) for path in sorted(FOLDER.glob("[0-9]*.md"))]


def page() -> str:
    """The index as Markdown."""
    lines = [
        "# Decisions",
        "",
        "Choices that will be asked about again, with their reasons. A record is not rewritten when it no longer holds: its status says",
        "which later record supersedes it.",
        "",
        "| record | status |",
        "| --- | --- |",
    ]
    return "\n".join([*lines, *(f"| [{r.number}. {r.title}]({r.file}) | {r.status} |" for r in records())]) + "\n"


def _record(path: Path) -> Record:
    first, _, third, *_ = path.read_text(encoding="utf-8").splitlines()
    title, status = _TITLE.fullmatch(first), _STATUS.match(third)
    if title is None or status is None or int(title[1]) != int(path.name[:4]):
        raise ValueError(f"{path}: begin with '# NUMBER. Title', an empty line and 'Status: accepted (Month Year).'")
    return Record(path.name, int(title[1]), title[2].replace("|", "\\|"), status[1])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
