"""The form of the plan page."""

from __future__ import annotations

from datetime import UTC
from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.web.controls import Field, text
from skyway.web.preferences import from_instant, to_instant
from skyway.web.work.question import MOST_PLANS

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import tzinfo

    from skyway.web.work.question import Question


AIMS = (
    ("energy", "least energy"),
    ("cost", "least cost"),
    ("p95", "soonest, 95 % within"),
    ("cost within 5%, then mean", "soonest of the cheap"),
    ("mean within 5%, then cost", "cheapest of the soon"),
)
RETURNS = (("home", "where it came from"), ("none", "it stays at the target"))
AFTER = ("return_to", "dwell", "if_undelivered")
MAX_OTHERS = MOST_PLANS - 1


class PlanForm:
    """The request as fields; each change is passed on at once.

    Parameters
    ----------
    question : Question
        The initial request.
    changed : callable
        Called with fields of the request.
    """

    def __init__(self, question: Question, changed: Callable[..., None]) -> None:
        self._changed = changed
        self._zone: tzinfo | None = None
        self._others = question.others
        q = question
        with ui.element("div").classes("rows wide"):
            self.start = Field("Start", self._takes("start"), kind="listed", value=q.start, hint="Station, or lat,lon")
            self.to = Field("Deliver to", self._takes("to"), kind="listed", value=q.to, hint="Station, or lat,lon")
            with ui.element("div").classes("pair"):
                self.payload = Field("Package", self._takes("payload"), value=q.payload, unit="kg", inputmode="decimal")
                self.drone = Field(
                    "Drone", self._takes("drone"), kind="select", value=q.drone, options=[("", "the best")]
                )
            self.depart = Field("Departure", self._takes_time("depart"), kind="datetime-local", hint="Empty: now")
            with ui.element("div").classes("pair"):
                self.window = Field(
                    "Leave within", self._takes("window"), value=q.window, hint="90min, 2h", placeholder="at once"
                )
                self.planner = Field(
                    "Planner", self._takes("planner"), kind="select", value=q.planner, options=[("robust", "robust")]
                )
            self.deadline = Field(
                "Deadline", self._takes_time("deadline"), kind="datetime-local", hint="Empty: as soon as possible"
            )
            self.not_before = Field(
                "Not before", self._takes_time("not_before"), kind="datetime-local", hint="Empty: at any time"
            )
            self.aim = Field(
                "Aim",
                self._takes("aim"),
                kind="listed",
                value=q.aim,
                options=AIMS,
                hint="Or a sum such as cost + 12/h*time",
                placeholder="soonest",
            )
            with ui.element("div").classes("pair"):
                self.reserve = Field("Reserve", self._takes("reserve"), value=q.reserve, unit="%", inputmode="decimal")
                self.soc = Field("Charge at start", self._takes("soc"), value=q.soc, unit="%", inputmode="decimal")
            with ui.element("div").classes("pair"):
                self.wind = Field(
                    "Wind", self._takes("wind"), value=q.wind, hint="8@270; empty: forecast", unit="m/s@° from"
                )
                self.others = Field(
                    "Compare with", self._takes_other, kind="select", value="", options=[("", "add one")]
                )
        self.after = ui.element("details").classes("after")
        with self.after:
            text("summary", "After the delivery")
            with ui.element("div").classes("rows wide"):
                self.return_to = Field(
                    "Drone goes to",
                    self._takes("return_to"),
                    kind="listed",
                    value=q.return_to,
                    placeholder="nearest pad",
                    hint="home, none, or a station",
                )
                self.dwell = Field(
                    "Time at the target", self._takes("dwell"), value=q.dwell, hint="5min", placeholder="none"
                )
                self.if_undelivered = Field(
                    "Package goes to, if not handed over",
                    self._takes("if_undelivered"),
                    kind="listed",
                    value=q.if_undelivered,
                    placeholder="nothing kept for it",
                    hint="back, or a station",
                )

    def offer(self, region: dict[str, Any], zone: tzinfo) -> None:
        """Offer the choices of the region."""
        self._zone = zone
        for field in (self.depart, self.deadline, self.not_before):
            field.measure("UTC" if zone is UTC else f"{str(zone).rpartition('/')[2].replace('_', ' ')} time")
        stations = [(one["id"], one["name"]) for one in region["stations"] if not one["bend"]]
        self.start.offer(stations)
        self.to.offer(stations)
        self.drone.offer([("", "the best"), *((one["id"], f"{one['id']}: {one['name']}") for one in region["drones"])])
        names = [(name, name) for name in region["planners"]]
        told = [(name, f"{name} (perfect information)") for name in region["clairvoyant"]]
        self.planner.offer([*names, *told])
        self.others.offer([("", "add one"), *names, *told])
        self.return_to.offer([*RETURNS, *stations])
        self.if_undelivered.offer([("back", "to where it came from"), *stations])

    def show(self, question: Question) -> None:
        """Show a request."""
        for name in ("start", "to", "payload", "drone", "window", "planner", "aim", "reserve", "soc", "wind", *AFTER):
            getattr(self, name).show(getattr(question, name))
        self.others.show("")
        self._others = question.others
        if any(getattr(question, name) for name in AFTER):
            self.after.props("open")
        for name in ("depart", "deadline", "not_before"):
            field: Field = getattr(self, name)
            field.show("" if self._zone is None else from_instant(getattr(question, name), self._zone))

    def _takes(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            getattr(self, name).keep(str(value))
            self._changed(**{name: str(value)[:200]})

        return take

    def _takes_time(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            getattr(self, name).keep(str(value))
            self._changed(**{name: to_instant(str(value), self._zone) if self._zone is not None else str(value)})

        return take

    def _takes_other(self, value: Any) -> None:
        """Add a planner for comparison; it is listed below the form, where it can be removed."""
        self.others.keep(str(value))
        if value:
            self._changed(others=tuple(dict.fromkeys((*self._others, str(value))))[-MAX_OTHERS:])
