"""Rows of orders and drones, from CSV or JSON: read field by field, every fault with its file, line and field."""

from __future__ import annotations

import difflib
import json
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault, InputError, one_line
from skyway.models.base.fields import MAX_UNKNOWN, finite
from skyway.models.base.files import read_text
from skyway.models.base.table import FaultCollector, read_table
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

MAX_BYTES = 64_000_000
MAX_ROWS = 100_000
MAX_FAULTS = 100
"""A file with more faults is not read to its end."""
MAX_TEXT = 200
"""Characters of an id, a place or a kind."""
YEARS = (1900, 2200)
"""Times beyond these years are typing errors."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row; `place` is an empty fault at the position of the row, `faults` collects its faults."""

    values: Mapping[str, Any]
    place: Fault
    faults: list[Fault]

    def fault(self, field: str, problem: str, remedy: str | None = None) -> None:
        """Note a fault of one field."""
        value = self.values.get(field)
        self.faults.append(fault_at(self.place, field, problem, None if value == "" else value, remedy))

    def _given(self, field: str) -> Any:
        value = self.values.get(field)
        return value.strip() if isinstance(value, str) else value

    def text(self, field: str, default: str | None = None) -> str:
        """Read a line of text; required unless there is a default."""
        value = self._given(field)
        if value is None or value == "":
            if default is None:
                self.fault(field, "is missing")
            return default or ""
        if isinstance(value, (int, float)) and not isinstance(value, bool):  # an id that JSON holds as a number
            value = str(value)
        if not isinstance(value, str) or one_line(value) != value or len(value) > MAX_TEXT:
            self.fault(field, f"must be one line of plain text of up to {MAX_TEXT} characters")
            return default or ""
        return value

    def number(self, field: str, low: float, high: float, default: float | None = None, hint: str = "") -> float:
        """Read a number in [low, high]; required unless there is a default."""
        value = self._given(field)
        if value is None or value == "":
            if default is None:
                self.fault(field, "is missing")
            return math.nan if default is None else default
        number = finite(value)
        if number is None:
            comma = isinstance(value, str) and "," in value
            self.fault(field, "is not a number", "write 0.8, with a point" if comma else "a number such as 0.8")
        elif not low <= number <= high:
            self.fault(field, "out of range", f"must be from {low:g} to {high:g}{hint}")
        else:
            return number
        return math.nan if default is None else default

    def whole(self, field: str, low: int, high: int, default: int) -> int:
        """Read a whole number in [low, high]."""
        number = self.number(field, low, high, default)
        if number != int(number):
            self.fault(field, "must be a whole number", f"from {low} to {high}")
            return default
        return int(number)

    def instant(self, field: str, *, required: bool = True) -> datetime | None:
        """Read an instant with its UTC offset; None if it is missing or wrong."""
        value = self._given(field)
        if value is None or value == "":
            if required:
                self.fault(field, "is missing", "a time such as 2013-07-10T14:00-04:00")
            return None
        try:
            instant = parse_instant(str(value))
        except InputError as error:
            self.fault(field, error.faults[0].problem, error.faults[0].remedy)
            return None
        if not YEARS[0] <= instant.year <= YEARS[1]:
            self.fault(field, "out of range", f"a year from {YEARS[0]} to {YEARS[1]}")
            return None
        return instant


def fault_at(place: Fault, field: str, problem: str, value: object = None, remedy: str | None = None) -> Fault:
    """Return a fault of one field at the place of a row."""
    path = f"{place.field}.{field}" if place.field else field
    return replace(place, field=path, problem=problem, value=value, remedy=remedy)


def read_rows(
    path: Path, key: str, required: Sequence[str], optional: Sequence[str], faults: list[Fault]
) -> Iterator[Row]:
    """Yield the rows of a table: CSV, or by the ending ``.json`` a list of objects, alone or under `key` beside a schema.

    An `InputError` refuses any other file; an unknown column or field is a fault, since a misspelt name must not silently
    mean a default. Stops early after too many faults.
    """
    rows = _json_rows(path, key, faults) if path.suffix.lower() == ".json" else _csv_rows(path, required, faults)
    for count, row in enumerate(checked_rows(rows, required, optional, faults)):
        if count >= MAX_ROWS:
            raise InputError(f"has more than {MAX_ROWS:,} rows", str(path), remedy="cut it to the part that is needed")
        yield row
        if len(faults) >= MAX_FAULTS:
            faults.append(replace(row.place, problem="too many faults; the rest was not read"))
            return


def checked_rows(
    rows: Iterable[tuple[Fault, dict[str, Any]]], required: Sequence[str], optional: Sequence[str], faults: list[Fault]
) -> Iterator[Row]:
    """Yield rows of values; each unknown field is a fault, reported once."""
    known = {*required, *optional}
    told: set[str] = set()
    for place, values in rows:
        for name in sorted(set(values) - known - told)[:MAX_UNKNOWN]:
            told.add(name)
            close = difflib.get_close_matches(name, known, n=1)
            remedy = f"did you mean {close[0]}?" if close else "known: " + ", ".join((*required, *optional))
            header = replace(place, line=1) if place.line else place
            faults.append(fault_at(header, name, "is not a field here", None, remedy))
        yield Row(values, place, faults)


def _csv_rows(path: Path, required: Sequence[str], faults: list[Fault]) -> Iterator[tuple[Fault, dict[str, Any]]]:
    file = str(path)
    shape = FaultCollector(file)
    for chunk in _chunks(path, required, shape):
        for number, line in enumerate(chunk.lines):
            yield Fault("", file, line), {name: texts[number] for name, texts in chunk.columns.items()}
    try:
        shape.raise_if_any()
    except InputError as error:
        faults += error.faults


def _chunks(path: Path, required: Sequence[str], shape: FaultCollector) -> Iterator[Any]:
    """Yield the chunks of a table with all its columns; one that lacks a required column is refused by name."""
    for number, chunk in enumerate(read_table(path, None, shape)):
        if not number:
            for name in required:
                if name not in chunk.columns:
                    has = "the file has the columns " + ", ".join(chunk.columns)
                    shape.add("no such column", has, line=1, field=name)
            shape.raise_if_any()
        yield chunk


def _json_rows(path: Path, key: str, faults: list[Fault]) -> Iterator[tuple[Fault, dict[str, Any]]]:
    file, schema = str(path), f"skyway.{key}/1"
    try:
        document = json.loads(read_text(path, max_bytes=MAX_BYTES))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        line = getattr(error, "lineno", None)
        raise InputError(f"is not JSON: {getattr(error, 'msg', 'nested too deeply')}", file, line) from error
    if isinstance(document, dict):
        if document.get("schema", schema) != schema:
            raise InputError("is not known", file, field="schema", value=document["schema"], remedy=f"one of {schema}")
        document = document.get(key)
    if not isinstance(document, list):
        raise InputError("must be a list of objects", file, field=key, remedy=f'{{"schema": "{schema}", "{key}": […]}}')
    if not document:
        raise InputError("is empty", file, field=key)
    for number, one in enumerate(document):
        place = Fault("", file, None, f"{key}[{number}]")
        if isinstance(one, dict):
            yield place, one
        else:
            faults.append(replace(place, problem="must be an object", value=one))
