"""Message rates: measured, and requested again if too low."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.wire.messages import kinds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.telemetry.live import LiveTelemetry

CHECK_S = 10.0
NEAR = 0.2
"""A rate that is lower by up to this share is sufficient."""
_MANY = 2.5
"""A rate may be higher by this factor: some vehicles report each of two batteries, or every change."""
_MAX_HZ = 50.0
_MAX_LOST = 0.9
_FEW = 2.0
"""Number of messages that may be missing or additional because of the time at which counting began."""
_ROUNDS = 3
_WITHIN = 0.35
"""If losses make counts uncertain, this multiple of the packets' loss is added to the tolerance."""


@dataclass(frozen=True, slots=True)
class RateCheck:
    """Rate of one kind of message."""

    message: str
    wanted_hz: float
    measured_hz: float
    """`wanted_hz`, `measured_hz`: the requested rate, and the rate then sent by the vehicle; losses of the radio do not
    count as not sent."""
    corrected_hz: float | None
    """Rate after a repeated request; None if that was not necessary."""
    ok: bool
    """Whether the final rate is sufficient."""

    def __str__(self) -> str:
        text = f"{self.message}: {self.measured_hz:.1f} of {self.wanted_hz:g} a second"
        if self.corrected_hz is not None:
            text += f", requested again: {self.corrected_hz:.1f}"
        return text if self.ok else f"{text}; the drone sends less than requested"


class RateKeeper:
    """Counts messages, and decides which to request again: first at the same rate, then at a corrected one.

    Rates are in the vehicle's own seconds, at any speed of a simulation.
    """

    def __init__(self, live: LiveTelemetry) -> None:
        self.live = live
        self.wanted_hz: dict[int, float] = {}
        """The requested rates."""
        self._asked_hz: dict[int, float] = {}
        self._rounds: dict[int, int] = {}
        self._checks: dict[int, RateCheck] = {}
        self._counts: dict[str, int] = {}
        self._begun_s, self._begun_boot_s = math.inf, 0.0
        self._reboots = live.clock.reboots

    @property
    def checks(self) -> tuple[RateCheck, ...]:
        """One for each requested message, once it has been measured."""
        return tuple(self._checks.values())

    def want(self, rates_hz: Mapping[int, float], now_s: float) -> None:
        """Take over the rates just requested."""
        if rates_hz == self.wanted_hz:  # the vehicle uses these rates again, without our corrections
            self._asked_hz = dict(rates_hz)
            self._rounds.clear()
            return
        self.wanted_hz, self._asked_hz = dict(rates_hz), dict(rates_hz)
        self._checks.clear()
        self._rounds.clear()
        self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        self._counts.clear()
        self._begun_s, self._begun_boot_s = now_s, self.live.clock.boot_s

    def heard(self, name: str, now_s: float) -> dict[int, float]:
        """Count a message; returns the rates to request now, by message id: usually none."""
        if now_s < self._begun_s:
            return {}
        if not self._begun_boot_s and self.live.clock.boot_s > 0.0:  # its own clock is known only from now on
            self._begin(now_s)
        self._counts[name] = self._counts.get(name, 0) + 1
        if now_s < self._begun_s + CHECK_S:
            return {}
        if self.live.clock.reboots != self._reboots:  # it has forgotten the requests
            self._reboots, wanted, self.wanted_hz = self.live.clock.reboots, self.wanted_hz, {}
            self.want(wanted, now_s)
            return dict(wanted)
        again = self._judge(now_s - self._begun_s)
        self._begin(now_s)
        return again

    def _judge(self, passed_s: float) -> dict[int, float]:
        boot_s = self.live.clock.boot_s - self._begun_boot_s
        seconds = boot_s if boot_s > 0.0 and abs(boot_s / passed_s - 1.0) > NEAR else passed_s
        loss = min(self.live.loss, _MAX_LOST)
        again = {}
        for number, wanted in self.wanted_hz.items():
            name = kinds()[number].name
            came = self._counts.get(name, 0) / seconds / (1.0 - loss)
            few = (NEAR + _WITHIN * loss) * wanted + _FEW / seconds
            ok = wanted - few <= came <= _MANY * wanted + few
            rounds = self._rounds.get(number, 0)
            before = self._checks.get(number)
            first = came if before is None or not rounds else before.measured_hz
            self._checks[number] = RateCheck(name, wanted, first, came if rounds else None, ok)
            if ok or rounds >= _ROUNDS:
                continue
            if rounds and came:  # repeating the same request has not helped
                self._asked_hz[number] = min(self._asked_hz[number] * wanted / came, _MAX_HZ)
            self._rounds[number] = rounds + 1
            again[number] = self._asked_hz[number]
        return again
