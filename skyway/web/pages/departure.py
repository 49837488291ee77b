"""The form of a departure: the plan, the drone and the options, and the equivalent command."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.flights.starting import FlightOptions
from skyway.models.base.errors import InputError, SkywayError
from skyway.web.controls import Button, CommandShown, Field, Status, say, text

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.web.site import Site


class DepartureForm:
    """The form of one open page.

    Parameters
    ----------
    site : Site
        The site whose work folder has the plans.
    begun : callable
        Called with the name of a started flight.
    shown : callable
        Called with the route of the chosen plan: pairs of latitude and longitude.
    """

    def __init__(self, site: Site, begun: Callable[[str], None], shown: Callable[[list[list[float]]], None]) -> None:
        self.site, self._begun, self._shown = site, begun, shown
        self.options = FlightOptions(scenario=site.scenario or "", given=tuple(site.options.given.words("fly")))
        self.plans: dict[str, dict[str, Any]] = {}
        text("h2", "Depart")
        self.choice = Field("Plan", self._choose, kind="select", hint="Saved on the page Plan, or by skyway plan -o")
        self.words = text("p", "", "faint")
        Field(
            "Connection to the drone",
            self._set("connect"),
            hint="udpin:127.0.0.1:14540, tcp:127.0.0.1:5760, /dev/ttyUSB0,57600",
        )
        Field("Pads", self._set("pads"), value="manual", hint="manual: people charge the drone; or tcp:HOST:PORT")
        self.drag = Field(
            "Drag of the drone",
            self._set("drag"),
            kind="select",
            hint="From skyway calibrate wind, to estimate the wind from tilt",
        )
        Field(
            "Package released by", self._set("release"), kind="select",
            options=[("", "as planned"), ("gripper", "the gripper"), ("hand", "a person, who confirms it")], value="",
        )  # fmt: skip
        Field("Ground heights", self._set("elevation"), hint="If the plan lacks one: target=34, metres above sea level")
        Field("Ask before each take-off", self._set("each"), kind="check", value=False)
        Field("Leave the drone's parameters as they are", self._set("keep"), kind="check", value=False)
        with ui.element("div").classes("line"):
            Button("Connect and check", self.start, "main")
            Button("Refresh the folder", self.read)
        text("p", "Nothing moves yet: the page shows the checks, then asks before the take-off.", "faint")
        self.status = Status()
        self.command = CommandShown("fly", "skyway fly PLAN --connect CONNECTION")

    async def read(self) -> None:
        """Offer the plans, and the drag files, of the folder."""
        files = self.site.folder.files(".json")
        names = [(one.name, one.modified_s, one.size) for one in files]
        try:
            found = await self.site.workers.ask("departure.plans", str(self.site.folder.root.resolve()), names)
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.plans = {one["name"]: one for one in found}
        self.choice.offer(
            [("", "choose a plan" if found else "no plan is saved yet"), *((one, one) for one in self.plans)]
        )
        drags = [one.name for one in self.site.folder.files(".toml")]
        self.drag.offer([("", "not known"), *((name, name) for name in drags)])

    def _choose(self, name: Any) -> None:
        plan = self.plans.get(str(name))
        self._set("plan")("" if plan is None else plan["name"])
        say(self.words, "" if plan is None else f"{plan['words']}; {plan['drone']} with {plan['payload_kg']:g} kg")
        self._shown([] if plan is None else plan["path"])

    def _set(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            typed: Any = value if isinstance(value, bool) else str(value).strip()[:300]
            self.options = replace(self.options, **{name: typed})
            try:
                self.command.show(shlex.join(["skyway", *self.options.words()]))
            except InputError:
                self.command.show("skyway fly PLAN --connect CONNECTION")

        return take

    def start(self) -> None:
        """Start the program of a flight; it requires a confirmation before the take-off."""
        plan = self.plans.get(self.options.plan)
        try:
            if plan is None:
                raise InputError("choose the plan to be flown", field="plan")
            folder, options = self.site.folder, self.options
            drag = str(folder.existing(options.drag)) if options.drag else ""
            whole = replace(options, plan=str(folder.existing(options.plan)), drag=drag)
            name = self.site.flights.begin(whole, plan["origin"], plan["destination"])
        except SkywayError as error:
            self.status.tell(str(error), wrong=True)
            return
        self.status.tell(f"started: {name}")
        self._begun(name)
