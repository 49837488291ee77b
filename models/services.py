"""Drone services, compositions and states (Definitions 1 to 4 of the paper).

A *service* is one flight of one drone from a take-off to the next landing; stations overflown on the way are its
``via``. A *composition* is the ordered chain of services, with the stops between them, that carries one package.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Literal

from models.units import iso

if TYPE_CHECKING:
    from collections.abc import Mapping

Recharge = Literal["full", "enough"]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a station or delivery target is.

    Attributes
    ----------
    lat, lon : float
        Degrees, WGS-84.
    elevation_m : float or None
        Height of the ground above mean sea level; None is unknown.
    name : str or None
        What people call it.
    pads : int
        Recharging pads; 0 is a delivery target.
    """

    lat: float
    lon: float
    elevation_m: float | None = None
    name: str | None = None
    pads: int = 0


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind as people say it.

    Attributes
    ----------
    speed_mps : float
        Metres per second.
    from_deg : float
        Where it blows FROM, degrees clockwise from true north.
    """

    speed_mps: float
    from_deg: float


@dataclass(frozen=True, slots=True)
class DroneService:
    """One flight of the drone (Definition 1): function and qualities, on the nominal course.

    Attributes
    ----------
    id : str
        Unique within its composition.
    origin, destination : str
        Station ids.
    via : tuple of str
        Stations overflown, in order.
    depart, arrive : datetime
        Take-off and touch-down, UTC.
    distance_m : float
        Along the segments.
    bearing_deg : float
        Initial bearing of the first segment, from true north.
    ground_speed_mps : float
        Planned mean ground speed of the cruise, to be commanded.
    energy_j : float
        Taken from the battery, climb and descent included.
    soc_depart, soc_arrive : float
        State of charge, 0 to 1.
    p_reserve : float or None
        Probability that the landing keeps the reserve; None is unknown.
    p_hold : float or None
        Probability that the wind holds the drone on the ground at `depart`; None is unknown.
    wind : Wind
        At cruise height, averaged over the flight.
    tailwind_mps, crosswind_mps : float
        Components of that wind along (tailwind positive) and across (from the left positive) the course.
    diverts : tuple of str
        Stations that stay in reach along the flight, nearest first.
    """

    id: str
    origin: str
    destination: str
    depart: datetime
    arrive: datetime
    distance_m: float
    bearing_deg: float
    ground_speed_mps: float
    energy_j: float
    soc_depart: float
    soc_arrive: float
    wind: Wind
    tailwind_mps: float
    crosswind_mps: float
    via: tuple[str, ...] = ()
    p_reserve: float | None = None
    p_hold: float | None = None
    diverts: tuple[str, ...] = ()

    @property
    def flight_time_s(self) -> float:
        """From take-off to touch-down, climb and descent included."""
        return (self.arrive - self.depart).total_seconds()


@dataclass(frozen=True, slots=True)
class Stop:
    """A stay at a station between two services, on the nominal course.

    Attributes
    ----------
    station : str
        Station id.
    arrive : datetime
        Touch-down, UTC.
    wait_s : float
        Wait for a free pad.
    recharge_s : float
        Time on the pad while charging.
    hold_s : float
        Further stay, charged, for better wind or a later queue.
    soc_from, soc_to : float
        State of charge on arrival and on leaving.
    p_pad_free : float or None
        Probability that a pad is free on arrival; None is unknown.
    """

    station: str
    arrive: datetime
    wait_s: float
    recharge_s: float
    hold_s: float
    soc_from: float
    soc_to: float
    p_pad_free: float | None = None

    @property
    def leave(self) -> datetime:
        """When the drone takes off again."""
        return self.arrive + timedelta(seconds=self.wait_s + self.recharge_s + self.hold_s)


@dataclass(frozen=True, slots=True)
class ArrivalDistribution:
    """When the package arrives, over the forecast (None: unknown)."""

    mean: datetime | None
    p50: datetime | None
    p95: datetime | None


@dataclass(frozen=True, slots=True)
class Composition:
    """The chain of services and stops that carries one package (Definition 2).

    Attributes
    ----------
    id : str
        Unique.
    planner : str
        Which planner made it.
    drone : str
        Drone id; the same drone flies every service.
    drone_parameters : mapping
        The drone's figures as the planner used them, with units in their names.
    payload_kg : float
        Mass of the package.
    airspeed_mps : float
        Airspeed planned with.
    max_ground_speed_mps : float
        Ground speed no leg exceeds.
    cruise_height_m : float
        Above the ground of the stations.
    climb_rate_mps, descent_rate_mps : float
        Vertical speeds planned with.
    reserve_soc : float
        No landing below it.
    depart : datetime
        Departure requested, UTC.
    origin, destination : str
        Station ids.
    stations : mapping of str to Place
        Every place the plan names.
    services : tuple of DroneService
        In flying order.
    stops : tuple of Stop
        In order; a stop at the origin comes first where the drone charges or holds before its first flight.
    arrival : ArrivalDistribution
        Over the forecast.
    planning_time_s : float
        Wall time of the planner, set-up excluded.
    """

    id: str
    planner: str
    drone: str
    payload_kg: float
    airspeed_mps: float
    max_ground_speed_mps: float
    cruise_height_m: float
    climb_rate_mps: float
    descent_rate_mps: float
    reserve_soc: float
    depart: datetime
    origin: str
    destination: str
    stations: Mapping[str, Place]
    services: tuple[DroneService, ...]
    stops: tuple[Stop, ...]
    arrival: ArrivalDistribution
    planning_time_s: float
    seed: int | None = None
    drone_parameters: Mapping[str, float | str | None] = field(default_factory=dict)
    scenario_path: str | None = None
    scenario_sha256: str | None = None
    on_time_probability: float | None = None
    success_probability: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def arrive(self) -> datetime:
        """Touch-down at the destination on the nominal course."""
        return self.services[-1].arrive if self.services else self.depart

    @property
    def flight_time_s(self) -> float:
        """Sum over the services."""
        return sum(service.flight_time_s for service in self.services)

    @property
    def wait_time_s(self) -> float:
        """Waiting for pads and holding, over the stops."""
        return sum(stop.wait_s + stop.hold_s for stop in self.stops)

    @property
    def recharge_time_s(self) -> float:
        """Time on pads while charging, over the stops."""
        return sum(stop.recharge_s for stop in self.stops)

    @property
    def delivery_time_s(self) -> float:
        """Flight + waiting + recharge (Definition 3), equal to arrival minus departure."""
        return self.flight_time_s + self.wait_time_s + self.recharge_time_s

    @property
    def distance_m(self) -> float:
        """Sum over the services."""
        return sum(service.distance_m for service in self.services)

    @property
    def energy_j(self) -> float:
        """Sum over the services."""
        return sum(service.energy_j for service in self.services)

    @property
    def min_soc(self) -> float:
        """Lowest state of charge at any landing."""
        return min((service.soc_arrive for service in self.services), default=1.0)

    @property
    def route(self) -> tuple[str, ...]:
        """Every station touched or overflown, in order."""
        path = [self.origin]
        for service in self.services:
            path += [*service.via, service.destination]
        return tuple(path)

    def __str__(self) -> str:
        return (
            f"{self.planner}: {' > '.join(self.route)} in {self.delivery_time_s / 60:.1f} min from {iso(self.depart)}"
        )


@dataclass(frozen=True, slots=True)
class State:
    """Where a delivery stands (Definition 4, with what decides feasibility added).

    Attributes
    ----------
    time : datetime
        UTC.
    station : str or None
        Station the drone stands at; None when it is in flight.
    position : tuple of float or None
        (lat, lon) in degrees when in flight.
    soc : float
        State of charge, 0 to 1.
    busy_pads : mapping of str to int
        Busy pads seen at stations now; absent is unknown.
    visited : frozenset of str
        Stations the delivery has landed at before.
    """

    time: datetime
    station: str | None = None
    position: tuple[float, float] | None = None
    soc: float = 1.0
    busy_pads: Mapping[str, int] = field(default_factory=dict)
    visited: frozenset[str] = frozenset()
