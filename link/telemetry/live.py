"""Live telemetry: messages of one vehicle become samples with data quality.

The interpretation of messages (`link.logs.common.messages`) and the assembly of samples (`link.logs.common.assembly`) are the same as in logs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.link.logs.common.assembly import Assembler
from skyway.link.logs.common.messages import SPOKEN
from skyway.link.telemetry import batteries
from skyway.link.telemetry.data_quality import DataQuality
from skyway.link.telemetry.plausible import BootTimes, Plausible
from skyway.link.telemetry.timebase import VehicleClock

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.link.logs.common.messages import Columns
    from skyway.link.wire.messages import Message
    from skyway.models.drones.telemetry import TelemetrySample

RATES_HZ: Mapping[int, float] = {30: 10.0, 33: 5.0, 74: 2.0, 1: 1.0, 147: 1.0, 245: 1.0, 42: 1.0, 2: 1.0, 168: 1.0}
"""Messages that telemetry is made of, and their requested rates: attitude, position, …, wind."""
WIND = 168
_SAME_AGAIN = frozenset(("HEARTBEAT", "EXTENDED_SYS_STATE", "MISSION_CURRENT"))
_TIMES = frozenset(("SYSTEM_TIME", "TIMESYNC"))
_WINDOW = 256
"""Packets over which losses are counted."""
_WINDOW_BITS = (1 << _WINDOW) - 1
_REORDERED = 128
_STEP_S = 5.0
"""Times that go back by more belong to another time base."""


class LiveTelemetry:
    """The telemetry of one vehicle."""

    def __init__(self, system: int) -> None:
        self.system = system
        self.clock = VehicleClock()
        """Source of the times."""
        self.sample: TelemetrySample | None = None
        """The newest sample."""
        self.reached: list[int] = []
        """Items reached, in the autopilot's numbering, each once (PX4 reports it ten times)."""
        self._assembler = Assembler(system)
        self._doubts = DataQuality()
        self._plausible = Plausible()
        self._boots = BootTimes()
        self._said: dict[str, tuple[bytes, dict[str, float]]] = {}
        self._newest: int | None = None
        self._newest_s = -math.inf
        self._came = self._counted = 0

    @property
    def doubts(self) -> dict[str, str]:
        """Data-quality problems as text, by quantity."""
        return self._doubts.words

    def hear(self, message: Message, posix_s: float, soc: float = math.nan) -> TelemetrySample | None:
        """Process a message; returns a sample if it completes one.

        `soc` is the state of charge by all reports of the vehicle's batteries, see `Batteries.soc`; a single message reports
        that of one battery.
        """
        name = message.name
        self._count(message.sequence)
        speak = SPOKEN.get(name)
        if speak is None and name not in _TIMES:
            return None
        if not self._timely(message, posix_s):
            return None
        reboots = self.clock.reboots
        time_s = self.clock.hear(message, posix_s)
        if self.clock.reboots != reboots:
            self.reached.clear()
        if self.clock.reboots != reboots or time_s < self._newest_s - _STEP_S:
            self._assembler.forget()  # also if another time base takes over: earlier data are in another time
            self._doubts.forget()
            self._plausible.forget()
            self._newest_s = time_s
        self._newest_s = max(self._newest_s, time_s)
        if speak is None:
            return None
        reports = self._reports(message, speak)
        if name in batteries.MESSAGES and (name == "SYS_STATUS" or math.isfinite(soc)):
            reports["soc"] = soc
        if name == "MISSION_ITEM_REACHED" and (not self.reached or self.reached[-1] != message["seq"]):
            self.reached.append(message["seq"])
        self._doubts.hear(reports, time_s)
        reports = self._plausible.hear(reports, time_s)
        reports["link_loss"] = self.loss
        sample = self._assembler.feed_one(time_s, reports)
        if sample is not None:
            self.sample = sample
        return sample

    def _reports(self, message: Message, speak: Callable[[Any], Columns]) -> dict[str, float]:
        """What a message says; one that says the same as the last of its name, as most do of some, is not worked out again."""
        before, reports = self._said.get(message.name, (b"", {}))
        if not message.payload or before != message.payload:
            reports = {quantity: float(value) for quantity, value in speak(message.fields).items()}
            if message.name in _SAME_AGAIN:
                self._said[message.name] = message.payload, reports
        return dict(reports)

    def _timely(self, message: Message, posix_s: float) -> bool:
        """Whether the times in a message are plausible; otherwise the complete message is omitted."""
        fields = message.fields
        boot_ms = fields.get("time_boot_ms")
        if message.name == "TIMESYNC" and fields["tc1"] and fields["ts1"]:
            boot_ms = fields["tc1"] * 1e-6
        if not self._boots.believed(boot_ms, posix_s):
            return False
        if message.name != "SYSTEM_TIME" or not fields["time_unix_usec"]:
            return True
        return self._boots.utc_believed(fields["time_unix_usec"] * 1e-6, fields["time_boot_ms"] * 1e-3)

    def _count(self, sequence: int) -> None:
        """Record which of the last packets have arrived, by their numbers: bit n is the n-th before the newest."""
        ahead = 1 if self._newest is None else (sequence - self._newest) & 0xFF
        if ahead >= _REORDERED:
            self._came |= 1 << (256 - ahead)  # late, or a duplicate
            return
        self._newest = sequence
        self._came = (self._came << ahead | 1) & _WINDOW_BITS
        self._counted = min(self._counted + ahead, _WINDOW)

    @property
    def loss(self) -> float:
        """Share of its last packets that were lost, 0-1."""
        return 1.0 - min(self._came.bit_count() / self._counted, 1.0) if self._counted else 0.0

    def latest(self, quantity: str) -> float:
        """Newest report of a quantity, however old; NaN before the first."""
        return self._assembler.latest(quantity)
