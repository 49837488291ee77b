"""Charts over time as SVG: axes with units, lines that break where data are missing."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from skyway.models.base.formatting import zone_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from datetime import tzinfo

WIDTH, BROAD, HEIGHT = 600.0, 1240.0, 240.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 12.0, 26.0, 40.0
_MAX_POINTS = 1_500
_TICKS = 6
_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10_800, 21_600, 43_200, 86_400)


def safe(value: object) -> str:
    """Return text for HTML or SVG: escaped, without the characters that neither may hold."""
    kept = "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in str(value))
    return html.escape(kept, quote=True)


@dataclass(frozen=True, slots=True)
class Course:
    """One line of a chart."""

    label: str
    style: str
    """CSS class of the line."""
    points: Sequence[tuple[float, float | None]]
    """(POSIX seconds, value); a value of None breaks the line."""
    gap_s: float = math.inf
    """Breaks the line where nothing was told for longer."""

    def pieces(self) -> list[list[tuple[float, float]]]:
        """Return the unbroken pieces."""
        found: list[list[tuple[float, float]]] = [[]]
        for at_s, value in self.points:
            if value is None or (found[-1] and at_s - found[-1][-1][0] > self.gap_s):
                if found[-1]:
                    found.append([])
                if value is None:
                    continue
            found[-1].append((at_s, value))
        return [_thinned(piece) for piece in found if piece]


@dataclass(frozen=True, slots=True)
class Band:
    """An area between two values over time, such as a sigma; as `Course`."""

    label: str
    style: str
    points: Sequence[tuple[float, float | None, float | None]]
    gap_s: float = math.inf

    def pieces(self) -> list[list[tuple[float, float]]]:
        """Return outlines."""
        low = Course("", "", [(at_s, low) for at_s, low, _ in self.points], self.gap_s).pieces()
        high = Course("", "", [(at_s, high) for at_s, _, high in self.points], self.gap_s).pieces()
        return [below + above[::-1] for below, above in zip(low, high, strict=False)]


@dataclass(slots=True)
class Chart:
    """A chart over time."""

    title: str
    unit: str
    """What is shown, and in what."""
    begin_s: float
    end_s: float
    """Range of the time axis, POSIX seconds."""
    courses: list[Course] = field(default_factory=list)
    """Lines; those first are drawn first."""
    bands: list[Band] = field(default_factory=list)
    """Areas, behind the lines."""
    level: tuple[float, str] | None = None
    """A value that matters, and its name."""
    low: float | None = None
    high: float | None = None
    """Range of the values; without them, what is drawn."""
    step: float | None = None
    """Between the lines of the grid."""
    width: float = WIDTH
    """`WIDTH`, or `BROAD` where much happens."""
    spans: Sequence[tuple[float, float]] = ()
    """(begin, end) in POSIX seconds that are shaded: the flights."""
    zone: tzinfo = UTC
    """In which the times are told."""
    turns: Sequence[tuple[float, str]] = ()
    """(POSIX seconds, words): upright marks."""

    def drawn(self) -> str:
        """Return the figure with its legend; one that reads so where nothing is known."""
        inner = self.picture()
        title = f"{safe(self.title)}, {safe(self.unit)}"
        if not inner:
            return f'<figure><figcaption>{title}</figcaption><p class="none">unknown: not in the journal</p></figure>'
        items = [f"<li>{swatch(style)}{safe(label)}</li>" for label, style in self.entries()]
        items += [f"<li>{safe(c.label)}: unknown</li>" for c in self.courses if not c.pieces()]
        return (
            f'<figure class="{"broad" if self.width > WIDTH else ""}"><figcaption>{title}</figcaption>'
            f'<div class="wide"><svg class="chart" viewBox="0 0 {self.width:g} {HEIGHT:g}" role="img" '
            f'aria-label="{safe(self.title)} over time">{inner}</svg></div>'
            f'<ul class="legend">{"".join(items)}</ul></figure>'
        )

    def picture(self) -> str:
        """Return the content of the picture; empty where nothing is known."""
        values = [v for c in self.courses for piece in c.pieces() for _, v in piece]
        values += [v for band in self.bands for piece in band.pieces() for _, v in piece]
        if not values:
            return ""
        scale = self._scale(values)
        parts = [*self._frame(scale), *self._marks(scale)]
        parts += [
            f'<path class="band {band.style}" d="{_path(piece, scale)}Z"/>'
            for band in self.bands
            for piece in band.pieces()
        ]
        parts += [
            f'<path class="line {course.style}" d="{_path(piece, scale)}"/>'
            for course in self.courses
            for piece in course.pieces()
        ]
        return "".join(parts)

    def entries(self) -> list[tuple[str, str]]:
        """Return the legend: words, and the CSS class of the mark."""
        found = [(band.label, f"band {band.style}") for band in self.bands if band.pieces()]
        found += [(course.label, f"line {course.style}") for course in self.courses if course.pieces()]
        if self.spans:
            found.append(("in flight", "span"))
        if self.turns:
            found.append(("decision in flight", "turn"))
        return found

    def _scale(self, values: Sequence[float]) -> Scale:
        level = [] if self.level is None else [self.level[0]]
        low = min(*values, *level, math.inf) if self.low is None else self.low
        high = max(*values, *level, -math.inf) if self.high is None else self.high
        step = nice_step(max(high - low, 1e-9)) if self.step is None else self.step
        if self.low is None:
            low = math.floor(low / step) * step
        if self.high is None:
            high = math.ceil(high / step + 1e-9) * step
        return Scale(self.begin_s, max(self.end_s, self.begin_s + 1.0), low, max(high, low + step), step, self.width)

    def _frame(self, s: Scale) -> list[str]:
        """Axes, grid and the figures at them."""
        parts = [
            f'<rect class="span" x="{s.x(a):.1f}" y="{_TOP:g}" width="{max(s.x(b) - s.x(a), 0.0):.1f}" '
            f'height="{HEIGHT - _TOP - _BOTTOM:g}"/>'
            for a, b in self.spans
        ]
        digits = 0 if s.step >= 1.0 else min(math.ceil(-math.log10(s.step)), 6)
        for k in range(round((s.high - s.low) / s.step) + 1):
            value = s.low + k * s.step
            y = s.y(value)
            parts.append(f'<path class="grid" d="M{_LEFT:g} {y:.1f}H{self.width - _RIGHT:g}"/>')
            parts.append(f'<text x="{_LEFT - 7:g}" y="{y + 4:.1f}" text-anchor="end">{value:.{digits}f}</text>')
        for at_s, label in time_ticks(s.begin_s, s.end_s, round(self.width / 100.0), self.zone):
            x = s.x(at_s)
            parts.append(f'<path class="grid" d="M{x:.1f} {HEIGHT - _BOTTOM:g}v5"/>')
            parts.append(f'<text x="{x:.1f}" y="{HEIGHT - _BOTTOM + 19:g}" text-anchor="middle">{label}</text>')
        name = zone_name(s.begin_s, self.zone)
        parts.append(f'<text class="axis-name" x="{_LEFT - 7:g}" y="14" text-anchor="end">{safe(self.unit)}</text>')
        parts.append(
            f'<text class="axis-name" x="{self.width - _RIGHT:g}" y="{HEIGHT - 5:g}" text-anchor="end">time, {safe(name)}</text>'
        )
        return parts

    def _marks(self, s: Scale) -> list[str]:
        parts = []
        if self.level is not None:
            y = s.y(self.level[0])
            parts.append(f'<path class="level" d="M{_LEFT:g} {y:.1f}H{self.width - _RIGHT:g}"/>')
            parts.append(f'<text class="level-name" x="{_LEFT + 5:g}" y="{y - 5:.1f}">{safe(self.level[1])}</text>')
        for at_s, words in self.turns:
            parts.append(
                f'<path class="turn" d="M{s.x(at_s):.1f} {_TOP:g}V{HEIGHT - _BOTTOM:g}"><title>{safe(words)}</title></path>'
            )
        return parts


@dataclass(frozen=True, slots=True)
class Scale:
    """From times and values to the picture."""

    begin_s: float
    end_s: float
    low: float
    high: float
    step: float
    width: float

    def x(self, at_s: float) -> float:
        """Right of the left edge."""
        share = (at_s - self.begin_s) / (self.end_s - self.begin_s)
        return _LEFT + min(max(share, 0.0), 1.0) * (self.width - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        """Below the upper edge."""
        share = (value - self.low) / (self.high - self.low)
        return HEIGHT - _BOTTOM - min(max(share, 0.0), 1.0) * (HEIGHT - _TOP - _BOTTOM)


def swatch(style: str, place: str = "") -> str:
    """Return the mark of a legend; `place` holds attributes that set it somewhere in a picture."""
    if style.startswith("line"):
        inner = f'<path class="{style}" d="M1 6h22"/>'
    elif style == "turn":
        inner = '<path class="turn" d="M12 0v12"/>'
    else:
        inner = MARKS.get(style, f'<rect class="{style}" x="1" y="1" width="22" height="10"/>')
    return f'<svg class="swatch" viewBox="0 0 24 12" {place} aria-hidden="true">{inner}</svg>'


MARKS = {
    "level-mark": '<path class="level" d="M12 0v12"/>',
    "station landed": '<g class="station landed"><circle cx="12" cy="6" r="5"/></g>',
    "station passed": '<g class="station passed"><circle cx="12" cy="6" r="5"/></g>',
    "station divert": '<g class="station divert"><circle cx="12" cy="6" r="5"/></g>',
    "station other": '<g class="station other"><circle cx="12" cy="6" r="3"/></g>',
    "turn-mark": '<path class="turn-mark" d="M12 1L17 6L12 11L7 6Z"/>',
    "turn-away": '<path class="turn-away" d="M12 0L18 11H6Z"/>',
}
"""Marks of a legend that are neither a line nor an area."""


def _path(points: Iterable[tuple[float, float]], scale: Scale) -> str:
    found = [f"{scale.x(at_s):.1f} {scale.y(value):.1f}" for at_s, value in points]
    return f"M{'L'.join(found)}" if len(found) > 1 else f"M{found[0]}h2"


def _thinned(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Keep first, lowest, highest and last of each of equal parts, so that no peak is lost."""
    if len(points) <= _MAX_POINTS:
        return points
    size = math.ceil(len(points) / (_MAX_POINTS // 4))
    kept: list[tuple[float, float]] = []
    for begin in range(0, len(points), size):
        part = points[begin : begin + size]
        chosen = {0, len(part) - 1}
        chosen |= {min(range(len(part)), key=lambda k: part[k][1]), max(range(len(part)), key=lambda k: part[k][1])}
        kept += [part[k] for k in sorted(chosen)]
    return kept


def nice_step(span: float) -> float:
    """Return a round step that divides a range into some five parts."""
    raw = span / 5.0
    power = 10.0 ** math.floor(math.log10(raw))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * 0.999)


def time_ticks(begin_s: float, end_s: float, most: int = _TICKS, zone: tzinfo = UTC) -> list[tuple[float, str]]:
    """Return instants on round times, with their names in a zone."""
    off_s = (datetime.fromtimestamp(begin_s, zone).utcoffset() or timedelta()).total_seconds()
    span = end_s - begin_s
    step = next((s for s in _STEPS_S if span / s <= most), 86_400 * math.ceil(span / 86_400 / most))
    pattern = "%H:%M:%S" if step < 60 else "%H:%M" if span < 86_400 else "%d %b %H:%M" if step < 86_400 else "%Y-%m-%d"
    first = math.ceil((begin_s + off_s) / step) * step - off_s
    instants = [first + k * step for k in range(int((end_s - first) // step) + 1)]
    return [(at_s, datetime.fromtimestamp(at_s, zone).strftime(pattern)) for at_s in instants]
