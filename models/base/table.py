"""CSV tables, read column by column; every fault is reported at once.

A column is read through its distinct texts (a record of 26,000 hours has some 40 different speeds), which is
fast and still lets each faulty line be named.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import files
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

MAX_BYTES = 64_000_000
MAX_ROWS = 5_000_000
_CHUNK_ROWS = 5_000
_KNOWN_TEXTS = 100_000
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")
LISTED_FAULTS = 20
HOPELESS_FAULTS = 100_000


class Problem(NamedTuple):
    """Reason why a text is not a valid value."""

    text: str
    remedy: str


class FaultCollector:
    """Faults of one file: the first twenty are reported, the others counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._found: list[Fault] = []
        self._unlisted = 0

    def add(
        self, problem: str, remedy: str, *, line: int | None = None, field: str | None = None, value: object = None
    ) -> None:
        """Note a fault; beyond a few times twenty only their number is kept."""
        if len(self._found) < 10 * LISTED_FAULTS:
            self._found.append(Fault(problem, self.file, line, field, value, remedy))
        else:
            self._unlisted += 1

    def first(self, wrong: Sequence[int] | NDArray[np.int64]) -> list[int]:
        """Return the first twenty of `wrong`, for `add`; the rest is counted."""
        self._unlisted += max(0, len(wrong) - LISTED_FAULTS)
        return [int(number) for number in wrong[:LISTED_FAULTS]]

    def raise_if_hopeless(self) -> None:
        """Raise the faults found so far if there are too many to continue."""
        if len(self._found) + self._unlisted > HOPELESS_FAULTS:
            self.raise_if_any(after=" in the lines read so far")

    def raise_if_any(self, *, after: str = "") -> None:
        """Raise the faults found, in the order of lines; `after` follows the number of faults not shown."""
        if not self._found:
            return
        found = sorted(self._found, key=lambda fault: fault.line or 0)
        more = len(found) + self._unlisted - LISTED_FAULTS
        if more > 0:
            found = [*found[:LISTED_FAULTS], Fault(f"and {more:,} more faults{after}", self.file)]
        raise InputError(found)


@dataclass(frozen=True, slots=True)
class Chunk:
    """Some rows of a table, by column."""

    lines: list[int]
    """Line of each row, counted from 1."""
    columns: dict[str, tuple[str, ...]]
    """Texts of each requested column, by its name, not stripped."""

    def decode(
        self,
        name: str,
        parse: Callable[[str], float | Problem],
        faults: FaultCollector,
        *,
        each_text_once: bool = False,
        known: dict[str, float] | None = None,
    ) -> NDArray[np.float64]:
        """Read a column of numbers, shape (rows,); a fault is noted and becomes NaN.

        Texts in `known` are not read again; valid texts are added to them.
        """
        texts = self.columns[name]
        values: dict[str, float] = {} if known is None else known
        if len(values) > _KNOWN_TEXTS:
            values.clear()
        problems: dict[str, Problem] = {}
        for text in set(texts).difference(values):
            value = parse(text.strip())
            if isinstance(value, Problem):
                problems[text] = value
            else:
                values[text] = value
        if problems:
            values = {**values, **dict.fromkeys(problems, math.nan)}
            rows = [row for row, text in enumerate(texts) if text in problems]
            if each_text_once:
                rows = sorted({texts[row]: row for row in reversed(rows)}.values())
            for row in faults.first(rows):
                problem, remedy = problems[texts[row]]
                faults.add(problem, remedy, line=self.lines[row], field=name, value=texts[row])
        return np.fromiter(map(values.__getitem__, texts), np.float64, len(texts))


class TableReader:
    """Rows of a table whose cells are separated by commas, or by semicolons if the header has these and no comma.

    Raises an `InputError` at a number with a decimal comma between semicolons.
    """

    def __init__(self, lines: Iterable[str], file: str) -> None:
        self._file = file
        stream = iter(lines)
        first = list(_until_header(stream))
        self.semicolons = bool(first) and ";" in first[-1] and "," not in first[-1]
        self._reader = csv.reader(chain(first, stream), delimiter=";" if self.semicolons else ",")

    @property
    def line_num(self) -> int:
        """Line of the latest row, counted from 1."""
        return self._reader.line_num

    def __iter__(self) -> TableReader:
        return self

    def __next__(self) -> list[str]:
        row = next(self._reader)
        if self.semicolons and (wrong := next(filter(_DECIMAL_COMMA.fullmatch, row), None)) is not None:
            problem, remedy = "has a decimal comma between semicolons", "write decimal points"
            raise InputError(problem, self._file, self.line_num, value=wrong.strip(), remedy=remedy)
        return row


def _until_header(stream: Iterator[str]) -> Iterator[str]:
    """Lines up to the first that is not blank."""
    for line in stream:
        yield line
        if line.strip():
            return


def read_table(
    path: Path, required: Sequence[str] | None, faults: FaultCollector, *, optional: Sequence[str] = ()
) -> Iterator[Chunk]:
    """Yield a CSV file in chunks of rows, with the requested columns; faults of its shape are collected.

    Without `required` all columns are given, in the order of the file. An `InputError` refuses a file above 64 MB or 5
    million rows, empty, without rows, or without a required column.
    """
    reader = TableReader(io.StringIO(_text(path), newline=""), str(path))
    try:
        header = next((row for row in reader if any(cell.strip() for cell in row)), None)
        places = _places(header, required, optional, faults)
        count = 0
        while True:
            lines: list[int] = []
            rows: list[list[str]] = []
            for row in islice(reader, _CHUNK_ROWS):
                lines.append(reader.line_num)
                rows.append(row)
            if not rows:
                break
            if set(map(len, rows)) != {len(header or ())}:
                lines, rows = _whole(lines, rows, len(header or ()), faults)
            count += len(rows)
            if rows:
                columns = list(zip(*rows, strict=True))
                yield Chunk(lines, {name: columns[place] for name, place in places.items()})
            faults.raise_if_hopeless()
    except csv.Error as error:
        raise InputError(f"is not CSV: {error}", faults.file, reader.line_num) from error
    if not count:
        faults.raise_if_any()
        raise InputError("has a header but no rows", faults.file)


def _whole(
    lines: list[int], rows: list[list[str]], width: int, faults: FaultCollector
) -> tuple[list[int], list[list[str]]]:
    """Leave out rows of the wrong width; all except empty ones are faults."""
    kept = [number for number, row in enumerate(rows) if len(row) == width]
    for line, row in zip(lines, rows, strict=True):
        if row and len(row) != width:
            problem = f"has {counted(len(row), 'cell')} where the header has {width}"
            faults.add(problem, "one cell for each column", line=line)
    return [lines[number] for number in kept], [rows[number] for number in kept]


def _text(path: Path) -> str:
    try:
        too_large = path.stat().st_size > MAX_BYTES
    except (OSError, ValueError):
        too_large = False  # files.read_text reports the problem
    if too_large:
        remedy = "cut it to the part that is needed"
        raise InputError(f"is larger than {MAX_BYTES / 1e6:.0f} MB", str(path), remedy=remedy)
    text = files.read_text(path, max_bytes=MAX_BYTES)
    if text.count("\n") > MAX_ROWS + 1:
        raise InputError(f"has more than {MAX_ROWS:,} rows", str(path), remedy="cut it to the part that is needed")
    return text


def _places(
    header: list[str] | None, required: Sequence[str] | None, optional: Sequence[str], faults: FaultCollector
) -> dict[str, int]:
    if header is None:
        raise InputError("is empty", faults.file, remedy="a header line and rows")
    names = [cell.strip() for cell in header]
    required = names if required is None else required
    has = "the file has the columns " + ", ".join(names)
    if len(names) == 1 and "\t" in names[0]:
        has = "they are separated by tabs: separate them by commas or semicolons"
    for name in required:
        if name not in names:
            faults.add("no such column", has, line=1, field=name)
    for name in dict.fromkeys((*required, *optional)):
        if names.count(name) > 1:
            faults.add("the column appears twice", "name it once", line=1, field=name)
    faults.raise_if_any()
    return {name: names.index(name) for name in (*required, *optional) if name in names}
