"""The fleet page: orders, drones and pads of a dispatcher, from its ledger."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from nicegui import Client, ui

from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Field, Status
from skyway.web.map_key import key
from skyway.web.map_layer import FleetBoard, MapLayer
from skyway.web.pages.fleet_answer import PARTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

LEDGERS = (".db",)
HOLDER = "dispatch"
"""Usual name of a dispatcher."""


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/fleet", FleetPage)


class FleetPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        del wanted
        self.site, self.client = site, client
        self.ledger = client.request.query_params.get("ledger", "")[:300]
        self.holder = client.request.query_params.get("holder", HOLDER)[:100]
        with ui.element("div").classes("work flying"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Ledger"'),
                ui.element("div").classes("rows wide"),
            ):
                self.choice = Field("Ledger", self._set("ledger"), kind="select", hint="A file of the work folder, .db")
                Field("Dispatcher", self._set("holder"), value=self.holder, hint="As skyway dispatch run --holder")
                with ui.element("div").classes("line"):
                    Button("Refresh the folder", self._list)
                self.status = Status()
                self.command = CommandShown("fleet")
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                MapLayer("Map of all drones of the fleet")
                key("vehicle", "station", "zone")
            with ui.element("section").classes("panel answer").props('aria-label="Fleet" tabindex=0'):
                self.board = FleetBoard(PARTS)
        self._list()
        self._show()

    def _list(self) -> None:
        names = [one.name for one in self.site.folder.files(*LEDGERS)]
        if not self.ledger and len(names) == 1:
            self.ledger = names[0]
        self.choice.offer(
            [("", "choose a ledger" if names else "no ledger in the folder yet"), *((one, one) for one in names)]
        )
        self.choice.show(self.ledger)

    def _set(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            setattr(self, name, str(value).strip()[:300])
            other = {} if self.holder == HOLDER else {"holder": self.holder}
            shell.remember(self.client, "/fleet", ({"ledger": self.ledger} if self.ledger else {}) | other)
            self._show()

        return take

    def _show(self) -> None:
        self.status.tell(
            ""
            if self.ledger
            else "Choose a ledger: skyway dispatch run writes one; skyway dispatch demo writes an example."
        )
        self.board.follow(self.ledger, self.holder)
        words = ["skyway", "dispatch", "status", "--ledger", self.ledger or "LEDGER.db"]
        self.command.show(shlex.join([*words, *(["--holder", self.holder] if self.holder != HOLDER else [])]))
