"""How good the planners are: the paper's experiment and ours, as ``skyway bench planners`` runs them."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from benchmarks.cases.instances import FOLDER, NETWORKS, UTILISATIONS, read_instance
from benchmarks.planners.paper import NODES, rows, run_experiment
from benchmarks.planners.trials import COMPARED_RUNS, Asked, try_instance
from benchmarks.tables import report
from benchmarks.tables.figure import commit, machine
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.files import make_folder, read_text, write_atomically
from skyway.models.base.parameters import changed
from skyway.planner.parameters.planner import USUAL
from skyway.planner.registry import PLANNERS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

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


PAPER = "paper"
"""Name of the paper's experiment beside those of the instances."""
MAX_BYTES = 64_000_000
"""Of a file of results."""


def say(text: str) -> None:
    """Tell progress."""
    print(text, file=sys.stderr, flush=True)


def chosen(size: Size, names: Sequence[str]) -> Size:
    """Return the part of a benchmark that is named: by beginnings of names of instances, and `PAPER`; without names all of it.

    Raises
    ------
    InputError
        A name that nothing has.
    """
    if not names:
        return size
    stems = [file.stem for file in size.instances]
    remedy = f"the beginning of one of {', '.join(stems)}; or {PAPER}"
    refuse(
        [
            Fault("no such instance in this benchmark", field="--instance", value=name, remedy=remedy)
            for name in names
            if not name or (name != PAPER and not any(stem.startswith(name) for stem in stems))
        ]
    )
    files = tuple(file for file in size.instances if file.stem.startswith(tuple(names)))
    return replace(size, instances=files, nodes=size.nodes if PAPER in names else ())


def run(
    size: Size,
    out: Path,
    *,
    keep: bool = False,
    force: bool = False,
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
        Instances that the folder's results hold are not run again. They must have been measured with the same `conditions`.
    force : bool
        Without `keep`: results that the folder holds are replaced.
    progress : callable
        Told in words how far it is.
    parameters : PlannerParameters
        Of all planners; those that are not at their defaults are kept with the results.
    workers, cluster
        See `skyway.models.compute.spreading.spread`; planning times are those of a processor of its own only with one worker.

    Raises
    ------
    InputError
        The folder cannot be written, holds results that are to be kept but were measured otherwise, or results although
        neither `keep` nor `force` is given; or an instance is not what was published.
    """
    make_folder(out, "--output")
    spread_over = {} if cluster is None and workers == 1 else {"workers": cluster or str(workers)}
    facts = {"commit": commit()} | machine() | spread_over | changed(parameters, "planner")
    results = Results(out, facts, conditions(size, parameters))
    if keep:
        results.read()
    elif results.path.exists() and not force:
        remedy = "--resume continues them, --force replaces them; or name another folder: --output"
        raise InputError("holds results already", str(results.path), remedy=remedy)
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
    write_atomically(table, text, force=True)
    return [table, results.path, *pictures]


def conditions(size: Size, parameters: PlannerParameters) -> dict[str, object]:
    """Return what all results of a folder must have in common, besides commit and machine, which are named for each part."""
    return {
        "planners": list(PLANNERS),
        "parameters": changed(parameters, "planner"),
        "most_deliveries": size.deliveries,
        "most_runs": size.runs,
        "most_paper_runs": size.paper_runs,
        "compared_runs": size.compared,
        "time_limit_s": size.time_limit_s,
    }


class Results:
    """What has been measured so far, in a folder's ``planners.json``.

    Parameters
    ----------
    out : Path
        The folder.
    facts : dict of str to str
        Commit and machine.
    conditions : dict
        See `conditions`.
    """

    def __init__(self, out: Path, facts: dict[str, str], conditions: dict[str, object]) -> None:
        self.path = out / "planners.json"
        self.facts = facts
        self.conditions = conditions
        self.rows: list[Row] = []
        self.runs: list[PaperRun] = []
        self.skipped: list[str] = []
        self._kept = facts

    @property
    def paper(self) -> list[PaperRow]:
        """Means of the paper's experiment."""
        return rows(self.runs)

    def read(self) -> None:
        """Take over what the file holds, if there is one; what is measured by another commit is told beside its own.

        Raises
        ------
        InputError
            It cannot be read, or was measured with other `conditions`.
        """
        if not self.path.exists():
            return
        try:
            document = json.loads(read_text(self.path, max_bytes=MAX_BYTES))
        except json.JSONDecodeError as error:
            raise InputError(f"is not JSON: {error}", str(self.path)) from None
        self.rows, self.runs, facts, measured = report.read_results(document, str(self.path))
        self._check_conditions(measured)
        self._kept, self.facts = self.facts, facts

    def _check_conditions(self, measured: Mapping[str, Any]) -> None:
        remedy = "measure with the same options, or into another folder: --output"
        refuse(
            [
                Fault(
                    f"the results in this folder were not measured with {wanted}",
                    str(self.path),
                    field=f"conditions.{name}",
                    value=measured.get(name, "nothing stated"),
                    remedy=remedy,
                )
                for name, wanted in self.conditions.items()
                if measured.get(name) != wanted
            ]
        )

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
        found = report.document(self.rows, self.paper, self.runs, self.facts, self.conditions, self.skipped)
        write_atomically(self.path, json.dumps(found, indent=1, allow_nan=False) + "\n", force=True)


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
