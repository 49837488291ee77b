"""Figures of the planner benchmark as SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.units import S_PER_MIN
from skyway.planner.evaluation.statistics import Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.planners.paper import PaperRow
    from benchmarks.planners.trials import Row


def draw(folder: Path, rows: Sequence[Row], paper: Sequence[PaperRow]) -> list[Path]:
    """Draw all figures that there is something to draw in; returns the files."""
    written = []
    if paper:
        written.append(_save(folder / "paper-execution-time.svg", paper_execution, paper))
        written.append(_save(folder / "paper-delivery-time.svg", paper_delivery, paper))
    planners = list(dict.fromkeys(row.planner for row in rows))
    if any(row.common is not None for row in rows):
        title = "Delivery time on runs that all planners delivered, 95 % intervals over days"
        written.append(_save_panels(folder / "delivery-time.svg", delivery, _on_all_runs(rows), title, planners))
        title = "Planning time, forecasting the queues met included"
        written.append(_save_panels(folder / "planning-time.svg", planning, rows, title, planners))
    rivals = [row for row in rows if not row.clairvoyant]
    if any(row.whole is not None for row in rivals):
        title = "Deliveries with a landing below the reserve, 95 % intervals over days"
        written.append(_save_panels(folder / "failures.svg", failures, rivals, title, planners))
    return written


def _on_all_runs(rows: Sequence[Row]) -> list[Row]:
    """Rows whose times are means over all the runs that are compared; of searches cut off there are fewer."""
    runs = [0 if row.common is None else row.common.runs for row in rows]
    most: dict[str, int] = {}
    for row, count in zip(rows, runs, strict=True):
        most[row.instance] = max(most.get(row.instance, 0), count)
    return [row for row, count in zip(rows, runs, strict=True) if count == most[row.instance]]


def _save(path: Path, paint: Any, what: Sequence[Any]) -> Path:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        paint(figure.subplots(), what)
        figure.savefig(path, format="svg", metadata={"Date": None})
    return path


def _save_panels(path: Path, paint: Any, rows: Sequence[Row], title: str, planners: Sequence[str]) -> Path:
    """A panel for each network, its instances from left to right, one legend for all; a planner's colour is its place."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    networks = list(dict.fromkeys(_network(row.instance) for row in rows))
    named = {row.planner for row in rows}
    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        figure = Figure(figsize=(max(2.6 * len(networks) + 1.0, 9.5), 5.0), layout="constrained")
        axes = figure.subplots(1, len(networks), squeeze=False, sharey=True)[0]
        for one, network in zip(axes, networks, strict=True):
            paint(one, [row for row in rows if _network(row.instance) == network], planners)
            one.set_title(network, fontsize=9)
            one.grid(axis="y", alpha=0.3)
        shown = [number for number, name in enumerate(planners) if name in named]
        handles = [mpl.lines.Line2D([], [], color=_colour(number), marker="o", linestyle="") for number in shown]
        labels = [planners[number] for number in shown]
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
        figure.suptitle(title, fontsize=10)
        figure.savefig(path, format="svg", metadata={"Date": None})
    return path


def _network(instance: str) -> str:
    return instance.rpartition("-")[0]


def _colour(number: int) -> str:
    return f"C{number}" if number < 10 else "black"


def _lines(axes: Any, paper: Sequence[PaperRow], value: Any, marked: Any) -> None:
    for number, name in enumerate(dict.fromkeys(row.planner for row in paper)):
        mine = [row for row in paper if row.planner == name and value(row) is not None]
        x, y = [row.nodes for row in mine], [value(row) for row in mine]
        axes.plot(x, y, marker="o", color=f"C{number}", label=name, markersize=4)
        cut = [(row.nodes, value(row)) for row in mine if marked(row)]
        if cut:
            axes.plot(*zip(*cut, strict=True), "^", color=f"C{number}", markersize=11, fillstyle="none")
    axes.set_xlabel("nodes")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def paper_execution(axes: Any, paper: Sequence[PaperRow]) -> None:
    """Mean execution time over nodes; triangles: some searches were cut off, the mean is a lower bound."""
    _lines(axes, paper, lambda row: 1000.0 * row.execution_s, lambda row: row.cut_off > 0)
    axes.set_yscale("log")
    axes.set_ylabel("mean execution time, ms (△: searches cut off, at least this)")
    axes.set_title("Average execution time")


def paper_delivery(axes: Any, paper: Sequence[PaperRow]) -> None:
    """Mean delivery time over nodes, on requests that all solved; triangles: searches that were cut off are left out."""
    found = [row for row in paper if row.planner != "pfs-strict"]
    _lines(
        axes,
        found,
        lambda row: None if row.delivery_s is None else row.delivery_s / S_PER_MIN,
        lambda row: row.cut_off > 0,
    )
    axes.set_ylabel("mean delivery time, min (△: requests cut off are left out)")
    axes.set_title("Average delivery time")


def _marks(axes: Any, rows: Sequence[Row], planners: Sequence[str], value: Any) -> None:
    """One mark for each planner, with its interval, beside each other over their instance."""
    instances = list(dict.fromkeys(row.instance for row in rows))
    for row in rows:
        found = value(row)
        if found is None or np.isnan(found.value):
            continue
        number = planners.index(row.planner)
        x = instances.index(row.instance) + 0.8 * ((number + 0.5) / len(planners) - 0.5)
        axes.plot([x], [found.value], "o", color=_colour(number), markersize=4)
        if not np.isnan(found.low):
            axes.plot([x, x], [found.low, found.high], color=_colour(number), linewidth=1.0)
    axes.set_xticks(range(len(instances)), [name.rpartition("-")[2] for name in instances], fontsize=8)
    axes.set_xlim(-0.5, len(instances) - 0.5)
    axes.set_xlabel("utilisation of pads", fontsize=8)


def delivery(axes: Any, rows: Sequence[Row], planners: Sequence[str]) -> None:
    """Mean delivery time with its interval, on runs that all delivered."""
    _marks(axes, rows, planners, lambda row: None if row.common is None else row.common.mean_s.scaled(1.0 / S_PER_MIN))
    axes.set_yscale("log")
    if axes.get_subplotspec().is_first_col():
        axes.set_ylabel("mean delivery time, min")


def failures(axes: Any, rows: Sequence[Row], planners: Sequence[str]) -> None:
    """Share of runs with a landing below the reserve, with its interval."""
    _marks(axes, rows, planners, lambda row: None if row.whole is None else row.whole.below_reserve.scaled(100.0))
    if axes.get_subplotspec().is_first_col():
        axes.set_ylabel("landings below the reserve, % of deliveries")


def planning(axes: Any, rows: Sequence[Row], planners: Sequence[str]) -> None:
    """Median planning time of a delivery."""

    def median(row: Row) -> Estimate | None:
        found = row.whole or row.common
        if found is None or not found.planning_s:
            return None
        return Estimate(1000.0 * float(np.median(found.planning_s)))

    _marks(axes, rows, planners, median)
    axes.set_yscale("log")
    if axes.get_subplotspec().is_first_col():
        axes.set_ylabel("median planning time, ms")
