"""Other drones on the pads, as reported by the pads, without those of this dispatcher."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen

if TYPE_CHECKING:
    from skyway.models.queues.pad_service import PadService, StationStatus
    from skyway.models.scenario.scenario import Scenario

REQUEST_INTERVAL_S = 300.0
"""Shortest interval of requests to all stations, s of the service's time."""


class SeenStrangers:
    """Requests the drones on the pads of a region.

    Parameters
    ----------
    scenario : Scenario
        The region.
    service : PadService or None
        The pad service; without it there are no reports.
    """

    def __init__(self, scenario: Scenario, service: PadService | None) -> None:
        self._service = service
        self._stations = [one.id for one in scenario.network.stations if one.pads]
        self._requested_s, self._seen = -math.inf, NOTHING_SEEN

    def at(self, now_s: float) -> PadsSeen:
        """Return the reported drones, at most `REQUEST_INTERVAL_S` old; stations that do not answer are absent."""
        if self._service is None or now_s < self._requested_s + REQUEST_INTERVAL_S:
            return self._seen
        self._requested_s = now_s
        found: dict[str, int] = {}
        for station in self._stations:
            try:
                found[station] = strangers_in(self._service.status(station))
            except SkywayError:
                continue
        self._seen = PadsSeen(found, {})
        return self._seen


def strangers_in(status: StationStatus) -> int:
    """Number of drones on the pads and in line that are not of this fleet."""
    ours = sum(one.state != "absent" for one in status.drones)
    return max(status.present - ours, 0)
