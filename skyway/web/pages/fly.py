"""The fly page, as far as it watches: vehicles heard on any connection, and deliveries under way.

It commands nothing. A delivery is flown by a supervisor in a process of its own (``skyway fly``), whose journal in the work folder this page reads.
"""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING

from nicegui import Client, ui

from skyway.models.base.errors import SkywayError
from skyway.web import shell
from skyway.web.controls import Button, Field, say, text
from skyway.web.map_layer import FleetTable, MapLayer

if TYPE_CHECKING:
    from skyway.web.preferences import Preferences
    from skyway.web.site import Site


def add(site: Site) -> None:
    """Add the page."""

    @ui.page("/fly", title="skyway: fly")
    async def fly(client: Client) -> None:
        with shell.page(site, client, "/fly") as wanted:
            FlyPage(site, wanted)


class FlyPage:
    """One open page."""

    def __init__(self, site: Site, wanted: Preferences) -> None:
        self.site = site
        self.connection = ""
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Connections"'),
                ui.element("div").classes("rows wide"),
            ):
                Field("Connection", self._typed, hint="udpin:127.0.0.1:14550, tcp:127.0.0.1:5760, /dev/ttyUSB0,57600")
                with ui.element("div").classes("line"):
                    Button("Watch", self.watch, "main")
                self.status = text("p", "", "status", role="status")
                self.watched = ui.element("div").classes("chips")
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer("Map of all vehicles. Arrow keys move it, plus and minus zoom, 0 shows everything.")
            with ui.element("section").classes("panel answer").props('aria-label="Vehicles"'):
                FleetTable(wanted)
                with ui.element("div").classes("command"):
                    self.command = text("code", "skyway watch --connect CONNECTION", id="fly-command")
                    text("button", "Copy", "plain", type="button", data_copy="fly-command")
        self._list()
        ui.timer(0.01, self._begin, once=True)

    def _begin(self) -> None:
        for name in ("region", "outline"):
            self.map.load(name, f"/api/{name}")

    def _typed(self, value: object) -> None:
        self.connection = str(value).strip()
        say(self.command, shlex.join(["skyway", "watch", "--connect", self.connection or "CONNECTION"]))

    def watch(self) -> None:
        """Listen on the connection that was typed."""
        try:
            self.site.fleet.watch(self.connection)
        except SkywayError as error:
            say(self.status, str(error))
            return
        say(self.status, "")
        self._list()

    def stop(self, connection: str) -> None:
        """Stop to listen on a connection."""
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
