"""METAR and SPECI reports of airports: station, time and wind.

Of a report everything before ``RMK`` is read up to the wind group, and also, by `pressures_told`, temperature and QNH: the rest (visibility, weather, trends with
winds of their own) differs by country. Winds are means over 2 or 10 minutes at 10 m, in knots, m/s or km/h, degrees FROM true north.

Source: WMO-No. 306, Manual on Codes, volume I.1, FM 15 (METAR) and FM 16 (SPECI), sections 15.2 to 15.5; Federal Meteorological
Handbook No. 1 (2019), chapter 12.
"""

from __future__ import annotations

import calendar
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from skyway.models.base.units import SPEED_UNITS_MPS, from_posix

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.models.base.table import FaultCollector

UNITS = {"KT": "kn", "KTS": "kn", "MPS": "m/s", "KMH": "km/h"}
START = re.compile(r"(?<![A-Z0-9/])([A-Z][A-Z0-9]{3}) +(\d{2})(\d{2})(\d{2})Z(?![A-Z0-9])")
WIND = re.compile(r"(\d{3}|VRB|///)P?(\d{2,3}|//)(?:GP?(\d{2,3}|//))?(KTS?|MPS|KMH)(?:/{2})?")
NEARLY = re.compile(r"\d(KTS?|MPS|KMH|MPH)$")
BEFORE_WIND = re.compile(r"AUTO|COR|CC[A-Z]|RTD|NIL|AMD")
DATE = re.compile(r"\d{4}/\d{2}/\d{2} \d{2}:\d{2}")
"""First line of a file of the NWS server: the date of the report below."""
MAX_REPORT = 5_000
"""Characters of one report: a longer text is not a report."""
PERIOD = re.compile(r"\d{4}/\d{4}")
"""The period of a TAF."""
QNH = re.compile(r"(?: (M?\d{2})/(?:M?\d{2}|//)?)?(?: +(?:Q(\d{4})|A(\d{4})))(?=[ =]|$)")
"""Temperature and pressure, the last groups of every report before trends and remarks (sections 15.11 and 15.12)."""
HPA_PER_INHG = 33.863_886


@dataclass(frozen=True, slots=True)
class MetarWind:
    """Wind of one report."""

    station: str
    """Its identifier, four letters or digits."""
    time_s: float
    """POSIX seconds of the observation."""
    speed_mps: float | None
    """Mean; None if it is missing."""
    from_deg: float | None
    """None if it is variable or missing, and in a calm."""
    gust_mps: float | None
    corrected: bool
    line: int
    """Position of its begin in the text."""
    group: str = ""
    """The wind as it was reported."""


def parse_metars(text: str, near_s: float, faults: FaultCollector) -> list[MetarWind]:
    """Read the reports in a text, one a line; a long one may continue in indented lines, and end with ``=``.

    A report contains only day, hour and minute: the month is that in which it is nearest to `near_s`, POSIX seconds, or to the date in
    a line of its own before it. A line that is not a report is a fault.
    """
    found = []
    for number, line, near in _lines(text, near_s, faults):
        begins = list(START.finditer(line))
        if not begins or line[: begins[0].start()].strip() not in ("", "METAR", "SPECI", "METAR COR", "SPECI COR"):
            taf = line.startswith("TAF")
            problem = "is a TAF, a forecast" if taf else "is not a METAR"
            faults.add(problem, "one report a line, such as KJFK 101851Z 22010KT", line=number, value=line)
            continue
        for one, after in zip(begins, [*begins[1:], None], strict=True):
            body = line[one.end() : None if after is None else after.start()]
            report = _report(one, body, number, near, faults, corrected="COR" in line[: one.start()].split())
            found += [] if report is None else [report]
    return found


def _lines(text: str, near_s: float, faults: FaultCollector) -> Iterator[tuple[int, str, float]]:
    """Yield (line number, report, POSIX seconds that it is near to), continued lines joined."""
    pending, first, near = "", 0, near_s
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip().upper()
        if pending and raw[:1].isspace() and not START.search(line):
            if len(pending) > MAX_REPORT:
                faults.add("the report is too long", f"{MAX_REPORT:,} characters at most", line=first)
                return
            pending += " " + line
            continue
        if pending:
            yield first, pending, near
            pending, near = "", near_s if not DATE.fullmatch(line) else near
        if DATE.fullmatch(line):
            try:
                near = datetime.strptime(line, "%Y/%m/%d %H:%M").replace(tzinfo=UTC).timestamp()
            except ValueError:
                faults.add("not a date", "such as 2023/10/17 05:51", line=number, value=line)
        elif line and not line.startswith("#"):
            pending, first = line, number
    if pending:
        yield first, pending, near


def _report(
    start: re.Match[str], body: str, line: int, near_s: float, faults: FaultCollector, *, corrected: bool
) -> MetarWind | None:
    station, day, hour, minute = start.groups()
    time_s = nearest_s(int(day), int(hour), int(minute), near_s)
    if time_s is None:
        faults.add("no such day and time", "day, hour and minute UTC, such as 101851Z", line=line, value=start[0])
        return None
    wind = group = None
    for group in body.split("RMK", maxsplit=1)[0].replace("=", " ").split():
        corrected = corrected or group == "COR" or group.startswith("CC")
        if PERIOD.fullmatch(group):
            faults.add("is a TAF, a forecast", "METAR or SPECI reports only", line=line, value=start[0] + body)
            return None
        wind = WIND.fullmatch(group)
        if wind is not None or not BEFORE_WIND.fullmatch(group):
            break
    if wind is None and group is not None and NEARLY.search(group):
        faults.add("not a wind group", "such as 22010G18KT, VRB03KT or 00000KT", line=line, value=group)
        return None
    if wind is None:
        return MetarWind(station, time_s, None, None, None, corrected, line)
    unit = SPEED_UNITS_MPS[UNITS[wind[4]]]
    degrees = float(wind[1]) if wind[1].isdigit() else None
    if degrees is not None and degrees > 360.0:
        faults.add("not a direction", "degrees from 000 to 360, or VRB", line=line, value=wind[0])
        return None
    speed = unit * float(wind[2]) if wind[2].isdigit() else None
    gust = unit * float(wind[3]) if wind[3] and wind[3].isdigit() else None
    unknown = speed is not None and speed > 0.0 and wind[1] == "///"
    calm = speed == 0.0
    return MetarWind(
        station,
        time_s,
        None if unknown else speed,
        None if calm or unknown else degrees,
        gust,
        corrected,
        line,
        wind[0],
    )


def nearest_s(day: int, hour: int, minute: int, near_s: float) -> float | None:
    """POSIX seconds of a day of the month, hour and minute UTC, in the month in which it is nearest; None if there is none.

    24:00 is the end of the day.
    """
    if not (1 <= day <= 31 and 0 <= hour <= 24 and 0 <= minute <= 59) or (hour == 24 and minute):
        return None
    near = from_posix(near_s)
    found = []
    for months in (-2, -1, 0, 1, 2):
        year, month = divmod(near.year * 12 + near.month - 1 + months, 12)
        if day <= calendar.monthrange(year, month + 1)[1]:
            found.append(
                (datetime(year, month + 1, day, tzinfo=UTC) + timedelta(hours=hour, minutes=minute)).timestamp()
            )
    return min(found, key=lambda one: abs(one - near_s))


def pressures_told(text: str) -> list[tuple[float, float | None]]:
    """QNH, hPa, and temperature, degrees Celsius, of the reports in a text that contain them; None for a missing temperature."""
    found = []
    for report in re.split(START, " ".join(text.upper().split()))[5::5]:
        told = QNH.search(report.split(" RMK", maxsplit=1)[0])
        if told is not None:
            hpa = float(told[2]) if told[2] else 0.01 * HPA_PER_INHG * float(told[3])
            found.append((hpa, None if told[1] is None else float(told[1].replace("M", "-"))))
    return found
