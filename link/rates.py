"""Whether telemetry comes as often as it was asked for; asked for anew where it does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from link.frames import kinds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from link.live import LiveTelemetry

CHECK_S = 10.0
NEAR = 0.2
"""A rate that is off by no more than this share will do."""
_MOST_HZ = 50.0
_MOST_LOST = 0.9
_ROUNDS = 2
_FEW = 2.0
"""So many messages may be missing or too many by the moment at which counting began."""


class Streaming(Protocol):
    """What is asked for messages at a rate, and counts those that come."""

    @property
    def live(self) -> LiveTelemetry:
        """Its telemetry."""
        ...

    def request_telemetry(self, rates_hz: Mapping[int, float]) -> tuple[int, ...]:
        """Ask for messages; returns the ids of those refused."""
        ...

    def measured_rates(self, duration_s: float) -> dict[str, float]:
        """Messages a second of each name that really come, over some time."""
        ...


@dataclass(frozen=True, slots=True)
class RateCheck:
    """How often one kind of message comes.

    Attributes
    ----------
    message : str
        Its name.
    wanted_hz, measured_hz : float
        As it was asked for, and as the vehicle sent it then.
    corrected_hz : float or None
        As it was sent after it was asked for anew; None where that was not needed.
    """

    message: str
    wanted_hz: float
    measured_hz: float
    corrected_hz: float | None = None

    @property
    def ok(self) -> bool:
        """Whether it comes as often as wanted, in the end."""
        last = self.measured_hz if self.corrected_hz is None else self.corrected_hz
        return _near(last, self.wanted_hz)

    def __str__(self) -> str:
        text = f"{self.message}: {self.measured_hz:.1f} of {self.wanted_hz:g} a second"
        if self.corrected_hz is not None:
            text += f", asked for anew: {self.corrected_hz:.1f}"
        return text if self.ok else f"{text}; the vehicle does not keep to it"


def _near(measured_hz: float, wanted_hz: float, duration_s: float = CHECK_S) -> bool:
    return abs(measured_hz - wanted_hz) <= NEAR * wanted_hz + _FEW / duration_s


def sent_rates(vehicle: Streaming, duration_s: float) -> dict[str, float]:
    """Messages of each name in a second of the vehicle's own, as it sends them: those lost on the way included."""
    begun_s = vehicle.live.clock.boot_s
    came = vehicle.measured_rates(duration_s)
    passed_s = vehicle.live.clock.boot_s - begun_s
    speed = passed_s / duration_s if passed_s > 0.0 else 1.0
    speed = 1.0 if abs(speed - 1.0) < NEAR else speed
    return {name: rate / speed / (1.0 - min(vehicle.live.loss, _MOST_LOST)) for name, rate in came.items()}


def check_rates(
    vehicle: Streaming, wanted_hz: Mapping[int, float], duration_s: float = CHECK_S
) -> tuple[RateCheck, ...]:
    """Measure rates, and correct the request where a rate is not what was asked for: first the same again, then more.

    Packets lost by the radio do not count as not sent: more packets would not help a bad radio.

    Parameters
    ----------
    vehicle : Streaming
        It was asked for these messages before.
    wanted_hz : mapping of message id to float
        What was asked for.
    duration_s : float
        How long to measure.

    Returns
    -------
    tuple of RateCheck
        One for each message wanted.
    """
    names = {number: kinds()[number].name for number in wanted_hz}
    first = latest = sent_rates(vehicle, duration_s)
    corrected: dict[int, float] = {}
    asked = dict(wanted_hz)
    for _ in range(_ROUNDS):
        far = [n for n, wanted in wanted_hz.items() if not _near(latest.get(names[n], 0.0), wanted, duration_s)]
        if not far:
            break
        for number in far:
            came = latest.get(names[number], 0.0)
            if number in corrected and came:  # to ask for the same again has not helped
                asked[number] = min(asked[number] * wanted_hz[number] / came, _MOST_HZ)
        vehicle.request_telemetry({number: asked[number] for number in far})
        latest = sent_rates(vehicle, duration_s)
        corrected |= {number: latest.get(names[number], 0.0) for number in far}
    return tuple(
        RateCheck(names[number], wanted, first.get(names[number], 0.0), corrected.get(number))
        for number, wanted in wanted_hz.items()
    )
