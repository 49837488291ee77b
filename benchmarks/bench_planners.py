"""How good the planners are: the paper's experiment and ours; ``skyway bench planners`` runs the same."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import report
from benchmarks.figure import commit, machine
from benchmarks.instances import FOLDER, NETWORKS, UTILISATIONS, read_instance
from benchmarks.paper import NODES, rows, run_experiment
from benchmarks.trials import COMPARED_RUNS, try_instance
from models.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.paper import PaperRow
    from benchmarks.trials import Row


@dataclass(frozen=True)
class Size:
    """How much is run.

    Attributes
    ----------
    instances : tuple of Path
        Files.
    deliveries, runs : int
        Of each instance at most.
    nodes : tuple of int
        Of the paper's experiment.
    paper_runs : int
        Of each size at most; the paper has half the nodes.
    time_limit_s : float
        Of each exhaustive search.
    compared : int
        Runs of each delivery in which times are compared.
    """

    instances: tuple[Path, ...]
    deliveries: int
    runs: int
    nodes: tuple[int, ...]
    paper_runs: int
    time_limit_s: float
    compared: int = COMPARED_RUNS


def _files(networks: tuple[str, ...], utilisations: tuple[float, ...]) -> tuple[Path, ...]:
    return tuple(FOLDER / f"{network}-{level:g}.json" for network in networks for level in utilisations)


FULL = Size(_files(NETWORKS, UTILISATIONS), 100, 20, NODES, 1000, 3.0)
QUICK = Size(_files(("new-york", "geometric-100"), (0.7,)), 2, 10, (5, 10, 15, 20), 3, 0.5)


def say(text: str) -> None:
    """Tell progress."""
    print(text, file=sys.stderr, flush=True)


def run(size: Size, out: Path, *, progress: Callable[[str], None] = say) -> list[Path]:
    """Run the benchmark and write table, figures and results into a folder; returns the files.

    Raises
    ------
    InputError
        The folder cannot be written, or an instance is not what was published.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(Fault(f"cannot be made: {error.strerror}", str(out))) from None
    started = time.perf_counter()
    found: list[Row] = []
    skipped: list[str] = []
    facts = {"commit": commit()} | machine()
    runs = run_experiment(
        size.nodes,
        time_limit_s=size.time_limit_s,
        runs=lambda nodes: min(nodes // 2, size.paper_runs),
        progress=progress,
    )
    paper = rows(runs)
    for file in size.instances:
        instance = read_instance(file).cut(size.deliveries, size.runs)
        try:
            instance.scenario()
        except InputError as error:
            skipped.append(f"{instance.name}: {error}")
            progress(f"left out: {skipped[-1]}")
            continue
        found += try_instance(instance, compared=size.compared, time_limit_s=size.time_limit_s, progress=progress)
    facts["seconds"] = f"{time.perf_counter() - started:.0f}"
    pictures = _draw(out, found, paper, progress)
    written = [out / "planners.md", out / "planners.json"]
    names = [path.name for path in pictures]
    written[0].write_text(report.markdown(found, paper, facts, skipped, names), encoding="utf-8")
    text = json.dumps(report.document(found, paper, runs, facts, skipped), indent=1, allow_nan=False)
    written[1].write_text(text + "\n", encoding="utf-8")
    return written + pictures


def _draw(out: Path, found: list[Row], paper: list[PaperRow], progress: Callable[[str], None]) -> list[Path]:
    """Draw what can be drawn here."""
    try:
        import matplotlib as mpl
    except ImportError:
        progress("no figures: drawing needs matplotlib, install skyway[plot]")
        return []
    progress(f"figures by matplotlib {mpl.__version__}")
    from benchmarks import pictures

    return pictures.draw(out, found, paper)


def main() -> int:
    """Run it from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a minute instead of a quarter of an hour")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args()
    for path in run(QUICK if options.quick else FULL, options.out):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
