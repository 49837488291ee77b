"""A divert under way: its station, and whether the vehicle has its mission."""

from __future__ import annotations

from dataclasses import dataclass, field

from skyway.link.supervisor.flight.give_way import GiveWay


@dataclass(slots=True)
class Divert:
    """The divert of one flight."""

    station: str | None = None
    """Where it is sent; None where it is not, or lands where it is."""
    turned: bool = False
    """The vehicle holds the mission to that station."""
    give_way: GiveWay = field(default_factory=GiveWay)
    """What is done about other aircraft."""

    def to(self, station: str, *, turned: bool = False) -> None:
        """Send it to a station."""
        self.station, self.turned = station, turned

    def done(self) -> None:
        """Note that the vehicle holds the mission."""
        self.turned = True

    def call_off(self) -> None:
        """Send it nowhere: it flies its leg, or lands where it is."""
        self.station, self.turned = None, False
