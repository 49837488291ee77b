"""Command ``study capacity``: how many orders an hour a network carries, and what would help most."""

from __future__ import annotations

import time
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.commands.shared_work import Cluster, Workers, processes, progress
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text

study = typer.Typer(help="Study a network over many simulated days.", no_args_is_help=True, rich_markup_mode=None)
study.callback()(lambda: None)
MOST_DAYS = 100_000


@study.command("capacity")
def capacity(
    scenario: options.ScenarioArgument = None,
    depart: Annotated[
        str | None, typer.Option(help="Start of the orders, with UTC offset: hour and season. Default: now.")
    ] = None,
    rates: Annotated[str, typer.Option(help="Orders per hour to try: 10,20,40.")] = "10,20,40,60,80",
    promise: Annotated[str, typer.Option(help="Time from ready to due, min: 60,90.")] = "90",
    drones: Annotated[str, typer.Option(help="Sizes of the fleet: 20,50.")] = "50",
    drone: Annotated[str | None, typer.Option(help="Model of the drones. Default: the first of the scenario.")] = None,
    hours: Annotated[float, typer.Option(help="Hours of order arrivals each day.", min=0.5, max=12.0)] = 3.0,
    days: Annotated[int, typer.Option(help="Simulated days of each case.", min=2, max=MOST_DAYS)] = 20,
    level: Annotated[float, typer.Option(help="Required share of orders delivered as promised, percent.")] = 90.0,
    within: Annotated[
        float,
        typer.Option(
            help="Greatest distance of a delivery, km; to the nearest station where none is within.",
            min=1.0,
            max=1000.0,
        ),
    ] = 20.0,
    orders: Annotated[
        Path | None, typer.Option(help="Orders from which places and packages are sampled, instead of random stations.")
    ] = None,
    more: Annotated[bool, typer.Option(help="Also try one more pad, station and drone.")] = True,
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    iterations: Annotated[int, typer.Option(help="Iterations of the search for the plan of each day.", min=0)] = 0,
    workers: Workers = None,
    cluster: Cluster = None,
    seed: Annotated[int, typer.Option(help="Random seed.", min=0, max=2**31 - 1)] = 0,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write all figures to a file (JSON).")] = None,
    picture: Annotated[Path | None, typer.Option("--plot", help="Draw FILE.svg, .png or .pdf.")] = None,
    force: options.Force = False,
) -> None:
    """Find how many orders per hour a network can serve, by promised time and fleet size, and which addition helps most.

    Each simulated day has orders, drones, other drones at the pads, and the wind of a day of the record that is held out of its forecast. All orders of a day are
    known when it is planned, and drones begin it with 50 to 100 % of charge: with more --hours a network carries fewer orders per hour. Days are spread over
    processes, or a Dask cluster; the number of processes does not change the figures.

    Examples
    --------
      skyway study capacity --depart 2013-07-10T14:00-04:00
      skyway study capacity --depart 2013-07-10T14:00-04:00 --rates 20,40,80,120 --promise 60,90 --drones 50,100 --days 100 --plot carries.svg
      skyway study capacity --depart 2013-07-10T14:00-04:00 --cluster tcp://127.0.0.1:8786 -o carries.json
    """
    from skyway.cli.commands.fleet.capacity_view import print_capacity
    from skyway.models.base.files import write_atomically
    from skyway.models.compute.spreading import spread
    from skyway.models.orders.files import read_orders
    from skyway.planner.capacity.day import Study, simulate
    from skyway.planner.capacity.demand import Demand, pattern_of
    from skyway.planner.capacity.study import document_of, find_capacity
    from skyway.planner.problem.problem import HORIZON_H
    from skyway.plots.pictures import check_format
    from skyway.scenarios import load_scenario

    for path in (output, picture):
        options.refuse_overwriting(path, force=force)
    if picture is not None:
        check_format(picture, "--plot")
    tried = numbers(rates, "--rates", 0.1, 100_000.0)
    promises_s = [60.0 * one for one in numbers(promise, "--promise", 1.0, 24 * 60.0)]
    fleets = [int(one) for one in numbers(drones, "--drones", 1.0, 10_000.0, whole=True)]
    if not 0.0 < level < 100.0:
        raise InputError("out of range", field="--level", value=level, remedy="percent, above 0 and below 100")
    wanted = typed_values.percent(level, "--level")
    world = load_scenario(scenario)
    with typed_values.as_typed():
        model = world.drone(drone) if drone is not None else world.drones[0]
    begin = typed_values.parse_depart(depart)
    with typed_values.named("--depart"):
        known = world.analogues(begin, HORIZON_H).labels
    demand = Demand(
        most_per_h=max(tried), hours=hours, within_m=1000.0 * within,
        pattern=() if orders is None else pattern_of(world, read_orders(orders), model),
    )  # fmt: skip
    asked = Study(
        scenario=None if scenario is None else Path(scenario).resolve(), digest=world.sha256 or "", begin=begin, demand=demand, drone=model.id,
        days=shuffled([date.fromisoformat(one) for one in known], seed), reserve=typed_values.percent(reserve, "--reserve", high=95.0),
        iterations=iterations, seed=seed, parameters=typed_values.planner_parameters(settings),
    )  # fmt: skip
    begun = time.monotonic()
    found = find_capacity(
        asked, tried, promises_s, fleets, days=days, level=wanted, network=world.network if more else None,
        run=lambda pieces: spread(
            partial(simulate, load=load_scenario), pieces, workers=processes(workers), cluster=cluster,
            told=progress("days simulated"),
        ),
    )  # fmt: skip
    document = json_text(document_of(found), indent=1)
    if output is not None:
        write_atomically(output, document + "\n", force=force)
    if picture is not None:
        from skyway.plots.capacity import plot_capacity

        plot_capacity(found, picture)
    for path in (output, picture):
        options.say_written(path)
    if as_json:
        typer.echo(document)
    else:
        print_capacity(found, time.monotonic() - begun)


def numbers(text: str, option: str, low: float, high: float, *, whole: bool = False) -> list[float]:
    """Return numbers as typed, separated by commas, in order."""
    try:
        found = sorted({float(one) for one in text.split(",")})
    except ValueError:
        found = []
    if not found or not all(low <= one <= high and not (whole and one % 1.0) for one in found):
        remedy = f"{'whole ' if whole else ''}numbers from {low:g} to {high:g}, separated by commas"
        raise InputError("are not such numbers", field=option, value=text, remedy=remedy)
    return found


def shuffled(days: list[date], seed: int) -> tuple[date, ...]:
    """Return days in the order in which they are simulated."""
    import numpy as np

    return tuple(days[int(one)] for one in np.random.default_rng(seed).permutation(len(days)))
