"""Commands ``orders add`` and ``orders list``: orders of a running dispatcher."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import options
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from skyway.models.orders.order import Order

orders = typer.Typer(help="Orders of a fleet that flies.", no_args_is_help=True, rich_markup_mode=None)
orders.callback()(lambda: None)
Holder = Annotated[str, typer.Option(help="Name of the dispatcher.")]
LedgerName = Annotated[
    str, typer.Option(help="Ledger of the dispatcher: a file (SQLite), or postgresql://USER@HOST/DATABASE.")
]


@orders.command("add")
def add(
    ledger: LedgerName,
    file: Annotated[
        Path | None, typer.Argument(help="Orders: CSV or JSON. Default: one order, by the options.")
    ] = None,
    id: Annotated[str | None, typer.Option(help="Unique id of the order.")] = None,  # noqa: A002  the field's word
    start: Annotated[str | None, typer.Option("--from", help="Station id, part of its name, or lat,lon.")] = None,
    to: Annotated[str | None, typer.Option(help="Station id, part of its name, or lat,lon.")] = None,
    mass: Annotated[float | None, typer.Option(help="Mass of the package, kg.")] = None,
    ready: Annotated[str | None, typer.Option(help="Earliest pick-up, with UTC offset.")] = None,
    due: Annotated[str | None, typer.Option(help="Due time of the delivery, with UTC offset.")] = None,
    kind: Annotated[str, typer.Option(help="Contents, for people.")] = "",
    priority: Annotated[int, typer.Option(help="0 to 9; a higher one is served first.")] = 0,
    holder: Holder = "dispatch",
) -> None:
    """Give orders to a running dispatcher; it plans them around flights under way.

    All orders of a file are accepted, or none if one is wrong, its id exists already, a place is unknown or has no pads, or its due time has passed.

    Examples
    --------
      skyway orders add late.csv --ledger ledger.db
      skyway orders add --ledger ledger.db --id serum --from bellevue --to jacobi --mass 0.4 --ready 2013-07-10T15:00-04:00 --due 2013-07-10T17:00-04:00
    """
    from skyway.dispatch.requests import give_orders, refuse_ended
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger
    from skyway.models.orders.files import order_of, read_orders

    typed = {"id": id, "from": start, "to": to, "mass_kg": mass, "ready": ready, "due": due}
    if file is not None and any(one is not None for one in typed.values()):
        raise InputError("a file and the options of one order exclude each other", remedy="give one of them")
    if file is None:
        values = {name: one for name, one in typed.items() if one is not None} | {"kind": kind, "priority": priority}
        found: tuple[Order, ...] = (order_of(values, "the order"),)
    else:
        found = read_orders(file)
    with open_ledger(ledger, create=False) as book:
        desk = Desk(book, holder)
        service = desk.get("service", "service")
        if service is None:
            remedy = "start it first: skyway dispatch run"
            raise InputError("the ledger has no dispatcher of this name", field="--holder", value=holder, remedy=remedy)
        refuse_ended(service)
        known = [one.id for one in found if desk.get("order", one.id) is not None]
        if known:
            raise InputError(
                "these orders exist already", field="id", value=", ".join(known[:5]), remedy="use other ids"
            )
        give_orders(desk, found)
    typer.echo(f"{len(found)} order{'s' if len(found) != 1 else ''} on the desk of {holder}")


@orders.command("list")
def list_orders(ledger: LedgerName, holder: Holder = "dispatch", as_json: options.AsJson = False) -> None:
    """List the orders of a dispatcher with their promises and states.

    Examples
    --------
      skyway orders list --ledger ledger.db
    """
    from skyway.cli.views.fleet_status import print_orders
    from skyway.dispatch.region import Region
    from skyway.dispatch.status import order_document, status_of
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.opening import open_ledger

    with open_ledger(ledger, create=False) as book:
        status = status_of(Desk(book, holder))
    if as_json:
        typer.echo(
            json_text([order_document(name, state, one) for name, (state, one) in status.orders.items()], indent=1)
        )
    else:
        print_orders(status, Region(status.service).base.timezone)
