"""PX4 logs (``.ulg``) as telemetry."""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from link.logs.log import MAX_EVENTS, LogEvent, LogSummary
from link.logs.messages import euler
from link.logs.pieces import HOLD_S, WARM_UP_S, InOrder, read_pieces
from link.logs.ulog_format import HEADER_BYTES, MAGIC, ULogContents, find_in_piece
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
MOST_FIXES = 100_000
"""The clock is set by so many of the receiver's messages."""
Columns = dict[str, "NDArray[np.float64]"]


class ULogFile:
    """A PX4 log.

    Parameters
    ----------
    path : Path
        Read once piece by piece to index it; again for each use.

    Raises
    ------
    InputError
        The file cannot be read, or has no header.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as stream:
                head = stream.read(HEADER_BYTES)
        except OSError as error:
            raise InputError(Fault(f"cannot be read: {error.strerror or error}", str(path))) from None
        if len(head) < HEADER_BYTES or not head.startswith(MAGIC):
            raise InputError(Fault("is no ULog: its header is damaged or cut", str(path)))
        self._log = ULogContents()
        self._id = 1
        self._spoken: set[str] = set()
        self._range_us = (math.inf, -math.inf)
        self._pieces: list[tuple[float, int]] = []
        self._zero_s, self._time_base = self._index()
        self.summary = self._summary()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry piece by piece."""
        samples = InOrder(self._id)
        for _, data, found in read_pieces(self.path, find_in_piece, begin=self._begin(from_s)):
            reports = {}
            for topic, speak in SPOKEN:
                columns = self._log.columns(topic, data, found) if topic in self._spoken else {}
                with contextlib.suppress(KeyError):  # another generation of the topic
                    if columns:
                        reports[topic] = self._times(columns), speak(columns)
            track = samples.feed(reports)
            if len(track) and track.time_s[0] >= to_s:
                return
            part = track.between(from_s, to_s)
            if len(part):
                yield part
        part = samples.flush().between(from_s, to_s)
        if len(part):
            yield part

    def _begin(self, from_s: float) -> int:
        """Return a place from which everything from a time on, and what has to be known by then, can be read."""
        wanted_us = (from_s - WARM_UP_S - HOLD_S - self._zero_s) * 1e6
        before = [place for latest_us, place in self._pieces if latest_us <= wanted_us]
        return before[-1] if before else HEADER_BYTES

    def _times(self, data: dict[str, Any]) -> NDArray[np.float64]:
        return np.asarray(data["timestamp"], dtype=np.float64) * 1e-6 + self._zero_s

    def _index(self) -> tuple[float, TimeBase]:
        """Go through the log once; find UTC through the receiver, where it ever had a fix."""
        wanted = dict.fromkeys(topic for topic, _ in SPOKEN) | dict.fromkeys(RECEIVERS)
        zeros: dict[str, NDArray[np.float64]] = {topic: np.empty(0) for topic in RECEIVERS}
        for base, data, found in read_pieces(self.path, find_in_piece, begin=HEADER_BYTES):
            self._pieces.append((self._range_us[1], base))
            self._log.see(data, found)
            self._log.skipped += found.skipped
            for topic in wanted:
                columns = self._log.columns(topic, data, found)
                if "timestamp" not in columns:
                    continue
                self._spoken.add(topic)
                stamps = columns["timestamp"].astype(np.float64)
                low, high = self._range_us
                self._range_us = min(low, float(stamps.min())), max(high, float(stamps.max()))
                if topic in zeros and "time_utc_usec" in columns and len(zeros[topic]) < MOST_FIXES:
                    utc = columns["time_utc_usec"].astype(np.float64)
                    zeros[topic] = np.concatenate([zeros[topic], (utc - stamps)[utc > 1e15]])
                if topic == "vehicle_status" and "system_id" in columns and columns["system_id"][0]:
                    self._id = int(columns["system_id"][0])
        for topic in RECEIVERS:
            if len(zeros[topic]):
                return float(np.median(zeros[topic])) * 1e-6, TimeBase("the autopilot's clock, set by GPS")
        doubt = "no GPS time was logged: times count from the start of the autopilot"
        return 0.0, TimeBase("the autopilot's clock since its start", absolute=False, doubts=(doubt,))

    def _summary(self) -> LogSummary:
        by_type = self._log.counts()
        known = bool(self._spoken & {"vehicle_attitude", "vehicle_local_position"})
        doubts = self._time_base.doubts
        if self._log.dropouts:
            lost = self._log.dropouts_ms / 1000.0
            doubts += (f"the logger lost data {self._log.dropouts} times, {lost:.1f} s in all",)
        first_us, last_us = self._range_us
        return LogSummary(
            format="ulog",
            messages=sum(by_type.values()),
            by_type=by_type,
            skipped_bytes=self._log.skipped,
            systems=(self._id,) if known else (),
            others=(),
            time_base=TimeBase(self._time_base.source, self._time_base.absolute, doubts),
            start_s=first_us * 1e-6 + self._zero_s if math.isfinite(first_us) else math.nan,
            end_s=last_us * 1e-6 + self._zero_s if math.isfinite(last_us) else math.nan,
            events=tuple(
                LogEvent(time_us * 1e-6 + self._zero_s, self._id, one_line(text))
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
