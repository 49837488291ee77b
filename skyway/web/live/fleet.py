"""Vehicles on the link: one watch process for each connection, and one digest of all of them.

No commands are sent here. Supervised flights are processes of their own, too: see `skyway.web.live.flights`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.models.base.errors import InputError, SkywayError
from skyway.web.live.runs import Run

if TYPE_CHECKING:
    from skyway.web.site import Site

MOST_WATCHES = 16
RECORDINGS = "recordings"
"""Subfolder of the work folder for recordings of received messages."""
GONE_S = 300.0
"""A vehicle that has been silent for this long is left out of the digest."""
EVERY_S = 0.1
"""Interval of updates from a watch."""
SAME_S = 0.4
"""Lifetime of a digest."""
BATCH_S, LONGEST_S = 0.08, 5.0
"""Updates of positions are collected for this long before they go to a browser, which repeats its request after this long without any."""
FRESH_S = 900.0
"""A journal written to within this time belongs to a flight in progress."""


class Fleet:
    """All received vehicles, on all connections."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.runs: dict[str, Run] = {}
        self._tasks: dict[str, asyncio.Task[int]] = {}
        self._vehicles: dict[tuple[str, int], dict[str, Any]] = {}
        self._document: tuple[float, bytes] = (-1.0, b"")
        self._version = 0
        self._news = asyncio.Event()
        self._deliveries: tuple[float, list[dict[str, Any]]] = (0.0, [])

    def watch(self, connection: str) -> None:
        """Listen on a connection, until stopped or until the connection ends."""
        if not connection or connection.startswith("-") or len(connection) > 200:
            raise InputError(
                "is not a connection", field="--connect", value=connection, remedy="such as udpin:127.0.0.1:14550"
            )
        if connection in self.runs:
            raise InputError("is already watched", field="--connect", value=connection)
        if len(self.runs) >= MOST_WATCHES:
            raise InputError(
                "too many connections are watched", field="--connect", value=connection, remedy="stop one of them"
            )
        run = Run(
            [
                "watch",
                "--connect",
                connection,
                "--every",
                f"{EVERY_S:g}",
                "--json",
                "--record",
                str(self.site.folder.root / RECORDINGS),
            ],
            lambda line: self.heard(connection, line),
        )
        self.runs[connection] = run
        self._tasks[connection] = asyncio.ensure_future(run.finished())

    def stop(self, connection: str) -> None:
        """Stop listening."""
        run = self.runs.pop(connection, None)
        if run is not None:
            run.stop()
        self._vehicles = {key: row for key, row in self._vehicles.items() if key[0] != connection}

    def stop_all(self) -> None:
        """End all watches: they only listen."""
        for connection in list(self.runs):
            self.stop(connection)

    def heard(self, connection: str, line: str) -> None:
        """Process a line of ``skyway watch --json``."""
        with contextlib.suppress(ValueError, TypeError, AttributeError):
            told = json.loads(line)
            rows = told.get("vehicles", [told]) if isinstance(told, dict) else told
            for row in rows:
                if isinstance(row, dict) and isinstance(row.get("system"), int):
                    self._take((connection, row["system"]), row)

    def _take(self, key: tuple[str, int], row: dict[str, Any]) -> None:
        """Store the state that a vehicle has sent; if it has moved, notify the browsers."""
        before = self._vehicles.get(key)
        moved = before is None or any(row.get(name) != before.get(name) for name in ("lat", "lon"))
        if moved:
            self._version += 1
            self._news.set()
        version = self._version if moved or before is None else before["version"]
        self._vehicles[key] = row | {"heard_s": time.monotonic(), "version": version}

    async def positions(self, since: int) -> dict[str, Any]:
        """Return the positions of the vehicles that have moved since a version; waits for some time until there are any."""
        if since >= self._version:
            self._news.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), LONGEST_S)
            await asyncio.sleep(BATCH_S)
        rows = [
            [f"{connection} {system}", row.get("lat"), row.get("lon")]
            for (connection, system), row in self._vehicles.items()
            if row["version"] > since
        ]
        return {"version": self._version, "rows": rows}

    async def document(self) -> bytes:
        """Return the digest as JSON; made once for all browsers whose requests are close together."""
        made_s, known = self._document
        if time.monotonic() < made_s + SAME_S:
            return known
        made = msgspec.json.encode(await self.digest())
        self._document = time.monotonic(), made
        return made

    async def digest(self) -> dict[str, Any]:
        """Return one document for everything: vehicles, connections, deliveries under way."""
        now_s = time.monotonic()
        self._vehicles = {key: row for key, row in self._vehicles.items() if now_s - row["heard_s"] < GONE_S}
        vehicles = [
            {name: value for name, value in row.items() if name not in ("heard_s", "version")}
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
        """Deliveries whose journal is being written; checked once a second, for any number of browsers."""
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
