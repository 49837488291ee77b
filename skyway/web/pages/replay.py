"""The replay page: one or two logs side by side, forwards and backwards."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from nicegui import Client, ui

from skyway.models.base.errors import SkywayError
from skyway.web import shell
from skyway.web.controls import CommandShown, Drop, Field, Status
from skyway.web.folder import LOGS, MOST_NAME
from skyway.web.map_key import key
from skyway.web.map_layer import MapLayer, Player

if TYPE_CHECKING:
    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

WHICH = ("log", "beside")
"""Names of the logs in the address of the page."""


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/replay", ReplayPage)


class ReplayPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site, self.client = site, client
        self.files = [client.request.query_params.get(name, "")[:MOST_NAME] for name in WHICH]
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Logs"'),
                ui.element("div").classes("rows wide"),
            ):
                Drop(
                    "Drop a log here, or choose (.tlog, .bin, .ulg, .csv, journal)",
                    ",".join(LOGS),
                    self.uploaded,
                    self.refused,
                )
                self.first = Field(
                    "Log", lambda name: self.choose(0, name), kind="select", hint="Of the work folder, newest first"
                )
                self.second = Field(
                    "Beside it",
                    lambda name: self.choose(1, name),
                    kind="select",
                    hint="From the first take-off of both on",
                )
                self.status = Status()
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer("Map of the flight")
                key("vehicle", "flown", "station", "zone", "wind")
            with ui.element("section").classes("panel answer").props('aria-label="Player"'):
                self.player = Player(wanted)
                self.player.on("failed", lambda event: self.status.tell(str(event.args), wrong=True))
                self.command = CommandShown("replay")
        ui.timer(0.01, self._begin, once=True)

    async def _begin(self) -> None:
        try:
            region: dict[str, Any] = await self.site.region()
        except SkywayError:
            region = {"timezone": "UTC", "bounds": [-180, -60, 180, 70]}
        self.player.in_region(region["timezone"], region["bounds"])
        self.map.put(bounds=region["bounds"], fitted=True)
        self._list()
        self._open()

    def _list(self) -> None:
        names = [one.name for one in self.site.folder.files(*LOGS)]
        for field, chosen, nothing in (
            (self.first, self.files[0], "choose a log"),
            (self.second, self.files[1], "no other"),
        ):
            field.offer([("", nothing), *((name, name) for name in names)])
            field.show(chosen)

    def choose(self, number: int, name: Any) -> None:
        """Show another log."""
        self.files[number] = str(name)
        self._open()

    def uploaded(self, name: str) -> None:
        """Show an uploaded log."""
        self.files[0] = name
        self._list()
        self._open()

    def refused(self, why: str) -> None:
        """Show the reason why a file was refused."""
        self.status.tell(why, wrong=True)

    def _open(self) -> None:
        asked = {which: name for which, name in zip(WHICH, self.files, strict=True) if name}
        names = list(asked.values())
        shell.remember(self.client, "/replay", asked)
        self.status.tell(
            ""
            if names
            else "Choose a log, or drop one. Logs of skyway fly and skyway watch are in the folder that they were started in."
        )
        self.player.run_method("open", names)
        words = [("report" if name.endswith(".jsonl") else "replay", name) for name in names]
        self.command.show(" && ".join(shlex.join(["skyway", *one]) for one in words))
