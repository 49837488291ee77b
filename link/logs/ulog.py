"""PX4 logs (``.ulg``) as telemetry."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from link.logs.assembly import Assembler, Stretch
from link.logs.log import MAX_EVENTS, LogEvent, LogSummary
from link.logs.messages import euler
from link.logs.ulog_format import HEADER_BYTES, MAGIC, read_contents
from models import geodesy
from models.errors import Fault, InputError, one_line
from models.telemetry import TimeBase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from models.telemetry import TelemetryTrack

RECEIVERS = ("vehicle_gps_position", "sensor_gps")
"""Topics that know UTC."""
Columns = dict[str, "NDArray[np.float64]"]


class ULogFile:
    """A PX4 log.

    Parameters
    ----------
    path : Path
        Read whole.

    Raises
    ------
    InputError
        The file cannot be read, or has no header.
    """

    def __init__(self, path: Path) -> None:
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InputError(Fault(f"cannot be read: {error.strerror or error}", str(path))) from None
        if len(data) < HEADER_BYTES or not data.startswith(MAGIC):
            raise InputError(Fault("is no ULog: its header is damaged or cut", str(path)))
        self._log = read_contents(data)
        wanted = dict.fromkeys(topic for topic, _ in SPOKEN) | dict.fromkeys(RECEIVERS)
        columns = {topic: self._log.columns(topic) for topic in wanted}
        self._sets: dict[str, dict[str, Any]] = {
            topic: found for topic, found in columns.items() if "timestamp" in found
        }
        self._zero_s, self._time_base = self._clock()
        self.summary = self._summary()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry in one piece."""
        stretch = Stretch()
        for topic, speak in SPOKEN:
            data = self._sets.get(topic)
            if data is None:
                continue
            try:
                columns = speak(data)
            except KeyError:
                continue  # another generation of the topic
            times = self._times(data)
            order = np.argsort(times, kind="stable")
            stretch.add(times[order], {name: np.asarray(values)[order] for name, values in columns.items()})
        track = Assembler(self._system()).feed(stretch).between(from_s, to_s)
        if len(track):
            yield track

    def _times(self, data: dict[str, Any]) -> NDArray[np.float64]:
        return np.asarray(data["timestamp"], dtype=np.float64) * 1e-6 + self._zero_s

    def _system(self) -> int:
        ids = self._sets.get("vehicle_status", {}).get("system_id", ())
        return int(ids[0]) if len(ids) and ids[0] else 1

    def _clock(self) -> tuple[float, TimeBase]:
        """Find UTC through the receiver, where it ever had a fix."""
        for topic in RECEIVERS:
            data = self._sets.get(topic, {})
            if "time_utc_usec" in data:
                utc = np.asarray(data["time_utc_usec"], dtype=np.float64)
                boot = np.asarray(data["timestamp"], dtype=np.float64)
                fixed = np.flatnonzero(utc > 1e15)
                if len(fixed):
                    return float(np.median(utc[fixed] - boot[fixed])) * 1e-6, TimeBase(
                        "the autopilot's clock, set by GPS"
                    )
        doubt = "no GPS time was logged: times count from the start of the autopilot"
        return 0.0, TimeBase("the autopilot's clock since its start", absolute=False, doubts=(doubt,))

    def _summary(self) -> LogSummary:
        by_type = self._log.counts()
        stamps = [self._times(data) for data in self._sets.values()]
        known = "vehicle_attitude" in self._sets or "vehicle_local_position" in self._sets
        doubts = self._time_base.doubts
        if self._log.dropouts_ms:
            lost = sum(self._log.dropouts_ms) / 1000.0
            doubts += (f"the logger lost data {len(self._log.dropouts_ms)} times, {lost:.1f} s in all",)
        return LogSummary(
            format="ulog",
            messages=sum(by_type.values()),
            by_type=by_type,
            skipped_bytes=self._log.skipped,
            systems=(self._system(),) if known else (),
            others=(),
            time_base=TimeBase(self._time_base.source, self._time_base.absolute, doubts),
            start_s=min((float(times.min()) for times in stamps), default=math.nan),
            end_s=max((float(times.max()) for times in stamps), default=math.nan),
            events=tuple(
                LogEvent(time_us * 1e-6 + self._zero_s, self._system(), one_line(text))
                for time_us, text in self._log.texts[:MAX_EVENTS]
            ),
        )


def _numbers(data: dict[str, Any], key: str) -> NDArray[np.float64]:
    return np.asarray(data[key], dtype=np.float64)


def _attitude(data: dict[str, Any]) -> Columns:
    return euler(*(_numbers(data, f"q[{number}]") for number in range(4)))


def _local(data: dict[str, Any]) -> Columns:
    good = (_numbers(data, "v_xy_valid") > 0) if "v_xy_valid" in data else np.ones(len(data["vx"]), dtype=bool)
    columns = {
        "vel_north_mps": np.where(good, _numbers(data, "vx"), np.nan),
        "vel_east_mps": np.where(good, _numbers(data, "vy"), np.nan),
        "vel_down_mps": np.where(good, _numbers(data, "vz"), np.nan),
        "height_m": -_numbers(data, "z"),
    }
    lat, lon = _numbers(data, "ref_lat"), _numbers(data, "ref_lon")
    placed = np.isfinite(lat) & (lat != 0.0) & (_numbers(data, "xy_global") > 0)
    if placed.any():
        per_lat = (
            geodesy.distance_m(lat[placed][0] - 0.005, lon[placed][0], lat[placed][0] + 0.005, lon[placed][0]) * 100
        )
        per_lon = (
            geodesy.distance_m(lat[placed][0], lon[placed][0] - 0.005, lat[placed][0], lon[placed][0] + 0.005) * 100
        )
        columns["lat_deg"] = np.where(placed, lat + _numbers(data, "x") / per_lat, np.nan)
        columns["lon_deg"] = np.where(placed, lon + _numbers(data, "y") / per_lon, np.nan)
        columns["alt_msl_m"] = np.where(placed, _numbers(data, "ref_alt") - _numbers(data, "z"), np.nan)
    return columns


def _battery(data: dict[str, Any]) -> Columns:
    volts = _numbers(data, "voltage_v")
    amperes, remaining = _numbers(data, "current_a"), _numbers(data, "remaining")
    return {
        "voltage_v": np.where(volts > 0.0, volts, np.nan),
        "current_a": np.where(amperes >= 0.0, amperes, np.nan),
        "soc": np.where((remaining >= 0.0) & (remaining <= 1.0), remaining, np.nan),
    }


def _landed(data: dict[str, Any]) -> Columns:
    return {"landed": _numbers(data, "landed")}


def _status(data: dict[str, Any]) -> Columns:
    return {
        "armed": (_numbers(data, "arming_state") == 2.0).astype(np.float64),
        "mode": _numbers(data, "nav_state"),
        "fixed_wing": (_numbers(data, "vehicle_type") == 2.0).astype(np.float64),
    }


def _wind(data: dict[str, Any]) -> Columns:
    north, east = _numbers(data, "windspeed_north"), _numbers(data, "windspeed_east")
    alive = (north != 0.0) | (east != 0.0)
    return {"wind_north_mps": np.where(alive, north, np.nan), "wind_east_mps": np.where(alive, east, np.nan)}


def _airspeed(data: dict[str, Any]) -> Columns:
    speed = _numbers(data, "true_airspeed_m_s")
    return {"airspeed_mps": np.where(speed > 0.0, speed, np.nan)}


def _mission(data: dict[str, Any]) -> Columns:
    return {"mission_item": _numbers(data, "seq_current")}


SPOKEN: tuple[tuple[str, Callable[[dict[str, Any]], Columns]], ...] = (
    ("vehicle_attitude", _attitude),
    ("vehicle_local_position", _local),
    ("battery_status", _battery),
    ("vehicle_land_detected", _landed),
    ("vehicle_status", _status),
    ("wind", _wind),
    ("wind_estimate", _wind),
    ("airspeed_validated", _airspeed),
    ("airspeed", _airspeed),
    ("mission_result", _mission),
)
"""Topics that telemetry is made of, and what each says."""
