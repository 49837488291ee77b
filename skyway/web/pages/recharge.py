"""The recharge page: a mission that is longer than a battery, cut at pads that are dragged on the map."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from nicegui import Client, ui

from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import SkywayError
from skyway.typed_values import parse_position
from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Drop, Field, Status, text
from skyway.web.folder import MISSIONS, safe_name
from skyway.web.map_key import key
from skyway.web.map_layer import MapLayer
from skyway.web.pages import recharge_answer
from skyway.web.undo import Undo
from skyway.web.work.question import OF_SCENARIO, Cut, Put

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

PADS = (".csv", ".geojson")
ACTIONS = [{"name": "pad", "words": "Put a pad here"}, {"name": "back", "words": "Put this pad back", "mark": True}]
_FLIGHT_OF_CLICK = "(e) => { const b = e.target.closest('[data-flight]'); if (b) emit(b.dataset.flight); }"


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/recharge", RechargePage)


class RechargePage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        del wanted
        self.site, self.client = site, client
        self.asked = Cut(mission=client.request.query_params.get("file", "")[:300])
        self.undos: Undo[Cut] = Undo(self._turn_to)
        self.fields: dict[str, Field] = {}
        self.pads: list[dict[str, Any]] = []
        self.found: dict[str, Any] | None = None
        self.task: asyncio.Task[None] | None = None
        self.folder, self.pad, self.place = "", "", ""
        with ui.element("div").classes("work"):
            with (
                ui.element("section").classes("panel form").props('aria-label="Mission, pads and drone"'),
                ui.element("div").classes("rows wide"),
            ):
                self._form()
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer(
                    "Map of the mission and its pads. Arrow keys move it, plus and minus zoom, 0 shows everything. Pads are moved by dragging them, or by the fields under Pad.",
                    on_choose=self.picked, on_move=self.moved,
                )  # fmt: skip
                key("work", "pad", "cut", "fence")
            with ui.element("section").classes("panel answer").props('aria-label="Answer"'):
                self._answer_part()
        ui.timer(0.01, self._begin, once=True)

    def _form(self) -> None:
        Drop("Drop a mission or pads here, or choose", ",".join((*MISSIONS, *PADS)), self.uploaded, self._wrong)
        self._field("mission", "Mission", kind="select", value=self.asked.mission)
        self._field("pads", "Pads", kind="select", hint="A file of stations (CSV, GeoJSON); or click on the map")
        self._field("vans", "Vans with pads", kind="select")
        self._field("depart", "First take-off", hint="With UTC offset; for vans, and the forecast of the scenario")
        self._field("drone", "Drone", kind="select", options=[("", "assume M200 V2")])
        self._field("autopilot", "Autopilot", kind="select", options=[("", "all"), *((one, one) for one in NAMES)])
        with ui.element("div").classes("pair"):
            self._field("wind", "Wind", unit="m/s@° from", hint="8@270; empty: still air")
            self._field("payload", "Package", unit="kg", inputmode="decimal")
        with ui.element("div").classes("pair"):
            self._field("soc", "Charge", unit="%", inputmode="decimal")
            self._field("reserve", "Reserve", unit="%", inputmode="decimal")
        with ui.element("div").classes("pair"):
            self._field("swap", "Changed in", unit="s", hint="Empty: it is charged", inputmode="numeric")
            self._field("laps", "Laps", hint="Of a patrol", inputmode="numeric")
        with ui.element("div").classes("pair"):
            self._field("packs", "Batteries", hint="Where they are changed", inputmode="numeric")
            self._field("chargers", "Chargers", hint="For them", inputmode="numeric")
        with ui.element("div").classes("pair"):
            self._field("home", "Home", hint="lat,lon, where the file has none")
            self._field("home_elevation", "Ground of home", unit="m", hint="Above the sea", inputmode="decimal")
        self._field("level_ground", "The ground of all pads is as high as home", kind="check")
        self._field("reorder", "Lines and places may be flown in another order", kind="check")
        text("h2", "Pad")
        with ui.element("div").classes("pair"):
            self.which = Field("Pad", self._set("pad"), kind="select", options=[("", "a new one")])
            Field("Place", self._set("place"), hint="lat,lon")
        with ui.element("div").classes("line"):
            Button("Put it there", self.put)
            self.undos.lay_out()
        self.chips = ui.element("div").classes("chips")

    def _field(self, name: str, label: str, **how: Any) -> None:
        self.fields[name] = Field(label, partial(self.typed, name), **({"value": getattr(self.asked, name)} | how))

    def _answer_part(self) -> None:
        self.status = Status()
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
        self.fields["drone"].offer([("", "assume M200 V2"), *((one["id"], one["id"]) for one in region["drones"])])
        self.map.put(bounds=region["bounds"], fitted=True)
        self._list()
        self._turn_to(self.asked)

    def _list(self) -> None:
        for name, endings, more in (
            ("mission", MISSIONS, [("", "choose a file")]),
            ("pads", PADS, [("", "those that I put on the map"), (OF_SCENARIO, "of the scenario")]),
            ("vans", PADS, [("", "none")]),
        ):
            names = [one.name for one in self.site.folder.files(*endings)]
            self.fields[name].offer([*more, *((one, one) for one in names)])
            self.fields[name].show(getattr(self.asked, name))

    def _set(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            setattr(self, name, str(value).strip()[:200])

        return take

    def _wrong(self, why: str) -> None:
        self.status.tell(why, wrong=True)

    # what is asked

    def uploaded(self, name: str) -> None:
        """Take a file that has come: a mission, or pads."""
        self._list()
        self.ask(**{"pads" if name.lower().endswith(PADS) else "mission": name})

    def typed(self, name: str, value: Any) -> None:
        """Take what a person has entered."""
        self.fields[name].keep(value)
        self.ask(**{name: value if isinstance(value, bool) else str(value)[:300]})

    def ask(self, **values: Any) -> None:
        """Ask something else; what was asked before can be had again."""
        asked = msgspec.structs.replace(self.asked, **values)
        if asked.pads != self.asked.pads:
            asked = msgspec.structs.replace(asked, put=())
        if asked != self.asked:
            self.undos.leave(self.asked)
            self._turn_to(asked)

    def _turn_to(self, asked: Cut) -> None:
        self.asked = asked
        for name, field in self.fields.items():
            field.show(getattr(asked, name))
        if self.task is not None:
            self.task.cancel()
        self.task = asyncio.create_task(self._answer())

    def picked(self, chosen: dict[str, Any]) -> None:
        """Take what was chosen on the map."""
        if chosen.get("action") == "pad":
            self._put("", float(chosen["lat"]), float(chosen["lon"]))
        elif chosen.get("action") == "back":
            self.take_back(str(chosen.get("mark")))

    def moved(self, moved: dict[str, Any]) -> None:
        """Move a pad."""
        self._put(str(moved["id"]), float(moved["lat"]), float(moved["lon"]))

    def put(self) -> None:
        """Put a pad where it was typed."""
        place = parse_position(self.place)
        if place is None:
            self._wrong("A place is written lat,lon: 47.3978,8.545")
        else:
            self._put(self.pad, *place)

    def _put(self, name: str, lat: float, lon: float) -> None:
        if self.asked.pads == OF_SCENARIO:
            self._wrong("The pads of a scenario stay where they are: take a file of stations.")
            return
        taken = {one["id"] for one in self.pads} | {one.id for one in self.asked.put}
        name = name or next(f"pad-{number}" for number in range(1, len(taken) + 2) if f"pad-{number}" not in taken)
        others = [one for one in self.asked.put if one.id != name]
        self.ask(put=(*others, Put(name, round(lat, 7), round(lon, 7))))

    def take_back(self, name: str) -> None:
        """Put a pad back to where its file has it; one that was new goes."""
        self.ask(put=tuple(one for one in self.asked.put if one.id != name))

    # the answer

    def _builtins(self) -> dict[str, Any]:
        """What is asked as a worker wants it: with the paths of files."""
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
            self.which.offer([("", "a new one"), *((one["id"], one["id"]) for one in self.pads)])
            if not self.asked.mission or not (self.pads or self.asked.vans):
                self.found = None
                self._draw()
                lacking = (
                    "pads: a file of stations, or click on the map" if self.asked.mission else "a mission, or drop one"
                )
                self.status.tell(f"Choose {lacking}.")
                await self._show_mission(asked)
                return
            self.status.tell("Cutting the mission …")
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
        """Show the mission as it is where it could not be cut: pads are put beside it."""
        if not asked["mission"]:
            return
        try:
            plain = await self.site.workers.ask("missions.shown", asked["mission"], self.site.scenario, {})
        except SkywayError:
            return  # what hinders it was told
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
        self.figures.set_content(recharge_answer.figures(found))
        self.pictures.set_content(recharge_answer.pictures(found))
        self.flights.set_content(recharge_answer.flights(found))
        self.notes.set_content(recharge_answer.notes(found))
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

    # what is saved

    def _folder_name(self) -> str:
        return safe_name(self.folder or f"{Path(self.asked.mission).stem}-batteries")

    def _pads_name(self) -> str:
        """Name of the file that the pads are in, or will be saved in where any was moved."""
        return f"{self._folder_name()}-pads.csv" if self.asked.put else self.asked.pads

    async def save(self) -> None:
        """Write the folder, and the pads where any was moved."""
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
        self._list()
        self.kept.tell(f"saved {', '.join(made)}; flown by: skyway fly {folder} --connect CONNECTION")

    async def download(self) -> None:
        """Hand the folder to the browser, as a ZIP file."""
        name = self._folder_name()
        try:
            content = await self.site.workers.ask("recharged.packed", self.site.scenario, self._builtins(), name)
        except SkywayError as error:
            self.kept.tell(str(error), wrong=True)
            return
        ui.download.content(content, f"{name}.zip")
