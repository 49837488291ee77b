"""Command ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skyway.cli import options
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text
from skyway.scenarios import load_scenario


def report(
    journal: Annotated[Path, typer.Argument(help="Journal, as written by skyway fly.")],
    log: Annotated[
        list[Path] | None, typer.Option(help="Recording of the flight (.tlog), for finer telemetry; repeatable.")
    ] = None,
    plan: Annotated[Path | None, typer.Option(help="Plan to compare with. Default: the journal's.")] = None,
    scenario: Annotated[Path | None, typer.Option(help="Scenario folder of the flight, for its no-fly zones.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Output page. Default: report.html.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of map, charge and wind: FILE.svg.")] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Write a report of a flight from its journal: what was planned, what happened, and why.

    The report is one HTML page that needs no network and no other file. Interrupted flights are reported, too. With --json
    the figures are printed, and no page is written unless -o names one.

    Examples
    --------
      skyway report recordings/delivery.jsonl
      skyway report out/demo/journal.jsonl --log out/demo/flight.tlog -o flight.html
      skyway report out/demo/journal.jsonl --json
    """
    from skyway.report.report import flight, write_report

    page = output or (None if as_json and plot is None else Path("report.html"))
    if plot is not None and plot.suffix.lower() != ".svg":
        raise InputError("is not a picture file", str(plot), field="--plot", remedy="FILE.svg")
    options.refuse_overwriting(page, plot, force=force)
    where = None if scenario is None else load_scenario(scenario)
    if page is None:
        document = flight(journal, logs=log or (), plan=plan)
    else:
        document = write_report(journal, page, logs=log or (), plan=plan, scenario=where, plot=plot, force=force)
    if as_json:
        typer.echo(json_text(document))
        return
    outcome = document.outcome
    ended = outcome.state if outcome.ended else f"not ended (journal stops in the state {outcome.state})"
    typer.echo(f"{ended}: {outcome.reason or 'no reason recorded'}")
    typer.echo(str(page))
    options.say_written(plot)
