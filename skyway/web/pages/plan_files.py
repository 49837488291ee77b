"""Saving, opening and exporting plans on the plan page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
from nicegui import ui

from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import SkywayError
from skyway.web.controls import Button, Field, Status, text
from skyway.web.folder import safe_name
from skyway.web.work.exports import KINDS
from skyway.web.work.question import Question

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.web.site import Site

SHOWN = 200
"""Number of plan files that are offered."""


class PlanFiles:
    """The part of the page for files.

    Parameters
    ----------
    site : Site
        The site with the work folder.
    shown : callable
        Returns the shown plan, as a document; None if there is none.
    ask : callable
        Makes a request.
    """

    def __init__(self, site: Site, shown: Callable[[], dict[str, Any] | None], ask: Callable[[Question], None]) -> None:
        self.site, self._shown, self._ask = site, shown, ask
        self.kind, self.stem, self.autopilot, self.contacts, self.wanted = "plan", "", NAMES[0], "", ""
        self.elevation = ""
        with ui.element("details").classes("files"):
            text("summary", "Save, export, open")
            with ui.element("div").classes("rows"):
                with ui.element("div").classes("pair"):
                    Field("Format", self._set("kind"), kind="select", value=self.kind, options=list(KINDS.items()))
                    Field(
                        "Autopilot",
                        self._set("autopilot"),
                        kind="select",
                        value=self.autopilot,
                        options=[(one, one) for one in NAMES],
                    )
                self.name = Field("Name", self._set("stem"), hint="Without ending; empty: start and target")
                Field(
                    "Ground heights",
                    self._set("elevation"),
                    hint="For missions, where the plan lacks one: target=34, metres above sea level",
                )
                Field("Contacts on the briefing", self._set("contacts"), kind="area", hint="One line each")
                with ui.element("div").classes("line"):
                    Button("Download", self.download)
                    Button("Save in the work folder", self.save)
                with ui.element("div").classes("line"):
                    self.choice = Field("Plans in the work folder", self._set("wanted"), kind="select")
                    Button("Open", self.open)
                self.told = Status()
        self._list()

    def _set(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            setattr(self, name, str(value)[:2000])

        return take

    def _list(self) -> None:
        names = [one.name for one in self.site.folder.files(".json")[:SHOWN]]
        self.choice.offer([("", "choose a file"), *((name, name) for name in names)])

    async def _made(self) -> list[tuple[str, bytes]]:
        plan = self._shown()
        if plan is None:
            raise SkywayError("the plan is not ready yet")
        stem = safe_name(self.stem) if self.stem.strip() else safe_name(f"{plan['from']}-{plan['to']}")
        more = {"autopilot": self.autopilot, "contacts": self.contacts, "elevation": self.elevation}
        found: list[tuple[str, bytes]] = await self.site.workers.ask(
            "exports.export", self.site.scenario, plan, self.kind, stem, more
        )
        return found

    async def download(self) -> None:
        """Send the files to the browser."""
        try:
            for name, content in await self._made():
                ui.download.content(content, name)
        except SkywayError as error:
            self.told.tell(str(error), wrong=True)
        else:
            self.told.tell("")

    async def save(self) -> None:
        """Write the files into the work folder, under unused names."""
        try:
            made = await self._made()
            names = self.site.folder.free_names([name for name, _ in made])
            for name, (_, content) in zip(names, made, strict=True):
                self.site.folder.write(name, content)
        except SkywayError as error:
            self.told.tell(str(error), wrong=True)
            return
        self._list()
        self.told.tell(f"saved {', '.join(names)}")

    async def open(self) -> None:
        """Repeat the request of a plan in the folder."""
        try:
            path = self.site.folder.existing(self.wanted)
            found = await self.site.workers.ask("exports.opened", str(path))
        except SkywayError as error:
            self.told.tell(str(error), wrong=True)
            return
        self.told.tell(f"opened {self.wanted}: planned again with its request")
        self._ask(msgspec.convert(found["question"], Question))
