"""Picture of a replayed flight: height, speed, battery, and wind with its uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.replay.known_wind import kept_s
from skyway.models.wind.triangle import speed_from
from skyway.plots.pictures import CALM, INK, MUTED, ROUTE, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.link.replay.replay import Replay


def plot_replay(found: Replay, path: Path) -> None:
    """Draw the flight over the minutes of the log."""
    figure = new_figure(10, 8)
    zero = found.summary.start_s
    axes = figure.subplots(4, 1, sharex=True)
    table = found.seconds
    minutes = (table.time_s - zero) / 60.0
    _line(axes[0], minutes, table["height_m"], INK, "height, m")
    twin = axes[0].twinx()
    _line(twin, minutes, np.hypot(table["vel_north_mps"], table["vel_east_mps"]), CALM, "ground speed, m/s")
    _line(axes[1], minutes, 100.0 * table["soc"], INK, "charge, %")
    power = axes[1].twinx()
    _line(power, minutes, table["power_w"], ROUTE, "power, W")
    _draw_wind(axes[2], axes[3], found, zero)
    for leg in found.legs:
        for one in axes:
            one.axvspan((leg.start_s - zero) / 60.0, (leg.end_s - zero) / 60.0, color=MUTED, alpha=0.15, linewidth=0)
    for one in axes:
        plain_axes(one)
        one.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes[3].set_xlabel("minutes of the log (grey: in the air)", fontsize=8)
    axes[0].set_title(f"vehicle {found.system}, {found.summary.format} log", color=INK, fontsize=10, loc="left")
    save_figure(figure, path)


def _line(axes: Any, minutes: Any, values: Any, color: str, label: str) -> None:
    axes.plot(minutes, values, color=color, linewidth=1.0)
    axes.set_ylabel(label, color=color, fontsize=8)
    axes.tick_params(labelsize=8)


def _pauses(found: Replay) -> NDArray[np.int64]:
    """Return the rows of the wind before which it was unknown, so that no line is drawn through that time."""
    time_s = found.wind.time_s
    return np.flatnonzero(np.diff(time_s) > kept_s(time_s)) + 1


def _draw_wind(upper: Any, lower: Any, found: Replay, zero: float) -> None:
    minutes = (found.wind.time_s - zero) / 60.0
    speed, direction = speed_from(found.wind.wind[:, 0], found.wind.wind[:, 1])
    sigma = found.wind.sigma_mps
    paused = _pauses(found)
    minutes, speed, sigma = (np.insert(one, paused, np.nan) for one in (minutes, speed, sigma))
    direction = np.insert(direction, paused, np.nan)
    upper.fill_between(
        minutes, np.maximum(speed - 2.0 * sigma, 0.0), speed + 2.0 * sigma, color=CALM, alpha=0.25, linewidth=0
    )
    _line(upper, minutes, speed, CALM, "wind, m/s (band: 95 %)")
    lower.plot(minutes, direction, ".", color=CALM, markersize=2)
    lower.set_ylabel("wind FROM, degrees", color=CALM, fontsize=8)
    lower.set_ylim(0, 360)
    if found.forecast:
        forecast = np.insert(found.wind.forecast, paused, np.nan, axis=0)
        expected, bearing = speed_from(forecast[:, 0], forecast[:, 1])
        upper.plot(minutes, expected, color=ROUTE, linewidth=1.0, linestyle="--", label="forecast")
        lower.plot(minutes, bearing, ".", color=ROUTE, markersize=1)
        upper.legend(fontsize=7, loc="upper right", frameon=False)
