"""Vehicles that are heard: one watch for each connection, in a process of its own, and one digest of all of them.

Nothing is commanded here. Supervised flights are processes of their own, too: see `skyway.web.live.flights`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError, SkywayError
from skyway.web.live.runs import Run

if TYPE_CHECKING:
    from skyway.web.site import Site

MOST_WATCHES = 16
GONE_S = 300.0
"""A vehicle that was heard no later is left out of the digest."""
FRESH_S = 900.0
"""A journal written to within so long belongs to a flight under way."""


class Fleet:
    """All that is heard, on all connections."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.runs: dict[str, Run] = {}
        self._tasks: dict[str, asyncio.Task[int]] = {}
        self._vehicles: dict[tuple[str, int], dict[str, Any]] = {}
        self._deliveries: tuple[float, list[dict[str, Any]]] = (0.0, [])

    def watch(self, connection: str) -> None:
        """Listen on a connection, until it is told to stop or nothing can be heard there any more."""
        if not connection or connection.startswith("-") or len(connection) > 200:
            raise InputError(
                "is not a connection", field="--connect", value=connection, remedy="such as udpin:127.0.0.1:14550"
            )
        if connection in self.runs:
            raise InputError("is watched already", field="--connect", value=connection)
        if len(self.runs) >= MOST_WATCHES:
            raise InputError(
                "too many connections are watched", field="--connect", value=connection, remedy="stop one of them"
            )
        run = Run(["watch", "--connect", connection, "--json"], lambda line: self.heard(connection, line))
        self.runs[connection] = run
        self._tasks[connection] = asyncio.ensure_future(run.finished())

    def stop(self, connection: str) -> None:
        """Stop to listen."""
        run = self.runs.pop(connection, None)
        if run is not None:
            run.stop()
        self._vehicles = {key: row for key, row in self._vehicles.items() if key[0] != connection}

    def stop_all(self) -> None:
        """End all watches: they only listen."""
        for connection in list(self.runs):
            self.stop(connection)

    def heard(self, connection: str, line: str) -> None:
        """Take a line of ``skyway watch --json``."""
        with contextlib.suppress(ValueError, TypeError, AttributeError):
            told = json.loads(line)
            rows = told.get("vehicles", [told]) if isinstance(told, dict) else told
            for row in rows:
                if isinstance(row, dict) and isinstance(row.get("system"), int):
                    self._vehicles[connection, row["system"]] = row | {"heard_s": time.monotonic()}

    async def digest(self) -> dict[str, Any]:
        """Return one document for everything: vehicles, watches, deliveries under way."""
        now_s = time.monotonic()
        self._vehicles = {key: row for key, row in self._vehicles.items() if now_s - row["heard_s"] < GONE_S}
        vehicles = [
            {name: value for name, value in row.items() if name != "heard_s"}
            | {"connection": connection, "age_s": round(now_s - row["heard_s"], 1)}
            for (connection, _), row in self._vehicles.items()
        ]
        watches = [
            {
                "connection": connection,
                "ended": run.code is not None,
                "said": run.lines[-1][:300] if run.code is not None and run.lines else "",
            }
            for connection, run in self.runs.items()
        ]
        return {
            "vehicles": vehicles,
            "watches": watches,
            "deliveries": await self._under_way(now_s),
            "flights": self.site.flights.digest(),
        }

    async def _under_way(self, now_s: float) -> list[dict[str, Any]]:
        """Deliveries whose journal is being written; looked at once a second, however many browsers ask."""
        asked_s, known = self._deliveries
        if now_s - asked_s < 1.0:
            return known
        self._deliveries = (now_s, known)
        wall_s = time.time()
        fresh = [
            (one.name, one.modified_s, one.size)
            for one in self.site.folder.files(".jsonl")
            if wall_s - one.modified_s < FRESH_S and one.name.removesuffix(".jsonl") not in self.site.flights.known()
        ]
        if fresh:
            try:
                known = await self.site.workers.ask(
                    "flights.standing", str(self.site.folder.root.resolve()), fresh[:50]
                )
            except SkywayError:
                known = []
        self._deliveries = (now_s, known if fresh else [])
        return self._deliveries[1]
