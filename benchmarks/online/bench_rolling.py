"""Replanning at every stop against the other planners: 500 deliveries on held-out days, the same realizations for all.

Each delivery of an instance is planned by every planner and flown in the same runs; the clairvoyant `exact` has perfect information about each run.
Results are written immediately, one delivery per line, and an interrupted run continues where it ended; several
processes may write parts of one instance to the same file. One decision takes 0.1 to 2 s, a delivery a few seconds, so
that 500 deliveries take a quarter of an hour to an hour on one core. `--alone` flies the rolling horizon without its rivals,
`--no-gusts` in truths without gusts and errors of energy, of which it is told.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.instances import LONG_FILE, read_instance
from benchmarks.planners.trials import ROLLING, Case, Contender, case_of, try_case
from benchmarks.tables.figure import Figure
from benchmarks.tables.lines import Row, append, missing, read
from skyway.planner.evaluation.evaluate import NO_ERRORS, clairvoyant_times
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.registry import ROBUST

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from benchmarks.cases.instances import Instance

RIVALS = (
    Contender(ROLLING, "enough"),
    Contender(ROBUST, "enough"),
    Contender("pfs-charge-aware", "enough"),
    Contender("pfs-charge-aware", "full"),
    Contender("pfs", "enough"),
    Contender("pfs", "full"),
)
BEST = "exact"
"""The planner with perfect information, to which all are compared."""
ABOVE_BEST = 12.0
"""Target for the mean excess over `BEST` in gusts, percent."""
ABOVE_BEST_IN_CALM = 3.0
"""The same without gusts and errors of energy."""
BELOW = {"pfs-charge-aware": 15.0, "pfs": 60.0}
"""Target for the mean reduction against other planners, percent, on requests that all solve."""


def try_delivery(case: Case, rivals: Sequence[Contender] = RIVALS) -> Row:
    """Fly one delivery with some planners: a line of the file of results, times in seconds, None if not delivered."""
    delivery = case.instance.deliveries[case.number]
    best, spent, _ = clairvoyant_times(case.realizations, case.instance.drone, BEST, range(len(case.realizations)))
    row: Row = {"number": case.number, "day": delivery.truth, BEST: {"delivery_s": _plain(best), "seconds": spent}}
    for rival in rivals:
        started = time.perf_counter()
        trial = try_case(case, rival)
        row[rival.label] = {
            "status": trial.status,
            "delivery_s": [None] * len(best) if trial.flown is None else _plain(trial.flown.delivery_s),
            "below_reserve": 0 if trial.flown is None else int(trial.flown.below_reserve.sum()),
            "seconds": time.perf_counter() - started,
        }
    return row


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [None if not np.isfinite(one) else float(one) for one in values]


def run(
    instance: Instance,
    path: Path,
    *,
    part: tuple[int, int] = (0, 1),
    rivals: Sequence[Contender] | None = None,
    progress: Callable[[str], None] = print,
) -> None:
    """Fly the deliveries of an instance that are not yet in a file of results, every n-th from the k-th on."""
    scenario = instance.scenario()
    for number in missing(path, len(instance.deliveries), part):
        row = try_delivery(case_of(scenario, instance, number, instance.runs), RIVALS if rivals is None else rivals)
        append(path, row)
        spent = sum(one["seconds"] for one in row.values() if isinstance(one, dict))
        progress(f"{instance.name}: delivery {number + 1} of {len(instance.deliveries)}, {spent:.1f} s")


def figures_of(rows: Sequence[Row], above_best: float = ABOVE_BEST) -> list[Figure]:
    """Return the results of replanning, with the targets; times over the runs that all delivered, failures counted separately."""
    names = [BEST, *(rival.label for rival in RIVALS if rival.label in rows[0])]
    times = {name: _times(rows, name) for name in names}
    day = np.repeat([int(row["day"].replace("-", "")) for row in rows], [len(row[BEST]["delivery_s"]) for row in rows])
    ours = RIVALS[0].label
    both = np.isfinite(times[BEST]) & np.isfinite(times[ours])
    whole = np.all([np.isfinite(one) for one in times.values()], axis=0)
    found = [_above(times, ours, BEST, both, day, above_best, "delivered by both")]
    each = 100.0 * (times[ours] / times[BEST] - 1.0)[both]
    found.append(Figure(f"{ours} above {BEST}, mean of each delivery's", float(each.mean()), "%"))
    found.append(Figure(f"{ours} above {BEST}, median of each delivery's", float(np.median(each)), "%"))
    found += [_above(times, name, BEST, whole, day, None, "delivered by all") for name in names[1:]]
    for rival in RIVALS:
        if rival.planner not in BELOW or rival.label not in names:
            continue
        least = BELOW[rival.planner] if rival.recharge == "enough" else None
        found.append(
            _above(times, ours, rival.label, whole, day, None if least is None else -least, "delivered by all")
        )
    for name in names[1:]:
        lost = int((~np.isfinite(times[name]) & np.isfinite(times[BEST])).sum())
        broken = sum(row[name]["below_reserve"] for row in rows)
        note = f"of {np.isfinite(times[BEST]).sum()}; {broken} with a landing below the reserve"
        found.append(Figure(f"{name}: not delivered", lost, "", None, note))
    spent = sum(row[ours]["seconds"] for row in rows) / max(len(both), 1)
    found.append(Figure(f"{ours}: a delivery takes", spent, "s", None, "of this process, all its decisions"))
    return found


def _times(rows: Sequence[Row], name: str) -> NDArray[np.float64]:
    return np.array(
        [np.nan if one is None else one for row in rows for one in row[name]["delivery_s"]], dtype=np.float64
    )


def _above(
    times: dict[str, NDArray[np.float64]],
    name: str,
    other: str,
    runs: NDArray[np.bool_],
    day: NDArray[np.int64],
    target: float | None,
    note: str,
) -> Figure:
    """Mean excess of the delivery time over that of another planner, percent, with its interval over days."""
    ratio = DayBootstrap(day[runs]).ratio(times[name][runs], times[other][runs]).scaled(100.0)
    note = f"95 %: {ratio.low - 100.0:.1f} to {ratio.high - 100.0:.1f}, {runs.sum()} {note}"
    return Figure(f"{name} above {other}", ratio.value - 100.0, "%", target, note)


def main() -> int:
    """Measure from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instance", type=Path, default=LONG_FILE)
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench/rolling.jsonl"), help="results; what is in it is kept"
    )
    parser.add_argument("--part", default="0/1", help="k/n: every n-th delivery from the k-th on, for n processes")
    parser.add_argument("--deliveries", type=int, default=10**6, help="number of deliveries, from the first on")
    parser.add_argument("--runs", type=int, default=10**6, help="of each delivery, at most")
    parser.add_argument("--alone", action="store_true", help="the rolling horizon and the clairvoyant only")
    parser.add_argument("--no-gusts", action="store_true", help="truths without gusts and errors of energy")
    options = parser.parse_args()
    instance = read_instance(options.instance)
    instance = instance.cut(options.deliveries, options.runs)
    if options.no_gusts:
        instance = replace(instance, errors=NO_ERRORS)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    first, _, parts = options.part.partition("/")
    run(instance, options.out, part=(int(first), int(parts)), rivals=RIVALS[:1] if options.alone else RIVALS)
    for figure in figures_of(read(options.out), ABOVE_BEST_IN_CALM if options.no_gusts else ABOVE_BEST):
        print(figure.line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
