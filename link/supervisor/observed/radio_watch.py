"""Quality of each radio, journaled at intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import RadioMeasured

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context

EVERY_S, GROUND_EVERY_S = 20.0, 300.0


@dataclass(slots=True)
class RadioWatch:
    """The radios of one delivery; written only by `write`."""

    _written_s: float = -math.inf
    _counted: dict[str, tuple[int, int]] = field(default_factory=dict)

    def write(self, ctx: Context) -> None:
        """Write the traffic and loss of each radio since the last record."""
        now_s = ctx.vehicle.connection.clock.now_s()
        if now_s < self._written_s + (EVERY_S if ctx.in_air else GROUND_EVERY_S):
            return
        begun = math.isfinite(self._written_s)
        self._written_s = now_s
        trip_s = ctx.vehicle.peer.round_trip.mean_s
        for number, radio in enumerate(ctx.vehicle.connection.qualities):
            before = self._counted.get(radio.name, (0, 0))
            self._counted[radio.name] = radio.received, radio.lost
            if not begun:
                continue
            received, lost = radio.received - before[0], radio.lost - before[1]
            entry = RadioMeasured(
                radio=radio.name, used=number == 0, received=received, lost=lost,
                delay_s=None if math.isnan(radio.delay_s) else radio.delay_s,
                round_trip_s=trip_s if number == 0 and math.isfinite(trip_s) else None,
                rssi=radio.signal, noise=radio.noise, remote_rssi=radio.remote_signal, remote_noise=radio.remote_noise,
            )  # fmt: skip
            ctx.note(entry)
