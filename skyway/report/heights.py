"""Heights in a flight report: ground, highest in the corridor, and the planned flight path over them, as SVG."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.base.fields import finite
from skyway.models.base.formatting import height_text
from skyway.models.composition.heights import least_at_m
from skyway.models.composition.schema import LegHeights
from skyway.report.svg import BROAD, HEIGHT, nice_step, safe, swatch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.report.flight_report import FlightReport

_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 12.0, 26.0, 40.0
MOST = 5_000
"""Points of a leg that are drawn."""


def planned_heights(leg: dict[str, Any]) -> LegHeights | None:
    """Read the heights of a leg of a plan; None where they are missing or damaged."""
    given = leg.get("heights")
    if not isinstance(given, dict):
        return None
    columns: dict[str, Any] = {
        name: _numbers(given.get(name)) for name in ("along_m", "ground_m", "top_m", "path_along_m", "path_height_m")
    }
    least, at = finite(given.get("least_m")), finite(given.get("least_along_m"))
    counts = [len(column) for column in columns.values()]
    if least is None or at is None or not counts[0] == counts[1] == counts[2] > 1 or not counts[3] == counts[4] > 0:
        return None
    return LegHeights(**columns, least_m=least, least_along_m=at)


def _numbers(values: Any) -> list[float]:
    """A list of numbers; empty where one is none."""
    found = [finite(one) for one in values[:MOST]] if isinstance(values, list) else []
    return [one for one in found if one is not None] if None not in found else []


def drawn_heights(document: FlightReport) -> str:
    """Return the figure of the planned heights over the terrain; empty where no plan has any."""
    legs = [leg.heights for leg in document.planned.legs if leg.heights is not None]
    if not legs:
        return ""
    ends = [0.0]
    for leg in legs:
        ends.append(ends[-1] + max(leg.along_m[-1], 1.0))
    values = [value for leg in legs for column in (leg.ground_m, leg.top_m, leg.path_height_m) for value in column]
    step = nice_step(max(max(values) - min(values), 20.0))
    low, high = math.floor(min(values) / step) * step, math.ceil(max(values) / step) * step
    high = max(high, low + step)

    def x(along_m: float) -> float:
        return _LEFT + along_m / ends[-1] * (BROAD - _LEFT - _RIGHT)

    def y(height_m: float) -> float:
        return HEIGHT - _BOTTOM - (height_m - low) / (high - low) * (HEIGHT - _TOP - _BOTTOM)

    def line(along: Sequence[float], heights: Sequence[float], begin: float) -> str:
        return "L".join(f"{x(begin + at):.1f} {y(height):.1f}" for at, height in zip(along, heights, strict=True))

    parts = []
    for k in range(round((high - low) / step) + 1):
        value = low + k * step
        parts.append(f'<path class="grid" d="M{_LEFT:g} {y(value):.1f}H{BROAD - _RIGHT:g}"/>')
        parts.append(f'<text x="{_LEFT - 7:g}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
    for begin, leg in zip(ends, legs, strict=False):
        close = f"L{x(begin + leg.along_m[-1]):.1f} {y(low):.1f}L{x(begin):.1f} {y(low):.1f}Z"
        parts.append(f'<path class="band planned" d="M{line(leg.along_m, leg.top_m, begin)}{close}"/>')
        parts.append(f'<path class="ground" d="M{line(leg.along_m, leg.ground_m, begin)}{close}"/>')
        way = [(leg.path_along_m[0], leg.ground_m[0]), *zip(leg.path_along_m, leg.path_height_m, strict=True), (leg.path_along_m[-1], leg.ground_m[-1])]  # fmt: skip
        parts.append(
            f'<path class="line actual" d="M{line([at for at, _ in way], [height for _, height in way], begin)}"/>'
        )
        at, flown = begin + leg.least_along_m, least_at_m(leg.path_along_m, leg.path_height_m, leg.least_along_m)
        parts.append(f'<path class="level" d="M{x(at):.1f} {y(flown):.1f}V{y(flown - leg.least_m):.1f}"/>')
        parts.append(
            f'<text class="level-name" x="{x(at) + 4:.1f}" y="{y(flown - 0.5 * leg.least_m) + 4:.1f}">{height_text(leg.least_m)}</text>'
        )
    tick = nice_step(ends[-1] / 1000.0)
    marks = [k * tick for k in range(int(ends[-1] / 1000.0 / tick) + 1)]
    foot = f'y="{HEIGHT - _BOTTOM + 19:g}" text-anchor="middle"'
    parts += [f'<text x="{x(1000.0 * mark):.1f}" {foot}>{mark:g}</text>' for mark in marks]
    parts.append(f'<text class="axis-name" x="{BROAD - _RIGHT:g}" y="{HEIGHT - 5:g}" text-anchor="end">way, km</text>')
    entries = (("planned way", "line actual"), ("ground", "ground"), ("highest ground or obstacle in the corridor", "band planned"), ("least clearance", "level-mark"))  # fmt: skip
    legend = "".join(f"<li>{swatch(style)}{safe(label)}</li>" for label, style in entries)
    return (
        '<figure class="broad"><figcaption>Planned height above sea level, m</figcaption>'
        f'<div class="wide"><svg class="chart" viewBox="0 0 {BROAD:g} {HEIGHT:g}" role="img" '
        f'aria-label="Planned heights over the terrain">{"".join(parts)}</svg></div><ul class="legend">{legend}</ul></figure>'
    )
