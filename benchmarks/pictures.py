"""Figures of the planner benchmark as SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from models.units import S_PER_MIN

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.paper import PaperRow
    from benchmarks.trials import Row


def draw(folder: Path, rows: Sequence[Row], paper: Sequence[PaperRow]) -> list[Path]:
    """Draw all figures that there is something to draw in; returns the files."""
    written = []
    if paper:
        written.append(_save(folder / "paper-execution-time.svg", paper_execution, paper))
        written.append(_save(folder / "paper-delivery-time.svg", paper_delivery, paper))
    if any(row.common is not None for row in rows):
        written.append(_save(folder / "delivery-time.svg", delivery, rows))
        written.append(_save(folder / "planning-time.svg", planning, rows))
    if any(row.whole is not None for row in rows):
        written.append(_save(folder / "failures.svg", failures, rows))
    return written


def _save(path: Path, paint: Any, what: Sequence[Any]) -> Path:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        paint(figure.subplots(), what)
        figure.savefig(path, format="svg", metadata={"Date": None})
    return path


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


def _bars(axes: Any, rows: Sequence[Row], value: Any) -> None:
    instances = list(dict.fromkeys(row.instance for row in rows))
    planners = list(dict.fromkeys(row.planner for row in rows))
    width = 0.85 / max(len(planners), 1)
    for number, planner in enumerate(planners):
        for place, instance in enumerate(instances):
            mine = next((row for row in rows if (row.instance, row.planner) == (instance, planner)), None)
            found = None if mine is None else value(mine)
            if found is None or np.isnan(found.value):
                continue
            x = place + (number - (len(planners) - 1) / 2.0) * width
            axes.bar(x, found.value, width, color=f"C{number}")
            if not np.isnan(found.low):
                axes.plot([x, x], [found.low, found.high], color="black", linewidth=0.8)
        axes.bar(0.0, 0.0, width, color=f"C{number}", label=planner)
    axes.set_xticks(range(len(instances)), instances, rotation=35, ha="right", fontsize=8)
    axes.legend(fontsize=7)
    axes.grid(axis="y", alpha=0.3)


def delivery(axes: Any, rows: Sequence[Row]) -> None:
    """Mean delivery time with its interval, on runs that all delivered."""
    _bars(axes, rows, lambda row: None if row.common is None else row.common.mean_s.scaled(1.0 / S_PER_MIN))
    axes.set_yscale("log")
    axes.set_ylabel("mean delivery time, min")
    axes.set_title("Delivery time on runs that all planners delivered, 95 % intervals over days")


def failures(axes: Any, rows: Sequence[Row]) -> None:
    """Share of runs with a landing below the reserve, with its interval."""
    rivals = [row for row in rows if not row.clairvoyant]
    _bars(axes, rivals, lambda row: None if row.whole is None else row.whole.below_reserve.scaled(100.0))
    axes.set_ylabel("landings below the reserve, % of runs")
    axes.set_title("Deliveries with a landing below the reserve, 95 % intervals over days")


def planning(axes: Any, rows: Sequence[Row]) -> None:
    """Median planning time of a delivery by instance."""
    for number, planner in enumerate(dict.fromkeys(row.planner for row in rows)):
        x, y = [], []
        for place, instance in enumerate(dict.fromkeys(row.instance for row in rows)):
            for row in rows:
                found = row.whole or row.common
                if (row.instance, row.planner) == (instance, planner) and found is not None and found.planning_s:
                    x.append(place)
                    y.append(1000.0 * float(np.median(found.planning_s)))
        axes.plot(x, y, "o", color=f"C{number}", label=planner, markersize=5)
    names = list(dict.fromkeys(row.instance for row in rows))
    axes.set_xticks(range(len(names)), names, rotation=35, ha="right", fontsize=8)
    axes.set_yscale("log")
    axes.set_ylabel("median planning time, ms")
    axes.set_title("Planning time, forecasting the queues met included")
    axes.legend(fontsize=7)
    axes.grid(axis="y", alpha=0.3)
