"""The map: one canvas of ours, which draws stations, routes, wind and vehicles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import ui

if TYPE_CHECKING:
    from collections.abc import Callable


class MapLayer(ui.element, component="static/map_layer.js", esm={"skyway-map": "static/map"}):
    """A map.

    Parameters
    ----------
    label : str
        For those who do not see it.
    on_choose, on_drag, on_vehicle : callable, optional
        Called with what was chosen in the menu of a place (action, station, lat, lon); with the stations that a stop was dragged from
        and to; with the id of a vehicle.
    """

    def __init__(
        self,
        label: str,
        *,
        on_choose: Callable[[dict[str, Any]], Any] | None = None,
        on_drag: Callable[[dict[str, Any]], Any] | None = None,
        on_vehicle: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        super().__init__()
        self._props["label"] = label
        for name, handler in (("choose", on_choose), ("drag_stop", on_drag), ("vehicle", on_vehicle)):
            if handler is not None:
                self.on(name, lambda event, handler=handler: handler(event.args))

    def put(self, **parts: Any) -> None:
        """Show parts: see ``static/map/index.js``."""
        self.run_method("set", parts)

    def load(self, name: str, url: str) -> None:
        """Let the browser fetch a part by itself."""
        self.run_method("load", name, url)
