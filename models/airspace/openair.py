"""Zones of OpenAir text files, versions 1 and 2: the airspace of pilots.

A zone begins with ``AC``. ``V X=`` and ``V D=`` stay in force until they change. Radii are in nautical miles, angles from
true north, heights in feet above the sea unless stated otherwise.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.models.airspace import areas
from skyway.models.airspace.activation import ALWAYS, Activation, Period, instant_s
from skyway.models.airspace.limits import GROUND, NO_CEILING, Limit, in_order, limit_of_text
from skyway.models.airspace.zone import KINDS, Kind, Volume, Zone
from skyway.models.base import geodesy
from skyway.models.base.errors import one_line

if TYPE_CHECKING:
    from skyway.models.airspace.areas import Place
    from skyway.models.airspace.notes import Notes

M_PER_NM = 1852.0
MAX_DECIMALS = 12
CLASSES: dict[str, Kind] = {
    "P": "prohibited",
    **dict.fromkeys(("R", "Q", "D-AREA", "DANGER", "TRA", "TSA", "TFR"), "authorization"),
    **dict.fromkeys(("A", "B", "C", "D", "CTR", "TMA", "CTA", "ATZ", "MATZ", "TIZ", "MTR", "NOTAM"), "authorization"),
    **dict.fromkeys(("RMZ", "TMZ", "TIA", "MTA"), "conditional"),
    **dict.fromkeys(("E", "F", "G", "W", "UNC", "UNCLASSIFIED", "FIR", "UIR", "OFR", "FIS", "VFRSEC", "ASR", "GSEC"), "information"),
    **dict.fromkeys(("ADIZ", "ALERT", "WARNING", "PROTECTED", "HTZ", "VFRR", "TRP", "TFZ", "LTA", "UTA"), "conditional"),
}  # fmt: skip
"""Kind of zone by class (``AC``) or type (``AY``). Restricted and danger areas, and controlled airspace, are entered with
the consent of the operator or controller in charge."""
_IGNORED = frozenset(("AF", "AG", "AX", "AR", "AT", "SP", "SB", "TO", "TC", "AM", "AS"))
_RECORD = re.compile(r"(A[A-Z]|D[A-Z]|S[A-Z]|T[A-Z]|V)(?:\s+(.*))?$", re.IGNORECASE)
_COORDINATE = re.compile(r"\s*([0-9][0-9:.\s]*?)\s*([NSEW])\s*,?", re.IGNORECASE)
_ALONE = re.compile(r"^\s*(AC|AN|DP)\s", re.IGNORECASE | re.MULTILINE)


def is_openair(text: str) -> bool:
    """Whether a text has records of OpenAir."""
    return {found.upper() for found in _ALONE.findall(text)} >= {"AC"}


@dataclass
class _Draft:
    """A zone while its records are read."""

    line: int
    word: str
    kind: Kind | None = None
    name: str = ""
    identity: str = ""
    floor: Limit | None = None
    ceiling: Limit | None = None
    ring: list[Place] = field(default_factory=list)
    circles: list[tuple[float, float, float]] = field(default_factory=list)
    periods: list[Period] = field(default_factory=list)
    broken: bool = False


class Reader:
    """Reads the records of one text in turn."""

    def __init__(self, notes: Notes, source: str) -> None:
        self.notes, self.source = notes, source
        self.centre: Place | None = None
        self.clockwise = True
        self.draft: _Draft | None = None
        self.zones: list[Zone] = []

    def read(self, text: str) -> list[Zone]:
        """Return the zones; parts that are not understood are noted."""
        for number, line in enumerate(text.splitlines(), 1):
            plain = line.split("*", 1)[0].strip()
            if not plain:
                continue
            record = _RECORD.match(plain)
            self.notes.at(self.draft.name if self.draft and self.draft.name else "", number)
            if record is None:
                self._unknown(plain)
            else:
                self._take(record.group(1).upper(), (record.group(2) or "").strip(), number)
        self._finish()
        return self.zones

    def _unknown(self, text: str) -> None:
        self.notes.closed("record", "is not known", text, "only the rest of the zone counts")

    def _take(self, word: str, value: str, number: int) -> None:
        if word == "AC":
            self._finish()
            self.notes.at(value, number)
            self.draft = _Draft(number, value.upper())
            self._class(value)
            return
        if word == "V":
            self._variable(value)
            return
        draft = self.draft
        if word in _IGNORED:
            return
        if draft is None:
            self._unknown(f"{word} {value}")
        elif word == "AN":
            draft.name = one_line(value).strip()
        elif word == "AI":
            draft.identity = one_line(value).strip()
        elif word == "AY":
            self._class(value)
        elif word == "AL":
            draft.floor = limit_of_text(value, self.notes, ceiling=False)
        elif word == "AH":
            draft.ceiling = limit_of_text(value, self.notes, ceiling=True)
        elif word == "AA":
            self._activation(value)
        elif word in ("DP", "DA", "DB", "DC", "DY"):
            self._draw(word, value)
        else:
            self._unknown(f"{word} {value}")

    def _class(self, word: str) -> None:
        """Take the stricter of class and type."""
        draft = self.draft
        if draft is None or word.strip().upper() in ("", "UNKNOWN"):
            kind: Kind | None = None if draft and draft.kind else "prohibited"
        else:
            kind = CLASSES.get(word.strip().upper())
        if kind is None and draft is not None and draft.kind is not None and not word.strip():
            return
        if kind is None or not word.strip():
            self.notes.closed("class", "is not known", word, "counted as prohibited")
            kind = "prohibited"
        if draft is not None:
            draft.kind = kind if draft.kind is None else min(draft.kind, kind, key=KINDS.index)

    def _variable(self, value: str) -> None:
        name, _, text = (part.strip() for part in value.partition("="))
        if name.upper() == "X":
            found = self._places(text)
            self.centre = found[0] if len(found) == 1 else None
            if self.centre is None:
                self._break("V X", "is not a position", value)
        elif name.upper() == "D" and text in ("+", "-"):
            self.clockwise = text == "+"
        elif name.upper() == "D":
            self._break("V D", "is not a direction", value)
        elif name.upper() not in ("Z", "W", "T"):
            self._unknown(f"V {value}")

    def _activation(self, value: str) -> None:
        draft = self.draft
        if draft is None:
            return
        begin, slash, end = (part.strip() for part in value.partition("/"))
        times = [
            missing if text.upper() in ("NONE", "") else instant_s(text)
            for text, missing in ((begin, -math.inf), (end, math.inf))
        ]
        if not slash or times[0] is None or times[1] is None or times[0] > times[1]:
            self.notes.closed("AA", "is not a time", value, "counted as always active")
            draft.periods.append(Period())
        else:
            draft.periods.append(Period(times[0], times[1]))

    def _draw(self, word: str, value: str) -> None:
        draft = self.draft
        if draft is None:
            return
        if word == "DP":
            found = self._places(value)
            if len(found) != 1:
                self._break(word, "is not a position", value)
            draft.ring += found[:1]
        elif word == "DY":
            self._break(word, "airways are not read", value)
        elif self.centre is None:
            self._break(word, "has no centre", value)
        elif word == "DC":
            radius = _numbers(value)
            if len(radius) != 1:
                self._break(word, "is not a radius", value)
            else:
                draft.circles.append((*self.centre, radius[0] * M_PER_NM))
        else:
            draft.ring += self._arc(word, value, self.centre)

    def _arc(self, word: str, value: str, centre: Place) -> list[Place]:
        """Return the places of an arc: by radius and angles (DA), or by its two ends (DB), both included."""
        lon, lat = centre
        if word == "DA":
            numbers = _numbers(value)
            if len(numbers) != 3 or not 0.0 < numbers[0] * M_PER_NM <= areas.MAX_RADIUS_M:
                self._break(word, "is not an arc", value)
                return []
            return areas.arc(lon, lat, numbers[0] * M_PER_NM, *numbers[1:], clockwise=self.clockwise)
        ends = self._places(value)
        if len(ends) != 2:
            self._break(word, "is not an arc", value)
            return []
        bearings = [geodesy.bearing_deg(lat, lon, y, x) for x, y in ends]
        radius = [geodesy.distance_m(lat, lon, y, x) for x, y in ends]
        mean_m = sum(radius) / 2.0
        if not 0.0 < mean_m <= areas.MAX_RADIUS_M:
            self._break(word, "is not an arc", value)
            return []
        inner = areas.arc(lon, lat, mean_m, *bearings, clockwise=self.clockwise)[1:-1]
        return [ends[0], *inner, ends[1]]

    def _places(self, text: str) -> list[Place]:
        """Read positions, latitude first; an empty list if one is not a position."""
        parts = _COORDINATE.findall(text)
        if not parts or len(parts) % 2 or _COORDINATE.sub("", text).strip(" ,"):
            return []
        found = []
        for (lat, ns), (lon, ew) in zip(parts[::2], parts[1::2], strict=True):
            if ns.upper() not in "NS" or ew.upper() not in "EW":
                return []
            y, x = self._degrees(lat, 2), self._degrees(lon, 3)
            if y is None or x is None or y > 90.0 or x > 180.0:
                return []
            found.append((-x if ew.upper() == "W" else x, -y if ns.upper() == "S" else y))
        return found

    def _degrees(self, text: str, digits: int) -> float | None:
        """Read degrees, minutes, seconds, any of them the last and with decimals; colons, or two digits each."""
        parts = [part for part in re.split(r"[:\s]+", text.strip()) if part]
        whole, dot, decimals = parts[0].partition(".") if len(parts) == 1 else ("", "", "")
        if len(parts) == 1 and len(whole) > digits:
            whole = whole.zfill(digits + (2 if len(whole) <= digits + 2 else 4))
            parts = [whole[:-4], whole[-4:-2], whole[-2:]] if len(whole) == digits + 4 else [whole[:-2], whole[-2:]]
            parts[-1] += dot + decimals
        try:
            values = [float(part) for part in parts]
        except ValueError:
            return None
        if not 1 <= len(values) <= 3 or max(map(len, parts)) > digits + MAX_DECIMALS:
            return None
        if any(value >= 60.0 for value in values[1:]):
            self.notes.closed("coordinate", "has 60 or more minutes or seconds", text, "carried over to the degrees")
        return sum(value / 60.0**place for place, value in enumerate(values))

    def _break(self, what: str, problem: str, value: str) -> None:
        """Note that the outline is not understood: the zone becomes the convex hull of the remaining places."""
        if self.draft is not None:
            self.draft.broken = True
        self.notes.closed(what, problem, value, "counted as the convex hull of the rest of its outline")

    def _finish(self) -> None:
        draft, self.draft = self.draft, None
        if draft is None:
            return
        self.notes.at(draft.name or draft.word, draft.line)
        parts = [areas.circle(lon, lat, radius, self.notes) for lon, lat, radius in draft.circles]
        if draft.ring or not parts:
            ring = areas.polygon([draft.ring], self.notes)
            parts.append(ring)
        if any(part is None for part in parts):
            return
        area = areas.joined([part for part in parts if part is not None])
        area = area.convex_hull if draft.broken else area
        for what, limit, count in (("AL", draft.floor, GROUND), ("AH", draft.ceiling, NO_CEILING)):
            if limit is None:
                self.notes.closed(what, "is missing", None, f"counted as {count}")
        volume = Volume(area, *in_order(draft.floor or GROUND, draft.ceiling or NO_CEILING, self.notes))
        name = draft.name or f"zone on line {draft.line}"
        when = Activation(tuple(draft.periods)) if draft.periods else ALWAYS
        kind = draft.kind or "prohibited"
        self.zones.append(Zone(draft.identity or name, name, kind, (volume,), when, self.source))


def _numbers(text: str) -> list[float]:
    """Read numbers separated by commas or blanks; an empty list if one is not a number."""
    try:
        found = [float(part) for part in re.split(r"[,\s]+", text.strip()) if part]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []
