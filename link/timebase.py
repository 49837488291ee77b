"""From the time since a vehicle's boot to UTC, at any speed that a simulation runs at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.telemetry import TimeBase

if TYPE_CHECKING:
    from link.frames import Message

_PLAUSIBLE_S = (946_684_800.0, 4_102_444_800.0)
"""Years 2000 to 2100: a clock without satellites starts in 1970."""
_REBOOT_S = 1.0


class VehicleClock:
    """The clock of one vehicle, learnt from SYSTEM_TIME; of TIMESYNC or arrival where it has none."""

    def __init__(self) -> None:
        self.offset_s: float | None = None
        self._arrival_s: float | None = None
        self._newest_boot_s = 0.0
        self.reboots = 0

    @property
    def base(self) -> TimeBase:
        """Where times come from."""
        if self.offset_s is not None:
            return TimeBase("the vehicle's clock (SYSTEM_TIME)")
        doubt = "the vehicle does not know the time: times are those of arrival here, late by the delay of the link"
        return TimeBase("this computer's clock", doubts=(doubt,))

    def hear(self, message: Message, posix_s: float) -> float:
        """Learn from a message, and return the instant it speaks of, POSIX seconds."""
        fields = message.fields
        boot_ms = fields.get("time_boot_ms")
        if boot_ms is None:
            return posix_s if self.offset_s is None else self._newest_boot_s + self.offset_s
        boot_s = float(boot_ms) * 1e-3
        if boot_s < self._newest_boot_s - _REBOOT_S:
            self.offset_s = self._arrival_s = None
            self._newest_boot_s = boot_s
            self.reboots += 1
        self._newest_boot_s = max(self._newest_boot_s, boot_s)
        if message.name == "SYSTEM_TIME":
            utc_s = fields["time_unix_usec"] * 1e-6
            if _PLAUSIBLE_S[0] < utc_s < _PLAUSIBLE_S[1]:
                self.offset_s = utc_s - boot_s
        if self.offset_s is not None:
            return boot_s + self.offset_s
        late = posix_s - boot_s
        self._arrival_s = late if self._arrival_s is None else min(self._arrival_s, late)
        return boot_s + self._arrival_s
