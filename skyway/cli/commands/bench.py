"""Commands ``bench planners`` and ``settings``, for researchers."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import skyway
from skyway import typed_values
from skyway.cli import options
from skyway.cli.commands.shared_work import Cluster
from skyway.cli.views.sheet import Column, Sheet
from skyway.models.base.errors import InputError

bench = typer.Typer(help="Measure planners.", no_args_is_help=True, rich_markup_mode=None)
bench.callback()(lambda: None)


@bench.command("planners")
def planners(
    quick: Annotated[bool, typer.Option("--quick", help="Run a small part: half a minute.")] = False,
    out: Annotated[Path, typer.Option("--output", "-o", help="Folder for the table, figures and pictures.")] = Path(
        "out/bench"
    ),
    instances: Annotated[
        list[str] | None,
        typer.Option(
            "--instance", help="Only instances whose names begin so, or paper: the paper's experiment; repeatable."
        ),
    ] = None,
    settings: options.Settings = None,
    keep: Annotated[
        bool,
        typer.Option(
            "--resume", help="Continue: keep the results that the folder holds, measured with the same options."
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the results that the folder holds.")] = False,
    workers: Annotated[
        int,
        typer.Option(
            help="Processes. With more than one, planning times are those of a busy machine.", min=1, max=1024
        ),
    ] = 1,
    cluster: Cluster = None,
) -> None:
    """Measure all planners, in the paper's experiment and on held-out days of wind.

    Writes a table (planners.md), all figures (planners.json) and pictures (SVG) into a folder. It takes about
    20 minutes; with --quick, half a minute. What is measured: docs/explanation/evaluation.md.

    Examples
    --------
      skyway bench planners --quick
      skyway bench planners --output results --resume
      skyway bench planners --instance new-york-0.5 --instance paper --output results
      skyway bench planners --workers 8
    """
    parameters = typed_values.planner_parameters(settings)
    module = _benchmark()
    size = module.chosen(module.QUICK if quick else module.FULL, instances or [])
    written = module.run(
        size, out, keep=keep, force=force, parameters=parameters, workers=workers, cluster=cluster
    )  # fmt: skip
    for path in written:
        typer.echo(str(path))


def _benchmark() -> Any:
    """Import the benchmark; it stands beside the packages in a checkout and is in no wheel."""
    root = Path(skyway.__file__).resolve().parent.parent
    if not (root / "benchmarks" / "planners" / "bench_planners.py").is_file():
        remedy = "clone the repository and install it with: pip install -e ."
        raise InputError("the benchmarks come with the source, not with the installed package", remedy=remedy)
    if str(root) not in sys.path:
        sys.path.append(str(root))
    return importlib.import_module("benchmarks.planners.bench_planners")


def settings(
    name: Annotated[str, typer.Argument(help="Only settings whose name begins with this.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON.")] = False,
) -> None:
    """List the tuned parameters of planners and filters, with default, unit, range and the measurement behind them.

    Set them for one command with --set name=value.

    Examples
    --------
      skyway settings
      skyway settings planner.robust --json
    """
    from dataclasses import asdict

    from skyway.models.base.json_text import json_text
    from skyway.models.base.parameters import entries, text_of
    from skyway.settings import Settings

    chosen = [one for one in entries(Settings()) if one.name.startswith(name)]
    if not chosen:
        raise InputError("no setting begins with this", field="name", value=name, remedy="skyway settings lists them")
    if as_json:
        typer.echo(json_text({"schema": "skyway.settings/1", "settings": [asdict(one) for one in chosen]}, indent=1))
        return
    columns = [Column(head, justify="left") for head in ("name", "default", "unit", "range", "meaning")]
    sheet = Sheet(columns, names=1)
    for one in chosen:
        sheet.add(one.name, text_of(one.default), one.unit, one.range_text, one.meaning)
    sheet.show()
