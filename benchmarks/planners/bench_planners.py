"""How good the planners are: the paper's experiment and ours; ``skyway bench planners`` runs the same."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.cases.instances import FOLDER, NETWORKS, UTILISATIONS, read_instance
from benchmarks.planners.paper import NODES, rows, run_experiment
from benchmarks.planners.trials import COMPARED_RUNS, Asked, try_instance
from benchmarks.tables import report
from benchmarks.tables.figure import commit, machine
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.parameters import changed
from skyway.planner.parameters.planner import USUAL

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.planners.paper import PaperRow, PaperRun
    from benchmarks.planners.trials import Row
    from skyway.planner.parameters.planner import PlannerParameters


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
QUICK = Size(_files(("new-york", "geometric-100"), (0.5,)), 2, 10, (5, 10, 15, 20), 3, 0.5, compared=1)


def say(text: str) -> None:
    """Tell progress."""
    print(text, file=sys.stderr, flush=True)


def run(
    size: Size,
    out: Path,
    *,
    keep: bool = False,
    progress: Callable[[str], None] = say,
    parameters: PlannerParameters = USUAL,
    workers: int = 1,
    cluster: str | None = None,
) -> list[Path]:
    """Run the benchmark and write table, figures and results into a folder; returns the files.

    After each instance the results so far are written, so that a run that was broken off can go on.

    Parameters
    ----------
    size : Size
        How much.
    out : Path
        Folder.
    keep : bool
        Instances that the folder's results hold are not run again.
    progress : callable
        Told in words how far it is.
    parameters : PlannerParameters
        Of all planners; those that are not at their defaults are kept with the results.
    workers, cluster
        See `skyway.models.compute.spreading.spread`; planning times are those of a processor of its own only with one worker.

    Raises
    ------
    InputError
        The folder cannot be written, or an instance is not what was published.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(Fault(f"cannot be made: {error.strerror}", str(out))) from None
    spread_over = {} if cluster is None and workers == 1 else {"workers": cluster or str(workers)}
    results = Results(out, {"commit": commit()} | machine() | spread_over | changed(parameters, "planner"))
    if keep:
        results.read()
    if not results.runs and size.nodes:
        started = time.perf_counter()
        results.runs = run_experiment(
            size.nodes,
            time_limit_s=size.time_limit_s,
            runs=lambda nodes: min(nodes // 2, size.paper_runs),
            progress=progress,
            parameters=parameters,
            workers=workers,
            cluster=cluster,
        )
        results.add([], time.perf_counter() - started)
    for file in size.instances:
        instance = read_instance(file).cut(size.deliveries, size.runs)
        if instance.name in {row.instance for row in results.rows}:
            continue
        try:
            instance.scenario()
        except InputError as error:
            results.skipped.append(f"{instance.name}: {error}")
            progress(f"left out: {results.skipped[-1]}")
            continue
        started = time.perf_counter()
        asked = Asked(instance, size.compared, size.time_limit_s, parameters)
        found = try_instance(asked, progress=progress, workers=workers, cluster=cluster)
        results.add(found, time.perf_counter() - started)
    results.write()
    pictures = _draw(out, results.rows, results.paper, progress)
    table = out / "planners.md"
    names = [path.name for path in pictures]
    text = report.markdown(results.rows, results.paper, results.facts, results.skipped, names)
    table.write_text(text, encoding="utf-8")
    return [table, results.path, *pictures]


class Results:
    """What has been measured so far, in a folder's ``planners.json``.

    Parameters
    ----------
    out : Path
        The folder.
    facts : dict of str to str
        Commit and machine.
    """

    def __init__(self, out: Path, facts: dict[str, str]) -> None:
        self.path = out / "planners.json"
        self.facts = facts
        self.rows: list[Row] = []
        self.runs: list[PaperRun] = []
        self.skipped: list[str] = []
        self._kept = facts

    @property
    def paper(self) -> list[PaperRow]:
        """Means of the paper's experiment."""
        return rows(self.runs)

    def read(self) -> None:
        """Take over what the file holds, if there is one; what is measured by another commit is told beside its own."""
        try:
            document = json.loads(self.path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return
        except (OSError, ValueError) as error:
            raise InputError(Fault(f"cannot be read: {error}", str(self.path))) from None
        self.rows, self.runs = report.read_rows(document), report.read_paper(document)
        self._kept, self.facts = self.facts, document["machine"]

    def add(self, found: list[Row], spent_s: float) -> None:
        """Take what was measured just now, and write all."""
        self.rows += found
        now = self._kept["commit"]
        if now not in self.facts["commit"]:
            self.facts |= self._kept | {"commit": f"{self.facts['commit']}, then {now}"}
        self.facts["seconds"] = f"{float(self.facts.get('seconds', 0.0)) + spent_s:.0f}"
        self.write()

    def write(self) -> None:
        """Write all."""
        found = report.document(self.rows, self.paper, self.runs, self.facts, self.skipped)
        self.path.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _draw(out: Path, found: list[Row], paper: list[PaperRow], progress: Callable[[str], None]) -> list[Path]:
    """Draw what can be drawn here."""
    try:
        import matplotlib as mpl
    except ImportError:
        progress("no figures: drawing needs matplotlib, install skyway[plot]")
        return []
    progress(f"figures by matplotlib {mpl.__version__}")
    from benchmarks.tables import pictures

    return pictures.draw(out, found, paper)


def main() -> int:
    """Run it from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="half a minute instead of three quarters of an hour")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--keep", action="store_true", help="do not run again what the folder's results hold")
    parser.add_argument("--instances", nargs="+", metavar="NAME", help="only those whose names begin so")
    options = parser.parse_args()
    size = QUICK if options.quick else FULL
    if options.instances:
        chosen = tuple(file for file in size.instances if file.stem.startswith(tuple(options.instances)))
        size = replace(size, instances=chosen)
    for path in run(size, options.out, keep=options.keep):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
