"""Vertical limits of zones: heights with their datum, as numbers or in pilots' notation."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skyway.models.airspace.pressure import NOT_TOLD, Pressure
from skyway.models.base.formatting import height_text

if TYPE_CHECKING:
    from skyway.models.airspace.notes import Notes

Datum = Literal["AGL", "AMSL", "FL", "WGS84"]
"""Above the ground, above mean sea level, pressure height (1013.25 hPa), above the ellipsoid."""

M_PER_FT = 0.3048
UNLIMITED = 99_999.0
"""Feet or metres at and above which a published ceiling means no ceiling."""
GEOID_M = (-107.0, 86.0)
"""Least and greatest height of the geoid (EGM2008) above the ellipsoid."""
_DATUMS: dict[str, Datum] = {
    "AGL": "AGL", "GND": "AGL", "SFC": "AGL", "ASFC": "AGL", "HEI": "AGL", "AAL": "AGL",
    "AMSL": "AMSL", "MSL": "AMSL", "ASL": "AMSL", "ALT": "AMSL", "QNH": "AMSL",
    "FL": "FL", "STD": "FL", "WGS84": "WGS84", "W84": "WGS84",
}  # fmt: skip
_UNIT_M = {"M": 1.0, "MT": 1.0, "METER": 1.0, "METRE": 1.0, "METERS": 1.0, "METRES": 1.0}
_UNIT_M |= dict.fromkeys(("FT", "F", "FEET", "FOOT"), M_PER_FT)
_NONE = {"UNL", "UNLIM", "UNLIMITED", "UNLTD", "NONE", ""}
_NUMBER = re.compile(r"[+-]?\d+(?:[.,]\d+)?")
_WORD = re.compile(r"WGS-?84|W84|[A-Z]+")


@dataclass(frozen=True, slots=True)
class Limit:
    """A floor or a ceiling."""

    value_m: float
    """Infinite where there is none."""
    datum: Datum = "AMSL"
    pressure: Pressure = NOT_TOLD
    """Pressure and temperature of the day, which determine the heights of flight levels."""

    def __str__(self) -> str:
        if math.isinf(self.value_m):
            return "unlimited" if self.value_m > 0 else "ground"
        if self.datum == "AGL" and self.value_m <= 0.0:
            return "ground"
        if self.datum == "FL":
            low, high = (height_text(one) for one in self._band_m())
            return f"FL{round(self.value_m / M_PER_FT / 100.0)} ({low} to {high} AMSL)"
        return f"{height_text(self.value_m)} {self.datum}"

    def lowest(self) -> tuple[float, bool]:
        """Least height that it may mean, metres, and whether it is above the ground; otherwise above the sea."""
        return self._band_m()[0], self.datum == "AGL"

    def highest(self) -> tuple[float, bool]:
        """Greatest height that it may mean, likewise."""
        return self._band_m()[1], self.datum == "AGL"

    def _band_m(self) -> tuple[float, float]:
        """Least and greatest height that it may mean, over the sea or the ground."""
        if self.datum == "FL" and math.isfinite(self.value_m):
            return self.pressure.band_m(self.value_m)
        low, high = GEOID_M if self.datum == "WGS84" else (0.0, 0.0)
        return self.value_m - high, self.value_m - low


GROUND = Limit(-math.inf, "AGL")
NO_CEILING = Limit(math.inf)


def limit_of_number(value: object, unit: object, datum: object, notes: Notes, *, ceiling: bool) -> Limit:
    """Read a limit given by number, unit and reference.

    A missing or unknown limit counts as the ground, or as unlimited above. Unknown ones are noted.
    """
    none = NO_CEILING if ceiling else GROUND
    what = "ceiling" if ceiling else "floor"
    if value is None or (isinstance(value, str) and value.strip().upper() in _NONE | {"GND", "SFC"}):
        return none
    if isinstance(value, str):
        numeric = _NUMBER.fullmatch(value.strip())
        if numeric is None:
            return limit_of_text(value, notes, ceiling=ceiling)
        value = float(value.replace(",", "."))
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        notes.closed(what, "is not a height", value, f"counted as {none}")
        return none
    if ceiling and value >= UNLIMITED:
        return NO_CEILING
    metres = _UNIT_M.get(str(unit or "M").strip().upper())
    known = _DATUMS.get(str(datum or "").strip().upper().replace("-", ""))
    if str(unit).strip().upper() == "FL":
        metres, known = M_PER_FT * 100.0, "FL"
    elif known == "FL" and str(datum).strip().upper() == "FL":
        metres = M_PER_FT * 100.0
    if not ceiling and value == 0 and known is None:
        return GROUND
    if metres is None or known is None:
        notes.closed(
            what, "has no known unit or reference", f"{value} {unit or ''} {datum or ''}", f"counted as {none}"
        )
        return none
    return Limit(float(value) * metres, known)


def limit_of_text(text: str, notes: Notes, *, ceiling: bool) -> Limit:
    """Read a limit as pilots write it: ``FL65``, ``2500ft AMSL``, ``100m GND``, ``SFC``, ``UNL``.

    Without a unit it is in feet, without a reference above the sea. An unknown form counts as no limit, and is noted.
    """
    none = NO_CEILING if ceiling else GROUND
    upper = text.strip().upper()
    numbers, words = _NUMBER.findall(upper), _WORD.findall(_NUMBER.sub(" ", upper.replace("WGS84", "W84")))
    if "W84" in upper:
        numbers = _NUMBER.findall(upper.replace("WGS84", "").replace("W84", ""))
        words = [word for word in words if word not in ("W", "WGS")] + ["W84"]
    if set(words) & (_NONE - {""}) and not numbers:
        return NO_CEILING if ceiling else _refused(text, notes, none, ceiling=ceiling)
    if words and not numbers and set(words) <= {"GND", "SFC", "ASFC", "AGL"}:
        return GROUND if not ceiling else Limit(0.0, "AGL")
    units = [word for word in words if word in _UNIT_M]
    datums = [word for word in words if word in _DATUMS]
    if len(numbers) != 1 or len(units) > 1 or len(units) + len(datums) != len(words):
        return _refused(text, notes, none, ceiling=ceiling)
    value = float(numbers[0].replace(",", "."))
    if ceiling and value >= UNLIMITED:
        return NO_CEILING
    if "FL" in datums:
        return Limit(value * 100.0 * M_PER_FT, "FL") if not units else _refused(text, notes, none, ceiling=ceiling)
    datum = _DATUMS[datums[0]] if datums else "AMSL"
    if len({_DATUMS[word] for word in datums}) > 1:
        return _refused(text, notes, none, ceiling=ceiling)
    if not ceiling and value == 0.0 and not datums:
        return GROUND
    return Limit(value * (_UNIT_M[units[0]] if units else M_PER_FT), datum)


def _refused(text: str, notes: Notes, none: Limit, *, ceiling: bool) -> Limit:
    notes.closed("ceiling" if ceiling else "floor", "is not a height", text, f"counted as {none}")
    return none


def in_order(floor: Limit, ceiling: Limit, notes: Notes) -> tuple[Limit, Limit]:
    """Return floor and ceiling; where the ceiling is below the floor both are ignored, with a note."""
    if ceiling.datum == floor.datum and ceiling.value_m < floor.value_m:
        notes.closed("ceiling", "lies below the floor", f"{floor} to {ceiling}", "counted as ground to unlimited")
        return GROUND, NO_CEILING
    return floor, ceiling
