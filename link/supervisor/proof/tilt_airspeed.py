"""Airspeed from the lean, second by second: it shows gusts at once, while the wind estimate follows only slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.drones.telemetry import QUANTITIES, TelemetryTrack
from skyway.models.wind.estimation.blocks import BlockMaker
from skyway.models.wind.estimation.measurement import tilt_air_velocity

if TYPE_CHECKING:
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.telemetry import TelemetrySample

_TOLD = attrgetter(*QUANTITIES)


@dataclass(slots=True)
class TiltAirspeed:
    """Airspeed of one multirotor, from its lean, its acceleration and its drag."""

    drag: DragModel
    _maker: BlockMaker = field(default_factory=BlockMaker)
    _waiting: list[tuple[float, ...]] = field(default_factory=list)
    _received_s: float = 0.0

    def hear(self, s: TelemetrySample) -> float | None:
        """Take a sample; return the airspeed of a second that it ends, m/s, NaN if unknown, and None within a second."""
        if not s.time_s > self._received_s:
            return None
        over = math.floor(s.time_s / self._maker.period_s) != math.floor(self._received_s / self._maker.period_s)
        self._received_s = s.time_s
        self._waiting.append((s.time_s, *_TOLD(s)))
        if not over:
            return None
        table = np.array(self._waiting)
        self._waiting.clear()
        ended = self._maker.feed(TelemetryTrack(s.system, table[:, 0], table[:, 1:]))
        if not len(ended):
            return None
        north, east = tilt_air_velocity(ended, self.drag)[-1]
        return math.hypot(north, east)
