"""Picture of forecasts compared with observations: error, spread and score by lead time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.plots.pictures import CALM, INK, MUTED, ROUTE, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from skyway.models.weather.verification import LeadScore


def plot_verification(scores: Sequence[LeadScore], path: Path | None = None) -> Figure:
    """Draw spread against skill on the left, bias, RMSE and CRPS of the speed on the right, by lead."""
    figure = new_figure(11, 4.2)
    grid = figure.add_gridspec(1, 2)
    lead = [one.lead_h for one in scores]
    left, right = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    left.plot(
        lead, [one.component_rmse_mps for one in scores], color=ROUTE, marker="o", label="RMSE of the mean (skill)"
    )
    left.plot(lead, [one.spread_mps for one in scores], color=CALM, marker="o", label="spread of the members")
    left.set_title("a component of the wind", color=INK, fontsize=10, loc="left")
    for values, color, style, label in (
        ([one.speed_rmse_mps for one in scores], ROUTE, "-", "RMSE"),
        ([one.crps_mps for one in scores], CALM, "-", "CRPS"),
        ([one.calibrated_crps_mps for one in scores], CALM, "--", "CRPS, calibrated on the other half"),
        ([one.speed_bias_mps for one in scores], INK, "-", "bias"),
    ):
        right.plot(lead, values, color=color, linestyle=style, marker="o", label=label)
    right.axhline(0.0, color=MUTED, linewidth=0.8)
    right.set_title("its speed", color=INK, fontsize=10, loc="left")
    pairs = sum(one.pairs for one in scores)
    for axes in (left, right):
        axes.set_xlabel("lead time, hours after the issue")
        axes.set_ylabel("m/s")
        axes.grid(color=MUTED, alpha=0.3, linewidth=0.5)
        axes.legend(fontsize=8, framealpha=0.9)
        plain_axes(axes)
    left.set_ylim(bottom=0.0)
    figure.suptitle(f"{pairs:,} forecasts compared with observations", color=INK, fontsize=10)
    return save_figure(figure, path)
