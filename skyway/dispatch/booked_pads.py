"""Pads of one flight of a fleet: those that it has booked, within their booked windows."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError, LinkError
from skyway.models.queues.pad_service import DroneOnPad

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.records import PlanStep
    from skyway.models.queues.pad_service import PadService, StationStatus

EARLY_S = 1.0
"""Time before its window from which a charge may begin, s."""


class BookedPads:
    """A pad service in which a drone does not come onto a pad before its window; satisfies `models.queues.pad_service.PadService`.

    A drone that is late requests a pad like any other: the pad service decides whether one is free.
    """

    def __init__(self, pads: PadService, steps: tuple[PlanStep, ...], posix_s: Callable[[], float]) -> None:
        self._pads, self._posix_s = pads, posix_s
        self._windows = [one for one in steps if one.kind == "charge" and one.pad is not None]
        self._requested: str | None = None
        self.charged_s = -math.inf
        """End of the present charge, as reported by the pad, POSIX seconds."""

    def status(self, station: str) -> StationStatus:
        """Return the present state of the pads of a station."""
        return self._pads.status(station)

    def charge(self, station: str, drone: str, to_soc: float) -> DroneOnPad:
        """Request a pad and charging; before its window the drone waits beside the pad."""
        window = next((one for one in self._windows if one.origin == station), None)
        if window is not None and self._posix_s() < window.begin_s - EARLY_S:
            return DroneOnPad(drone=drone, state="waiting", to_soc=to_soc, pad_free_s=window.begin_s)
        self._requested = station
        on_pad = self._pads.charge(station, drone, to_soc)
        known_s = on_pad.pad_free_s if on_pad.state == "waiting" else on_pad.done_s
        self.charged_s = -math.inf if known_s is None else known_s
        return on_pad

    def release(self, station: str, drone: str) -> DroneOnPad:
        """Release the pad; its window is over."""
        self._requested = None
        self._windows, self.charged_s = [one for one in self._windows if one.origin != station], -math.inf
        return self._pads.release(station, drone)

    def leave(self, station: str, drone: str) -> None:
        """Release the pad on which a flight ended before its next take-off: others would wait for it."""
        if self._requested == station:
            with suppress(LinkError, InputError):  # the next flight from there releases it
                self.release(station, drone)
