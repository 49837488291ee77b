"""Units of a table of telemetry that cannot be right: times by the rate of the rows, power, voltage and current by what flies on them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import with_unit
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.blocks import is_flying

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import Kind

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds"}
LEAST_STEP_S, MOST_STEP_S = 1.2e-4, 5.0
"""Time between two rows of a flight log: from fast sensor logs to slow trackers."""
LEAST_ROWS = 10
FARTHEST = 1e9
"""Larger values are damage; sums of them would overflow."""
TIMES_OFF = 100.0
"""The vehicle's speed times the time, divided by the distance between its positions: beyond this the times have another unit."""
MOVING_MPS, MOVED_M = 2.0, 20.0
FLIES_ON_W = 5.0
"""Less in flight, on average, than the smallest multirotor with a camera needs (80 g: 20 W)."""
MOST = {"power_w": (200e3, "milliwatts"), "voltage_v": (1500.0, "millivolts"), "current_a": (1000.0, "milliamperes")}
"""Mean in flight above which the unit is a thousandth."""
ON_ROTORS = ("multirotor", "helicopter", "VTOL", "unknown")


class UnitCheck:
    """Looks at the rows of a table, piece by piece, for values in another unit than is assumed."""

    def __init__(self) -> None:
        self._step_s = math.nan
        self._flown_m = self._moved_m = 0.0
        self._sums: dict[str, tuple[float, int]] = {}

    def add(self, time_s: NDArray[np.float64], values: dict[str, NDArray[np.float64]]) -> None:
        """Take the next rows: times, and the quantities as they were read."""
        if math.isnan(self._step_s) and len(time_s) >= LEAST_ROWS:
            steps = np.diff(time_s)
            self._step_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else math.nan
        values = {name: np.clip(column, -FARTHEST, FARTHEST) for name, column in values.items()}
        self._move(time_s, values)
        track = TelemetryTrack.of_columns(1, time_s, values)
        told = np.isfinite(track["height_m"]) | np.isfinite(track["vel_north_mps"]) | np.isfinite(track["landed"])
        aloft = is_flying(track) & told
        for name in MOST:
            known = track[name][aloft & np.isfinite(track[name])]
            total, count = self._sums.get(name, (0.0, 0))
            self._sums[name] = total + float(known.sum()), count + len(known)

    def _move(self, time_s: NDArray[np.float64], values: dict[str, NDArray[np.float64]]) -> None:
        """Add up the distance by velocity and time, and that by positions, where the vehicle moves."""
        if not {"vel_north_mps", "vel_east_mps", "lat_deg", "lon_deg"} <= values.keys() or len(time_s) < 2:
            return
        speed = np.hypot(values["vel_north_mps"], values["vel_east_mps"])[1:]
        lat, lon = values["lat_deg"], values["lon_deg"]
        moved = geodesy.M_PER_DEG * np.hypot(np.diff(lat), np.diff(lon) * np.cos(np.radians(lat[1:])))
        steps = np.diff(time_s)
        chosen = (speed > MOVING_MPS) & np.isfinite(moved)
        self._flown_m += float((speed * steps)[chosen].sum())
        self._moved_m += float(moved[chosen].sum())

    def wrong_time(self, column: str, unit: str) -> str | None:
        """Return a sentence if the times, which were read in a unit, cannot be in it."""
        step, off = self._step_s, math.nan
        if self._moved_m > MOVED_M and self._flown_m > 0.0:
            off = self._flown_m / self._moved_m
        if unit not in TIME_UNITS or math.isnan(step):
            return None
        scales = {name: factor / TIME_UNITS[unit] for name, factor in TIME_UNITS.items() if name != unit}
        if math.isfinite(off):
            if 1.0 / TIMES_OFF < off < TIMES_OFF:
                return None
            likely = min(scales, key=lambda name: abs(math.log(off * scales[name])))
            if not 1.0 / TIMES_OFF < off * scales[likely] < TIMES_OFF:
                return None
            times = f"{off:,.0f}" if off > 1.0 else f"{off:.1g}"
            why = f"in {_NAMES[unit]} the speeds give {times} times the distance between the positions"
            return f"column {column} is probably in {_likely(likely)}: {why}"
        if LEAST_STEP_S <= step < MOST_STEP_S:
            return None
        fits = (name for name, scale in scales.items() if LEAST_STEP_S <= step * scale < MOST_STEP_S)
        likely = next(fits, "")
        if not likely:
            return None
        return (
            f"column {column} is probably in {_likely(likely)}: in {_NAMES[unit]} there is one row every {step:.3g} s"
        )

    def wrong_power(self, kind: Kind, columns: Mapping[str, str]) -> str | None:
        """Return a sentence if the power in flight, or what it is computed from, cannot be in its unit; `columns` are those read."""
        if kind not in ON_ROTORS:
            return None
        means = {name: total / count for name, (total, count) in self._sums.items() if count >= LEAST_ROWS}
        for name, (most, likely) in MOST.items():
            if name in columns and means.get(name, 0.0) > most:
                told = f"{means[name]:,.0f} {name[-1].upper()}"
                return f"column {columns[name]} has {told} on average in flight: it is probably in {likely}"
        mean = means.get("power_w", 0.0)
        if not 1e-6 < mean < FLIES_ON_W:
            return None
        drawn = with_unit(mean, "W", 2)
        if "power_w" in columns:
            return f"column {columns['power_w']} has {drawn} on average in flight, less than any multirotor needs: it is probably in kilowatts"
        names = " and ".join(columns[name] for name in ("voltage_v", "current_a") if name in columns)
        return (
            f"columns {names} give {drawn} on average in flight, less than any multirotor needs: one is in another unit"
        )


def _likely(unit: str) -> str:
    return f'{_NAMES[unit]} (time_unit = "{unit}" with --columns)'
