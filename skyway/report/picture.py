"""Map, charge and wind of a flight in one SVG, in light or dark colours as the reader prefers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.report import map as chart_of_places
from skyway.report.charts import charts
from skyway.report.page import page_template
from skyway.report.svg import BROAD, HEIGHT, safe, swatch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.report.flight_report import FlightReport
    from skyway.report.map import Zone

_SHOWN = 2
"""Charge and wind: the first of the charts."""
_ROW, _CHAR = 24.0, 7.2
_MAP_SHARE = 0.36


def picture(document: FlightReport, zones: list[Zone] | None) -> str:
    """Return the picture. Raises an `InputError` where the journal has no position."""
    drawn = chart_of_places.map_picture(document, zones)
    if drawn is None:
        raise InputError("the journal has no positions to draw", field="--plot")
    inner, map_height = drawn
    wide = BROAD * _MAP_SHARE
    tall = wide * map_height / chart_of_places.WIDTH
    figures = [chart for chart in charts(document)[:_SHOWN] if chart.picture()]
    left, scale = wide + 24.0, (BROAD - wide - 24.0) / BROAD
    y = 0.0
    parts = []
    for chart in figures:
        parts.append(f'<text class="head" x="{left:g}" y="{y + 18:g}">{safe(chart.title)}, {safe(chart.unit)}</text>')
        box = f'x="{left:g}" y="{y + 24:g}" width="{BROAD * scale:g}" height="{HEIGHT:g}"'
        parts.append(
            f'<svg {box} viewBox="0 0 {BROAD * scale:g} {HEIGHT:g}">{replace(chart, width=BROAD * scale).picture()}</svg>'
        )
        y += 24.0 + HEIGHT
        rows, y = _legend(chart.entries(), left, BROAD, y)
        parts += rows
        y += 10.0
    rows, foot = _legend(chart_of_places.map_entries(document, zones), 0.0, wide, tall + 4.0)
    height = max(y, foot)
    parts.append(
        f'<svg x="0" y="0" width="{wide:g}" height="{tall:g}" viewBox="0 0 {chart_of_places.WIDTH:g} {map_height:g}">'
        f'<rect class="span" width="100%" height="100%" rx="10"/>{inner}</svg>'
    )
    style = page_template().split("<style>")[1].split("</style>")[0].split("@media screen and")[0]  # no phone
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-16 -16 {BROAD + 32:g} {height + 32:g}">'
        f"<style>{style} .head{{font-weight:600}} .swatch{{margin:0}}</style>"
        f'<rect x="-16" y="-16" width="100%" height="100%" style="fill:var(--card)"/>{"".join([*parts, *rows])}</svg>\n'
    )


def _legend(entries: Sequence[tuple[str, str]], left: float, right: float, top: float) -> tuple[list[str], float]:
    """Return the legend in rows, and where it ends."""
    x, y = left, top
    parts = []
    for words, style in entries:
        wide = 32.0 + _CHAR * len(words) + 14.0
        if x > left and x + wide > right:
            x, y = left, y + _ROW
        parts.append(swatch(style, f'x="{x:g}" y="{y + 4:g}" width="24" height="12"'))
        parts.append(f'<text x="{x + 31:g}" y="{y + 14:g}">{safe(words)}</text>')
        x += wide
    return parts, y + _ROW
