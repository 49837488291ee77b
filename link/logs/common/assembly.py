"""Assembly of telemetry samples from messages: the latest value of every quantity, if recent.

The same assembler serves a log, where thousands of messages come at once, and a live link, where they come one by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.drones.telemetry import (
    COLUMN,
    HIGHEST,
    LOWEST,
    QUANTITIES,
    TelemetrySample,
    TelemetryTrack,
    believable,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

FRESH_S = 2.0
"""A quantity of motion older than this is unknown."""
SLOW_FRESH_S = 15.0
"""The same for rarely sent values."""
SLOW = frozenset(
    (
        "soc",
        "armed",
        "landed",
        "fixed_wing",
        "mission_item",
        "mode",
        "wind_north_mps",
        "wind_east_mps",
        "mission_reached",
        "gps_ok",
        "ekf_ok",
        "airspeed_ok",
    )
)
_AIRSPEED, _AIRSPEED_OK, _VOLTAGE, _CURRENT, _POWER = (
    COLUMN[name] for name in ("airspeed_mps", "airspeed_ok", "voltage_v", "current_a", "power_w")
)
TICK_GAP_S = 0.5
"""If no attitude came for this long, a position also gives a sample."""


class Stretch:
    """Reports of one vehicle over some time: columns of each kind of message."""

    def __init__(self) -> None:
        self.reports: list[tuple[NDArray[np.float64], Mapping[str, NDArray[np.float64]]]] = []
        """Times in s, shape (reports,), and the quantities reported then, by name."""

    def add(self, time_s: ArrayLike, columns: Mapping[str, ArrayLike]) -> None:
        """Add reports of one kind, in the order of time."""
        times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        known = {
            name: np.broadcast_to(np.asarray(values, dtype=np.float64), times.shape) for name, values in columns.items()
        }
        if len(times) and known:
            self.reports.append((times, known))


class Assembler:
    """Makes the samples of one vehicle; `lasting` quantities are sent only when they change, and remain valid until then."""

    def __init__(self, system: int, lasting: frozenset[str] = frozenset()) -> None:
        self.system = system
        self._last_time = [-math.inf] * len(QUANTITIES)
        self._last_value = [math.nan] * len(QUANTITIES)
        self._last_tick = self._last_main = -math.inf
        self._fresh = [
            math.inf if name in lasting else SLOW_FRESH_S if name in SLOW else FRESH_S for name in QUANTITIES
        ]

    def feed(self, stretch: Stretch) -> TelemetryTrack:
        """Take reports not older than those before, and return the samples that they complete."""
        ticks = self._ticks(stretch)
        values = np.full((len(ticks), len(QUANTITIES)), np.nan)
        by_quantity: dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = {}
        for times, columns in stretch.reports:
            for name, column in columns.items():
                by_quantity.setdefault(name, []).append((times, column))
        for name, number in COLUMN.items():
            parts = by_quantity.get(name, [])
            times = np.concatenate([self._last_time[number : number + 1], *(part[0] for part in parts)])
            column = np.concatenate([self._last_value[number : number + 1], *(part[1] for part in parts)])
            if len(parts) > 1:
                order = np.argsort(times, kind="stable")
                times, column = times[order], column[order]
            place = np.searchsorted(times, ticks, side="right") - 1
            held = np.maximum(place, 0)
            fresh = (place >= 0) & (ticks - times[held] <= self._fresh[number])
            values[:, number] = np.where(fresh, column[held], np.nan)
            self._last_time[number], self._last_value[number] = float(times[-1]), float(column[-1])
        if len(ticks):
            self._last_tick = float(ticks[-1])
        return TelemetryTrack(self.system, ticks, _finished(values))

    def feed_one(self, time_s: float, columns: Mapping[str, float]) -> TelemetrySample | None:
        """Take one live message, in microseconds; returns a sample if it completes one, by the rules of `feed`."""
        for name, value in columns.items():
            number = COLUMN[name]
            self._last_time[number], self._last_value[number] = time_s, value
        if "roll_rad" in columns:
            self._last_main = max(self._last_main, time_s)
        elif "vel_north_mps" not in columns or time_s - self._last_main <= TICK_GAP_S:
            return None
        if time_s <= self._last_tick:
            return None
        self._last_tick = time_s
        heard = zip(self._last_value, self._last_time, self._fresh, LOWEST, HIGHEST, strict=True)
        row = [
            value if time_s - told_s <= fresh_s and lowest <= value <= highest else math.nan
            for value, told_s, fresh_s, lowest, highest in heard
        ]
        if row[_AIRSPEED_OK] != 1.0:
            row[_AIRSPEED] = math.nan
        power_w = row[_VOLTAGE] * row[_CURRENT]
        if math.isfinite(power_w):
            row[_POWER] = power_w
        return TelemetrySample.of_row(time_s, self.system, row)

    def latest(self, quantity: str) -> float:
        """Newest report of a quantity, however old; NaN before the first."""
        return self._last_value[COLUMN[quantity]]

    def forget(self) -> None:
        """Begin again, as after a restart of the vehicle."""
        self._last_time[:] = [-math.inf] * len(QUANTITIES)
        self._last_value[:] = [math.nan] * len(QUANTITIES)
        self._last_tick = self._last_main = -math.inf

    def _ticks(self, stretch: Stretch) -> NDArray[np.float64]:
        """Times at which samples are taken: every attitude, and positions if attitudes are missing."""
        main = [times for times, columns in stretch.reports if "roll_rad" in columns]
        other = [
            times for times, columns in stretch.reports if "vel_north_mps" in columns and "roll_rad" not in columns
        ]
        ticks = np.sort(np.concatenate([np.array([self._last_main]), *main]))
        self._last_main = float(ticks[-1])
        if other:
            extra = np.sort(np.concatenate(other))
            before = ticks[np.searchsorted(ticks, extra, side="right") - 1]
            ticks = np.sort(np.concatenate([ticks, extra[extra - before > TICK_GAP_S]]))
        return np.unique(ticks[ticks > self._last_tick])


def _finished(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Plausible values, airspeed only of a trusted sensor, and power from voltage and current if both are reported."""
    found = believable(values)
    found[..., _AIRSPEED] = np.where(found[..., _AIRSPEED_OK] == 1.0, found[..., _AIRSPEED], np.nan)
    power = found[..., _VOLTAGE] * found[..., _CURRENT]
    found[..., _POWER] = np.where(np.isfinite(power), power, found[..., _POWER])
    return found
