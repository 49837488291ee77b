"""Inputs of the page besides its scenario: current weather and pads, terrain, zones, as for `skyway plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

_FILES = ("forecast", "zones")
"""Fields of `skyway.planning.Conditions` that are paths, not texts."""


class Given(msgspec.Struct, frozen=True, kw_only=True):
    """Values of options, as typed; paths are absolute."""

    forecast: tuple[str, ...] = ()
    forecast_error: str = ""
    observed: tuple[str, ...] = ()
    pads: str = ""
    terrain: tuple[str, ...] = ()
    obstacles: tuple[str, ...] = ()
    zones: tuple[str, ...] = ()
    authorized: tuple[str, ...] = ()

    def words(self, command: str = "plan") -> list[str]:
        """Return the equivalent options of a command; `fly` has different options for forecast error, pads and authorizations."""
        names = ("forecast", "observed", "terrain", "obstacles", "zones")
        found = [word for name in names for one in getattr(self, name) for word in (f"--{name}", one)]
        if command == "plan":
            found += ["--forecast-error", self.forecast_error] if self.forecast_error else []
            found += [word for one in self.authorized for word in ("--authorized", one)]
            found += ["--pads", self.pads] if self.pads else []
        return found

    def region(self) -> dict[str, Any]:
        """Return those of the scenario, as fields of `skyway.planning.Conditions`."""
        return self._fields("terrain", "obstacles", "zones", "authorized")

    def weather(self) -> dict[str, Any]:
        """Return those of the wind, likewise."""
        error = {"forecast_error": Path(self.forecast_error)} if self.forecast_error else {}
        return self._fields("forecast", "observed") | error

    def _fields(self, *names: str) -> dict[str, Any]:
        found = {name: list(getattr(self, name)) or None for name in names}
        return {name: [Path(one) for one in some] if some and name in _FILES else some for name, some in found.items()}


_now = [Given()]


def given() -> Given:
    """Return the weather and zones given to this process."""
    return _now[0]


def give(what: Given) -> None:
    """Set them for this process, at its start."""
    _now[0] = what
