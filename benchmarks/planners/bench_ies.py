"""PFS against the exhaustive search, 5 to 40 nodes: a short form of the paper's experiment."""

from __future__ import annotations

from benchmarks.planners.paper import NODES, rows, run_experiment
from benchmarks.tables.figure import Figure

RUNS = 3
TIME_LIMIT_S = 4.0


def measure(*, runs: int = RUNS, time_limit_s: float = TIME_LIMIT_S) -> list[Figure]:
    """Return mean execution times by size; a mean that holds runs cut off is only a lower bound, and says so."""
    found = rows(run_experiment(NODES, time_limit_s=time_limit_s, runs=lambda nodes: min(runs, nodes // 2)))
    figures = []
    for row in found:
        if row.planner not in {"pfs", "ies"}:
            continue
        note = f"{row.runs} runs"
        if row.cut_off:
            note += f", {row.cut_off} cut off at {time_limit_s:g} s: at least this"
        if row.no_route:
            note += f", {row.no_route} without a route"
        what = f"{row.planner}, {row.nodes} nodes: mean execution time"
        figures.append(Figure(what, 1000.0 * row.execution_s, "ms", note=note))
    return figures
