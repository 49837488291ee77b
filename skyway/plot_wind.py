"""Pictures of the wind forecast: a rose, and the speed hour by hour as a fan."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from models.units import from_posix
from models.wind_marginal import rose
from skyway.pictures import CALM, INK, MUTED, ROUTE, new_figure, save_figure
from skyway.wind_summary import over_region

if TYPE_CHECKING:
    from pathlib import Path

    from models.scenario import Scenario
    from models.wind_forecast import WindEnsemble


def plot_wind(
    ensemble: WindEnsemble, scenario: Scenario, hours: int, path: Path, truth: WindEnsemble | None = None
) -> None:
    """Draw the rose over all hours and the hourly fan, at cruise height over the middle of the network."""
    north, east = over_region(ensemble, scenario)
    slots = min(north.shape[1], max(1, round(hours * 3600 / ensemble.slot_s)))
    north, east = north[:, :slots], east[:, :slots]
    figure = new_figure(11, 4.6)
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.7))
    polar = figure.add_subplot(grid[0], projection="polar")
    table = rose(north, east, np.repeat(ensemble.probability[:, None], slots, axis=1) / slots)
    angles = np.radians(table.sector_from_deg)
    width = 2 * np.pi / len(angles) * 0.92
    bottom = np.zeros(len(angles))
    shades = np.linspace(0.25, 1.0, table.probability.shape[1])
    edges = [*table.speed_edges_mps]
    for k in range(table.probability.shape[1]):
        if not table.probability[:, k].any():
            continue
        upper = f"{edges[k + 1]:g}" if np.isfinite(edges[k + 1]) else "more"
        label = f"{edges[k]:g} to {upper} m/s"
        polar.bar(angles, 100 * table.probability[:, k], width, bottom, color=CALM, alpha=float(shades[k]), label=label)
        bottom += 100 * table.probability[:, k]
    polar.set_theta_zero_location("N")  # type: ignore[attr-defined]
    polar.set_theta_direction(-1)  # type: ignore[attr-defined]
    polar.set_title("where it comes from, % of hours", color=INK, fontsize=9)
    polar.tick_params(labelsize=7)
    polar.legend(fontsize=6, loc="lower left", bbox_to_anchor=(-0.25, -0.15))
    axes = figure.add_subplot(grid[1])
    speed = np.hypot(north, east)
    hour = np.arange(slots) * ensemble.slot_s / 3600.0
    for low, high, alpha in ((0.05, 0.95, 0.2), (0.25, 0.75, 0.35)):
        axes.fill_between(
            hour,
            *np.quantile(speed, (low, high), axis=0),
            color=CALM,
            alpha=alpha,
            linewidth=0,
            label=f"{100 * low:.0f} to {100 * high:.0f} %",
        )
    axes.plot(hour, np.quantile(speed, 0.5, axis=0), color=CALM, linewidth=1.8, label="median")
    if truth is not None:
        true_north, true_east = over_region(truth, scenario)
        axes.plot(hour, np.hypot(true_north[0, :slots], true_east[0, :slots]), color=INK, linewidth=1.4, label="truth")
    for drone in scenario.drones:
        axes.axhline(drone.wind_limit_mps, color=ROUTE, linewidth=0.8, linestyle="--")
        axes.annotate(
            f"limit {drone.id}",
            (0, drone.wind_limit_mps),
            xytext=(2, 2),
            textcoords="offset points",
            fontsize=6,
            color=ROUTE,
        )
    begin = from_posix(ensemble.start_s).astimezone(ZoneInfo(scenario.timezone))
    axes.set_xlabel(f"hours after {begin:%Y-%m-%d %H:%M %Z}")
    axes.set_ylabel(f"wind at {scenario.rules.cruise_height_m:g} m, m/s")
    axes.set_ylim(bottom=0)
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=7)
    axes.set_title(f"{scenario.name}: {len(ensemble.labels)} possible courses", color=INK, fontsize=9, loc="left")
    save_figure(figure, path)
