"""Pads of the stations ahead: requested from their pad services only when a decision in the air needs them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError, LinkError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.models.queues.pad_service import PadService

ASK_EVERY_S = 30.0
"""Time for which a report about a station is valid, s."""
SILENT_S = 60.0
"""Pause after a failure of a pad service, s: each request may take seconds, during which nothing else is monitored."""


class PadsAhead(Mapping[str, int]):
    """Other drones on the pads and in line at stations, by station; stations without a report are absent."""

    def __init__(self, pads: PadService, now_s: Callable[[], float]) -> None:
        self._pads, self._now_s = pads, now_s
        self._reports: dict[str, tuple[float, int]] = {}
        self._silent_until_s = -math.inf

    def __getitem__(self, station: str) -> int:
        now_s = self._now_s()
        requested_s, present = self._reports.get(station, (-math.inf, 0))
        if now_s < requested_s + ASK_EVERY_S:
            return present
        if now_s < self._silent_until_s:
            raise KeyError(station)
        try:
            status = self._pads.status(station)
        except (LinkError, InputError) as error:
            self._silent_until_s = now_s + SILENT_S
            raise KeyError(station) from error
        self._reports[station] = now_s, status.present
        return status.present

    def __iter__(self) -> Iterator[str]:
        """Iterate over the stations with a report."""
        return iter(self._reports)

    def __len__(self) -> int:
        return len(self._reports)
