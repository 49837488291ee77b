"""The simulated world: vehicles, wind, ground, pads, and a log of events."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError
from skyway.sim_stub.faults import AT_STATIONS, Fault, parse_fault
from skyway.sim_stub.plant.physics import metres_per_degree, offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind, WindTruth
from skyway.sim_stub.vehicle import Vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.models.network.station import Station
    from skyway.sim_stub.config import VehicleConfig
    from skyway.sim_stub.pads import Pads

_MAX_LOG = 100_000


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened."""

    sim_s: float
    """When, in simulated time."""
    system: int
    """To which vehicle; 0 to none."""
    text: str

    def __str__(self) -> str:
        who = f"vehicle {self.system}" if self.system else "pads"
        return f"{self.sim_s:10.2f} s  {who:<11} {self.text}"


class World:
    """Everything simulated: vehicles, the wind that blows (calm by default), stations, faults that will come.

    `epoch_s` are the POSIX seconds at simulated time 0; `on_event` is called with every event.
    """

    def __init__(
        self,
        *,
        epoch_s: float = 1_373_464_800.0,
        wind: WindTruth | None = None,
        stations: Sequence[Station] = (),
        faults: Sequence[Fault] = (),
        on_event: Callable[[Event], None] | None = None,
    ) -> None:
        self.epoch_s = epoch_s
        self.wind: WindTruth = wind or ConstantWind()
        self.stations = tuple(stations)
        self._station_lat, self._station_lon = np.array([(one.lat, one.lon) for one in self.stations]).reshape(-1, 2).T
        self.faults = tuple(faults)
        self.on_event = on_event
        self.sim_s = self.wall_s = 0.0
        self.vehicles: dict[int, Vehicle] = {}
        self.events: list[Event] = []
        self.pads: Pads | None = None

    def add(self, config: VehicleConfig) -> Vehicle:
        """Add a vehicle to the world. Raises an `InputError` if the system id is in use."""
        if config.system in self.vehicles:
            raise InputError(Wrong("two vehicles have the same system id", field="system", value=config.system))
        vehicle = Vehicle(config, self)
        self.vehicles[config.system] = vehicle
        return vehicle

    def next_due_s(self) -> float:
        """Simulated instant of the next scheduled event."""
        due = math.inf if self.pads is None else self.pads.next_due_s()
        for vehicle in self.vehicles.values():
            rests_s = vehicle.rests_until_s
            due = min(due, vehicle.next_due_s() if rests_s <= self.sim_s else rests_s)
        return due

    def next_wall_s(self) -> float:
        """Wall instant at which a protocol timer of a vehicle runs out."""
        due = math.inf
        for vehicle in self.vehicles.values():
            if vehicle.rests_until_s <= self.sim_s:
                due = min(due, vehicle.next_wall_s())
        return due

    def advance(self, sim_s: float, wall_s: float) -> None:
        """Advance the time of everything."""
        self.sim_s, self.wall_s = sim_s, wall_s
        for vehicle in self.vehicles.values():
            vehicle.advance(sim_s, wall_s)
        if self.pads is not None:
            self.pads.advance(sim_s)

    def inject(self, fault: Fault | str) -> None:
        """Inject an unplanned fault, for example ``"link-loss+60s#2"`` (see `sim_stub.faults`).

        Its times count from now, or from the first take-off. Raises an `InputError` if there is no such fault, vehicle,
        or station with pads.
        """
        asked = parse_fault(fault) if isinstance(fault, str) else fault
        begun_s = 0.0 if asked.after_take_off else self.sim_s
        now = replace(asked, start_s=asked.start_s + begun_s, end_s=asked.end_s + begun_s)
        if asked.kind == AT_STATIONS:
            if self.pads is None:
                raise InputError(Wrong("there are no pads here", field="--fault", value=asked.kind))
            self.pads.take(now)
            return
        if asked.system is not None and asked.system not in self.vehicles:
            raise InputError(Wrong("no such vehicle", field="--fault", value=asked.system))
        for system, vehicle in self.vehicles.items():
            if asked.system in (None, system):
                vehicle.faults.add(now, vehicle.sim_s)
                vehicle.wake()

    @property
    def anyone_active(self) -> bool:
        """Whether a vehicle flies or has its motors on."""
        return any(vehicle.active for vehicle in self.vehicles.values())

    def log(self, system: int, text: str) -> None:
        """Note an event."""
        vehicle = self.vehicles.get(system)
        event = Event(vehicle.sim_s if vehicle else self.sim_s, system, text)
        if len(self.events) < _MAX_LOG:
            self.events.append(event)
        if self.on_event is not None:
            self.on_event(event)

    def ground_m(self, lat: float, lon: float, otherwise_m: float) -> float:
        """Height of the ground: that of the nearest station, where it is known."""
        near = self._nearest(lat, lon)
        return otherwise_m if near is None or near[0].elevation_m is None else near[0].elevation_m

    def station_near(self, lat: float, lon: float, within_m: float) -> str | None:
        """Id of the station within a distance, or None."""
        near = self._nearest(lat, lon)
        return near[0].id if near is not None and near[1] <= within_m else None

    def _nearest(self, lat: float, lon: float) -> tuple[Station, float] | None:
        """Return the nearest station within a degree of latitude, and how far it is, m."""
        if not self.stations:
            return None
        north, east = metres_per_degree(lat)
        turn = (self._station_lon - lon + 180.0) % 360.0 - 180.0
        away = ((self._station_lat - lat) * north) ** 2 + (turn * east) ** 2
        found = self.stations[int(away.argmin())]
        if abs(found.lat - lat) > 1.0:
            return None
        return found, math.hypot(*offset_m(lat, lon, found.lat, found.lon))
