"""The missions page: any mission file with its map, profile, items and findings; corrected, converted, uploaded."""

from __future__ import annotations

import asyncio
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import Client, ui

from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import SkywayError
from skyway.report.svg import safe
from skyway.web import drawn, shell
from skyway.web.controls import Button, CommandShown, Drop, Field
from skyway.web.folder import MISSIONS
from skyway.web.map_key import key
from skyway.web.map_layer import MapLayer
from skyway.web.pages import mission_answer
from skyway.web.pages.mission_transfer import Transfer
from skyway.web.pages.under_way import UnderWay

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

USUAL = {
    "drone": "",
    "autopilot": "",
    "wind": "",
    "payload": "0",
    "soc": "100",
    "reserve": "20",
    "depart": "",
    "region": "",
}
"""What is asked of a mission by default."""
_ITEM_OF_CLICK = "(e) => { const b = e.target.closest('[data-item]'); if (b) emit(b.dataset.item); }"


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/missions", MissionsPage)


class MissionsPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site, self.client, self.wanted = site, client, wanted
        self.file = client.request.query_params.get("file", "")
        given = client.request.query_params
        self.asked = {name: given.get(name, usual)[:200] for name, usual in USUAL.items()}
        self.found: dict[str, Any] | None = None
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="File and vehicle"'),
                ui.element("div").classes("rows wide"),
            ):
                self._form()
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer("Map of the mission")
                key("work", "finding", "fence")
                self.under = ui.element("div").classes("under-map")
            with ui.element("section").classes("panel answer").props('aria-label="Findings"'):
                self._answer()
        with self.under:
            self.profile = ui.html("").classes("profile")
        ui.timer(0.01, self._begin, once=True)

    def _form(self) -> None:
        Drop(
            "Drop a .plan or .waypoints here, or choose",
            ",".join(MISSIONS),
            self.uploaded,
            lambda why: self.status.tell(why, wrong=True),
        )
        self.choice = Field("Missions in the work folder", self.choose, kind="select")
        Field(
            "Autopilot",
            self._set("autopilot"),
            kind="select",
            value=self.asked["autopilot"],
            options=[("", "as the file says"), *((one, one) for one in NAMES)],
        )
        self.drone = Field(
            "Drone", self._set("drone"), kind="select", value=self.asked["drone"], options=[("", "assume M200 V2")]
        )
        with ui.element("div").classes("pair"):
            self._typed("Wind", "wind", unit="m/s@° from", hint="8@270; empty: still air")
            self._typed("Package", "payload", unit="kg", inputmode="decimal")
        with ui.element("div").classes("pair"):
            self._typed("Charge", "soc", unit="%", inputmode="decimal")
            self._typed("Reserve", "reserve", unit="%", inputmode="decimal")
        Field(
            "With zones, pads and fleet of the scenario",
            self._set("region"), kind="check", value=bool(self.asked["region"]),
        )  # fmt: skip
        self.transfer = Transfer(self.site, self.client, lambda: self.file, self._differ)

    def _typed(self, label: str, name: str, **how: Any) -> None:
        Field(label, self._set(name), value=self.asked[name], **how)

    def _answer(self) -> None:
        self.at_work = UnderWay(self.client, self._show, "Check it now")
        self.status = self.at_work.status
        self.verdict = ui.html("")
        self.differences = ui.html("")
        self.differences.on("click", self.at_item, js_handler=_ITEM_OF_CLICK)
        self.findings = ui.html("")
        self.findings.on("click", self.at_item, js_handler=_ITEM_OF_CLICK)
        with ui.element("div").classes("line"):
            self.fix = Button("Fix what is certain, as a new file", self.mend)
            self.conversions = [
                Button(f"Convert to {suffix}", partial(self.convert, suffix)) for suffix in (".plan", ".waypoints")
            ]
        self.flights = ui.html("")
        self.items = ui.html("")
        self.command = CommandShown("mission")

    async def _begin(self) -> None:
        self._list()
        try:
            region = await self.site.region()
        except SkywayError:
            region = {"drones": [], "bounds": [-180, -60, 180, 70]}
        self.drone.offer([("", "assume M200 V2"), *((one["id"], one["id"]) for one in region["drones"])])
        self.map.put(bounds=region["bounds"], fitted=True)
        await self._show()

    def _list(self) -> None:
        names = [one.name for one in self.site.folder.files(*MISSIONS)]
        self.choice.offer([("", "choose a file"), *((name, name) for name in names)])
        self.choice.show(self.file)

    def _set(self, name: str) -> Callable[[Any], Awaitable[None]]:
        async def take(value: Any) -> None:
            self.asked[name] = ("yes" if value else "") if isinstance(value, bool) else str(value)[:200]
            await self._show()

        return take

    async def choose(self, name: Any) -> None:
        """Show a file of the folder."""
        self.file = str(name)
        self.transfer.doubt()
        self._differ([])
        await self._show()

    async def uploaded(self, name: str) -> None:
        """Show an uploaded file."""
        self.file = name
        self.transfer.doubt()
        self._differ([])
        self._list()
        await self._show()

    async def _show(self) -> None:
        """Read and check the file, replacing any current reading, and show the findings."""
        given = {name: value for name, value in self.asked.items() if value != USUAL[name]}
        shell.remember(self.client, "/missions", ({"file": self.file} if self.file else {}) | given)
        await asyncio.wait({self.at_work.begin(self._checked())})

    async def _checked(self) -> None:
        if not self.file:
            self._clear()
            self.status.tell("Choose a mission, or drop one. The page Plan saves plans as missions, too.")
            return
        try:
            path = self.site.folder.existing(self.file)
            self.at_work.tell("Checking …")
            self.found = await self.site.workers.ask("missions.shown", str(path), self.site.scenario, self.asked)
        except SkywayError as error:
            self._clear()
            self.status.tell(str(error), wrong=True)
            return
        self.status.tell("")
        self._draw(self.found)

    def _clear(self) -> None:
        """Show no mission."""
        self.found = None
        for part in (self.profile, self.verdict, self.findings, self.flights, self.items):
            part.set_content("")
        for button in (self.fix, *self.conversions):
            button.enable(False)  # noqa: FBT003  as of every button
        self.map.put(tracks=[], marks=[])
        self.command.show("")

    def _draw(self, found: dict[str, Any]) -> None:
        tracks = [
            {"points": area["points"], "colour": "start" if area["inside"] else "zone", "width": 1.5, "dash": [6, 4]}
            for area in found["fence"]
        ]
        tracks += [{"points": leg["points"], "colour": "route", "width": 3} for leg in found["legs"]]
        marks = [{"place": place, "label": "H", "colour": "ink"} for place in [found["home"]] if place]
        marks += [{"place": place, "label": "R", "colour": "other"} for place in found["rally"]]
        for one in found["findings"]:
            if one["place"] and one["severity"] != "info":
                marks.append({"place": one["place"], "label": "!", "colour": "warn"})
        self.map.put(tracks=tracks, marks=marks, bounds=mission_answer.bounds(found), fitted=True)
        self.profile.set_content(drawn.profile(found["legs"], self.wanted))
        counts = [sum(one["severity"] == kind for one in found["findings"]) for kind in ("error", "warning")]
        words = ", ".join(
            f"{count} {kind}{'s' if count != 1 else ''}"
            for count, kind in zip(counts, ("error", "warning"), strict=True)
            if count
        )
        style = "good" if found["ok"] and not words else "warn"
        self.verdict.set_content(
            f"<p class='big'>{safe(Path(self.file).name)}: <span class='{style}'>{words or 'ok'}</span></p>"
        )
        self.findings.set_content(mission_answer.findings(found["findings"], self.wanted))
        self.flights.set_content(mission_answer.flights(found["flights"], self.wanted))
        self.items.set_content(mission_answer.items(found, self.wanted))
        for button in self.conversions:
            button.enable(True)  # noqa: FBT003
        self.fix.enable(any(one["certain"] for one in found["findings"]))
        given = [
            ("--drone", self.asked["drone"]),
            ("--autopilot", self.asked["autopilot"]),
            ("--wind", self.asked["wind"]),
        ]
        given += [
            (f"--{name}", self.asked[name])
            for name, usual in (("payload", "0"), ("soc", "100"), ("reserve", "20"))
            if self.asked[name] != usual
        ]
        words_ = ["skyway", "check", self.file, *(word for option, value in given if value for word in (option, value))]
        words_ += ["--scenario", self.site.scenario or "newyork"] if self.asked["region"] else []
        self.command.show(shlex.join(words_))

    def _differ(self, found: list[dict[str, Any]]) -> None:
        """Show the vehicle's differences."""
        self.differences.set_content(mission_answer.differences(found, self.wanted))

    def at_item(self, event: Any) -> None:
        """Show the place of an item."""
        place = (self.found or {"places": {}})["places"].get(str(event.args))
        if place:
            self.map.put(centre=place)

    async def mend(self) -> None:
        """Write a new file with the certain findings fixed."""
        await self._made(Path(self.file).suffix if self.file.endswith((".plan", ".waypoints")) else ".plan", self.asked)

    async def convert(self, suffix: str) -> None:
        """Write the mission in another format."""
        await self._made(suffix, None)

    async def _made(self, suffix: str, asked: dict[str, str] | None) -> None:
        try:
            path = self.site.folder.existing(self.file)
            made = await self.site.workers.ask("missions.converted", str(path), suffix, asked, self.site.scenario)
            names = self.site.folder.free_names([name for name, _ in made["files"]])
            for name, (_, content) in zip(names, made["files"], strict=True):
                self.site.folder.write(name, content)
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.file = names[0]
        self.transfer.doubt()
        self._list()
        await self._show()
        self.status.tell("; ".join((f"saved {', '.join(names)}", *made["told"])))
