"""Command ``dispatch plan``: the assignment of orders to the drones of a fleet."""

from __future__ import annotations

import getpass
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.option_groups import with_groups
from skyway.cli.request_options import ConditionOptions, PadOptions
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.ledger import Hold
    from skyway.models.network.station import Station
    from skyway.models.orders.fitting import Work
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.result import DispatchPlan
    from skyway.planner.parameters.planner import PlannerParameters

ANSWER_WALL_S = 30.0
"""Longest wait for the answer of a dispatcher, s of wall time."""
dispatch = typer.Typer(help="Plan for a fleet.", no_args_is_help=True, rich_markup_mode=None)
dispatch.callback()(lambda: None)


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOptions:
    """Orders, drones, and how they are planned and booked."""

    orders: Annotated[Path, typer.Option(help="Orders: CSV or JSON.")]
    fleet: Annotated[Path, typer.Option(help="Drones with their places and charges: CSV or JSON.")]
    ledger: Annotated[
        str | None, typer.Option(help="Book the pads here: a file (SQLite), or postgresql://USER@HOST/DATABASE.")
    ] = None
    holder: Annotated[str, typer.Option(help="Holder of the bookings.")] = "dispatch"
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0
    time_limit: Annotated[float, typer.Option("--time-limit", help="Time limit of the search for a plan, s.")] = 10.0
    iterations: Annotated[
        int,
        typer.Option(
            help="Maximum number of iterations of the search; reproducible if the time limit is not reached.", min=0
        ),
    ] = 10**9
    seed: Annotated[int, typer.Option(help="Random seed.", min=0, max=2**32 - 1)] = 0
    settings: options.Settings = None
    as_json: options.AsJson = False
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the plan to a file.")] = None
    force: options.Force = False

    def read(self, conditions: ConditionOptions, *, most_reserve: float) -> FleetInputs:
        """Read the files, and what is known of the wind.

        Raises
        ------
        InputError
            A file or an option is wrong, or the plan would overwrite a file.
        """
        from skyway.models.orders.fitting import read_work

        options.refuse_overwriting(self.output, force=self.force)
        if conditions.truth is not None:
            remedy = "remove it: fleets are planned with a forecast"
            raise InputError("a fleet is not planned with perfect information", field="--actual-wind", remedy=remedy)
        parameters = typed_values.planner_parameters(self.settings)
        reserve = typed_values.percent(self.reserve, "--reserve", high=most_reserve)
        work = read_work(conditions.loaded(), self.orders, self.fleet)
        known, _ = conditions.winds(work.scenario, conditions.instant, None)
        return FleetInputs(work, conditions.instant, known.forecast, parameters, reserve)

    def show(self, work: Work, made: DispatchPlan) -> None:
        """Print a plan, and write it to a file; exit with 1 where nothing is served."""
        from skyway.cli.views.dispatch import print_dispatch
        from skyway.models.base.files import write_atomically
        from skyway.planner.dispatch.result import document_of

        document = json_text(document_of(made), indent=1)
        if self.output is not None:
            write_atomically(self.output, document + "\n", force=self.force)
        options.say_written(self.output)
        if self.as_json:
            typer.echo(document)
        else:
            print_dispatch(work, made)
        if made.answers and not made.served:
            raise typer.Exit(1)


class FleetInputs(NamedTuple):
    """Values of `FleetOptions`."""

    work: Work
    depart: datetime
    forecast: WindEnsemble
    parameters: PlannerParameters
    reserve: float


@dispatch.command("plan")
@with_groups
def plan(conditions: ConditionOptions, pads: PadOptions, fleet_options: FleetOptions) -> None:
    """Assign orders to the drones of a fleet, with times and stops, and book the pads.

    Each order is served or refused with a reason; the plan includes empty flights and charging. It is simulated in many realizations of wind, energy and
    other drones at the pads: each served order has a probability of delivery by its due time. Exit code 1: no order is served.

    Examples
    --------
      skyway dispatch plan --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00
      skyway dispatch plan --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00 --ledger ledger.db -o day.json
    """
    from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
    from skyway.now import pads_now
    from skyway.planner.promises.booked import plan_fleet

    inputs = fleet_options.read(conditions, most_reserve=95.0)
    seen = NOTHING_SEEN
    if pads.pads is not None:
        found = pads_now(inputs.work.scenario, pads.pads, inputs.depart)
        seen = PadsSeen(found.busy, found.free_s)
        for note in found.notes:
            typer.echo(note, err=True)
    made = plan_fleet(
        inputs.work, inputs.depart, inputs.forecast, inputs.parameters, reserve=inputs.reserve, time_limit_s=fleet_options.time_limit,
        iterations=fleet_options.iterations, seed=fleet_options.seed, ledger=fleet_options.ledger, holder=fleet_options.holder, seen=seen,
    )  # fmt: skip
    fleet_options.show(inputs.work, made)


@dispatch.command("tours")
@with_groups
def tours(
    conditions: ConditionOptions,
    fleet_options: FleetOptions,
    fewest_drones: Annotated[
        bool,
        typer.Option(
            "--fewest-drones", help="Minimize the number of drones that serve all orders, whatever their time."
        ),
    ] = False,
) -> None:
    """Plan tours: each drone leaves its station once, with several packages on board, charges on the way, and returns.

    A drone carries what its payload allows; every package is delivered by its due time, or refused with a reason. Exit code 1: none is served.

    Examples
    --------
      skyway dispatch tours --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00
      skyway dispatch tours --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00 --ledger ledger.db -o tours.json
    """
    from skyway.planner.promises.booked import booked
    from skyway.planner.tours.plan import plan_tours

    inputs = fleet_options.read(conditions, most_reserve=75.0)

    def planned(holds: Sequence[Hold]) -> DispatchPlan:
        return plan_tours(
            inputs.work, inputs.depart, forecast=inputs.forecast, holds=holds, reserve=inputs.reserve, time_limit_s=fleet_options.time_limit,
            iterations=fleet_options.iterations, seed=fleet_options.seed, fewest_drones=fewest_drones, parameters=inputs.parameters,
        )  # fmt: skip

    made = booked(planned, inputs.work, inputs.depart, ledger=fleet_options.ledger, holder=fleet_options.holder, time_limit_s=fleet_options.time_limit)  # fmt: skip
    fleet_options.show(inputs.work, made)


Holder = Annotated[str, typer.Option(help="Name of the dispatcher, which holds the bookings.")]
LedgerName = Annotated[str, typer.Option(help="Ledger: a file (SQLite), or postgresql://USER@HOST/DATABASE.")]


@dispatch.command("run")
def run(
    ledger: LedgerName,
    orders: Annotated[Path | None, typer.Option(help="Initial orders: CSV or JSON.")] = None,
    fleet: Annotated[
        Path | None, typer.Option(help="Drones with their places and charges: CSV or JSON. Required the first time.")
    ] = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Fly simulated drones, as fast as the machine can.")
    ] = False,
    scenario: Annotated[Path | None, typer.Option(help="Scenario folder. Default: the built-in one.")] = None,
    depart: Annotated[str | None, typer.Option(help="Start of the service, with UTC offset. Default: now.")] = None,
    wind: Annotated[
        str | None, typer.Option(help="One constant wind as the forecast, m/s@degrees FROM: 8@270.")
    ] = None,
    actual_wind: Annotated[
        str | None,
        typer.Option("--actual-wind", help="True wind of the simulation: 8@270, or a day of the record."),
    ] = None,
    notice: Annotated[
        float | None,
        typer.Option(
            help="Simulate that each order arrives this long before it is ready, min. Default: all at once.",
            min=0.0,
            max=10080.0,
        ),
    ] = None,
    workers: Annotated[int, typer.Option(help="Worker processes, of up to 50 flights each.", min=1, max=64)] = 1,
    hours: Annotated[
        float | None,
        typer.Option(
            help="End after this time. Default: once all orders are closed and all drones stand.", min=0.01, max=8760.0
        ),
    ] = None,
    holder: Holder = "dispatch",
    folder: Annotated[Path, typer.Option(help="Where journals and logs go: a new folder for each new service.")] = Path(
        "flights"
    ),
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    time_limit: Annotated[
        float, typer.Option("--time-limit", help="Time limit of the search for each plan, s.", min=0.01, max=3600.0)
    ] = 2.0,
    iterations: Annotated[
        int, typer.Option(help="Maximum number of iterations of the search for each plan.", min=0)
    ] = 10**9,
    lease: Annotated[float, typer.Option(help="Lifetime of leases without renewal, s.")] = 10.0,
    seed: Annotated[int, typer.Option(help="Random seed of the simulation.", min=0, max=2**32 - 1)] = 1,
    traffic: Annotated[bool, typer.Option(help="Simulate other drones at the pads.")] = True,
    http: Annotated[
        str | None,
        typer.Option(help="Serve the HTTP API at HOST:PORT; access from other machines needs a token (SKYWAY_TOKEN)."),
    ] = None,
    settings: options.Settings = None,
) -> None:
    """Run a fleet: take orders, plan, book the pads, fly, and replan around flights under way.

    The ledger stores the state of the service: started again with the same
    ledger and holder, the service resumes. Orders come with --orders, skyway orders add, and the HTTP API; skyway dispatch status shows its state.

    Examples
    --------
      skyway dispatch run --simulate --ledger ledger.db --orders orders.csv --fleet fleet.csv --depart 2013-07-10T14:00-04:00
      skyway dispatch run --simulate --ledger ledger.db --fleet fleet.csv --hours 24 --workers 4 --http 127.0.0.1:8090
    """
    from skyway.dispatch.service import Options, Service
    from skyway.dispatch.status import outcome
    from skyway.models.compute.worker_processes import hold_lifeline
    from skyway.models.orders.files import read_both

    hold_lifeline()
    if not simulate:
        remedy = "give --simulate; a single real drone is flown by skyway fly"
        raise InputError("fleets of real drones are not flown yet", field="--simulate", remedy=remedy)
    if not 0.5 <= lease <= 3600.0:
        raise InputError("out of range", field="--lease", value=lease, remedy="0.5 to 3600 s")
    typed_values.planner_parameters(settings)
    ordered, drones = read_both(orders, fleet)
    inputs = Options(
        ledger=ledger, dispatcher=holder, folder=folder, begin_s=typed_values.parse_depart(depart).timestamp(),
        orders=ordered, fleet=drones,
        scenario=None if scenario is None else str(scenario.resolve()), wind=wind, actual_wind=actual_wind,
        reserve=typed_values.percent(reserve, "--reserve", high=95.0), workers=workers, ttl_s=lease, plan_s=time_limit,
        iterations=iterations, lasts_s=None if hours is None else hours * 3600.0, seed=seed, strangers=traffic,
        settings=tuple(settings or ()), notice_s=None if notice is None else 60.0 * notice, say=typer.echo,
    )  # fmt: skip
    service = Service(inputs)
    if http is not None:
        from skyway.dispatch.http_api import serve_in_background

        typer.echo(f"HTTP API: {serve_in_background(ledger, holder, http)}/openapi.json")
    service.run()
    for line in outcome(ledger, holder):
        typer.echo(line)


@dispatch.command("demo")
def demo(
    drones: Annotated[int, typer.Option(help="Drones of the fleet.", min=1, max=250)] = 50,
    rate: Annotated[float, typer.Option("--rate", help="Orders per hour.", min=1.0, max=2000.0)] = 60.0,
    hours: Annotated[float, typer.Option(help="Hours of order arrivals.", min=0.05, max=24.0)] = 1.0,
    workers: Annotated[int, typer.Option(help="Worker processes, of up to 50 flights each.", min=1, max=64)] = 2,
    seed: Annotated[int, typer.Option(help="Random seed of orders, drones and simulation.", min=0, max=2**32 - 1)] = 1,
    port: Annotated[int, typer.Option(help="Port of the page.", min=0, max=65535)] = 8080,
    page: Annotated[bool, typer.Option(help="Show the fleet on the page, until Ctrl-C.")] = True,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for orders, fleet, ledger and journals.")
    ] = Path("out/demo-fleet"),
) -> None:
    """Fly a simulated fleet in New York, in the wind of a day that was not forecast, and show it on the page.

    Orders arrive over time; other drones charge at the pads, too. Without the page the command ends with the status of the fleet.

    Examples
    --------
      skyway dispatch demo
      skyway dispatch demo --drones 10 --rate 12 --no-page -o out/small
    """
    from skyway.dispatch.demonstration import FleetDemo, run_demo

    def show(at: str) -> None:
        from skyway.web.server import ServeOptions, serve

        serve(
            ServeOptions(folder=output, port=port, begins_at=at, ends="the page and its fleet"),
            lambda words: typer.echo(words, err=True),
        )

    wanted = FleetDemo(folder=output, drones=drones, rate_per_h=rate, hours=hours, workers=workers, seed=seed)
    run_demo(wanted, typer.echo, show=show if page else None)


@dispatch.command("worker", hidden=True)
def worker(
    ledger: LedgerName,
    holder: Holder = "dispatch",
    number: Annotated[int, typer.Option(help="Number of this worker.")] = 1,
) -> None:
    """Supervise flights of a service; skyway dispatch run starts it."""
    from skyway.dispatch.worker import work
    from skyway.models.compute.worker_processes import hold_lifeline

    hold_lifeline()
    work(ledger, holder, number)


@dispatch.command("world", hidden=True)
def world(ledger: LedgerName, holder: Holder = "dispatch") -> None:
    """Simulate the world of a service; skyway dispatch run starts it."""
    from skyway.dispatch.simulation import simulate as run_world
    from skyway.models.compute.worker_processes import hold_lifeline

    hold_lifeline()
    run_world(ledger, holder)


@dispatch.command("status")
def status(
    ledger: LedgerName,
    holder: Holder = "dispatch",
    as_prometheus: Annotated[
        bool, typer.Option("--prometheus", help="Figures in the text format of Prometheus.")
    ] = False,
    as_json: options.AsJson = False,
) -> None:
    """Show the status of a fleet: first what needs a person, then orders, drones, and changed promises with reasons.

    Examples
    --------
      skyway dispatch status --ledger ledger.db
      skyway dispatch status --ledger ledger.db --prometheus
    """
    from skyway.cli.views.fleet_status import print_status
    from skyway.dispatch.region import Region
    from skyway.dispatch.status import document_of, prometheus, status_of
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger

    if as_json and as_prometheus:
        raise InputError("--json and --prometheus exclude each other", remedy="give one of them")
    with open_ledger(ledger, create=False) as book:
        found = status_of(Desk(book, holder))
    if as_json:
        typer.echo(json_text(document_of(found), indent=1))
    elif as_prometheus:
        typer.echo(prometheus(found), nl=False)
    else:
        print_status(found, Region(found.service).base.timezone)


@dispatch.command("close")
def close(
    station: Annotated[str, typer.Argument(help="Station id.")],
    pad: Annotated[int, typer.Argument(help="Number of the pad, from 1.", min=1)],
    ledger: LedgerName,
    until: Annotated[str, typer.Option(help="End of the closure, with UTC offset.")],
    begin: Annotated[
        str | None, typer.Option("--from", help="Start of the closure, with UTC offset. Default: now.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Reason, for people.")] = "",
    holder: Holder = "dispatch",
) -> None:
    """Report a pad as out of order: the dispatcher replans around it.

    Examples
    --------
      skyway dispatch close bellevue 2 --ledger ledger.db --until 2013-07-10T18:00-04:00
    """
    from skyway.dispatch.records import PadRecord
    from skyway.dispatch.requests import close_pad
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger

    with open_ledger(ledger, create=False) as book:
        desk = Desk(book, holder)
        now_s, found = _at(desk, station, pad)
        end_s = typed_values.parse_time(until, "--until").timestamp()
        begin_s = now_s if begin is None else typed_values.parse_time(begin, "--from").timestamp()
        if end_s <= begin_s:
            raise InputError("is not after the beginning", field="--until", value=until)
        record = PadRecord(station=found.id, pad=pad, from_s=begin_s, until_s=end_s, reason=reason)
        close_pad(desk, record)
    typer.echo(f"pad {pad} of {found.id} is out of order until {until}")


@dispatch.command("open")
def open_(
    station: Annotated[str, typer.Argument(help="Station id.")],
    ledger: LedgerName,
    pad: Annotated[int | None, typer.Argument(help="Number of the pad, from 1. Default: all pads.", min=1)] = None,
    holder: Holder = "dispatch",
) -> None:
    """Open closed pads again before their closures end: the dispatcher uses them with its next plan.

    Examples
    --------
      skyway dispatch open bellevue --ledger ledger.db
      skyway dispatch open bellevue 2 --ledger ledger.db
    """
    from skyway.dispatch.requests import open_pads
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger

    with open_ledger(ledger, create=False) as book:
        desk = Desk(book, holder)
        now_s, found = _at(desk, station, pad)
        opened = open_pads(desk, found.id, pad, now_s, _user())
    for number in opened:
        typer.echo(f"pad {number} of {found.id} is open again")
    if not opened:
        typer.echo(
            f"{'no pad' if pad is None else f'pad {pad}'} of {found.id} is {'' if pad is None else 'not '}out of order"
        )


@dispatch.command("cancel")
def cancel(
    order: Annotated[str, typer.Argument(help="Order id.")], ledger: LedgerName, holder: Holder = "dispatch"
) -> None:
    """Cancel an order whose package is not aboard a drone; a drone that flies to the package stays where it stands or lands next, and is then free.

    The command waits up to 30 s for the answer of a running dispatcher. Exit code 2: the order cannot be cancelled.

    Examples
    --------
      skyway dispatch cancel serum --ledger ledger.db
    """
    from skyway.dispatch.requests import cancel_order, cancellation_told
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger

    with open_ledger(ledger, create=False) as book:
        desk = Desk(book, holder)
        if cancel_order(desk, order, _user()) != "asked":
            typer.echo(f"{order} was already cancelled")
            return
        end_s = time.monotonic() + ANSWER_WALL_S
        waits, words = cancellation_told(desk, order)
        while waits and time.monotonic() < end_s:
            time.sleep(0.1)
            waits, words = cancellation_told(desk, order)
    typer.echo(f"{words}, skyway orders list shows the order" if waits else words)


def _at(desk: Desk, station: str, pad: int | None) -> tuple[float, Station]:
    """Return the time of a running service, POSIX seconds, and the station that a text names; it must have the pad."""
    from skyway.dispatch.region import Region
    from skyway.dispatch.requests import refuse_ended
    from skyway.dispatch.status import status_of

    status = status_of(desk)
    refuse_ended(desk.get("service", "service"))
    network = Region(status.service).base.network
    found = network.stations[network.find(station)]
    if pad is not None and pad > found.pads:
        raise InputError("the station has no such pad", field="pad", value=pad, remedy=f"1 to {found.pads}")
    return status.now_s, found


def _user() -> str:
    """Return the name of the user, for people."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "an operator"
