"""Heights of flight levels on a day: pressure heights as heights above mean sea level, by QNH and temperature.

A flight level is a surface of equal pressure: that of the standard atmosphere at its height. An altimeter set to QNH shows that surface higher by the same number of metres at
all heights, since QNH is reduced by the standard atmosphere too. The true height differs by the temperature: where the air is warmer than the standard by dT at all heights,

    z = A + dT / 0.0065 ln(T(s) / T(A)),  T(h) = 288.15 - 0.0065 h

where A is the height that the altimeter shows, and s the height of the place of the QNH: there an altimeter shows its own height at any temperature.

Unknown values range between their extremes, so a level is a band: QNH from 955 to 1085 hPa, air 40 degrees colder to 30 warmer than the standard. Known values may change until the flight:
QNH by 6 hPa, which is what "very rapidly" means in three hours (Met Office, "Barometric pressure tendency"), and the air between ground and level by 6 degrees.

Sources: ICAO Doc 7488, Manual of the ICAO Standard Atmosphere (1993); ICAO Doc 8168, volume I, part III, section 1, chapter 4 (temperature corrections; 4 % for 10 degrees).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.files import read_text
from skyway.models.wind.observed.metar import HPA_PER_INHG, pressures_told

if TYPE_CHECKING:
    from collections.abc import Iterator

STANDARD_HPA, STANDARD_K, LAPSE_K_PER_M = 1013.25, 288.15, 0.0065
EXPONENT = 0.190_263
SCALE_M = STANDARD_K / LAPSE_K_PER_M
POSSIBLE_HPA = 955.0, 1085.0
POSSIBLE_K = -40.0, 30.0
"""Warmer than the standard."""
CHANGE_HPA, CHANGE_K = 6.0, 6.0
READABLE_HPA = 870.0, 1090.0
"""Lowest and highest pressure at sea level on record, rounded outwards."""
HIGHEST_M = 30_000.0
"""Above this height the temperature has no further effect."""
HIGHEST_PLACE_M, PLACES = 4500.0, 30
"""No airport is higher (Daocheng Yading: 4,411 m); and the heights of places in between that are tried."""
METAR = "metar="
MAX_BYTES = 4 * 1024 * 1024
_TYPED = re.compile(r"(?:QNH|Q)?(\d{3,4}(?:\.\d+)?)(?:HPA)?|A(\d{4})|(\d{2}\.\d+)(?:INHG)?", re.IGNORECASE)
_DEGREES = re.compile(r"([+-]?\d{1,2}(?:\.\d+)?)C", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Pressure:
    """The pressure and the temperature of a day, as far as they are known."""

    qnh_hpa: tuple[float, float] = POSSIBLE_HPA
    """Least and greatest of the region."""
    temperature_c: tuple[float, float] | None = None
    """Likewise, near the ground; None: not known."""
    sure: bool = False
    """Whether the pressure was given."""

    def band_m(self, level_m: float) -> tuple[float, float]:
        """Least and greatest height above mean sea level of a pressure height."""
        change = CHANGE_HPA if self.sure else 0.0
        shown = [
            level_m + SCALE_M * ((qnh / STANDARD_HPA) ** EXPONENT - 1.0)
            for qnh in (self.qnh_hpa[0] - change, self.qnh_hpa[1] + change)
        ]
        found = [one for height in shown for one in self._true_m(height)]
        return min(found), max(found)

    def _true_m(self, shown_m: float) -> Iterator[float]:
        """Yield heights that an altimeter at QNH may show as this pressure height; the place of the QNH may be at any height up to it."""
        top_m = min(shown_m, HIGHEST_M)
        for step in range(PLACES + 1):
            place_m = min(top_m, HIGHEST_PLACE_M) * step / PLACES
            between = math.log((STANDARD_K - LAPSE_K_PER_M * place_m) / (STANDARD_K - LAPSE_K_PER_M * top_m))
            for warmer in self._warmer_k(place_m):
                yield shown_m + warmer / LAPSE_K_PER_M * between

    def _warmer_k(self, place_m: float) -> tuple[float, float]:
        if self.temperature_c is None:
            return POSSIBLE_K
        usual_c = STANDARD_K - 273.15 - LAPSE_K_PER_M * place_m
        return self.temperature_c[0] - usual_c - CHANGE_K, self.temperature_c[1] - usual_c + CHANGE_K


NOT_TOLD = Pressure()


def split_pressure(path: Path) -> tuple[Path, Pressure]:
    """File of a name, and the pressure that follows it: ``zones.txt@Q1021``, ``zones.txt@A2992,15C``, ``zones.txt@metar=FILE``.

    Raises an `InputError` if it is not a pressure.
    """
    head, mark, told = str(path).rpartition("@")
    if not mark or path.is_file() or not Path(head).is_file():
        return path, NOT_TOLD
    if told.startswith(METAR):
        return Path(head), _of_metars(Path(told.removeprefix(METAR)))
    return Path(head), _typed(told, head)


def resolved(path: Path) -> str:
    """Name of an airspace file as seen by other processes, and of the METARs that follow it."""
    return str(path.resolve()) if METAR not in str(path) else named_in(str(path), Path.cwd())


def named_in(text: str, folder: Path) -> str:
    """Name of an airspace file in a folder, and of the METARs that follow it."""
    head, mark, file = text.rpartition("@" + METAR)
    return f"{folder / head}{mark}{folder / file}" if mark else str(folder / text)


def _typed(told: str, file: str) -> Pressure:
    remedy = "write QNH as FILE@Q1013 or FILE@A2992, with the temperature as FILE@Q1013,15C, or name METARs as FILE@metar=METARS"
    first, _, second = told.partition(",")
    qnh, degrees = _TYPED.fullmatch(first.strip()), _DEGREES.fullmatch(second.strip())
    if qnh is None or (second and degrees is None):
        raise InputError("what follows its name is not a pressure", file, value=told, remedy=remedy)
    hpa = float(qnh[1]) if qnh[1] else HPA_PER_INHG * (0.01 * float(qnh[2]) if qnh[2] else float(qnh[3]))
    if not READABLE_HPA[0] <= hpa <= READABLE_HPA[1]:
        raise InputError("is impossible at sea level", file, value=told, remedy=remedy)
    warmth = None if degrees is None else (float(degrees[1]),) * 2
    return Pressure((hpa, hpa), warmth, sure=True)


def _of_metars(path: Path) -> Pressure:
    """Bounds of the values in METARs."""
    found = pressures_told(read_text(path, max_bytes=MAX_BYTES))
    qnh = [hpa for hpa, _ in found if READABLE_HPA[0] <= hpa <= READABLE_HPA[1]]
    warmth = [degrees for _, degrees in found if degrees is not None]
    if not qnh:
        raise InputError("has no QNH", str(path), remedy="METARs with a group such as Q1013 or A2992")
    return Pressure((min(qnh), max(qnh)), (min(warmth), max(warmth)) if warmth else None, sure=True)
