"""Results of the planner benchmark as a table for people and a document for programs."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.planners.paper import PaperRun
from benchmarks.planners.trials import Row
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import S_PER_MIN
from skyway.planner.evaluation.evaluate import Estimate, Evaluation

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.planners.paper import PaperRow

SCHEMA = "skyway.benchmark-results/1"
INTRODUCTION = """# Planners measured

Written by `skyway bench planners`. All times in minutes, with 95 % intervals over days in brackets; a dash is an end that the days do not tell.
*Failures* are counted over all simulated deliveries of a planner. *Times* are compared over the first few runs of each
delivery, those that every planner delivered (except `pfs-strict`, which is missing from the means where it has no plan).
Clairvoyant planners know the hourly wind and the queues of these runs, but neither gusts nor
energy errors: they are a bound, not a competitor. `robust, rolling horizon` flies only these runs, and its planning time is that of
one decision. Method: docs/explanation/evaluation.md; instances:
docs/reference/benchmark.md.

All stations of these instances have 1,000 holding spots: as in the paper, drones wait for a pad on the ground. With
few spots drones hover for one at busy stations, and of these planners only `robust` expects that.

A row with fewer runs than others (searches cut off, no plan) has means over those runs only: do not
compare them with others; the figure of delivery times omits such rows.

`ies` is measured on networks of at most 200 stations, `robust, rolling horizon` also of at most 200, and `pfs-strict`, which
runs in circles until its step limit, of at most 50.
"""
GLANCE = """## At a glance

Mean delivery time above that of the clairvoyant `exact`, %, over the runs that all delivered, with its 95 % interval over the days; in
parentheses the share of all deliveries with a landing below the reserve, %.
"""
PAPER = """## The paper's experiment

The paper prints no figures of its results, nor its networks, wind or loads, so only shapes can be compared. Means of execution time with
searches cut off are lower bounds and marked with ≥. Delivery times are means over the requests that all planners (except
`pfs-strict`) solved without a cut-off; for `pfs-strict` over those of them that it solved.
"""
_HEAD = (
    "planner",
    "planned",
    "no route",
    "wandered / cut off",
    "deliveries flown",
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


def markdown(
    rows: Sequence[Row],
    paper: Sequence[PaperRow],
    facts: Mapping[str, str],
    skipped: Sequence[str],
    pictures: Sequence[str] = (),
) -> str:
    """The whole report; pictures are named by the files that stand beside it."""
    parts = [INTRODUCTION, "\n".join(f"- {key}: {value}" for key, value in facts.items()) + "\n"]
    if rows:
        parts.append(GLANCE + "\n" + _glance(rows))
    parts += [_picture(name) for name in pictures if not name.startswith("paper")]
    parts += [
        f"## {name}\n\n" + _table(_HEAD, [_cells(row) for row in rows if row.instance == name])
        for name in dict.fromkeys(row.instance for row in rows)
    ]
    if skipped:
        parts.append("## Left out\n\n" + "\n".join(f"- {reason}" for reason in skipped) + "\n")
    if paper:
        parts.append(PAPER + "\n" + _paper_table(paper))
    parts += [_picture(name) for name in pictures if name.startswith("paper")]
    return "\n".join(parts)


def _picture(name: str) -> str:
    return f"![{name.removesuffix('.svg').replace('-', ' ')}]({name})\n"


def _glance(rows: Sequence[Row]) -> str:
    """Planners by instances."""
    instances = list(dict.fromkeys(row.instance for row in rows))
    lines = []
    for planner in dict.fromkeys(row.planner for row in rows if not row.clairvoyant):
        mine = {row.instance: row for row in rows if row.planner == planner}
        lines.append([planner, *(_short(mine.get(instance)) for instance in instances)])
    return _table(("planner", *instances), lines)


def _short(row: Row | None) -> str:
    if row is None or row.whole is None:
        return "-"
    above = "-" if row.common is None else row.common.regret.scaled(100.0).text(".0f")
    return f"{above} ({100 * row.whole.below_reserve.value:.1f})"


def document(
    rows: Sequence[Row],
    paper: Sequence[PaperRow],
    runs: Sequence[PaperRun],
    facts: Mapping[str, str],
    conditions: Mapping[str, object],
    skipped: Sequence[str],
) -> dict[str, object]:
    """The same for a JSON file; times in seconds."""
    return {
        "schema": SCHEMA,
        "machine": dict(facts),
        "conditions": dict(conditions),
        "rows": [row.document() for row in rows],
        "left_out": list(skipped),
        "paper": [vars(row) for row in paper],
        "paper_runs": [run.document() for run in runs],
    }


def read_results(document: Any, file: str) -> tuple[list[Row], list[PaperRun], dict[str, str], dict[str, Any]]:
    """Rows, runs of the paper's experiment, machine and conditions of a JSON file of results (no conditions: an older file).

    Raises
    ------
    InputError
        It is of another schema, or not what `document` makes.
    """
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(Fault("is of another schema", file, field="schema", value=schema, remedy=SCHEMA))
    try:
        rows = [
            Row(**one | {"whole": _evaluation(one["whole"]), "common": _evaluation(one["common"])})
            for one in document["rows"]
        ]
        runs = [PaperRun(**one) for one in document["paper_runs"]]
        facts = {str(key): str(value) for key, value in document["machine"].items()}
        spent_s = f"{float(facts.get('seconds', 0.0)):.0f}"
        conditions = dict(document.get("conditions", {}))
        return rows, runs, {"commit": "unknown"} | facts | {"seconds": spent_s}, conditions
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        problem = f"is not a file of results: {type(error).__name__}: {error}"
        raise InputError(problem, file, remedy="measure again with --force, or into another folder") from None


def _evaluation(document: Mapping[str, Any] | None) -> Evaluation | None:
    if document is None:
        return None
    values: dict[str, Any] = {}
    for field in fields(Evaluation):
        value = document[field.name]
        if field.name == "calibration":
            value = tuple((one["promised"], _estimate(one)) for one in value)
        elif isinstance(value, dict) and "low" in value:
            value = _estimate(value)
        values[field.name] = tuple(value) if isinstance(value, list) else value
    return Evaluation(**values)


def _estimate(document: Mapping[str, Any]) -> Estimate:
    return Estimate(*(math.nan if document[name] is None else document[name] for name in ("value", "low", "high")))


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
        cells += ["-"] * 5
    else:
        rates = (whole.stranded, whole.below_reserve, whole.unflyable, whole.calibration_error)
        cells.append(str(whole.runs))
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
