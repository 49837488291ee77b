"""Results of the planner benchmark as a table for people and a document for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.units import S_PER_MIN

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.paper import PaperRow, PaperRun
    from benchmarks.trials import Row
    from planner.evaluate import Estimate

SCHEMA = "skyway.benchmark-results/1"
INTRODUCTION = """# Planners measured

All times in minutes, with 95 % intervals (block bootstrap over days) in brackets. *Failures* are counted over all
simulated deliveries of a planner; *times* are compared over the runs that every planner delivered (those of
`pfs-strict` do not decide what is compared: where it has no plan it is missing from the means). Clairvoyant planners
are told the hourly wind and the queues, neither gusts nor errors of energy: a bound, not a rival, and known for
the first run of each delivery alone. How it is measured:
docs/explanation/evaluation.md; the instances: docs/reference/benchmark.md. `ies` is tried on networks of at most 200
stations, `pfs-strict`, which goes in circles until its step limit, of at most 50.
"""
PAPER = """## The paper's experiment

The paper prints no figure of its results, nor its networks, wind or loads: compare shapes. Means of execution time with searches cut off are lower bounds and marked with ≥. Delivery times are
means over the requests that all planners (but `pfs-strict`) solved and no search was cut off on; `pfs-strict` over
those of them that it solved.
"""
_HEAD = (
    "planner",
    "planned",
    "no route",
    "wandered / cut off",
    "stranded %",
    "below reserve %",
    "unflyable %",
    "promise off, points",
    "runs compared",
    "delivery mean",
    "p50",
    "p95",
    "flight",
    "waiting",
    "recharge",
    "above clairvoyant %",
    "planning median / max, ms",
)


def markdown(rows: Sequence[Row], paper: Sequence[PaperRow], facts: Mapping[str, str], skipped: Sequence[str]) -> str:
    """The whole report."""
    parts = [INTRODUCTION, "\n".join(f"- {key}: {value}" for key, value in facts.items()) + "\n"]
    parts += [
        f"## {name}\n\n" + _table(_HEAD, [_cells(row) for row in rows if row.instance == name])
        for name in dict.fromkeys(row.instance for row in rows)
    ]
    if skipped:
        parts.append("## Left out\n\n" + "\n".join(f"- {reason}" for reason in skipped) + "\n")
    if paper:
        parts.append(PAPER + "\n" + _paper_table(paper))
    return "\n".join(parts)


def document(
    rows: Sequence[Row],
    paper: Sequence[PaperRow],
    runs: Sequence[PaperRun],
    facts: Mapping[str, str],
    skipped: Sequence[str],
) -> dict[str, object]:
    """The same for a JSON file; times in seconds."""
    return {
        "schema": SCHEMA,
        "machine": dict(facts),
        "rows": [row.document() for row in rows],
        "left_out": list(skipped),
        "paper": [vars(row) for row in paper],
        "paper_runs": [run.document() for run in runs],
    }


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _minutes(value: Estimate, *, interval: bool = False) -> str:
    scaled = value.scaled(1.0 / S_PER_MIN)
    return scaled.text(".0f") if interval else ("-" if np.isnan(scaled.value) else f"{scaled.value:.0f}")


def _cells(row: Row) -> list[str]:
    name = f"{row.planner} (clairvoyant)" if row.clairvoyant else row.planner
    cells = [name, f"{row.planned} of {row.deliveries}", str(row.no_route)]
    cells.append(str(row.cut_off if row.clairvoyant else row.wandered))
    whole, common = row.whole, row.common
    if whole is None:
        cells += ["-"] * 4
    else:
        rates = (whole.stranded, whole.below_reserve, whole.unflyable, whole.calibration_error)
        cells += [rate.scaled(100.0).text(".1f") for rate in rates]
    if common is None:
        cells += ["0"] + ["-"] * 7
    else:
        cells.append(str(common.runs))
        cells += [_minutes(value, interval=True) for value in (common.mean_s, common.p50_s, common.p95_s)]
        cells += [_minutes(value) for value in (common.flight_s, common.wait_s, common.recharge_s)]
        cells.append(common.regret.scaled(100.0).text(".0f") if common.clairvoyant_runs else "-")
    planning = (whole.planning_s if whole else ()) or (common.planning_s if common else ())
    cells.append(f"{1000 * np.median(planning):.1f} / {1000 * max(planning):.1f}" if planning else "-")
    return cells


def _paper_table(paper: Sequence[PaperRow]) -> str:
    head = (
        "nodes",
        "planner",
        "runs",
        "solved",
        "cut off",
        "no route",
        "execution mean, ms",
        "delivery mean",
        "compared",
    )
    rows = []
    for row in paper:
        execution = f"{'≥ ' if row.cut_off else ''}{1000 * row.execution_s:.1f}"
        delivery = "-" if row.delivery_s is None else f"{row.delivery_s / S_PER_MIN:.0f}"
        counts = (row.runs, row.solved, row.cut_off, row.no_route)
        rows.append([str(row.nodes), row.planner, *map(str, counts), execution, delivery, str(row.compared)])
    return _table(head, rows)
