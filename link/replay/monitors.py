"""Monitors of a flight: wind, battery, legs; the same live and over a log, piece by piece.

Every monitor takes the rows of whole seconds and says what it notices at the time when it can know it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from skyway.models.base.formatting import distance_text, duration, percent, wind_text, with_unit
from skyway.models.calibration.energy import VERTICAL_MPS
from skyway.models.drones.power import PHASES, Phase
from skyway.models.drones.telemetry import COLUMN, TelemetryTrack
from skyway.models.wind.estimation.blocks import is_flying, is_trusted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.estimation.filter import FilteredWind
    from skyway.models.wind.estimation.live import LiveWind

Kind = Literal["wind", "battery", "mission"]
PERIOD_S = 1.0
LEG_GAP_S = 5.0
"""Pauses in the air of up to so long do not end a leg."""
MIN_LEG_S = 10.0
WIND_EVERY_S, BATTERY_EVERY_S, CHECK_EVERY_S = 10.0, 30.0, 30.0
SOC_JUMP, SOC_LOW, SOC_STUCK_S, SOC_STUCK_W = 0.10, 0.20, 180.0, 100.0
MAX_LEGS = 10_000
_ENDS = (("lat_deg", "from_lat", "to_lat"), ("lon_deg", "from_lon", "to_lon"), ("soc", "soc_start", "soc_end"))
"""What is known first and last of a leg."""


@dataclass(frozen=True, slots=True)
class Notice:
    """A message of a monitor."""

    time_s: float
    """When it could be known."""
    kind: Kind
    """``wind``, ``battery`` or ``mission``."""
    text: str
    """For a person."""
    event: bool = True
    """Whether it is worth keeping; otherwise it is only the present state."""


@dataclass(slots=True)
class Leg:
    """One flight, from leaving the ground to landing; unknown values are NaN."""

    start_s: float
    end_s: float
    """`start_s`, `end_s`: times as in the log."""
    distance_m: float = 0.0
    """Flown over the ground."""
    from_lat: float = math.nan
    from_lon: float = math.nan
    to_lat: float = math.nan
    to_lon: float = math.nan
    soc_start: float = math.nan
    soc_end: float = math.nan
    """`soc_start`, `soc_end`: state of charge, 0 to 1."""
    energy_j: float = math.nan
    """Taken from the battery."""

    @property
    def time_s(self) -> float:
        """Its duration so far."""
        return self.end_s - self.start_s

    def add(self, time_s: float, row: NDArray[np.float64]) -> None:
        """Take the quantities of the next second."""
        step = min(time_s - self.end_s, LEG_GAP_S)
        self.end_s = time_s
        speed = math.hypot(row[COLUMN["vel_north_mps"]], row[COLUMN["vel_east_mps"]])
        power = float(row[COLUMN["power_w"]])
        self.distance_m += speed * step if math.isfinite(speed) else 0.0
        if math.isfinite(power):
            self.energy_j = power * step + (0.0 if math.isnan(self.energy_j) else self.energy_j)
        for name, first, last in _ENDS:
            value = float(row[COLUMN[name]])
            if math.isfinite(value):
                setattr(self, last, value)
                if math.isnan(getattr(self, first)):
                    setattr(self, first, value)


@dataclass(frozen=True, slots=True)
class PhaseEnergy:
    """Time and energy of one phase of flight; the energy is NaN where power was never known."""

    time_s: float
    energy_j: float


class Seconds:
    """Makes one row of each whole second: the last sample of it, but the mean of the power."""

    def __init__(self) -> None:
        self._rows: TelemetryTrack | None = None

    def feed(self, track: TelemetryTrack) -> TelemetryTrack:
        """Take samples not older than those before; return the seconds that are over."""
        rows = track if self._rows is None else TelemetryTrack.joined([self._rows, track])
        number = np.floor(rows.time_s / PERIOD_S)
        first_open = int(np.searchsorted(number, number[-1], side="left")) if len(rows) else 0
        self._rows = rows.part(slice(first_open, None))
        return _each_second(rows.part(slice(0, first_open)))

    def flush(self) -> TelemetryTrack:
        """Return the second under way."""
        rows, self._rows = self._rows, None
        return TelemetryTrack.joined(()) if rows is None else _each_second(rows)


def _each_second(track: TelemetryTrack) -> TelemetryTrack:
    if not len(track):
        return track
    starts = np.flatnonzero(np.diff(np.floor(track.time_s / PERIOD_S), prepend=-np.inf))
    last = np.append(starts[1:], len(track)) - 1
    values = track.values[last].copy()
    power = track["power_w"]
    known = np.isfinite(power)
    total = np.add.reduceat(np.where(known, power, 0.0), starts)
    count = np.add.reduceat(known.astype(np.float64), starts)
    values[:, COLUMN["power_w"]] = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    return TelemetryTrack(track.system, track.time_s[last], values)


class LegWatch:
    """Finds the flights and what each phase of them takes."""

    def __init__(self) -> None:
        self.legs: list[Leg] = []
        """Those that are over, at most `MAX_LEGS`."""
        self._leg: Leg | None = None
        self._told = False
        self._item = math.nan
        self._up = False
        self._time_s: dict[Phase, float] = dict.fromkeys(PHASES, 0.0)
        self._energy_j: dict[Phase, float] = dict.fromkeys(PHASES, 0.0)
        self._powered = False

    def feed(self, rows: TelemetryTrack) -> list[Notice]:
        """Take seconds; return what was noticed."""
        found: list[Notice] = []
        flying = is_flying(rows).tolist()
        for time_s, row, up in zip(rows.time_s.tolist(), rows.values, flying, strict=True):
            self._up = up
            if self._leg is not None and time_s - self._leg.end_s > LEG_GAP_S:
                found += self._land(time_s)
            if up:
                if self._leg is None:
                    self._leg, self._told = Leg(time_s, time_s), False
                self._meter(min(time_s - self._leg.end_s, LEG_GAP_S), row)
                self._leg.add(time_s, row)
                if self._leg.time_s >= MIN_LEG_S and not self._told:
                    self._told = True
                    ago = f"in the air for {duration(self._leg.time_s)}"
                    found.append(Notice(time_s, "mission", f"leg {len(self.legs) + 1}: {ago}"))
            item = float(row[COLUMN["mission_item"]])
            if math.isfinite(item) and item != self._item:
                if math.isfinite(self._item):
                    found.append(Notice(time_s, "mission", f"flies to mission item {item:.0f}", event=False))
                self._item = item
        return found

    def close(self, time_s: float) -> list[Notice]:
        """The stream has ended."""
        return [] if self._leg is None else self._land(time_s, landed=not self._up)

    def phases(self) -> dict[Phase, PhaseEnergy]:
        """Time and energy of climb, cruise and descent so far."""
        return {
            phase: PhaseEnergy(self._time_s[phase], self._energy_j[phase] if self._powered else math.nan)
            for phase in PHASES
        }

    def _meter(self, step_s: float, row: NDArray[np.float64]) -> None:
        rise, power = -float(row[COLUMN["vel_down_mps"]]), float(row[COLUMN["power_w"]])
        phase: Phase = "climb" if rise > VERTICAL_MPS else "descent" if rise < -VERTICAL_MPS else "cruise"
        self._time_s[phase] += step_s
        if math.isfinite(power):
            self._powered = True
            self._energy_j[phase] += power * step_s

    def _land(self, time_s: float, *, landed: bool = True) -> list[Notice]:
        leg, self._leg = self._leg, None
        if leg is None or leg.time_s < MIN_LEG_S or len(self.legs) >= MAX_LEGS:
            return []
        self.legs.append(leg)
        how = f"landed {duration(time_s - leg.end_s)} ago" if landed else "still in the air at the end"
        text = f"leg {len(self.legs)}: {how}, {distance_text(leg.distance_m)} in {duration(leg.time_s)}"
        return [Notice(time_s, "mission", text)]


class BatteryWatch:
    """Notices a state of charge that jumps, falls low, or stays where it cannot."""

    def __init__(self) -> None:
        self.first = self.last = math.nan
        self._changed_s = self._due_s = -math.inf
        self._low = self._stuck = False

    def feed(self, rows: TelemetryTrack) -> list[Notice]:
        """Take seconds; return what was noticed."""
        found: list[Notice] = []
        for time_s, soc, power in zip(
            rows.time_s.tolist(), rows["soc"].tolist(), rows["power_w"].tolist(), strict=True
        ):
            if math.isfinite(soc):
                found += [Notice(time_s, "battery", text) for text in self._look(time_s, soc, power)]
            if time_s >= self._due_s and (math.isfinite(soc) or math.isfinite(power)):
                self._due_s = time_s + BATTERY_EVERY_S
                charge = f"charge {percent(soc)}"
                drawn = with_unit(power, "W", 0)
                found.append(Notice(time_s, "battery", f"battery {charge}, {drawn}", event=False))
        return found

    def _look(self, time_s: float, soc: float, power: float) -> list[str]:
        texts = []
        if abs(soc - self.last) > SOC_JUMP:  # false for NaN
            texts.append(f"the state of charge jumps from {percent(self.last)} to {percent(soc)}")
        if soc < SOC_LOW and not self._low:
            texts.append(f"the state of charge falls below {percent(SOC_LOW)}")
        self._low = soc < SOC_LOW
        if soc != self.last or not power > SOC_STUCK_W:
            self._changed_s, self._stuck = time_s, False
        elif time_s - self._changed_s > SOC_STUCK_S and not self._stuck:
            self._stuck = True
            texts.append(f"the state of charge is stuck at {percent(soc)} while {with_unit(power, 'W', 0)} are drawn")
        self.first = soc if math.isnan(self.first) else self.first
        self.last = soc
        return texts


class WindWatch:
    """Reports the wind, and detects a wrong drag and an inconsistent filter."""

    def __init__(self, wind: LiveWind) -> None:
        self._wind = wind
        self._due_s = self._check_s = -math.inf
        self._wrong = False
        self._verdict = "unknown"
        self._stuck: tuple[str, ...] = ()

    def feed(self, course: FilteredWind) -> list[Notice]:
        """Take the course over some seconds; the checks look at what the filter knows at their end."""
        from skyway.models.wind.triangle import speed_from

        found: list[Notice] = []
        measured = np.flatnonzero(np.isfinite(course.nis) & course.trusted)
        speed, direction = speed_from(course.wind[measured, 0], course.wind[measured, 1])
        sigma = course.sigma_mps[measured]
        for place, time_s in enumerate(course.time_s[measured].tolist()):
            if time_s >= self._due_s:
                self._due_s = time_s + WIND_EVERY_S
                text = f"wind {wind_text(speed[place], direction[place], sigma[place])}"
                found.append(Notice(time_s, "wind", text, event=False))
        return found

    def check(self, time_s: float) -> list[Notice]:
        """Look at drag and consistency, at most once in `CHECK_EVERY_S`."""
        if time_s < self._check_s or self._wind.filter is None:
            return []
        self._check_s = time_s + CHECK_EVERY_S
        texts = []
        check = self._wind.check_drag()
        if check.wrong and not self._wrong:
            texts.append(check.advice)
        self._wrong = check.wrong
        stuck = self._wind.stuck
        texts += [f"{name} does not change: the sensor is stuck" for name in stuck if name not in self._stuck]
        self._stuck = stuck
        health = self._wind.filter.health
        if health.verdict == "overconfident" != self._verdict:
            low, high = health.band
            mean = f"mean NIS {health.mean:.1f}, 95 % band {low:.1f} to {high:.1f}"
            why = mean if math.isfinite(health.mean) else "measurements far from its estimate"
            texts.append(f"the filter is overconfident ({why}): the wind is unknown until it is consistent")
        self._verdict = health.verdict
        return [Notice(time_s, "wind", text) for text in texts]


class TrustWatch:
    """Reports when the position of a vehicle in the air is no longer reliable, and when it is again."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def feed(self, rows: TelemetryTrack) -> list[Notice]:
        """Take seconds; return what was noticed."""
        found: list[Notice] = []
        aloft, trusted = is_flying(rows), is_trusted(rows)
        for time_s, up, sure, gps in zip(
            rows.time_s.tolist(), aloft.tolist(), trusted.tolist(), rows["gps_ok"].tolist(), strict=True
        ):
            if up and not sure and self._since_s is None:
                self._since_s = time_s
                poor, doubted = "the receiver's fix is lost or poor", "the vehicle does not trust its own position"
                found.append(Notice(time_s, "wind", f"{poor if gps == 0.0 else doubted}: no wind from here"))
            elif sure and self._since_s is not None:
                found.append(Notice(time_s, "wind", f"position trusted again after {duration(time_s - self._since_s)}"))
                self._since_s = None
        return found
