"""Command ``dispatch plan``: which drone of a fleet takes which order when."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.option_groups import with_groups
from skyway.cli.request_options import ConditionOptions
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text

dispatch = typer.Typer(help="Plan for a fleet.", no_args_is_help=True, rich_markup_mode=None)
dispatch.callback()(lambda: None)


@dispatch.command("plan")
@with_groups
def plan(
    conditions: ConditionOptions,
    orders: Annotated[Path, typer.Option(help="Orders: CSV or JSON.")],
    fleet: Annotated[Path, typer.Option(help="Drones as they stand: CSV or JSON.")],
    ledger: Annotated[
        str | None, typer.Option(help="Book the pads here: a file (SQLite), or postgresql://USER@HOST/DATABASE.")
    ] = None,
    holder: Annotated[str, typer.Option(help="In whose name pads are booked.")] = "dispatch",
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    time_limit: Annotated[float, typer.Option("--time-limit", help="Time to better the plan, s.")] = 10.0,
    iterations: Annotated[
        int, typer.Option(help="Changes to try at most; with enough time the same plan comes out each time.", min=0)
    ] = 10**9,
    seed: Annotated[int, typer.Option(help="Random seed.", min=0, max=2**32 - 1)] = 0,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the plan to a file.")] = None,
    force: options.Force = False,
) -> None:
    """Plan which drone of a fleet takes which order when, by which stops, and book the pads.

    Each order is served or refused with a reason; empty flights and charges are planned with it. Exit code 1: none is served.

    Examples
    --------
      skyway dispatch plan --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00
      skyway dispatch plan --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00 --ledger ledger.db -o day.json
    """
    from skyway.cli.views.dispatch import print_dispatch
    from skyway.models.base.files import write_atomically
    from skyway.models.orders.files import read_orders, read_vehicles
    from skyway.models.orders.fitting import fit
    from skyway.planner.dispatch.booked import plan_fleet
    from skyway.planner.dispatch.result import document_of

    options.refuse_overwriting(output, force=force)
    if conditions.truth is not None:
        remedy = "leave it out: fleets are planned with a forecast"
        raise InputError("a fleet is not planned with perfect information", field="--actual-wind", remedy=remedy)
    parameters = typed_values.planner_parameters(settings)
    least = typed_values.percent(reserve, "--reserve", high=95.0)
    scenario = conditions.loaded()
    work = fit(scenario, read_orders(orders), read_vehicles(fleet))
    depart = conditions.instant
    known, _ = conditions.winds(work.scenario, depart, None)
    made = plan_fleet(
        work, depart, known.forecast, parameters,
        reserve=least, time_limit_s=time_limit, iterations=iterations, seed=seed, ledger=ledger, holder=holder,
    )  # fmt: skip
    document = json_text(document_of(made), indent=1)
    if output is not None:
        write_atomically(output, document + "\n", force=force)
    options.say_written(output)
    if as_json:
        typer.echo(document)
    else:
        print_dispatch(work, made)
    if made.answers and not made.served:
        raise typer.Exit(1)
