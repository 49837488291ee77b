"""A flight log of any format: its contents and its telemetry."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from skyway.link.logs.common.vehicle_kind import Vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from skyway.models.drones.telemetry import TelemetryTrack, TimeBase

MAX_EVENTS = 5000
"""Number of messages for people that are kept of one log."""


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A text event of a log."""

    time_s: float
    """As in the samples."""
    system: int
    """Its source."""
    text: str


@dataclass(frozen=True, slots=True)
class LogSummary:
    """Summary of a log."""

    format: str
    """``tlog``, ``dataflash``, ``ulog`` or ``csv``."""
    messages: int
    """Valid messages (rows of a CSV)."""
    by_type: dict[str, int]
    """By the format's own name of the message."""
    skipped_bytes: int
    """Bytes (rows of a CSV) that are not part of any message."""
    systems: tuple[int, ...]
    """Vehicles with telemetry."""
    others: tuple[int, ...]
    """Systems without telemetry: ground stations, radios."""
    time_base: TimeBase
    """Its clock, with its defects."""
    start_s: float = math.nan
    end_s: float = math.nan
    """`start_s`, `end_s`: first and last time; NaN in an empty log."""
    events: tuple[LogEvent, ...] = field(default=())
    """Texts of the log, at most `MAX_EVENTS`."""
    vehicles: Mapping[int, Vehicle] = field(default_factory=dict)
    """Kind of each vehicle."""
    doubted: Mapping[int, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """Intervals in which each vehicle reported that it does not trust its position, as in the samples, by system id."""

    def vehicle(self, system: int | None) -> Vehicle:
        """Type and autopilot of a vehicle in this log."""
        return self.vehicles.get(system or 0, Vehicle())


class Log(Protocol):
    """A log that has been indexed."""

    @property
    def summary(self) -> LogSummary:
        """Summary of the contents."""

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry of every vehicle piece by piece; each vehicle's pieces are in the order of time."""
