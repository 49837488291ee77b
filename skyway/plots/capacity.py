"""Picture of the capacity of a network: shares of orders delivered as promised by rate, and the gain of each addition."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.base.formatting import duration
from skyway.plots.pictures import CALM, INK, MUTED, MUTED_INK, ROUTE, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.planner.capacity.study import CapacityFound

COLOURS = (INK, CALM, ROUTE, MUTED_INK)
STYLES = ("-", "--", ":", "-.")
SHOWN = 15
"""Changes that are drawn."""


def plot_capacity(found: CapacityFound, path: Path) -> None:
    """Draw the answer of a study into a file."""
    both = bool(found.effects)
    figure = new_figure(11.0 if both else 6.0, 4.6)
    axes = figure.subplots(1, 2 if both else 1, squeeze=False)[0]
    _rates(axes[0], found)
    if both:
        _effects(axes[1], found)
    save_figure(figure, path)


def _rates(axes: Any, found: CapacityFound) -> None:
    promises = sorted({one.promise_s for one in found.capacities})
    fleets = sorted({one.drones for one in found.capacities})
    for capacity in found.capacities:
        own = [
            one for one in found.cases if (one.case.promise_s, one.case.drones) == (capacity.promise_s, capacity.drones)
        ]
        rates = [one.case.rate_per_h for one in own]
        colour = COLOURS[fleets.index(capacity.drones) % len(COLOURS)]
        style = STYLES[promises.index(capacity.promise_s) % len(STYLES)]
        label = f"{capacity.drones} drones, {duration(capacity.promise_s)}"
        shares = [100.0 * one.served for one in own]
        ends = [one.served_between for one in own]
        bars = [
            [0.0 if math.isnan(low) else share - 100.0 * low for share, (low, _) in zip(shares, ends, strict=True)],
            [0.0 if math.isnan(high) else 100.0 * high - share for share, (_, high) in zip(shares, ends, strict=True)],
        ]
        axes.errorbar(
            rates,
            shares,
            bars,
            color=colour,
            linestyle=style,
            marker="o",
            markersize=3,
            capsize=2,
            linewidth=1.5,
            label=label,
        )
        if not math.isnan(capacity.rate_per_h) and not capacity.beyond:
            axes.plot([capacity.rate_per_h], [100.0 * found.level], "D", color=colour, markersize=6)
    axes.axhline(100.0 * found.level, color=MUTED, linewidth=1.0)
    axes.set_xlabel("orders an hour", fontsize=8)
    axes.set_ylabel("delivered as promised, % of all orders", fontsize=8)
    axes.set_ylim(0.0, 103.0)
    axes.set_xlim(left=0.0)
    axes.legend(fontsize=7, frameon=False, loc="lower left")
    plain_axes(axes)


def _effects(axes: Any, found: CapacityFound) -> None:
    shown = found.effects[:SHOWN]
    rows = range(len(shown))
    values = [one.per_h for one in shown]
    bars = [0.0 if math.isnan(one.half_per_h) else one.half_per_h for one in shown]
    colours = [CALM if one.sure else MUTED for one in shown]
    axes.barh(
        rows,
        values,
        xerr=bars,
        color=colours,
        height=0.7,
        error_kw={"ecolor": MUTED_INK, "elinewidth": 1, "capsize": 2},
    )
    axes.set_yticks(rows, [str(one.change) for one in shown], fontsize=7)
    axes.invert_yaxis()
    axes.axvline(0.0, color=INK, linewidth=0.8)
    base = "" if found.base is None else f" at {found.base.case.rate_per_h:g} orders/h, {found.base.case.drones} drones"
    axes.set_xlabel(
        f"orders an hour more as promised{base}; lines: 95 %; grey: no clear difference from chance", fontsize=8
    )
    plain_axes(axes)
