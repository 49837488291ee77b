"""The missions page: any mission file with its map, profile, items and findings; mended, converted, uploaded."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import Client, ui

from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import SkywayError
from skyway.report.svg import safe
from skyway.web import drawn, shell
from skyway.web.controls import Button, CommandShown, Drop, Field, Status, say, text
from skyway.web.folder import MISSIONS
from skyway.web.live.runs import Run
from skyway.web.map_layer import MapLayer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

_STEP = re.compile(r"^(.*?) (\d+)/(\d+)$")
_ITEM_OF_CLICK = "(e) => { const b = e.target.closest('[data-item]'); if (b) emit(b.dataset.item); }"


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/missions", MissionsPage)


class MissionsPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site, self.client, self.wanted = site, client, wanted
        self.file = client.request.query_params.get("file", "")
        self.asked = {
            "drone": "",
            "autopilot": "",
            "wind": "",
            "payload": "0",
            "soc": "100",
            "reserve": "20",
            "depart": "",
            "region": "",
        }
        self.connect, self.sure = "", False
        self.found: dict[str, Any] | None = None
        self.run: Run | None = None
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="File and vehicle"'),
                ui.element("div").classes("rows wide"),
            ):
                self._form()
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer("Map of the mission. Arrow keys move it, plus and minus zoom, 0 shows everything.")
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
        with ui.element("div").classes("pair"):
            Field(
                "Autopilot",
                self._set("autopilot"),
                kind="select",
                options=[("", "as the file says"), *((one, one) for one in NAMES)],
            )
            self.drone = Field("Drone", self._set("drone"), kind="select", options=[("", "assume M200 V2")])
        with ui.element("div").classes("pair"):
            Field("Wind", self._set("wind"), unit="m/s@° from", hint="8@270; empty: still air")
            Field("Package", self._set("payload"), value="0", unit="kg", inputmode="decimal")
        with ui.element("div").classes("pair"):
            Field("Charge", self._set("soc"), value="100", unit="%", inputmode="decimal")
            Field("Reserve", self._set("reserve"), value="20", unit="%", inputmode="decimal")
        Field("with zones, pads and fleet of the scenario", self._set("region"), kind="check", value=False)
        text("h2", "Vehicle")
        Field(
            "Connection",
            lambda value: setattr(self, "connect", str(value).strip()[:200]),
            hint="udpin:127.0.0.1:14540, tcp:…, /dev/ttyUSB0,57600",
        )
        with ui.element("div").classes("line"):
            Button("Compare with the vehicle", self.compare)
        Field(
            "I am sure: replace the mission of the vehicle",
            lambda on: setattr(self, "sure", bool(on)),
            kind="check",
            value=False,
        )
        with ui.element("div").classes("line"):
            Button("Upload and read back", self.upload, "main")
        self.bar = ui.element("progress").props('max=1 value=0 aria-label="Upload"')
        self.progress = Status()
        self.output = text("pre", "", "output")

    def _answer(self) -> None:
        self.status = Status()
        self.verdict = ui.html("")
        self.findings = ui.html("")
        self.findings.on("click", self.at_item, js_handler=_ITEM_OF_CLICK)
        with ui.element("div").classes("line"):
            self.fix = Button("Mend what is certain, as a new file", self.mend)
            Button("Convert to .plan", lambda: self.convert(".plan"))
            Button("Convert to .waypoints", lambda: self.convert(".waypoints"))
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
        await self._show()

    async def uploaded(self, name: str) -> None:
        """Show a file that has come."""
        self.file = name
        self._list()
        await self._show()

    async def _show(self) -> None:
        """Read and check the file, and show what was found."""
        if not self.file:
            self.status.tell("Choose a mission, or drop one.")
            return
        try:
            path = self.site.folder.existing(self.file)
            self.found = await self.site.workers.ask("missions.shown", str(path), self.site.scenario, self.asked)
        except SkywayError as error:
            self.found = None
            self.status.tell(str(error), wrong=True)
            return
        self.status.tell("")
        self._draw(self.found)

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
        self.map.put(tracks=tracks, marks=marks, bounds=_bounds(found), fitted=True)
        self.profile.set_content(drawn.profile(found["legs"], self.wanted.height))
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
        self.findings.set_content(_findings(found["findings"]))
        self.flights.set_content(_flights(found["flights"]))
        self.items.set_content(_items(found))
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

    def at_item(self, event: Any) -> None:
        """Show where a finding is."""
        for one in (self.found or {"findings": ()})["findings"]:
            if str(one["item"]) == str(event.args) and one["place"]:
                self.map.put(centre=one["place"])
                return

    async def mend(self) -> None:
        """Write a new file with the certain findings mended."""
        await self._made(Path(self.file).suffix if self.file.endswith((".plan", ".waypoints")) else ".plan", self.asked)

    async def convert(self, suffix: str) -> None:
        """Write the mission in another format."""
        await self._made(suffix, None)

    async def _made(self, suffix: str, asked: dict[str, str] | None) -> None:
        try:
            path = self.site.folder.existing(self.file)
            made = await self.site.workers.ask("missions.converted", str(path), suffix, asked, self.site.scenario)
            first = Path(made["files"][0][0])
            free = Path(self.site.folder.free_name(first.name)).stem
            names = [free + name.removeprefix(first.stem) for name, _ in made["files"]]
            for name, (_, content) in zip(names, made["files"], strict=True):
                self.site.folder.write(name, content)
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.file = names[0]
        self._list()
        await self._show()
        self.status.tell("; ".join((f"saved {', '.join(names)}", *made["told"])))

    async def compare(self) -> None:
        """Compare the file with what the vehicle holds."""
        await self._on_vehicle(["verify"])

    async def upload(self) -> None:
        """Upload the file, and read it back."""
        if not self.sure:
            self.progress.tell(
                "An upload replaces the mission of the vehicle: say above that you are sure.", wrong=True
            )
            return
        await self._on_vehicle(["upload"], "--yes")

    async def _on_vehicle(self, command: list[str], *more: str) -> None:
        """Run a command of the link in its own process, and show what it prints."""
        try:
            path = self.site.folder.existing(self.file)
        except SkywayError as error:
            self.progress.tell(str(error), wrong=True)
            return
        if not self.connect or self.connect.startswith("-"):
            self.progress.tell("Say above how the vehicle is connected.", wrong=True)
            return
        if self.run is not None and self.run.code is None:
            self.progress.tell("Wait for what is running.", wrong=True)
            return
        words = [*command, str(path), "--connect", self.connect, *more]
        self.run = Run(words, self._heard, outlives=True)
        self.progress.tell(f"skyway {shlex.join([*command, self.file, '--connect', self.connect, *more])}")
        say(self.output, "")
        code = await self.run.finished()
        done = {
            0: "done: both are equal",
            1: "they differ",
            2: "not done: see above",
            3: "failed: the vehicle or the link",
        }
        self.progress.tell(f"{command[0]}: {done.get(code, f'ended with {code}')}", wrong=code != 0)

    def _heard(self, line: str) -> None:
        with self.client:
            step = _STEP.match(line)
            if step is not None:
                self.bar.props(f"max={step[3]} value={step[2]}")
                self.progress.tell(line)
            elif self.run is not None:
                say(self.output, "\n".join(one for one in self.run.lines if not _STEP.match(one)))


def _bounds(found: dict[str, Any]) -> list[float] | None:
    points = (
        [at for leg in found["legs"] for at in leg["points"]]
        + found["rally"]
        + [at for area in found["fence"] for at in area["points"]]
    )
    if not points:
        return None
    lat, lon = [at[0] for at in points], [at[1] for at in points]
    return [min(lon), min(lat), max(lon), max(lat)]


def _findings(found: list[dict[str, Any]]) -> str:
    if not found:
        return "<p class='good'>Nothing was found.</p>"
    rows = []
    for one in found:
        where = (
            "mission"
            if one["item"] is None
            else f'<button type="button" class="chip" data-item="{one["item"]}">item {one["item"]}</button>'
        )
        style = {"error": "warn", "warning": "warn"}.get(one["severity"], "faint")
        mend = " (certain: it can be mended)" if one["certain"] else ""
        rows.append(
            f"<tr><td class='{style}'>{safe(one['severity'])}</td><td>{where}</td><td>{safe(one['message'])}</td><td>{safe(one['remedy'])}{mend}</td></tr>"
        )
    head = "<tr><th>kind</th><th>where</th><th>finding</th><th>what would be right</th></tr>"
    return (
        f"<h2>Findings</h2><div class='scroll'><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _flights(flights: list[dict[str, str]]) -> str:
    names = ("items", "distance", "time", "energy", "ends", "kept")
    rows = ["".join(f"<td>{safe(one.get(name, ''))}</td>" for name in names) for one in flights]
    head = "<tr><th>items</th><th>distance</th><th>time</th><th>energy</th><th>ends with</th><th>reserve kept</th></tr>"
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return (
        f"<h2>Flights</h2><div class='scroll'><table><thead>{head}</thead><tbody>{body}</tbody></table></div>"
        if flights
        else ""
    )


def _items(found: dict[str, Any]) -> str:
    rows = "".join(f"<tr>{''.join(f'<td>{safe(cell)}</td>' for cell in row)}</tr>" for row in found["items"])
    head = "<tr><th>item</th><th>command</th><th>frame</th><th>parameters 1 to 4</th><th>place</th><th>height</th></tr>"
    more = (
        f"<p class='faint'>{found['count'] - len(found['items'])} more</p>"
        if found["count"] > len(found["items"])
        else ""
    )
    return f"<h2>Items</h2><div class='scroll'><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>{more}"
