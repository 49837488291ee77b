"""Playback of a log as MAVLink at any speed, forwards or backwards, with pause and seek.

A MAVLink log is sent as it was recorded, byte for byte. Of other logs the messages that a ground station lives on are made
from the telemetry. Time is handed in, so that the same player runs on the wall clock and in tests.
"""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.tlog.stamps import StampCheck
from skyway.link.logs.tlog.tlog import read_frames
from skyway.link.wire.encoded_sample import encode
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.logs.common.log import Log
    from skyway.link.logs.tlog.track import Tlog

Packet = tuple[float, bytes]
WINDOW_BYTES = 1 << 18
BEFORE_S, AFTER_S = 2.0, 8.0
"""How much of another log is made into messages around what is requested."""
MAX_SPEED = 1000.0


class Packets(ABC):
    """What of a log is played, a window of it in memory at a time."""

    def __init__(self, start_s: float, end_s: float) -> None:
        self.start_s, self.end_s = start_s, end_s
        """`start_s`, `end_s`: first and last time."""
        self._held: list[Packet] = []
        self._reach = (math.inf, -math.inf)

    def between(self, from_s: float, to_s: float) -> list[Packet]:
        """Return the packets with ``from_s < time <= to_s``, in the order of time."""
        to_s = min(to_s, self.end_s)
        if not (self._reach[0] <= from_s and to_s <= self._reach[1]):
            self._held, self._reach = self._load(from_s, to_s)
        return [packet for packet in self._held if from_s < packet[0] <= to_s]

    @abstractmethod
    def _load(self, from_s: float, to_s: float) -> tuple[list[Packet], tuple[float, float]]:
        """Return the packets of a time, and of which longer time they are all that there are."""


class TlogPackets(Packets):
    """Packets of a tlog as they were recorded, of all systems or of one."""

    def __init__(self, log: Tlog, system: int | None, start_s: float, end_s: float) -> None:
        super().__init__(start_s, end_s)
        self._log, self._system = log, system

    def _load(self, from_s: float, to_s: float) -> tuple[list[Packet], tuple[float, float]]:
        index = self._log.index
        begin, shift_s = index.offset_at(from_s)
        check = StampCheck(shift_s)
        found: list[Packet] = []
        memory = index.beginning.copy() if begin == 0 else None
        for frames in read_frames(self._log.path, begin=begin, chunk_bytes=WINDOW_BYTES, memory=memory):
            times = check.clean(index.forward.undone(frames))
            wanted = frames.offset >= 0
            if self._system is not None:
                wanted &= frames.system == self._system
            for row in np.flatnonzero(wanted):
                at = int(frames.offset[row]) - frames.base
                found.append((float(times[row]), frames.data[at : at + int(frames.length[row])].tobytes()))
            if len(times) and times[-1] > to_s:
                return found, (from_s, float(np.nextafter(times[-1], -math.inf)))
        return found, (from_s, math.inf)


class SamplePackets(Packets):
    """Messages made from the telemetry of a log without MAVLink."""

    def __init__(self, log: Log, start_s: float, end_s: float) -> None:
        super().__init__(start_s, end_s)
        self._log = log

    def _load(self, from_s: float, to_s: float) -> tuple[list[Packet], tuple[float, float]]:
        reach, zero_s = (from_s - BEFORE_S, to_s + AFTER_S), self._log.summary.start_s
        tracks = self._log.tracks(reach[0], float(np.nextafter(reach[1], math.inf)))
        found = [(sample.time_s, encode(sample, zero_s)) for track in tracks for sample in track.samples()]
        return sorted(found, key=itemgetter(0)), reach


def packets_of(log: Log, system: int | None = None, from_s: float = -math.inf, to_s: float = math.inf) -> Packets:
    """Return what of a log can be played: of all systems or of one, within a part of its time."""
    from skyway.link.logs.tlog.track import Tlog

    ends = max(log.summary.start_s, from_s), min(log.summary.end_s, to_s)
    return TlogPackets(log, system, *ends) if isinstance(log, Tlog) else SamplePackets(log, *ends)


@dataclass(slots=True)
class Player:
    """Plays packets in time."""

    source: Packets
    send: Callable[[bytes], object]
    """Takes the bytes of each packet."""
    speed: float = 1.0
    """Seconds of the log to a second; negative plays backwards; infinite plays all at once."""
    paused: bool = False
    position_s: float = field(default=math.nan)
    """Where in the log it is."""

    def __post_init__(self) -> None:
        if math.isnan(self.position_s):
            self.position_s = float(np.nextafter(self.source.start_s, -math.inf))

    @property
    def ended(self) -> bool:
        """Whether it has reached the end in its direction of play; an empty log has ended."""
        if not math.isfinite(self.source.start_s):
            return True
        return self.position_s >= self.source.end_s if self.speed >= 0.0 else self.position_s < self.source.start_s

    def step(self, elapsed_s: float) -> int:
        """Play for a duration of the clock, s; returns the packets sent."""
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
        """Go to a time after the start, s."""
        if not math.isfinite(offset_s):
            raise InputError(Fault("is not a time to seek to", field="seek", value=offset_s))
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
