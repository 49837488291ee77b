"""Legs refused by the preflight check, excluded from plans for some time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.dispatch.records import PlanStep
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.flights import Leg

LEG_CLOSED_S = 600.0
"""Least time for which a leg that was not begun is closed, s."""


class ClosedLegs:
    """Legs that are excluded from plans until the next hour of the forecast, by type of drone, because the check would refuse them again.

    The list is not stored: after a restart of the process they are refused again.

    Parameters
    ----------
    forecast : callable
        Takes POSIX seconds, returns the forecast known at that time.
    say : callable
        Displays a line.
    """

    def __init__(self, forecast: Callable[[float], WindEnsemble], say: Callable[[str], None]) -> None:
        self._forecast, self._say = forecast, say
        self._until_s: dict[Leg, float] = {}

    def close(self, kind: str, steps: Sequence[PlanStep], station: str, now_s: float) -> None:
        """Close the leg by which the flight of a drone of a type was to leave a station, if there is one."""
        flown = next((one for one in steps if one.kind == "fly" and one.origin == station), None)
        if flown is None:
            return
        forecast = self._forecast(now_s)
        slot = math.floor((now_s + LEG_CLOSED_S - forecast.start_s) / forecast.slot_s) + 1
        until_s = forecast.start_s + slot * forecast.slot_s
        self._until_s[kind, station, flown.destination] = until_s
        self._say(f"{kind}: {station} to {flown.destination} is not planned for {duration(until_s - now_s)}")

    def at(self, now_s: float) -> dict[Leg, float]:
        """Return the legs closed at a time, and the end of each closure."""
        self._until_s = {leg: until_s for leg, until_s in self._until_s.items() if until_s > now_s}
        return dict(self._until_s)
