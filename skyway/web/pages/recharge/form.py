"""The form of the recharge page: mission, pads and drone, and the position of a new pad."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.missions.autopilots import NAMES
from skyway.typed_values import parse_position
from skyway.web.controls import Button, Drop, Field, text
from skyway.web.folder import MISSIONS
from skyway.web.work.question import OF_SCENARIO

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.web.folder import Folder
    from skyway.web.undo import Undo
    from skyway.web.work.question import Cut

PADS = (".csv", ".geojson")
"""Suffixes of pad files."""


class CutForm:
    """The request as fields; each change is passed on at once.

    Parameters
    ----------
    folder : Folder
        The folder whose files are offered.
    asked : Cut
        The initial request.
    changed : callable
        Called with fields of the request.
    put : callable
        Called with the name of a pad, empty for a new one, and its new place: latitude and longitude.
    wrong : callable
        Called with errors of the input.
    undos : Undo
        Its buttons are here.
    """

    def __init__(
        self,
        folder: Folder,
        asked: Cut,
        changed: Callable[..., None],
        put: Callable[[str, float, float], None],
        wrong: Callable[[str], None],
        undos: Undo[Cut],
    ) -> None:
        self._folder, self._asked = folder, asked
        self._changed, self._put, self._wrong = changed, put, wrong
        self._fields: dict[str, Field] = {}
        self._pad = self._place = ""
        Drop("Drop a mission or pads here, or choose", ",".join((*MISSIONS, *PADS)), self.uploaded, wrong)
        self._field("mission", "Mission", kind="select", value=asked.mission)
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
            self._which = Field("Pad", partial(setattr, self, "_pad"), kind="select", options=[("", "a new one")])
            Field("Place", partial(setattr, self, "_place"), hint="lat,lon")
        with ui.element("div").classes("line"):
            Button("Put it there", self.put)
            undos.lay_out()

    def _field(self, name: str, label: str, **how: Any) -> None:
        self._fields[name] = Field(label, partial(self._typed, name), **({"value": getattr(self._asked, name)} | how))

    def _typed(self, name: str, value: Any) -> None:
        self._fields[name].keep(value)
        self._changed(**{name: value if isinstance(value, bool) else str(value)[:300]})

    def uploaded(self, name: str) -> None:
        """Use an uploaded file: a mission, or pads."""
        self.offer_files()
        self._changed(**{"pads" if name.lower().endswith(PADS) else "mission": name})

    def put(self) -> None:
        """Put a pad at the typed place."""
        place = parse_position(str(self._place).strip()[:200])
        if place is None:
            self._wrong("A place is written lat,lon: 47.3978,8.545")
        else:
            self._put(str(self._pad)[:200], *place)

    def show(self, asked: Cut) -> None:
        """Show a request."""
        self._asked = asked
        for name, field in self._fields.items():
            field.show(getattr(asked, name))

    def offer_files(self) -> None:
        """Offer the files in the work folder."""
        for name, endings, more in (
            ("mission", MISSIONS, [("", "choose a file")]),
            ("pads", PADS, [("", "those that I put on the map"), (OF_SCENARIO, "of the scenario")]),
            ("vans", PADS, [("", "none")]),
        ):
            names = [one.name for one in self._folder.files(*endings)]
            self._fields[name].offer([*more, *((one, one) for one in names)])
            self._fields[name].show(getattr(self._asked, name))

    def offer_drones(self, names: Sequence[str]) -> None:
        """Offer the drones of the scenario."""
        self._fields["drone"].offer([("", "assume M200 V2"), *((one, one) for one in names)])

    def offer_pads(self, names: Sequence[str]) -> None:
        """Offer the pads that can be moved."""
        self._which.offer([("", "a new one"), *((one, one) for one in names)])
