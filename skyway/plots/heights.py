"""Picture of heights over a terrain model: ground, highest in the corridor, flight path, and its least clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import height_text
from skyway.models.composition.heights import least_at_m
from skyway.plots.pictures import CALM, INK, MUTED, MUTED_INK, ROUTE, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.models.composition.heights import LegHeights

GROUND = "#c9b79c"
HEIGHTS_IN = 2.4
"""Of the picture of all legs, one after the other."""


def plot_heights(legs: Sequence[LegHeights | None], path: Path, *, title: str = "") -> None:
    """Draw the heights of some legs into a file; an `InputError` where none is known."""
    if all(one is None for one in legs):
        raise InputError("no heights to draw: the ground below all flights is unknown", str(path))
    figure = new_figure(9, HEIGHTS_IN + 0.6)
    draw_heights(figure.add_subplot(), legs)
    figure.suptitle(title, fontsize=9)
    save_figure(figure, path)


def draw_heights(axes: Any, legs: Sequence[LegHeights | None], names: Sequence[str] = ()) -> None:
    """Draw legs one after the other: distance along, kilometres, and height above mean sea level.

    The names are those of the places where legs begin and end.
    """
    begin_km, known = 0.0, [one for one in legs if one is not None]
    low = min(min(one.ground_m) for one in known)
    high = max(max(*one.path_height_m, *one.top_m) for one in known)
    space = max(high - low, 30.0)
    floor = low - 0.08 * space
    labels = "ground", "highest in the corridor"
    for number, one in enumerate(known):
        along = [begin_km + at / 1000.0 for at in one.along_m]
        first = number == 0
        axes.fill_between(
            along, one.top_m, floor, color=MUTED, alpha=0.45, linewidth=0, label=labels[1] if first else None
        )
        axes.fill_between(along, one.ground_m, floor, color=GROUND, linewidth=0, label=labels[0] if first else None)
        way = [begin_km + at / 1000.0 for at in one.path_along_m]
        ends = [one.ground_m[0], *one.path_height_m, one.ground_m[-1]]
        axes.plot([way[0], *way, way[-1]], ends, color=ROUTE, linewidth=1.6, label="way flown" if first else None)
        for tower in one.obstacles:
            at, foot = begin_km + tower.along_m / 1000.0, least_at_m(one.along_m, one.ground_m, tower.along_m)
            axes.plot([at, at], [foot, tower.top_m], color=MUTED_INK, linewidth=1.4)
            axes.annotate(tower.name[:24], (at, tower.top_m), textcoords="offset points", xytext=(0, 2), fontsize=6, color=MUTED_INK, ha="center")  # fmt: skip
        at_km = begin_km + one.least_along_m / 1000.0
        flown = least_at_m(one.path_along_m, one.path_height_m, one.least_along_m)
        mark = "least clearance" if first else None
        axes.plot([at_km, at_km], [flown - one.least_m, flown], color=INK, linewidth=1.2, marker="_", label=mark)
        axes.annotate(height_text(one.least_m), (at_km, flown - 0.5 * one.least_m), textcoords="offset points", xytext=(4, -3), fontsize=7, color=INK)  # fmt: skip
        if number < len(names):
            axes.annotate(names[number], (begin_km, floor), textcoords="offset points", xytext=(2, 3), fontsize=7, color=MUTED_INK)  # fmt: skip
        begin_km = along[-1]
        if number < len(known) - 1:
            axes.axvline(begin_km, color=CALM, linewidth=0.6, linestyle=":")
    if len(names) > len(known):
        axes.annotate(names[len(known)], (begin_km, floor), textcoords="offset points", xytext=(-2, 3), fontsize=7, color=MUTED_INK, ha="right")  # fmt: skip
    axes.set_xlim(0.0, begin_km)
    axes.set_ylim(floor, high + 0.35 * space)
    axes.set_xlabel("way, km", fontsize=8)
    axes.set_ylabel("above sea level, m", fontsize=8)
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=7, ncols=4, loc="upper right", frameon=True, edgecolor="none", framealpha=0.8)
    plain_axes(axes)
