"""Progress of a delivery: the plan in force, the present leg, the vehicle's place and the places visited."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.legs import station_at
from skyway.link.supervisor.work.progress import WorkProgress
from skyway.models.composition.service import Place

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.link.supervisor.legs import Leg
    from skyway.link.supervisor.onward import Onward
    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario

AT_STATION_M = 60.0


@dataclass(slots=True)
class DeliveryProgress:
    """The progress of one delivery; written only by its own methods."""

    resumed: bool = False
    """It was started by an earlier run of the program."""
    plan: Composition | None = None
    """The plan in force from the vehicle's station, or from the present leg, on."""
    leg: Leg | None = None
    """The leg uploaded, or under way."""
    flight: int = 0
    """Number of flights begun."""
    station: str | None = None
    """Station at which the vehicle stands; None in the air and away from stations."""
    visited: set[str] = field(default_factory=set)
    """Stations of earlier landings."""
    landed_at: str | None = None
    """Place where the last flight ended, once recorded."""
    diverts: tuple[str, ...] = ()
    """Divert stations of the next leg."""
    charge_to: float | None = None
    """Charge at departure."""
    least_soc: float | None = None
    """Least charge at departure, if it differs from the plan."""
    charged: bool = False
    """The battery was charged here."""
    waits_from_s: float | None = None
    """Time of the first decision to wait here before the next leg, POSIX seconds."""
    called_off: bool = False
    """The plan in force ends with the next landing."""
    work: WorkProgress = field(default_factory=WorkProgress)
    """Progress of the work, for work instead of a delivery."""
    onward: Onward | None = None
    """Destination after the target; None until the package was delivered, or could not be."""

    # The plan

    def take_plan(self, plan: Composition | None) -> None:
        """Put a plan in force; None for none."""
        self.plan, self.called_off = plan, False

    def go_on(self, onward: Onward) -> None:
        """Continue from the target: without a required charge, and with all stations unvisited."""
        self.onward, self.charge_to, self.charged = onward, None, False
        self.visited = set()

    def call_off(self, onward: Onward) -> None:
        """Divert in the air: until it lands the plan in force only supplies places."""
        self.go_on(onward)
        self.called_off = True

    def begins_at(self, station: str | None) -> bool:
        """Whether the plan in force has a leg that begins at a station."""
        return self.plan is not None and bool(self.plan.services) and self.plan.services[0].origin == station

    def reach(self, station: str | None) -> None:
        """Remove the flown leg from the plan; a plan that does not continue from this station is dropped."""
        if self.called_off:
            self.take_plan(None)
        elif self.plan is not None:
            self.plan = self.plan.after(station)

    def prepare(self, diverts: Iterable[str], charge_to: float | None, least_soc: float | None = None) -> None:
        """Take the decision for the next leg besides the plan."""
        self.diverts, self.charge_to, self.least_soc = tuple(diverts), charge_to, least_soc

    def waited_s(self, now_s: float) -> float:
        """Return the time since the first decision to wait here before the next leg, s; the first call sets it."""
        if self.waits_from_s is None:
            self.waits_from_s = now_s
        return now_s - self.waits_from_s

    def charge_done(self) -> None:
        """Record that the battery was charged here."""
        self.charged = True

    # The leg

    def take_leg(self, leg: Leg | None) -> None:
        """Set the leg that is uploaded or under way; None if there is none."""
        self.leg = leg

    def begin_flight(self) -> None:
        """Count a flight, before its take-off is commanded."""
        self.flight += 1
        self.landed_at = None

    def take_off(self) -> None:
        """Leave the station."""
        self.station, self.charged, self.charge_to, self.least_soc, self.waits_from_s = None, False, None, None, None

    def not_begun(self) -> None:
        """Undo a flight that did not take off."""
        self.flight -= 1

    # Place

    def stand_at(self, station: str | None) -> None:
        """Set the station where it stands."""
        self.station = station

    def note_landing(self, where: str | None) -> None:
        """Set the place where a flight ended; None until that is recorded."""
        self.landed_at = where

    def visit(self, station: str) -> None:
        """Record a landing at a station."""
        self.visited.add(station)

    def restore(
        self, station: str | None, visited: Iterable[str], diverts: Iterable[str], charge_to: float | None
    ) -> None:
        """Restore the progress from a journal."""
        self.station = station or self.station
        self.visited = set(visited)
        self.prepare(diverts, charge_to)

    def restore_flight(self, flight: int) -> None:
        """Restore the number of flights started."""
        self.flight = flight

    def station_at(self, place: tuple[float, float] | None, scenario: Scenario) -> str | None:
        """Name the known station at a place; None if there is none."""
        if place is None:
            return None
        known = {s.id: Place.of(s) for s in scenario.network.stations}
        if self.plan is not None:
            known |= dict(self.plan.stations)
        return station_at(known, *place, AT_STATION_M)
