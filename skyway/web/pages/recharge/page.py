"""The recharge page: a mission that is longer than a battery, cut at pads that can be dragged on the map."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from nicegui import Client, ui

from skyway.models.base.errors import SkywayError
from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Field, Status
from skyway.web.folder import safe_name
from skyway.web.map_key import key
from skyway.web.map_layer import MapLayer
from skyway.web.pages.recharge import answer
from skyway.web.pages.recharge.form import CutForm
from skyway.web.pages.under_way import UnderWay
from skyway.web.undo import Undo
from skyway.web.work.question import OF_SCENARIO, Cut, Put

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

ACTIONS = [
    {"name": "pad", "words": "Put a pad here"},
    {"name": "carry", "words": "Move this pad", "mark": True},
    {"name": "back", "words": "Put this pad back", "mark": True},
]
_FLIGHT_OF_CLICK = "(e) => { const b = e.target.closest('[data-flight]'); if (b) emit(b.dataset.flight); }"


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/recharge", RechargePage)


class RechargePage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        del wanted
        self.site, self.client = site, client
        given = dict(client.request.query_params)
        self.asked = Cut.of_address({"mission": given.get("file", "")} | given)
        self.undos: Undo[Cut] = Undo(self._turn_to)
        self.pads: list[dict[str, Any]] = []
        self.found: dict[str, Any] | None = None
        self.folder = ""
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Mission, pads and drone"'),
                ui.element("div").classes("rows wide"),
            ):
                self.form = CutForm(self.site.folder, self.asked, self.changed, self._put, self._wrong, self.undos)
                self.chips = ui.element("div").classes("chips")
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer(
                    "Map of the mission and its pads",
                    on_choose=self.picked, on_move=self.moved,
                )  # fmt: skip
                key("work", "pad", "cut", "fence", keys=("pads", "carry"))
            with ui.element("section").classes("panel answer").props('aria-label="Answer"'):
                self._answer_part()
        ui.timer(0.01, self._begin, once=True)

    def _answer_part(self) -> None:
        self.at_work = UnderWay(self.client, self._begin_answer, "Cut it now", self._cancelled)
        self.status = self.at_work.status
        self.figures = ui.html("")
        self.pictures = ui.html("")
        self.flights = ui.html("")
        self.flights.on("click", self.at_cut, js_handler=_FLIGHT_OF_CLICK)
        self.notes = ui.html("")
        with ui.element("div").classes("line"):
            Field("Folder", self._set("folder"), hint="Of the work folder; empty: named for the mission")
            self.save_button = Button("Save in the work folder", self.save)
            self.load_button = Button("Download", self.download)
        self.kept = Status()
        self.command = CommandShown("recharge")

    async def _begin(self) -> None:
        self.map.put(actions=ACTIONS, movable=True)
        try:
            region = await self.site.region()
        except SkywayError:
            region = {"drones": [], "bounds": [-180, -60, 180, 70]}
        self.form.offer_drones([one["id"] for one in region["drones"]])
        self.map.put(bounds=region["bounds"], fitted=True)
        self.form.offer_files()
        self._turn_to(self.asked)

    def _set(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            setattr(self, name, str(value).strip()[:200])

        return take

    def _wrong(self, why: str) -> None:
        self.status.tell(why, wrong=True)

    # the request

    def changed(self, **values: Any) -> None:
        """Make a new request; earlier ones remain available."""
        asked = msgspec.structs.replace(self.asked, **values)
        if asked.pads != self.asked.pads:
            asked = msgspec.structs.replace(asked, put=())
        if asked != self.asked:
            self.undos.leave(self.asked)
            self._turn_to(asked)

    def _turn_to(self, asked: Cut) -> None:
        self.asked = asked
        self.form.show(asked)
        shell.remember(self.client, "/recharge", asked.query())
        self._begin_answer()

    def picked(self, chosen: dict[str, Any]) -> None:
        """Use a choice on the map."""
        if chosen.get("action") == "pad":
            self._put("", float(chosen["lat"]), float(chosen["lon"]))
        elif chosen.get("action") == "back":
            self.take_back(str(chosen.get("mark")))

    def moved(self, moved: dict[str, Any]) -> None:
        """Move a pad."""
        self._put(str(moved["id"]), float(moved["lat"]), float(moved["lon"]))

    def _put(self, name: str, lat: float, lon: float) -> None:
        if self.asked.pads == OF_SCENARIO:
            self._wrong("Pads of a scenario cannot be moved: use a file of stations.")
            return
        taken = {one["id"] for one in self.pads} | {one.id for one in self.asked.put}
        name = name or next(f"pad-{number}" for number in range(1, len(taken) + 2) if f"pad-{number}" not in taken)
        others = [one for one in self.asked.put if one.id != name]
        self.changed(put=(*others, Put(name, round(lat, 7), round(lon, 7))))

    def take_back(self, name: str) -> None:
        """Return a pad to its place in the file; a new one is removed."""
        self.changed(put=tuple(one for one in self.asked.put if one.id != name))

    # the result

    def _begin_answer(self) -> None:
        self.at_work.begin(self._answer())

    def _cancelled(self) -> str:
        """Clear the previous result: it does not belong to the request."""
        self.found = None
        self._draw()
        return ""

    def _builtins(self) -> dict[str, Any]:
        """The request in the form for a worker: with the paths of files."""
        asked: dict[str, Any] = msgspec.to_builtins(self.asked)
        for name in ("mission", "pads", "vans"):
            if asked[name] and asked[name] != OF_SCENARIO:
                asked[name] = str(self.site.folder.existing(asked[name]))
        return asked

    async def _answer(self) -> None:
        with self.client:
            self.undos.show(self.asked)
            self._show_moved()
            self.kept.tell("")
            try:
                asked = self._builtins()
                self.pads = await self.site.workers.ask("recharged.places", self.site.scenario, asked)
            except SkywayError as error:
                self.found, self.pads = None, []
                self._draw()
                self._wrong(str(error))
                return
            self.form.offer_pads([one["id"] for one in self.pads])
            if not self.asked.mission or not (self.pads or self.asked.vans):
                self.found = None
                self._draw()
                lacking = (
                    "pads: a file of stations, or click on the map" if self.asked.mission else "a mission, or drop one"
                )
                self.status.tell(f"Choose {lacking}.")
                await self._show_mission(asked)
                return
            self.at_work.tell("Cutting the mission …")
            try:
                self.found = await self.site.workers.ask("recharged.shown", self.site.scenario, asked)
            except SkywayError as error:
                self.found = None
                self._draw()
                self._wrong(str(error))
                await self._show_mission(asked)
                return
            self.status.tell("")
            self._draw()

    async def _show_mission(self, asked: dict[str, Any]) -> None:
        """Show the original mission if it could not be cut, so that pads can be added."""
        if not asked["mission"]:
            return
        try:
            plain = await self.site.workers.ask("missions.shown", asked["mission"], self.site.scenario, {})
        except SkywayError as error:
            self._wrong(str(error))
            return
        lines = [leg["points"] for leg in plain["legs"]]
        self._on_map(lines, plain["home"], [])

    def _on_map(self, lines: list[Any], home: list[float] | None, cuts: list[list[float]]) -> None:
        used = {one["where"] for one in self.found["bars"]} if self.found else set()
        marks = [{"place": home, "label": "H", "colour": "ink"}] if home else []
        marks += [{"place": place, "label": "||", "colour": "ink"} for place in cuts]
        marks += [
            {"place": [one["lat"], one["lon"]], "label": "P", "colour": "start" if one["id"] in used else "other", "id": one["id"], "name": one["id"]}
            for one in self.pads
        ]  # fmt: skip
        parts: dict[str, Any] = {
            "plans": [{"path": lines, "stops": [], "route": []}] if lines else [],
            "chosen": 0,
            "marks": marks,
        }
        points = [at for line in lines for at in line]
        framed = (self.asked.mission, self.asked.pads)
        if points and framed != getattr(self, "_framed", None):
            self._framed = framed
            lat, lon = [at[0] for at in points], [at[1] for at in points]
            parts |= {"bounds": [min(lon), min(lat), max(lon), max(lat)], "fitted": True}
        self.map.put(**parts)

    def _draw(self) -> None:
        found = self.found
        for button in (self.save_button, self.load_button):
            button.enable(found is not None)
        if found is None:
            for part in (self.figures, self.pictures, self.flights, self.notes):
                part.set_content("")
            self._on_map([], None, [])
            self.command.show("")
            return
        cuts = [one["left_at"] for one in found["summary"]["flights"] if one["left_at"]]
        self._on_map(found["lines"], found["home"], [[one["lat"], one["lon"]] for one in cuts])
        self.figures.set_content(answer.figures(found))
        self.pictures.set_content(answer.pictures(found))
        self.flights.set_content(answer.flights(found))
        self.notes.set_content(answer.notes(found))
        self.command.show(self.asked.command(self.site.scenario, self._pads_name(), self._folder_name()))

    def _show_moved(self) -> None:
        self.chips.clear()
        with self.chips:
            for one in self.asked.put:
                words = f"{one.id} at {one.lat:.5f},{one.lon:.5f} \N{MULTIPLICATION SIGN}"
                Button(words, partial(self.take_back, one.id), "chip", title="Put it back")

    def at_cut(self, event: Any) -> None:
        """Show where the work is left."""
        for one in self.found["summary"]["flights"] if self.found else ():
            if str(one["number"]) == str(event.args) and one["left_at"]:
                self.map.put(centre=[one["left_at"]["lat"], one["left_at"]["lon"]])

    # saving

    def _folder_name(self) -> str:
        return safe_name(self.folder or f"{Path(self.asked.mission).stem}-batteries")

    def _pads_name(self) -> str:
        """Name of the file of the pads, or of the file in which they will be saved if any was moved."""
        return f"{self._folder_name()}-pads.csv" if self.asked.put else self.asked.pads

    async def save(self) -> None:
        """Write the folder, and the pads if any was moved."""
        wanted = self._folder_name()
        try:
            folder, pads = self.site.folder.free_names([wanted, f"{wanted}-pads.csv"])
            root = str(self.site.folder.root.resolve())
            made = await self.site.workers.ask(
                "recharged.saved", self.site.scenario, self._builtins(), root, folder, pads
            )
        except SkywayError as error:
            self.kept.tell(str(error), wrong=True)
            return
        self.form.offer_files()
        self.kept.tell(f"saved {', '.join(made)}; flown by: skyway fly {folder} --connect CONNECTION")

    async def download(self) -> None:
        """Send the folder to the browser, as a ZIP file."""
        name = self._folder_name()
        try:
            content = await self.site.workers.ask("recharged.packed", self.site.scenario, self._builtins(), name)
        except SkywayError as error:
            self.kept.tell(str(error), wrong=True)
            return
        ui.download.content(content, f"{name}.zip")
