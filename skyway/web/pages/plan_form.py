"""The form of the plan page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.web.controls import Field
from skyway.web.preferences import from_instant, to_instant

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import tzinfo

    from skyway.web.work.question import Question


class PlanForm:
    """What is asked, as fields; each change is handed on at once.

    Parameters
    ----------
    question : Question
        What they show at first.
    changed : callable
        Called with fields of the question.
    """

    def __init__(self, question: Question, changed: Callable[..., None]) -> None:
        self._changed = changed
        self._zone: tzinfo | None = None
        q = question
        with ui.element("div").classes("rows wide"):
            self.start = Field("Start", self._takes("start"), kind="listed", value=q.start, hint="Station, or lat,lon")
            self.to = Field("Deliver to", self._takes("to"), kind="listed", value=q.to, hint="Station, or lat,lon")
            with ui.element("div").classes("pair"):
                self.payload = Field("Package", self._takes("payload"), value=q.payload, unit="kg", inputmode="decimal")
                self.drone = Field(
                    "Drone", self._takes("drone"), kind="select", value=q.drone, options=[("", "best of the fleet")]
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
                value=q.aim,
                hint="energy; cost; cost + 12/h*time; cost within 5%, then mean",
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
                    "Beside it", self._takes_other, kind="select", value="", options=[("", "no other planner")]
                )

    def offer(self, region: dict[str, Any], zone: tzinfo) -> None:
        """Offer what the region has."""
        self._zone = zone
        stations = [(one["id"], one["name"]) for one in region["stations"] if not one["bend"]]
        self.start.offer(stations)
        self.to.offer(stations)
        self.drone.offer(
            [("", "best of the fleet"), *((one["id"], f"{one['id']}: {one['name']}") for one in region["drones"])]
        )
        names = [(name, name) for name in region["planners"]]
        told = [(name, f"{name} (perfect information)") for name in region["clairvoyant"]]
        self.planner.offer([*names, *told])
        self.others.offer([("", "no other planner"), *names, *told])

    def show(self, question: Question) -> None:
        """Show a question."""
        for name in ("start", "to", "payload", "drone", "window", "planner", "aim", "reserve", "soc", "wind"):
            getattr(self, name).show(getattr(question, name))
        self.others.show(question.others[0] if question.others else "")
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
        self.others.keep(str(value))
        self._changed(others=(str(value),) if value else ())
