"""Compositions and states (Definitions 2 to 4 of the paper).

A *service* is one flight of one drone from a take-off to the next landing; stations overflown on the way are its
``via``. A *composition* is the ordered chain of services, with the stops between them, that carries one package.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Literal

from skyway.models.base import views
from skyway.models.base.errors import AuditError
from skyway.models.base.formatting import duration
from skyway.models.base.units import J_PER_WH, iso
from skyway.models.composition.service import Stop

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime

    import pandas as pd

    from skyway.models.base.statistics import Figure
    from skyway.models.composition.conditions import Condition
    from skyway.models.composition.distributions import ArrivalDistribution, DeliveryCosts, EnergyDistribution
    from skyway.models.composition.heights import TerrainUse
    from skyway.models.composition.release import Release
    from skyway.models.composition.service import DroneService, Place

Recharge = Literal["full", "enough"]


def _figures(value: object, where: str) -> Iterator[tuple[str, float]]:
    """Every float of a value and of its parts, with its path."""
    if isinstance(value, float):
        yield where.lstrip("."), value
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from _figures(one, f"{where}.{key}")
    elif isinstance(value, tuple):
        for number, one in enumerate(value, start=1):
            yield from _figures(one, f"{where}[{number}]")
    elif is_dataclass(value) and not isinstance(value, type):
        for part in fields(value):
            yield from _figures(getattr(value, part.name), f"{where}.{part.name}")


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
    success_probability, on_time_probability : float or None
        That every landing keeps the reserve, and that the package arrives by the deadline; None is unknown.
    success, on_time : Figure or None
        Uncertainty of these; None if nothing was sampled.
    parameters : mapping of str to str
        Parameters of planners that were not at their defaults, as they are typed after ``--set``.
    conditions : tuple of Condition
        Winds and pads observed at the time of planning that the promise rests on.
    terrain : TerrainUse or None
        Terrain that the legs are flown over; None if the ground is known at stations alone.
    authorized : tuple of str
        Zones for which the plan counts on an authorization.
    zones : tuple of str
        Files of zones given in addition to those of the scenario.
    not_before : datetime or None
        Earliest arrival of the package; None: no limit.
    energy : EnergyDistribution or None
        Where the scenario has prices, or the objective counts energy.
    costs : DeliveryCosts or None
        Where the scenario has prices.
    way_back : WayBack or None
        Plan of the drone after the delivery; None is unknown. Times, distances and energies of a composition are
        those of the delivery alone.
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
    success: Figure | None = None
    on_time: Figure | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()
    terrain: TerrainUse | None = None
    authorized: tuple[str, ...] = ()
    zones: tuple[str, ...] = ()
    not_before: datetime | None = None
    energy: EnergyDistribution | None = None
    costs: DeliveryCosts | None = None
    way_back: WayBack | None = None

    def __post_init__(self) -> None:
        """Refuse a composition with a figure that is not a number."""
        for where, value in _figures(self, ""):
            if not math.isfinite(value):
                raise AuditError(self.planner, None, where, value, "a finite figure")

    @property
    def parts(self) -> tuple[Composition, ...]:
        """The delivery, and the way back where there is one."""
        back = None if self.way_back is None else self.way_back.plan
        return (self,) if back is None else (self, back)

    @property
    def there_and_back(self) -> Composition:
        """All flights as one chain, the way back after the delivery; itself where there is no way back.

        The time at the target is a stop. Fields other than flights and stops are those of the delivery.
        """
        way = self.way_back
        if way is None or way.plan is None:
            return self
        back = way.plan
        services = tuple(replace(one, id=f"back-{number}") for number, one in enumerate(back.services, start=1))
        stay = Stop(back.origin, self.arrive, 0.0, 0.0, 0.0, self.services[-1].soc_arrive, back.services[0].soc_depart)
        first, others = (
            (back.stops[0], back.stops[1:])
            if back.stops[:1] and back.stops[0].arrive == back.depart
            else (stay, back.stops)
        )
        stay = replace(first, arrive=self.arrive, hold_s=first.hold_s + way.dwell_s)
        return replace(
            self,
            destination=back.destination,
            stations={**back.stations, **self.stations},
            services=(*self.services, *services),
            stops=(*self.stops, stay, *others),
            way_back=None,
        )

    def after(self, station: str | None) -> Composition | None:
        """Return what is left to be flown after a landing at a station: all where the next leg begins there, None where the plan does not continue from it."""
        if not self.services:
            return None
        if self.services[0].destination == station:
            rest = self.services[1:]
            return replace(self, services=rest, origin=str(station)) if rest else None
        return self if self.services[0].origin == station else None

    def stop_before(self, service: DroneService) -> Stop | None:
        """Return the stop that one of the services leaves from, if there is one: the last at its origin, which may be visited twice."""
        at_origin = (
            one for one in reversed(self.stops) if one.station == service.origin and one.arrive <= service.depart
        )
        return next(at_origin, None)

    @property
    def arrive(self) -> datetime:
        """Touch-down at the destination on the typical schedule."""
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
    def energy_wh(self) -> float:
        """The energy in watt-hours."""
        return self.energy_j / J_PER_WH

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

    def to_frame(self) -> pd.DataFrame:
        """Return the legs, each with the stop that follows it, as a pandas DataFrame."""
        return views.frame(views.leg_rows(self), "leg")

    def _repr_html_(self) -> str:
        return views.html_table(str(self), views.leg_rows(self))

    def __repr__(self) -> str:
        return f"Composition({self})"

    def __str__(self) -> str:
        return f"{self.planner}: {' > '.join(self.route)} in {duration(self.delivery_time_s)} from {iso(self.depart)}"


@dataclass(frozen=True, slots=True)
class WayBack:
    """Plan of the drone after the delivery, on the typical schedule.

    Attributes
    ----------
    asked : str
        ``home``, ``nearest-pad``, ``none`` or the id of a station.
    station : str
        Where the drone is in the end.
    dwell_s : float
        Time at the target, from touch-down to take-off; of a release in the air, that of the hover.
    plan : Composition or None
        The way there, without the package; None: it stays at the target.
    undelivered_to : str or None
        Where the package goes if it cannot be delivered; None: nothing is kept for that.
    undelivered : Composition or None
        The way there, with the package.
    release : str
        How the package leaves the drone, one of `models.composition.release.RELEASES`.
    """

    asked: str
    station: str
    dwell_s: float = 0.0
    plan: Composition | None = None
    undelivered_to: str | None = None
    undelivered: Composition | None = None
    release: Release = "gripper"


@dataclass(frozen=True, slots=True)
class State:
    """State of a delivery (Definition 4, extended by what decides feasibility).

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
        Drones seen on the pads of stations and in line now; absent is unknown.
    pads_free_s : mapping of str to tuple of float
        When busy pads of these stations become free, POSIX seconds, as far as that is known.
    visited : frozenset of str
        Stations the delivery has landed at before.
    """

    time: datetime
    station: str | None = None
    position: tuple[float, float] | None = None
    soc: float = 1.0
    busy_pads: Mapping[str, int] = field(default_factory=dict)
    pads_free_s: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    visited: frozenset[str] = frozenset()
