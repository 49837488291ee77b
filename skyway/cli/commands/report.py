"""The command that tells what became of a flight: ``report``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from skyway.cli import options
from skyway.cli.log_options import AsJson, Force
from skyway.models.base.errors import Fault, InputError
from skyway.scenarios import load_scenario

REPORT_HELP = """Make a page of a flight from its journal: what was planned, what happened, and why.

The page needs no network and no other file. It is made also of a flight that was broken off. With --json the figures
are printed instead, and no page is written unless -o names one.

\b
Examples:
  skyway report recordings/delivery.jsonl
  skyway report out/demo/journal.jsonl --log out/demo/flight.tlog -o flight.html
  skyway report out/demo/journal.jsonl --json
"""

JournalFile = Annotated[Path, typer.Argument(help="Journal, as skyway fly writes it.", show_default=False)]
Recording = Annotated[
    list[Path] | None,
    typer.Option("--log", help="Recording of the flight (.tlog): finer telemetry; repeatable.", show_default=False),
]
PlanFile = Annotated[
    Path | None, typer.Option("--plan", help="Compare with this plan, not with the journal's.", show_default=False)
]
ScenarioFolder = Annotated[
    Path | None,
    typer.Option("--scenario", help="Scenario folder of the flight: its no-fly zones are drawn.", show_default=False),
]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="The page; without it, report.html.", show_default=False),
]

Plot = Annotated[
    Path | None,
    typer.Option("--plot", help="Draw map, charge and wind: FILE.svg; with a page.", show_default=False),
]


def report(
    journal: JournalFile,
    log: Recording = None,
    plan: PlanFile = None,
    scenario: ScenarioFolder = None,
    output: Output = None,
    plot: Plot = None,
    as_json: AsJson = False,
    force: Force = False,
) -> None:
    """Make a page of a flight (the help text is `REPORT_HELP`)."""
    from skyway.report.report import flight, write_report

    page = output or (None if as_json and plot is None else Path("report.html"))
    if plot is not None and plot.suffix.lower() != ".svg":
        raise InputError(Fault("is no name of a picture", str(plot), field="--plot", remedy="FILE.svg"))
    options.refuse_overwriting(page, plot, force=force)
    where = None if scenario is None else load_scenario(scenario)
    if page is None:
        document = flight(journal, logs=log or (), plan=plan)
    else:
        document = write_report(journal, page, logs=log or (), plan=plan, scenario=where, plot=plot, force=force)
    if as_json:
        typer.echo(json.dumps(document, allow_nan=False))
        return
    outcome = document["outcome"]
    ended = outcome["state"] if outcome["ended"] else f"not ended ({outcome['state']})"
    typer.echo(f"{ended}: {outcome['reason'] or 'no reason is told'}")
    typer.echo(str(page))
    options.say_written(plot)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", help=REPORT_HELP)(report)
