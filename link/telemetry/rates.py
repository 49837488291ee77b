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
"""A rate that is lower by no more than this share will do."""
_MANY = 2.5
"""A rate may be higher by this factor: some vehicles report each of two batteries, or every change."""
_MAX_HZ = 50.0
_MAX_LOST = 0.9
_FEW = 2.0
"""So many messages may be missing or too many by the moment at which counting began."""
_ROUNDS = 3
_WITHIN = 0.35
"""Where losses make counts uncertain, so much of the packets' loss is added to what will do."""


@dataclass(frozen=True, slots=True)
class RateCheck:
    """How often one kind of message comes."""

    message: str
    wanted_hz: float
    measured_hz: float
    """`wanted_hz`, `measured_hz`: as it was requested, and as the vehicle sent it then; losses of the radio do not
    count as not sent."""
    corrected_hz: float | None
    """As it was sent after it was requested again; None where that was not needed."""
    ok: bool
    """Whether it comes as often as wanted, in the end."""

    def __str__(self) -> str:
        text = f"{self.message}: {self.measured_hz:.1f} of {self.wanted_hz:g} a second"
        if self.corrected_hz is not None:
            text += f", requested again: {self.corrected_hz:.1f}"
        return text if self.ok else f"{text}; the drone sends less than requested"


class RateKeeper:
    """Counts messages, and says which to ask for again: first the same again, then more or less than is wanted.

    Rates are in the vehicle's own seconds, whatever speed a simulation runs at.
    """

    def __init__(self, live: LiveTelemetry) -> None:
        self.live = live
        self.wanted_hz: dict[int, float] = {}
        """What was requested."""
        self._asked_hz: dict[int, float] = {}
        self._rounds: dict[int, int] = {}
        self._checks: dict[int, RateCheck] = {}
        self._counts: dict[str, int] = {}
        self._begun_s, self._begun_boot_s = math.inf, 0.0
        self._reboots = live.clock.reboots

    @property
    def checks(self) -> tuple[RateCheck, ...]:
        """One for each message wanted, once it has been measured."""
        return tuple(self._checks.values())

    def want(self, rates_hz: Mapping[int, float], now_s: float) -> None:
        """Take over the rates just requested."""
        if rates_hz == self.wanted_hz:  # the vehicle has taken these rates again, without our corrections
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
        """Count a message; returns what to ask for now, by message id: mostly nothing."""
        if now_s < self._begun_s:
            return {}
        if (
            not self._begun_boot_s and self.live.clock.boot_s > 0.0
        ):  # its own clock is known from now on, not since it started
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
            if rounds and came:  # to ask for the same again has not helped
                self._asked_hz[number] = min(self._asked_hz[number] * wanted / came, _MAX_HZ)
            self._rounds[number] = rounds + 1
            again[number] = self._asked_hz[number]
        return again
