"""A divert under way: its station, and whether the vehicle has its mission."""

from __future__ import annotations

from dataclasses import dataclass, field

from skyway.link.supervisor.flight.give_way import GiveWay


@dataclass(slots=True)
class Divert:
    """The divert of one flight."""

    station: str | None = None
    """Destination of the divert; None if there is none, or the drone lands where it is."""
    turned: bool = False
    """The vehicle has the mission to that station."""
    give_way: GiveWay = field(default_factory=GiveWay)
    """Reaction to other aircraft."""

    def to(self, station: str, *, turned: bool = False) -> None:
        """Set the destination."""
        self.station, self.turned = station, turned

    def done(self) -> None:
        """Record that the vehicle has the mission."""
        self.turned = True

    def call_off(self) -> None:
        """Cancel the divert: the drone flies its leg, or lands where it is."""
        self.station, self.turned = None, False
