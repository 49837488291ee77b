"""``skyway watch``: the live table of all vehicles on a connection."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from skyway.cli import options
from skyway.cli.connection_options import Line
from skyway.cli.option_groups import with_groups
from skyway.models.base.errors import InputError, VehicleTimeoutError


@with_groups
def watch(
    link: Line,
    lasting: Annotated[
        float | None, typer.Option("--duration", help="End after this time, s. Without it: at Ctrl-C.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Watch all vehicles on a connection: position, charge, wind, mode, link. Ctrl-C ends it.

    Where the output is not a terminal, one line per second and vehicle is printed.

    Examples
    --------
      skyway watch --connect udpin:127.0.0.1:14540
      skyway watch --connect tcp:127.0.0.1:5760 --duration 10 --json
    """
    from skyway.cli.views.watch import Watched, show

    if lasting is not None and not 0.0 < lasting < math.inf:
        raise InputError("out of range", field="--duration", value=lasting, remedy="seconds, above 0")
    with link.opened() as connection:
        watched = Watched(connection)
        begun_s = connection.clock.now_s()
        try:
            show(watched, math.inf if lasting is None else begun_s + lasting, as_json=as_json)
        except KeyboardInterrupt:
            typer.echo("", err=True)
        if not watched.vehicles:
            raise VehicleTimeoutError("no heartbeat", connection.clock.now_s() - begun_s)
