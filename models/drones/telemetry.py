"""Telemetry of a vehicle, in one form for live links and all log formats.

A `TelemetrySample` is one sample of one vehicle. A `TelemetryTrack` is many of them as columns, which is the form that the
filter and the calibrations use; both have the same fields, so that code downstream cannot distinguish a live
flight from a replay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetrySample:
    """One sample of a vehicle's telemetry; NaN is unknown, or no longer known."""

    time_s: float
    """POSIX seconds (UTC); seconds since the log began where `TimeBase.absolute` is false."""
    system: int = 1
    """MAVLink system id; 1 where a log has none."""
    lat_deg: float = math.nan
    lon_deg: float = math.nan
    """WGS-84."""
    alt_msl_m: float = math.nan
    height_m: float = math.nan
    """Above mean sea level; above the take-off site (home)."""
    vel_north_mps: float = math.nan
    vel_east_mps: float = math.nan
    vel_down_mps: float = math.nan
    """Velocity over the ground."""
    roll_rad: float = math.nan
    pitch_rad: float = math.nan
    yaw_rad: float = math.nan
    """Body (forward, right, down) in north-east-down; pitch is positive nose up, yaw clockwise from true north."""
    airspeed_mps: float = math.nan
    """True airspeed of a sensor, as far as can be determined: bridges without a sensor repeat the ground speed."""
    wind_north_mps: float = math.nan
    wind_east_mps: float = math.nan
    """The autopilot's own estimate, where the air moves TOWARDS; NaN while it is not alive (exactly 0)."""
    throttle: float = math.nan
    """0 to 1."""
    soc: float = math.nan
    """State of charge, 0 to 1 of nameplate."""
    voltage_v: float = math.nan
    current_a: float = math.nan
    power_w: float = math.nan
    """Of the main battery; current and power are positive when it is discharged. Power is their product where both are
    known, otherwise as reported in the log."""
    armed: float = math.nan
    landed: float = math.nan
    """1 yes, 0 no."""
    fixed_wing: float = math.nan
    """1 if the vehicle reports that it flies on wings (a plane, a VTOL in forward flight), 0 if on the rotors of a
    multirotor; `NEITHER` for anything else (a VTOL in transition, a helicopter, wheels, a hull)."""
    mission_item: float = math.nan
    """Item that the vehicle flies to, in its own numbering."""
    mode: float = math.nan
    """The autopilot's custom mode number."""
    mission_reached: float = math.nan
    """Item reached last, in the vehicle's numbering."""
    link_loss: float = math.nan
    """Share of its latest packets that were lost, 0 to 1; NaN in logs."""
    gps_ok: float = math.nan
    ekf_ok: float = math.nan
    """1 if the vehicle trusts its receiver, and its own estimate of position and velocity, 0 if it does not
    (`link.logs.common.trust`)."""
    airspeed_ok: float = math.nan
    """1 if the airspeed is that of a sensor that the vehicle has and uses."""

    @property
    def ground_speed_mps(self) -> float:
        """Speed over the ground, m/s; NaN if it is unknown."""
        return math.hypot(self.vel_north_mps, self.vel_east_mps)

    @classmethod
    def of_row(cls, time_s: float, system: int, row: Sequence[float]) -> TelemetrySample:
        """Return a sample of what is in a row of a `TelemetryTrack`; in less time than the constructor takes, for many come a second."""
        sample = object.__new__(cls)
        for put, value in zip(_PUT, (time_s, system, *row), strict=True):
            put(sample, value)
        return sample


_PUT = tuple(getattr(TelemetrySample, item.name).__set__ for item in fields(TelemetrySample))
"""What sets each field of a sample, in order."""
QUANTITIES: tuple[str, ...] = tuple(
    item.name for item in fields(TelemetrySample) if item.name not in ("time_s", "system")
)
"""Fields that a vehicle reports."""
COLUMN = {name: number for number, name in enumerate(QUANTITIES)}
"""Column of each quantity in a track."""
NEITHER = 0.5
"""`TelemetrySample.fixed_wing` of vehicles that fly neither on wings nor on the rotors of a multirotor."""
_LIMITS = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-180.0, 180.0),
    "alt_msl_m": (-1000.0, 100_000.0),
    "height_m": (-20_000.0, 100_000.0),
    **dict.fromkeys(("vel_north_mps", "vel_east_mps", "vel_down_mps"), (-500.0, 500.0)),
    **dict.fromkeys(("roll_rad", "pitch_rad", "yaw_rad"), (-7.0, 7.0)),
    "airspeed_mps": (0.0, 500.0),
    **dict.fromkeys(("wind_north_mps", "wind_east_mps"), (-100.0, 100.0)),
    "voltage_v": (0.0, 5000.0),
    "current_a": (-5000.0, 5000.0),
    "power_w": (-1e6, 1e6),
}
LOWEST, HIGHEST = (tuple(_LIMITS.get(name, (-1e12, 1e12))[end] for name in QUANTITIES) for end in (0, 1))
"""Of each quantity what can be."""
_LOWEST, _HIGHEST = np.array(LOWEST, dtype=np.float64), np.array(HIGHEST, dtype=np.float64)


def believable(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return telemetry, shape (..., quantities), with implausible values as NaN: damage, or a missing sensor."""
    return np.where((values >= _LOWEST) & (values <= _HIGHEST), values, np.nan)  # false for NaN


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Clock of a stream of times, and its defects."""

    source: str
    """Source of the clock, in words."""
    absolute: bool = True
    """Whether times are POSIX seconds; otherwise they count from the log's own zero."""
    doubts: tuple[str, ...] = field(default=())
    """Each one sentence for a person."""


@dataclass(frozen=True, slots=True, eq=False)
class TelemetryTrack:
    """Samples of one vehicle as columns."""

    system: int
    """System id of the vehicle."""
    time_s: NDArray[np.float64]
    """Shape (samples,). Never decreasing."""
    values: NDArray[np.float64]
    """Shape (samples, quantities). In the order of `QUANTITIES`; NaN is unknown."""

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.time_s), len(QUANTITIES)):
            raise InputError("the columns of a telemetry track do not fit together")

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, quantity: str) -> NDArray[np.float64]:
        """Return one quantity, shape (samples,)."""
        return self.values[:, COLUMN[quantity]]

    def part(self, chosen: NDArray[np.bool_] | NDArray[np.int64] | slice) -> TelemetryTrack:
        """Return some of the samples."""
        return TelemetryTrack(self.system, self.time_s[chosen], self.values[chosen])

    def between(self, from_s: float, to_s: float) -> TelemetryTrack:
        """Return the samples with ``from_s <= time < to_s``."""
        first, last = np.searchsorted(self.time_s, (from_s, to_s))
        return self.part(slice(int(first), int(last)))

    def samples(self) -> Iterator[TelemetrySample]:
        """Return the samples one by one, as a live link gives them."""
        for time_s, row in zip(self.time_s.tolist(), self.values.tolist(), strict=True):
            yield TelemetrySample.of_row(time_s, self.system, row)

    @classmethod
    def of_samples(cls, samples: Iterable[TelemetrySample]) -> TelemetryTrack:
        """Collect the samples of one vehicle."""
        kept = list(samples)
        if len({sample.system for sample in kept}) > 1:
            raise InputError("a track has one vehicle; split the samples by system first")
        values = np.array([[getattr(sample, name) for name in QUANTITIES] for sample in kept], dtype=np.float64)
        times = np.array([sample.time_s for sample in kept], dtype=np.float64)
        return cls(kept[0].system if kept else 1, times, values.reshape(len(kept), len(QUANTITIES)))

    @classmethod
    def of_columns(
        cls, system: int, time_s: NDArray[np.float64], columns: Mapping[str, NDArray[np.float64]]
    ) -> TelemetryTrack:
        """Make a track of the columns that are known."""
        values = np.full((len(time_s), len(QUANTITIES)), np.nan)
        for name, column in columns.items():
            values[:, COLUMN[name]] = column
        return cls(system, np.asarray(time_s, dtype=np.float64), values)

    @classmethod
    def joined(cls, tracks: Iterable[TelemetryTrack]) -> TelemetryTrack:
        """Return the tracks of one vehicle, one after the other."""
        parts = list(tracks)
        if not parts:
            return cls(1, np.empty(0), np.empty((0, len(QUANTITIES))))
        return cls(
            parts[0].system,
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.values for part in parts]),
        )
