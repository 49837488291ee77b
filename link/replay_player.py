"""A log played back as MAVLink: to any ground station, at any speed, forwards or backwards, with pause and seek.

A MAVLink log is sent as it was recorded, byte for byte. Of other logs the messages that a ground station lives on are made
from the telemetry. Time is handed in, so that the same player runs on the wall clock and in tests.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from link.logs.tlog import StampCheck, read_frames
from models.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from link.logs.log import Log
    from link.logs.tlog import TlogIndex
    from models.telemetry import TelemetrySample

Packet = tuple[float, bytes]
WINDOW_BYTES = 1 << 18
MAX_SPEED = 1000.0


class PacketSource(Protocol):
    """Anything that can be played."""

    @property
    def start_s(self) -> float:
        """First time."""

    @property
    def end_s(self) -> float:
        """Last time."""

    def between(self, from_s: float, to_s: float) -> list[Packet]:
        """Return the packets with ``from_s < time <= to_s``, in the order of time."""


class TlogPackets:
    """Packets of a tlog, a piece of it in memory at a time."""

    def __init__(self, path: Path, index: TlogIndex) -> None:
        self._path, self._index = path, index
        self.start_s, self.end_s = index.first_s, index.last_s
        self._held: list[Packet] = []
        self._reach = (math.inf, -math.inf)

    def between(self, from_s: float, to_s: float) -> list[Packet]:
        """Return the packets with ``from_s < time <= to_s``."""
        if not (self._reach[0] <= from_s and to_s <= self._reach[1]):
            self._load(from_s, to_s)
        return [packet for packet in self._held if from_s < packet[0] <= to_s]

    def _load(self, from_s: float, to_s: float) -> None:
        begin, shift_s = self._index.offset_at(from_s)
        check = StampCheck(shift_s)
        self._held = []
        for frames in read_frames(self._path, begin=begin, chunk_bytes=WINDOW_BYTES):
            times = check.clean(frames.time_s)
            for row in np.flatnonzero(frames.offset >= 0):
                at = int(frames.offset[row]) - frames.base
                self._held.append((float(times[row]), frames.data[at : at + int(frames.length[row])].tobytes()))
            if len(times) and times[-1] > to_s:
                self._reach = (from_s, float(np.nextafter(times[-1], -math.inf)))
                return
        self._reach = (from_s, math.inf)


class SamplePackets:
    """Messages made from the telemetry of a log that is no MAVLink log."""

    def __init__(self, log: Log) -> None:
        self.start_s, self.end_s = log.summary.start_s, log.summary.end_s
        self._samples = [sample for track in log.tracks() for sample in track.samples()]
        self._times = np.array([sample.time_s for sample in self._samples])
        if len(self._samples):
            self.start_s, self.end_s = float(self._times[0]), float(self._times[-1])

    def between(self, from_s: float, to_s: float) -> list[Packet]:
        """Return the packets with ``from_s < time <= to_s``."""
        first, last = np.searchsorted(self._times, (from_s, to_s), side="right")
        return [(sample.time_s, encode(sample, self.start_s)) for sample in self._samples[first:last]]


class Part:
    """Part of a source, as if it were the whole.

    Parameters
    ----------
    source : PacketSource
    from_s, to_s : float
        In the source's time; infinite for its own ends.
    """

    def __init__(self, source: PacketSource, from_s: float, to_s: float) -> None:
        self._source = source
        self.start_s, self.end_s = max(source.start_s, from_s), min(source.end_s, to_s)

    def between(self, from_s: float, to_s: float) -> list[Packet]:
        """Return the packets with ``from_s < time <= to_s``."""
        return self._source.between(from_s, min(to_s, self.end_s))


def packets_of(log: Log) -> PacketSource:
    """Return what of a log can be played."""
    from link.logs.tlog_track import Tlog

    return TlogPackets(log.path, log.index) if isinstance(log, Tlog) else SamplePackets(log)


def encode(sample: TelemetrySample, zero_s: float) -> bytes:
    """Make HEARTBEAT, ATTITUDE, GLOBAL_POSITION_INT, VFR_HUD and SYS_STATUS of a sample."""
    import io

    from pymavlink.dialects.v20 import common

    link = common.MAVLink(io.BytesIO(), srcSystem=sample.system, srcComponent=1)
    boot_ms = int(max(sample.time_s - zero_s, 0.0) * 1000.0) & 0xFFFFFFFF

    def whole(value: float, scale: float, unknown: int, most: int) -> int:
        return int(np.clip(round(value * scale), -most, most)) if math.isfinite(value) else unknown

    def real(value: float) -> float:
        return value if math.isfinite(value) else 0.0

    armed = common.MAV_MODE_FLAG_SAFETY_ARMED if sample.armed == 1.0 else 0
    kind = common.MAV_TYPE_FIXED_WING if sample.fixed_wing == 1.0 else common.MAV_TYPE_QUADROTOR
    cm = 32767
    messages: list[Any] = [
        common.MAVLink_heartbeat_message(kind, common.MAV_AUTOPILOT_GENERIC, armed, 0, common.MAV_STATE_ACTIVE, 3),
        common.MAVLink_attitude_message(
            boot_ms, real(sample.roll_rad), real(sample.pitch_rad), real(sample.yaw_rad), 0.0, 0.0, 0.0
        ),
        common.MAVLink_vfr_hud_message(
            real(sample.airspeed_mps),
            real(sample.ground_speed_mps),
            0,
            0,
            real(sample.alt_msl_m),
            -real(sample.vel_down_mps),
        ),
        common.MAVLink_sys_status_message(
            0,
            0,
            0,
            0,
            whole(sample.voltage_v, 1000.0, 65535, 65534),
            whole(sample.current_a, 100.0, -1, cm),
            whole(sample.soc, 100.0, -1, 100),
            0,
            0,
            0,
            0,
            0,
            0,
        ),
    ]
    if math.isfinite(sample.lat_deg):
        position = common.MAVLink_global_position_int_message(
            boot_ms,
            whole(sample.lat_deg, 1e7, 0, 2**31 - 1),
            whole(sample.lon_deg, 1e7, 0, 2**31 - 1),
            whole(sample.alt_msl_m, 1e3, 0, 2**31 - 1),
            whole(sample.height_m, 1e3, 0, 2**31 - 1),
            whole(sample.vel_north_mps, 100.0, 0, cm),
            whole(sample.vel_east_mps, 100.0, 0, cm),
            whole(sample.vel_down_mps, 100.0, 0, cm),
            65535,
        )
        messages.append(position)
    return b"".join(bytes(message.pack(link)) for message in messages)


@dataclass(slots=True)
class Player:
    """Plays packets in time.

    Attributes
    ----------
    source : PacketSource
    send : callable
        Takes the bytes of each packet.
    speed : float
        Seconds of the log to a second; negative plays backwards; infinite plays all at once.
    position_s : float
        Where in the log it is.
    paused : bool
    """

    source: PacketSource
    send: Callable[[bytes], object]
    speed: float = 1.0
    paused: bool = False
    position_s: float = field(default=math.nan)

    def __post_init__(self) -> None:
        if math.isnan(self.position_s):
            self.position_s = float(np.nextafter(self.source.start_s, -math.inf))

    @property
    def ended(self) -> bool:
        """Whether it stands at the end it plays towards; an empty log has ended."""
        if not math.isfinite(self.source.start_s):
            return True
        return self.position_s >= self.source.end_s if self.speed >= 0.0 else self.position_s < self.source.start_s

    def step(self, elapsed_s: float) -> int:
        """Play for so many seconds of the clock; returns the packets sent."""
        if self.paused or self.ended:
            return 0
        before_first = float(np.nextafter(self.source.start_s, -math.inf))
        target = float(np.clip(self.position_s + elapsed_s * self.speed, before_first, self.source.end_s))
        packets = self.source.between(min(self.position_s, target), max(self.position_s, target))
        for _, data in packets if self.speed >= 0.0 else reversed(packets):
            self.send(data)
        self.position_s = target
        return len(packets)

    def seek(self, offset_s: float) -> None:
        """Go to so many seconds after the beginning."""
        if not math.isfinite(offset_s):
            raise InputError(Fault("is no time to seek to", field="seek", value=offset_s))
        self.position_s = float(np.clip(self.source.start_s + offset_s, self.source.start_s, self.source.end_s))

    def status(self) -> dict[str, Any]:
        """Return where it is, as JSON has it."""
        return {
            "position_s": round(self.position_s - self.source.start_s, 3),
            "length_s": round(self.source.end_s - self.source.start_s, 3),
            "speed": self.speed if math.isfinite(self.speed) else "max",
            "paused": self.paused,
            "ended": self.ended,
        }

    def command(self, line: str) -> dict[str, Any]:
        """Obey one line of the control interface and return the status.

        A line is ``{"do": "pause" | "play" | "seek" | "speed" | "reverse" | "status"}`` with ``"to"`` seconds for seek and
        ``"to"`` a factor for speed.
        """
        try:
            order = json.loads(line)
        except (ValueError, RecursionError):
            return {"error": "not JSON"}
        if not isinstance(order, dict):
            return {"error": "not an object"}
        do, to = order.get("do"), order.get("to")
        number = float(to) if isinstance(to, int | float) and not isinstance(to, bool) and abs(to) < 1e12 else math.nan
        if do in ("pause", "play"):
            self.paused = do == "pause"
        elif do == "reverse":
            self.speed = -self.speed
        elif do == "seek" and math.isfinite(number):
            self.seek(number)
        elif do == "speed" and 0.0 < abs(number) <= MAX_SPEED:
            self.speed = number
        elif do != "status":
            return {"error": "do must be pause, play, reverse, status, seek with to in s, or speed with to up to 1000"}
        return self.status()
