"""Strangers on the pads, as a dispatcher sees them: what the pads report, without its own drones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen

if TYPE_CHECKING:
    from skyway.models.queues.pad_service import PadService, StationStatus
    from skyway.models.scenario.scenario import Scenario

ASKED_S = 300.0
"""So often, of its own time, all stations are asked at most."""


class SeenStrangers:
    """Asks the pads of a region who stands there.

    Parameters
    ----------
    scenario : Scenario
        The region.
    service : PadService or None
        Who is asked; without it nothing is seen.
    """

    def __init__(self, scenario: Scenario, service: PadService | None) -> None:
        self._service = service
        self._stations = [one.id for one in scenario.network.stations if one.pads]
        self._asked_s, self._seen = -math.inf, NOTHING_SEEN

    def at(self, now_s: float) -> PadsSeen:
        """Return who is there, as it was seen at most `ASKED_S` ago; stations that do not answer are not in it."""
        if self._service is None or now_s < self._asked_s + ASKED_S:
            return self._seen
        self._asked_s = now_s
        found: dict[str, int] = {}
        for station in self._stations:
            try:
                found[station] = strangers_in(self._service.status(station))
            except SkywayError:
                continue
        self._seen = PadsSeen(found, {})
        return self._seen


def strangers_in(status: StationStatus) -> int:
    """Drones on the pads and in line that are not ours."""
    ours = sum(one.state != "absent" for one in status.drones)
    return max(status.present - ours, 0)
