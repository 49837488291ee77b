"""The plan page: a request on the map or in the form, with the answer beside it."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import msgspec
from nicegui import Client, ui

from skyway.models.base.errors import SkywayError
from skyway.models.base.formatting import direction_text
from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Field, say, text
from skyway.web.map_key import key
from skyway.web.map_layer import MapLayer
from skyway.web.pages import plan_answer, plan_on_map
from skyway.web.pages.plan_files import PlanFiles
from skyway.web.pages.plan_form import PlanForm
from skyway.web.pages.under_way import UnderWay
from skyway.web.undo import Undo
from skyway.web.work.question import MOST_PLANS, Question

if TYPE_CHECKING:
    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

FRESH_S = 60.0
"""A result younger than this is shown again, without a new computation, when a person returns to its request."""
LAYERS = {"wind": "wind", "zones": "zones", "terrain": "ground"}
"""Layers that can be hidden on the map: label, and name there."""


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/", PlanPage)


class PlanPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site, self.client, self.wanted = site, client, wanted
        self.question = Question.of_address(dict(client.request.query_params))
        self.undos: Undo[Question] = Undo(self._turn_to)
        self.region: dict[str, Any] | None = None
        self.answer: dict[str, Any] | None = None
        self.more: dict[str, Any] | None = None
        self.answered: tuple[Question, float] | None = None
        self.chosen = 0
        self.winds: dict[str, Any] = {"hours": []}
        self.layers: dict[str, bool] = {}
        self.weather: asyncio.Task[None] | None = None
        self._lay_out()
        ui.timer(0.01, self._begin, once=True)

    def _lay_out(self) -> None:
        with ui.element("div").classes("work"):
            with ui.element("section").classes("panel form").props('aria-label="What is asked"'):
                self.form = PlanForm(self.question, self.changed)
                self.kept = ui.element("div").classes("chips")
                with ui.element("div").classes("line"):
                    self.undos.lay_out()
                    Button("Clear", lambda: self.ask(Question()), title="Begin again")
            with ui.element("section").classes("seen").props('aria-label="Map"'):
                self.map = MapLayer(
                    "Map of the network",
                    on_choose=self.picked,
                    on_drag=self.dragged,
                )  # fmt: skip
                key("station", "stop", "route", "other", "zone", "wind", keys=("stations", "segments", "carry"))
                with ui.element("div").classes("under-map"):
                    self.hour = Field(
                        "Wind and queues at",
                        self.slid,
                        kind="range",
                        value="0",
                        on_slide=self.slid,
                        min="0",
                        max="23",
                        step="1",
                    )
                    self.told = text("span", "", "told", role="status")
                    self.seen = {
                        layer: Field(layer, partial(self._see, layer), kind="check", value=True) for layer in LAYERS
                    }
            with ui.element("section").classes("panel answer").props('aria-label="Answer"'):
                self.at_work = UnderWay(self.client, self._begin_answer, "Plan now", self._cancelled)
                self.status = self.at_work.status
                self.first = ui.element("p")
                with self.first:
                    text("a", "Or watch a delivery being flown: the demonstration", href="/fly")
                with ui.element("div") as self.shown:
                    self.figures = ui.html("")
                    self.pictures = ui.html("")
                    self.beside = ui.html("")
                    self.beside.on("click", lambda event: self.show(int(event.args)), js_handler=_PLAN_OF_CLICK)
                    self.reasons = ui.html("")
                    self.notes = ui.html("")
                    self.files = PlanFiles(self.site, self._shown_plan, self.ask)
                self.command = CommandShown("plan")

    async def _begin(self) -> None:
        """Fill the page: the map fetches the region itself, the form needs it here."""
        self.map.put(actions=list(plan_on_map.ACTIONS))
        try:
            self.region = await self.site.region()
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.seen["zones"].set_visibility(bool(self.region["zones"]))
        self.seen["terrain"].set_visibility(self.region["terrain"])
        self.form.offer(self.region, self.wanted.zone(self.region["timezone"]))
        self.form.show(self.question)
        self._begin_answer()

    def _see(self, layer: str, on: object) -> None:
        self.layers[LAYERS[layer]] = bool(on)
        self.map.put(layers=self.layers)

    @property
    def timezone(self) -> str:
        """IANA name of the region's local time."""
        return "UTC" if self.region is None else str(self.region["timezone"])

    # the request

    def changed(self, **values: Any) -> None:
        """Process a person's input."""
        self.ask(msgspec.structs.replace(self.question, **values))

    def ask(self, question: Question) -> None:
        """Make a new request; earlier ones remain available."""
        if question != self.question:
            self.undos.leave(self.question)
            self._turn_to(question)

    def _turn_to(self, question: Question) -> None:
        self.question = question
        self.form.show(question)
        shell.remember(self.client, "/", question.query())
        self._begin_answer()

    def picked(self, chosen: dict[str, Any]) -> None:
        """Use a place of the map."""
        self.ask(plan_on_map.chosen_there(self.question, chosen))

    def dragged(self, moved: dict[str, Any]) -> None:
        """Move a stop to another station."""
        made = self.plans[self.chosen]["stops"] if self.plans else []
        self.ask(plan_on_map.stop_moved(self.question, made, str(moved["from"]), str(moved["to"])))

    # the result

    def _begin_answer(self) -> None:
        self.at_work.begin(self._answer())

    def _cancelled(self) -> str:
        """Text on the page after a person has cancelled the computation."""
        if self.is_current:
            return "Reasons and other routes are not shown."
        return "Below is the plan of the previous request." if self.plans else ""

    @property
    def is_current(self) -> bool:
        """Whether the shown plan belongs to the current request."""
        return self.answered is not None and self.answered[0] == self.question

    async def _answer(self) -> None:
        """Plan, and show results as they arrive: first the plan, then the extras."""
        with self.client:
            self._show_ends()
            self._show_kept()
            self.undos.show(self.question)
            self.weather = asyncio.create_task(self._weather())
            self.first.style(f"display: {'none' if self.question.complete else 'block'}")
            if not self.question.complete:
                self._answered(None)
                self.status.tell("Choose a start and a target: click on the map, or type a station.")
                return
            asked = msgspec.to_builtins(self.question), "UTC" if self.wanted.time == "utc" else None
            if not (self.is_current and self.answered is not None and time.monotonic() - self.answered[1] < FRESH_S):
                self.shown.classes("old")
                self.at_work.tell("Planning …")
                try:
                    found = await self.site.workers.ask("planned.plan", self.site.scenario, *asked)
                except SkywayError as error:
                    self._answered(None)
                    self.status.tell(str(error), wrong=True)
                    return
                self._answered(found)
            if self.more is None:
                self._draw()
                self.at_work.tell("Reasons and other routes follow …")
                try:
                    self.more = await self.site.workers.ask("planned.explained", self.site.scenario, *asked)
                except SkywayError as error:
                    self.status.tell(str(error), wrong=True)
                    return
            self._draw()
            self.status.tell("")

    def _answered(self, found: dict[str, Any] | None) -> None:
        """Store the result of the current request, or the lack of one."""
        self.answer, self.more, self.chosen = found, None, 0
        self.answered = None if found is None else (self.question, time.monotonic())
        if found is None:
            self._draw()

    async def _weather(self) -> None:
        """Wind and queues of the hours from the departure on."""
        conditions = self.question.conditions()
        given = {name: value for name, value in conditions.items() if value}
        try:
            found = await self.site.workers.ask("region.winds", self.site.scenario, conditions)
        except SkywayError:
            found = {"hours": []}
        if conditions != self.question.conditions():
            return  # other hours have been requested meanwhile
        self.winds = found
        if not found["hours"]:
            return
        address = f"?{urlencode(given)}"
        self.map.load("wind", f"/api/wind{address}")
        self.map.load("queues", f"/api/queues{address}")
        self.slid(self.hour.shown)

    def slid(self, value: Any) -> None:
        """Show another hour."""
        self.hour.keep(str(value))
        hours = self.winds["hours"]
        if not hours:
            say(self.told, "")
            return
        number = max(0, min(int(float(value)), len(hours) - 1))
        one = hours[number]
        self.map.put(hour=number)
        from skyway.models.base.units import parse_instant

        when = self.wanted.clock(parse_instant(one["time"]), self.timezone)
        spread = f"{self.wanted.speed_text(one['p10_mps']).split(' ', maxsplit=1)[0]} to {self.wanted.speed_text(one['p90_mps'])}"
        towards = "variable" if one["from_deg"] is None else f"from {direction_text(one['from_deg'], 10)}"
        say(self.told, f"{when}: wind {self.wanted.speed_text(one['mean_mps'])} ({spread}) {towards}")

    @property
    def plans(self) -> list[dict[str, Any]]:
        """All plans that are shown side by side."""
        if self.answer is None:
            return []
        others = [] if self.more is None else self.more["alternatives"]
        first, *planners = self.answer["plans"]
        return [first, *planners, *others][:MOST_PLANS]

    def _shown_plan(self) -> dict[str, Any] | None:
        """The shown plan in the form of its file; None if it does not belong to the request."""
        return self.plans[self.chosen]["composition"] if self.plans and self.is_current else None

    def show(self, number: int) -> None:
        """Show another of the plans side by side."""
        if 0 <= number < len(self.plans):
            self.chosen = number
            self._draw()

    def _draw(self) -> None:
        plans, answer = self.plans, self.answer
        if self.is_current or answer is None:
            self.shown.classes(remove="old")
        shapes = [{name: one[name] for name in ("path", "stops", "route")} for one in plans]
        self.map.put(plans=shapes, chosen=self.chosen)
        if answer is None:
            for part in (self.figures, self.pictures, self.beside, self.reasons, self.notes):
                part.set_content("")
            self.command.show(self.question.command(self.site.scenario) if self.question.complete else "")
            return
        plan = plans[self.chosen]
        zone = self.wanted.zone(self.timezone)
        self.figures.set_content(plan_answer.figures(plan, self.wanted))
        self.pictures.set_content(plan_answer.pictures(plans, self.chosen, zone, self.wanted))
        self.beside.set_content(plan_answer.beside(plans, self.chosen, answer["without"]))
        self.reasons.set_content("" if self.more is None else plan_answer.explained(self.more, self.wanted))
        self.notes.set_content(plan_answer.notes(plan, answer, self.wanted))
        self.command.show(self.question.command(self.site.scenario, plan["planner"]))

    def _show_kept(self) -> None:
        """Constraints on the route, each with a button that removes it."""
        self.kept.clear()
        with self.kept:
            for name, words in (("stop_at", "stop at"), ("avoid", "avoid"), ("others", "compare with")):
                for place in getattr(self.question, name):
                    act = {"action": f"not_{name}", "station": place}
                    Button(
                        f"{words} {place} \N{MULTIPLICATION SIGN}",
                        partial(self.picked, act),
                        "chip",
                        title="Take this back",
                    )

    def _show_ends(self) -> None:
        """Start and target on the map."""
        places = {one["id"]: one for one in (self.region or {}).get("stations", ())}

        def place(typed: str) -> dict[str, float] | None:
            if typed.strip() in places:
                found = places[typed.strip()]
                return {"lat": found["lat"], "lon": found["lon"]}
            from skyway.typed_values import parse_position

            position = parse_position(typed)
            return None if position is None else {"lat": position[0], "lon": position[1]}

        self.map.put(
            start=place(self.question.start),
            target=place(self.question.to),
            avoid=list(self.question.avoid),
            stopAt=list(self.question.stop_at),
        )


_PLAN_OF_CLICK = "(e) => { const b = e.target.closest('[data-plan]'); if (b) emit(b.dataset.plan); }"
