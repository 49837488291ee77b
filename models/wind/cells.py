"""Cells of tables of wind: times, numbers, directions."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from skyway.models.base.table import Problem

if TYPE_CHECKING:
    from datetime import datetime

FIRST_YEAR, LAST_YEAR = 1800, 2200


def check_year(stamp: datetime) -> Problem | None:
    """Return what is wrong with a time that no record of wind can have."""
    if FIRST_YEAR <= stamp.year <= LAST_YEAR:
        return None
    return Problem("the time is out of range", f"a year from {FIRST_YEAR} to {LAST_YEAR}")


def parse_number(text: str) -> float | Problem:
    """Read a finite decimal number."""
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        hint = "write the decimals after a point" if re.fullmatch(r"[-+]?\d+,\d+", text) else "a number"
        return Problem("not a number", f"{hint}, or list the text under missing")
    return value if math.isfinite(value) else Problem("not a finite number", "list the text under missing")


def parse_direction(text: str) -> float | Problem:
    """Read a direction in degrees, 0 to 360."""
    value = parse_number(text)
    if isinstance(value, float) and not 0.0 <= value <= 360.0:
        return Problem("direction out of range", "degrees from 0 to 360, or list the text under variable")
    return value
