"""Tables that never lose text: as wide as the terminal, otherwise one paragraph per row; complete in a pipe."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from dataclasses import dataclass, field
from typing import Literal

import typer
from rich.cells import cell_len

from skyway.models.base.formatting import UNKNOWN

NUMBERS = re.compile(r"(?:[-+0-9.,<>%±°() ]|to|nan|inf)+")
"""A cell that contains only figures."""
NO_NUMBER = re.compile(r"[-+]?(?:nan|inf)\b")
GAP = 2
"""Blanks between columns."""
MIN_WIDTH = 20


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    head: str
    """Its head."""
    unit: str = ""
    """Below the head."""
    justify: Literal["left", "right"] = "right"
    words: str | None = None
    """Text of a value in a paragraph, such as ``charge {} %``; None is head, value, unit."""


@dataclass
class Sheet:
    """A table whose first columns name a row."""

    columns: list[Column]
    names: int = 1
    """Number of the first columns that name a row: in a paragraph they come before it."""
    rows: list[tuple[str, ...] | str] = field(default_factory=list)
    """Cells, or a line between rows."""

    def add(self, *cells: str) -> None:
        """Add a row; a figure that is not a finite number is shown as unknown."""
        figures = (NO_NUMBER.sub(UNKNOWN, one) if NUMBERS.fullmatch(one) else one for one in cells[self.names :])
        self.rows.append((*cells[: self.names], *figures))

    def note(self, line: str) -> None:
        """Add a line between rows."""
        self.rows.append(line)

    def lines(self, width: int | None) -> list[str]:
        """Return the table in lines of at most a width; None is any."""
        for gap in (GAP, 1):
            table = self._table(gap)
            if width is None or max(cell_len(line) for line in table) <= width:
                return table
        return self._paragraphs(width or MIN_WIDTH)

    def show(self) -> None:
        """Print it."""
        typer.echo("\n".join(self.lines(width())))

    def _table(self, gap: int) -> list[str]:
        heads = [[column.head for column in self.columns]]
        if any(column.unit for column in self.columns):
            heads.append([column.unit for column in self.columns])
        cells = [*heads, *(row for row in self.rows if not isinstance(row, str))]
        wide = [max(cell_len(row[k]) for row in cells) for k in range(len(self.columns))]

        def line(row: list[str] | tuple[str, ...]) -> str:
            parts = []
            for text, space, column in zip(row, wide, self.columns, strict=True):
                blanks = " " * (space - cell_len(text))
                parts.append(blanks + text if column.justify == "right" else text + blanks)
            return (" " * gap).join(parts).rstrip()

        rule = "─" * (sum(wide) + gap * (len(wide) - 1))
        body = [row if isinstance(row, str) else line(row) for row in self.rows]
        return [*(line(head) for head in heads), rule, *body]

    def _paragraphs(self, width: int) -> list[str]:
        found: list[str] = []
        for row in self.rows:
            if isinstance(row, str):
                found += wrapped(row, width)
                continue
            found += wrapped("  ".join(text for text in row[: self.names] if text.strip()), width)
            parts = []
            for text, column in zip(row[self.names :], self.columns[self.names :], strict=True):
                if text.strip():
                    words = column.words or " ".join(part for part in (column.head, "{}", column.unit) if part)
                    parts.append(words.format(text.strip()))
            found += textwrap.wrap(
                ", ".join(parts), max(width, MIN_WIDTH), initial_indent="    ", subsequent_indent="    ",
                break_long_words=False, break_on_hyphens=False,
            )  # fmt: skip
        return found


def width() -> int | None:
    """Columns of the terminal, or of ``COLUMNS``; None in a pipe, where lines are not broken or cut."""
    asked = os.environ.get("COLUMNS", "")
    if asked.isdigit() and int(asked) > 0:
        return max(int(asked), MIN_WIDTH)
    return max(shutil.get_terminal_size().columns, MIN_WIDTH) if sys.stdout.isatty() else None


def wrapped(text: str, wide: int | None) -> list[str]:
    """Break a line between words; continuation lines are indented by two more."""
    if wide is None or cell_len(text) <= wide:
        return [text]
    indent = " " * (len(text) - len(text.lstrip()) + 2)
    return textwrap.wrap(
        text, wide, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    ) or [text]


def say(text: str) -> None:
    """Print a line, broken at the width of the terminal."""
    typer.echo("\n".join(wrapped(text, width())))
