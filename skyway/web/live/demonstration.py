"""The demonstration on the page: a worker makes its plan; its simulation and its flight are separate processes."""

from __future__ import annotations

import asyncio
import sys
import time
from typing import TYPE_CHECKING

from skyway.flights import demonstration
from skyway.models.base.errors import SkywayError

if TYPE_CHECKING:
    from skyway.web.site import Site


LISTENS_S = 30.0
"""Longest time for a simulation to start."""


async def begin_once(site: Site) -> None:
    """Start it unless one is in progress; it departs automatically."""
    under_way = (live for live in site.flights.known().values() if not live.ended)
    if not any(word.endswith(demonstration.PLANNED) for live in under_way for word in live.words):
        try:
            await begin(site, asks=False)
        except SkywayError as error:
            print(f"skyway: the demonstration does not begin: {error}", file=sys.stderr)  # noqa: T201  nobody else is there to be told


async def begin(site: Site, *, asks: bool = True) -> str:
    """Plan it, start the simulation and the flight; returns the name of the flight."""
    folder = site.folder.root.resolve()
    made = await site.workers.ask("demonstrated.prepared", str(folder))
    connect, pads, output = demonstration.simulate(folder, made["depart"])
    end_s = time.monotonic() + LISTENS_S
    while not demonstration.listens(output):
        if time.monotonic() > end_s:
            raise SkywayError(f"the simulation does not start: see {output.name} in the work folder")
        await asyncio.sleep(0.1)
    return site.flights.begin(
        demonstration.options(folder, connect, pads, asks=asks), made["origin"], made["destination"]
    )
