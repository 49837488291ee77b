"""The fly page: departures, flights under way, and vehicles on the link.

Each delivery is flown by a supervisor in a separate process (``skyway fly``). This page starts it, shows the contents of its files, and writes commands to one of them.
"""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import Client, ui

from skyway.models.base.errors import SkywayError
from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Field, Status, text
from skyway.web.live import demonstration
from skyway.web.live.fleet import RECORDINGS
from skyway.web.map_key import key
from skyway.web.map_layer import FlightPanel, MapLayer
from skyway.web.pages.departure import DepartureForm

if TYPE_CHECKING:
    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

ACTIONS = [{"action": "divert", "words": "Land here instead", "station": True, "listed": "refuges"}]
"""Commands at a station of the map."""


def watch_words(connection: str) -> list[str]:
    """Return the command equivalent to the watch of the page."""
    return ["skyway", "watch", "--connect", connection, "--record", RECORDINGS]


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/fly", FlyPage)


class FlyPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site = site
        self.connection = ""
        flown = bool(site.flights.known())
        with ui.element("div").classes("work flying"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Departure and connections"'),
                ui.element("div").classes("rows wide"),
            ):
                with ui.element("div").classes("rows"):
                    self.form = DepartureForm(site, self._begun, self._show_plan)
                with ui.element("div").classes("rows"):
                    self._watching()
                    if flown:
                        self._demonstration()
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer(
                    "Map of all flights and vehicles",
                    on_choose=self._chosen, on_vehicle=self._vehicle,
                )  # fmt: skip
                key("vehicle", "flown", "ahead", "reach", "station", "zone", "wind", keys=("stations", "vehicles"))
            with ui.element("section").classes("panel answer").props('aria-label="Flights"'):
                self.panel = FlightPanel(wanted, client.request.query_params.get("flight", "")[:300])
                self.panel.on("resume", self._resume)
                if not flown:
                    self._demonstration()  # the part that new users see first
        self._list()
        ui.timer(0.01, self._begin, once=True)

    def _watching(self) -> None:
        text("h2", "Watch")
        Field("Connection", self._typed, hint="udpin:127.0.0.1:14550, tcp:127.0.0.1:5760")
        with ui.element("div").classes("line"):
            Button("Watch", self.watch)
        self.status = Status()
        self.watched = ui.element("div").classes("chips")
        self.watching = CommandShown("watch", shlex.join(watch_words("CONNECTION")))

    def _demonstration(self) -> None:
        text("h2", "Demonstration")
        text(
            "p",
            "A delivery across a simulated New York, ten times faster than real time, and sixty times on the ground. No drone is needed.",
            "faint",
        )
        with ui.element("div").classes("line"):
            Button("Fly the demonstration", self.demonstrate, "" if self.site.flights.known() else "main")
        self.planned = Status()

    async def _begin(self) -> None:
        try:
            region: dict[str, Any] = await self.site.region()
        except SkywayError:
            region = {"timezone": "UTC"}
        self.panel.in_zone(region["timezone"])
        self.map.put(actions=ACTIONS, refuges=[])
        await self.form.read()

    # Flights

    def _begun(self, name: str) -> None:
        self.panel.run_method("open", name, True)  # noqa: FBT003  takes command

    def _show_plan(self, path: list[list[float]]) -> None:
        self.map.put(proposed=path)

    def _chosen(self, chosen: dict[str, Any]) -> None:
        if chosen.get("action") == "divert" and chosen.get("station"):
            self.panel.run_method("prepare", f"divert {chosen['station']}")

    def _vehicle(self, chosen: dict[str, Any]) -> None:
        self.panel.run_method("choose", str(chosen.get("id", "")))

    def _resume(self, event: Any) -> None:
        try:
            self.site.flights.resume(str(event.args)[:300])
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)

    async def demonstrate(self) -> None:
        """Fly the demonstration, started by one click."""
        self.planned.tell("Planning the demonstration: a few seconds …")
        try:
            name = await demonstration.begin(self.site)
        except SkywayError as error:
            self.planned.tell(str(error), wrong=True)
            return
        self.planned.tell("")
        self._begun(name)

    # Watches

    def _typed(self, value: object) -> None:
        self.connection = str(value).strip()
        self.watching.show(shlex.join(watch_words(self.connection or "CONNECTION")))

    def watch(self) -> None:
        """Listen on the typed connection."""
        try:
            self.site.fleet.watch(self.connection)
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.status.tell("")
        self._list()

    def stop(self, connection: str) -> None:
        """Stop listening on a connection."""
        self.site.fleet.stop(connection)
        self._list()

    def _list(self) -> None:
        self.watched.clear()
        with self.watched:
            for connection in self.site.fleet.runs:
                Button(
                    f"{connection} \N{MULTIPLICATION SIGN}",
                    partial(self.stop, connection),
                    "chip",
                    title="Stop to watch",
                )
