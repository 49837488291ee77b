"""Reader of one table of a configuration file, field by field; every fault is collected."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault, InputError, one_line
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

MAX_BYTES = 1024 * 1024
MAX_UNKNOWN = 20
"""Unknown fields of one table that are reported."""
_DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""")
"""A key of more than 32 parts: the memory that `tomllib` takes for a key grows with the square of its parts."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file of at most 1 MB; an error names the line."""
    text = read_text(path, max_bytes=MAX_BYTES)
    if _DEEP_KEY.search(text):
        raise InputError("is nested too deeply", str(path))
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or a number of thousands of digits
        where = re.search(r" \(at line (\d+), column \d+\)$", str(error))
        reason = str(error)[: where.start()] if where else str(error)
        raise InputError(f"is not TOML: {reason}", str(path), int(where[1]) if where else None) from error
    except RecursionError:
        raise InputError("is nested too deeply", str(path)) from None


def finite(text: object) -> float | None:
    """Return the number in a text or value, or None if it is not a finite number."""
    if isinstance(text, bool) or (isinstance(text, str) and "_" in text):
        return None
    try:
        number = float(text)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


class Table:
    """One table of a file, named by its dotted path and read field by field; wrong fields give faults and a fallback."""

    def __init__(self, values: object, file: str, path: str, faults: list[Fault]) -> None:
        self.file = file
        self.path = path
        self.faults = faults
        self._read: set[str] = set()
        self._values: dict[str, Any] = values if isinstance(values, dict) else {}
        self._is_table = isinstance(values, dict)
        if not self._is_table:
            self.fault("", "must be a table", values)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def fault(self, key: str, problem: str, value: object = None, remedy: str | None = None) -> None:
        """Add a fault about one field."""
        field = ".".join(part for part in (self.path, key) if part)
        self.faults.append(Fault(problem, self.file, None, field or None, value, remedy))

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        above: float = -math.inf,
    ) -> float:
        """Read a finite number in [low, high] and above `above`; required unless there is a default."""
        fallback = math.nan if default is None else default
        value = self._get(key, required=default is None)
        if value is None:
            return fallback
        number = finite(value) if not isinstance(value, str) else None
        if number is None:
            self.fault(key, "must be a number", value)
            return fallback
        if not low <= number <= high or not number > above:
            self.fault(key, "out of range", value, _range_text(low, high, above))
            return fallback
        return number

    def whole(self, key: str, default: int, *, low: int, high: int) -> int:
        """Read a whole number in [low, high]."""
        value = self._get(key, required=False)
        if value is None:
            return default
        if isinstance(value, bool) or not isinstance(value, int):
            self.fault(key, "must be a whole number", value)
            return default
        if not low <= value <= high:
            self.fault(key, "out of range", value, _range_text(low, high, -math.inf))
            return default
        return value

    def text(self, key: str, default: str | None = None, *, choices: Sequence[str] | None = None) -> str:
        """Read a text that is not empty, one of `choices` where given; required unless there is a default."""
        value = self._get(key, required=default is None)
        if value is None:
            return default or ""
        if not isinstance(value, str) or not value.strip():
            self.fault(key, "must be a text that is not empty", value)
            return default or ""
        if one_line(value) != value:
            self.fault(key, "must be one line of plain text", value)
            return default or ""
        if choices is not None and value not in choices:
            self.fault(key, "is not known", value, "one of " + ", ".join(choices))
            return default or choices[0]
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Read true or false."""
        if key not in self:
            return default
        value = self._get(key, required=False)
        if not isinstance(value, bool):
            self.fault(key, "is neither true nor false", value)
            return default
        return value

    def texts(self, key: str, default: tuple[str, ...]) -> tuple[str, ...]:
        """Read a list of texts."""
        value = self._get(key, required=False)
        if value is None:
            return default
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fault(key, "must be a list of texts", value)
            return default
        return tuple(value)

    def table(self, key: str) -> Table:
        """Read a table; an absent one is empty."""
        self._read.add(key)
        return Table(self._values.get(key, {}), self.file, f"{self.path}.{key}" if self.path else key, self.faults)

    def tables(self, key: str) -> list[Table]:
        """Read a list of tables; an absent one is empty."""
        self._read.add(key)
        values = self._values.get(key, [])
        path = f"{self.path}.{key}" if self.path else key
        if not isinstance(values, list):
            self.fault(key, "must be a list of tables", values)
            return []
        return [Table(value, self.file, f"{path}[{number}]", self.faults) for number, value in enumerate(values)]

    def finish(self) -> None:
        """Report every field that was not read: a misspelt name must not silently mean a default."""
        unknown = [key for key in self._values if key not in self._read]
        for key in unknown[:MAX_UNKNOWN]:
            close = difflib.get_close_matches(key, self._read, n=1)
            known = f"did you mean {close[0]}?" if close else "known: " + ", ".join(sorted(self._read))
            self.fault(key, "is not a field here", None, known)
        if len(unknown) > MAX_UNKNOWN:
            self.fault("", f"has {len(unknown) - MAX_UNKNOWN} more unknown fields")

    def _get(self, key: str, *, required: bool) -> Any:
        self._read.add(key)
        value = self._values.get(key)
        if value is None and required and self._is_table:
            self.fault(key, "is missing")
        return value


def _range_text(low: float, high: float, above: float) -> str:
    if math.isfinite(above):
        return f"must be above {above:g}" + (f" and at most {high:g}" if math.isfinite(high) else "")
    if math.isfinite(low) and math.isfinite(high):
        return f"must be from {low:g} to {high:g}"
    return f"must be at least {low:g}" if math.isfinite(low) else f"must be at most {high:g}"
