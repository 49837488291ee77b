"""Pictures of a wind forecast: a wind rose, and the speed by hour as a fan chart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.formatting import date_clock
from skyway.models.base.statistics import weighted_quantile
from skyway.models.base.units import from_posix
from skyway.models.wind.marginal import SECTORS, SPEED_EDGES_MPS, rose
from skyway.plots.pictures import CALM, INK, MUTED, ROUTE, new_figure, plain_axes, save_figure
from skyway.plots.wind_summary import over_region

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble


def plot_wind(
    ensemble: WindEnsemble, scenario: Scenario, hours: int, path: Path | None = None, truth: WindEnsemble | None = None
) -> Figure:
    """Draw the rose over all hours and the hourly fan, at cruise height at the centre of the network."""
    north, east = over_region(ensemble, scenario)
    slots = min(north.shape[1], max(1, round(hours * 3600 / ensemble.slot_s)))
    north, east = north[:, :slots], east[:, :slots]
    figure = new_figure(11, 4.8)
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.5))
    _draw_rose(figure.add_subplot(grid[0], projection="polar"), ensemble, north, east)
    axes = figure.add_subplot(grid[1])
    _draw_fan(axes, ensemble, np.hypot(north, east))
    if truth is not None:
        true_north, true_east = over_region(truth, scenario)
        _steps(axes, ensemble, np.hypot(true_north[0, :slots], true_east[0, :slots]), color=INK, label="truth")
    top = _draw_limits(axes, scenario, float(axes.get_ylim()[1]))
    zone = ZoneInfo(scenario.timezone)
    begin = from_posix(ensemble.start_s).astimezone(zone)
    axes.set_xlim(0, slots * ensemble.slot_s / 3600.0)
    axes.set_ylim(0, top)
    axes.set_xlabel(f"hours after {date_clock(begin, zone, named=True)}")
    axes.set_ylabel(f"wind at {scenario.rules.cruise_height_m:g} m at the centre of the network, m/s", fontsize=8)
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=7, loc="lower left", framealpha=0.9)
    count = len(ensemble.labels)
    courses = "one wind" if count == 1 else f"{count} ensemble members"
    axes.set_title(f"{scenario.name}: {courses}", color=INK, fontsize=10, loc="left")
    plain_axes(axes)
    return save_figure(figure, path)


def _draw_rose(polar: Any, ensemble: WindEnsemble, north: NDArray[np.float64], east: NDArray[np.float64]) -> None:
    """Share of the hours by the sector the wind comes from, by speed."""
    from matplotlib import colormaps
    from matplotlib.ticker import MaxNLocator

    slots = north.shape[1]
    table = rose(north, east, np.repeat(ensemble.probability[:, None], slots, axis=1) / slots)
    angles = np.arange(SECTORS) * 2.0 * np.pi / SECTORS
    width = 2 * np.pi / len(angles) * 0.92
    bottom = np.zeros(len(angles))
    present = np.flatnonzero(table.probability.any(axis=0))
    shades = colormaps["viridis_r"](np.linspace(0.05, 0.95, table.probability.shape[1]))
    edges = SPEED_EDGES_MPS
    for k in present:
        label = f"{edges[k]:g} to {edges[k + 1]:g}" if k + 2 < len(edges) else f"over {edges[k]:g}"
        height = 100 * table.probability[:, k]
        polar.bar(angles, height, width, bottom, color=shades[k], label=label, zorder=3)
        bottom += height
    polar.set_theta_zero_location("N")
    polar.set_theta_direction(-1)
    polar.set_xticks(np.radians(np.arange(0, 360, 45)), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])
    polar.set_ylim(0, 1.02 * float(bottom.max()))
    polar.set_yticks([tick for tick in MaxNLocator(4).tick_values(0, float(bottom.max()))[1:] if tick <= bottom.max()])
    polar.set_rlabel_position(112.5)
    polar.yaxis.set_major_formatter(lambda value, _: f"{value:g} %")
    polar.grid(color=MUTED, alpha=0.4, linewidth=0.5)
    polar.set_title("where it comes from, share of hours", color=INK, fontsize=10)
    polar.tick_params(labelsize=7)
    polar.legend(
        title="m/s", title_fontsize=7, fontsize=7, loc="center left", bbox_to_anchor=(-0.32, 0.5), frameon=False
    )


def _draw_fan(axes: Any, ensemble: WindEnsemble, speed: NDArray[np.float64]) -> None:
    """Quantiles of the speed by slot; wind is constant within a slot, hence the steps."""
    low, quarter, middle, three, high = (
        np.array([weighted_quantile(slot, ensemble.probability, level) for slot in speed.T])
        for level in (0.05, 0.25, 0.5, 0.75, 0.95)
    )
    hour = np.arange(speed.shape[1] + 1) * ensemble.slot_s / 3600.0
    if len(ensemble.labels) > 1:
        for below, above, alpha, label in ((low, high, 0.2, "5 to 95 %"), (quarter, three, 0.35, "25 to 75 %")):
            below_, above_ = np.append(below, below[-1]), np.append(above, above[-1])
            axes.fill_between(hour, below_, above_, step="post", color=CALM, alpha=alpha, linewidth=0, label=label)
    _steps(axes, ensemble, middle, color=CALM, label="median" if len(ensemble.labels) > 1 else "wind")
    axes.set_ylim(0, max(1.0, 1.08 * float(high.max())))


def _steps(axes: Any, ensemble: WindEnsemble, speed: NDArray[np.float64], *, color: str, label: str) -> None:
    hour = np.arange(len(speed) + 1) * ensemble.slot_s / 3600.0
    axes.step(hour, np.append(speed, speed[-1]), where="post", color=color, linewidth=1.8, label=label)


def _draw_limits(axes: Any, scenario: Scenario, top: float) -> float:
    """Wind limits of the drones, one line for those that share one; returns the top of the axis."""
    limits: dict[float, list[str]] = {}
    for drone in scenario.drones:
        limits.setdefault(drone.wind_limit_mps, []).append(drone.id)
    for limit, names in limits.items():
        axes.axhline(limit, color=ROUTE, linewidth=0.8, linestyle="--")
        text = "limit of " + (", ".join(names) if len(names) <= 5 else f"{', '.join(names[:4])} and others")
        place, shift = (1, limit), (-2, 2)
        axes.annotate(
            text,
            place,
            xycoords=("axes fraction", "data"),
            xytext=shift,
            textcoords="offset points",
            ha="right",
            fontsize=7,
            color=ROUTE,
        )
    return max(top, 1.1 * max(limits, default=0.0))
