"""The map: one canvas that draws stations, routes, wind and vehicles, and lets people move things."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.web.preferences import CHOICES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.web.preferences import Preferences


class MapLayer(ui.element, component="static/map_layer.js", esm={"skyway-map": "static/map"}):
    """A map that fetches the region, the ground, the base map and the outline.

    Parameters
    ----------
    label : str
        For people who cannot see the map.
    on_choose, on_drag, on_vehicle, on_move : callable, optional
        Called with the choice in the menu of a place (action, station, lat, lon); with the stations from and to which a stop was
        dragged; with the id of a vehicle; with the id of a mark and the place to which it was dragged.
    """

    def __init__(
        self,
        label: str,
        *,
        on_choose: Callable[[dict[str, Any]], Any] | None = None,
        on_drag: Callable[[dict[str, Any]], Any] | None = None,
        on_vehicle: Callable[[dict[str, Any]], Any] | None = None,
        on_move: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        super().__init__()
        self._props["label"] = label
        given = (("choose", on_choose), ("drag_stop", on_drag), ("vehicle", on_vehicle), ("drag_mark", on_move))
        for name, handler in given:
            if handler is not None:
                self.on(name, lambda event, handler=handler: handler(event.args))

    def put(self, **parts: Any) -> None:
        """Show parts: see ``static/map/index.js``."""
        self.run_method("set", parts)

    def load(self, name: str, url: str) -> None:
        """Let the browser fetch a part separately."""
        self.run_method("load", name, url)


class OnMap(ui.element):
    """A component of the page that moves something on the map, in the person's preferred units."""

    def __init__(self, wanted: Preferences) -> None:
        super().__init__()
        self._props.update(
            {
                "speed-unit": CHOICES["speed"][1][wanted.speed], "speed-factor": wanted.speed_factor,
                "height-unit": wanted.height, "height-factor": wanted.height_factor, "utc": wanted.time == "utc",
            }
        )  # fmt: skip


class Player(OnMap, component="static/player.js", esm={"skyway-flight": "static/flight"}):
    """Plays logs: ``static/player.js``."""

    def in_region(self, timezone: str, bounds: Sequence[float]) -> None:
        """Show local times of a region (west, south, east, north) for its logs, and UTC for logs from elsewhere."""
        self._props["zone"], self._props["bounds"] = timezone, list(bounds)
        self.update()


class FlightPanel(OnMap, component="static/flights.js", esm={"skyway-flight": "static/flight"}):
    """Flights in progress, one tab each, and received vehicles: ``static/flights.js``.

    Parameters
    ----------
    wanted : Preferences
        Units and times.
    first : str
        Name of the flight that is shown initially.
    """

    def __init__(self, wanted: Preferences, first: str) -> None:
        super().__init__(wanted)
        self._props["first"] = first

    def in_zone(self, timezone: str) -> None:
        """Show local times of a zone."""
        self._props["zone"] = timezone
        self.update()


class FleetBoard(ui.element, component="static/fleet.js", esm={"skyway-flight": "static/flight"}):
    """Status of a fleet, in parts that the browser fetches, its drones on the map, and the cancellation of orders: ``static/fleet.js``.

    Parameters
    ----------
    parts : sequence of str
        Their names, from the top.
    """

    def __init__(self, parts: Sequence[str]) -> None:
        super().__init__()
        self._props["parts"] = list(parts)

    def follow(self, ledger: str, holder: str) -> None:
        """Show another ledger."""
        self._props.update({"ledger": ledger, "holder": holder})
        self.update()
