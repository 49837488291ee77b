"""Pads of the stations, with queues, charging, and other drones that come and go.

First come, first served, no reservations. Other drones arrive as a Poisson process and charge for exponential times,
with the rates of `models.queues.load`; they are sampled here, not taken from the queue model that plans are made with. Time
passes from event to event.
"""

from __future__ import annotations

import heapq
import math
import random
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import percent
from skyway.models.queues.opening_hours import opening_hours
from skyway.models.queues.pad_service import DroneOnPad, PadServiceError, StationStatus
from skyway.sim_stub.faults import AT_STATIONS
from skyway.sim_stub.vehicle import Charge

if TYPE_CHECKING:
    from skyway.models.network.station import Station
    from skyway.models.queues.load import PadLoad
    from skyway.sim_stub.faults import Fault
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.world import World

_WARM_UP_H = 24
_RATES_H = 24
_MAX_LINE = 1000
_HOURS_D = 60  # days of opening hours


@dataclass(eq=False, slots=True)
class _Customer:
    """Somebody at a station: another drone, or one of ours."""

    stay_s: float = 0.0
    """How long another drone charges."""
    end_s: float = math.inf
    """When it leaves the pad, or when ours is charged; infinite while it waits."""
    vehicle: Vehicle | None = None
    """Ours; None for another drone."""
    to_soc: float = 1.0


@dataclass(slots=True)
class _Site:
    """One station."""

    station: Station
    row: int
    generator: random.Random
    on_pads: list[_Customer] = field(default_factory=list)
    line: deque[_Customer] = field(default_factory=deque)
    """`on_pads`, `line`: who stands on the pads and who waits, in order."""
    next_arrival_s: float = math.inf
    """When the next other drone comes."""
    rates_from_s: float = -math.inf
    rates: tuple[list[float], list[float]] = ((), ())  # type: ignore[assignment]
    shut: bool = False
    """Whether it is closed now."""
    closed: list[tuple[float, float]] = field(default_factory=list)
    """Times at which it is closed, simulated instants, ascending; those that are over are dropped."""

    def is_closed(self, sim_s: float) -> bool:
        """Whether charging is closed at an instant."""
        return bool(self.closed) and self.closed[0][0] <= sim_s < self.closed[0][1]

    def next_due_s(self) -> float:
        """Next time at which another drone arrives or leaves."""
        due = self.next_arrival_s
        if self.closed:
            due = min(due, self.closed[0][1] if self.shut else self.closed[0][0])
        for customer in self.on_pads:
            due = min(due, customer.end_s)
        return due


class Pads:
    """All pads of a world; satisfies `models.queues.pad_service.PadService`.

    `load` are other drones, in the order of the world's stations, drawn from the seed; None is none.
    """

    def __init__(self, world: World, load: PadLoad | None = None, *, seed: int = 1) -> None:
        self.world, self.load = world, load
        self._sites = {
            station.id: _Site(station, row, random.Random(f"{seed}/{station.id}"))  # noqa: S311
            for row, station in enumerate(world.stations)
        }
        self._now = world.sim_s - _WARM_UP_H * 3600.0
        self._raids: list[Fault] = []
        self._hosts: list[_Site] = []  # where ours are
        for fault in world.faults:
            if fault.kind == AT_STATIONS:
                self.take(fault)
        timezone = "UTC" if load is None else load.timezone
        for site in self._sites.values():
            begin_s = world.epoch_s + self._now
            hours = opening_hours(site.station.open_hours)
            closed_s = hours.closed_between(timezone, begin_s, begin_s + _HOURS_D * 86_400.0) - world.epoch_s
            site.closed = [(begin, end) for begin, end in closed_s.tolist()]
        if load is not None:
            for site in self._sites.values():
                if site.station.pads:
                    site.next_arrival_s = self._arrival_after(site, self._now)
        self._due = -math.inf
        self._calendar: list[tuple[float, int, _Site]] = []
        self._reschedule()
        self.advance(world.sim_s)
        world.pads = self

    # Time

    def next_due_s(self) -> float:
        """Simulated instant of the next event."""
        return self._due

    def advance(self, sim_s: float) -> None:
        """Let everything up to an instant happen."""
        while self._due <= sim_s:
            if self._raids and self._raids[0].start_s <= self._due:
                self._raid(self._raids.pop(0))
            else:
                self._now, _, site = self._calendar[0]
                self._happen(site)
                self._book(site)
                continue
            self._reschedule()
        self._now = max(self._now, sim_s)
        for site in self._hosts[:]:
            self._see_off(site)

    def _reschedule(self) -> None:
        """Put the calendar of all stations up again."""
        self._calendar = [(site.next_due_s(), site.row, site) for site in self._sites.values()]
        heapq.heapify(self._calendar)
        self._look_up()

    def _book(self, site: _Site) -> None:
        """Put the next event of the station that was first in the calendar in its place."""
        heapq.heapreplace(self._calendar, (site.next_due_s(), site.row, site))
        self._look_up()

    def _look_up(self) -> None:
        due = self._calendar[0][0] if self._calendar else math.inf
        self._due = min(due, self._raids[0].start_s) if self._raids else due

    def take(self, fault: Fault) -> None:
        """Have other drones come and take every pad of a station, or of all, for a time.

        They come at the fault's start, as many as there are pads, and stand in line behind those who are there. An
        `InputError` says that no station of that name has pads.
        """
        site = self._sites.get(fault.word)
        if fault.word and (site is None or not site.station.pads):
            raise InputError(Wrong("no station with pads", field="--fault", value=f"{fault.kind}={fault.word}"))
        self._raids = sorted([*self._raids, fault], key=lambda raid: raid.start_s)
        self._reschedule()

    def _raid(self, fault: Fault) -> None:
        self._now = max(self._now, fault.start_s)
        self.world.log(0, f"pads of {fault.word or 'all stations'} are taken")
        for site in self._sites.values():
            if fault.word in ("", site.station.id):
                site.line.extend(_Customer(fault.end_s - fault.start_s) for _ in range(site.station.pads))
                self._fill(site)

    def _open_or_close(self, site: _Site) -> None:
        """Close a station whose time has come: who charges stays where he is, without power; or open it again."""
        while site.closed and site.closed[0][1] <= self._now:
            site.closed.pop(0)
        shut = site.is_closed(self._now)
        if shut == site.shut:
            return
        site.shut = shut
        for customer in site.on_pads:
            vehicle = customer.vehicle
            if vehicle is not None and shut and vehicle.charging is not None:
                vehicle.tend()
                vehicle.charging, customer.end_s = None, math.inf
                vehicle.event(f"is no longer charged: {site.station.id} closes")
            elif vehicle is not None and not shut and vehicle.battery.soc < customer.to_soc:
                self._begin(site, customer, vehicle)

    def _happen(self, site: _Site) -> None:
        self._open_or_close(site)
        if site.next_arrival_s <= self._now:
            mean_s = self._rates(site, self._now)[1]
            if len(site.line) < _MAX_LINE:
                site.line.append(_Customer(site.generator.expovariate(1.0 / mean_s)))
            site.next_arrival_s = self._arrival_after(site, self._now)
        for customer in [customer for customer in site.on_pads if customer.end_s <= self._now]:
            if customer.vehicle is not None:
                customer.end_s = math.inf
                self._charged(site, customer, customer.vehicle)
            else:
                site.on_pads.remove(customer)
        self._fill(site)

    def _fill(self, site: _Site) -> None:
        """Let those who wait onto the pads that are free."""
        while site.line and len(site.on_pads) < site.station.pads and not site.shut:
            customer = site.line.popleft()
            site.on_pads.append(customer)
            if customer.vehicle is not None:
                self._begin(site, customer, customer.vehicle)
            else:
                customer.end_s = self._now + customer.stay_s

    def _see_off(self, site: _Site) -> None:
        """Take those of ours off the books who have left or started their motors."""
        ours = [(c, c.vehicle) for c in (*site.on_pads, *site.line) if c.vehicle is not None]
        if not ours:
            self._hosts.remove(site)
        for customer, vehicle in ours:
            if vehicle.active:
                self._remove(site, customer, vehicle)

    def _remove(self, site: _Site, customer: _Customer, vehicle: Vehicle) -> None:
        vehicle.tend()
        vehicle.charging = None
        vehicle.event(f"leaves the pads of {site.station.id}")
        if customer in site.on_pads:
            site.on_pads.remove(customer)
        else:
            site.line.remove(customer)
        self._fill(site)
        self._reschedule()

    # Charging

    def _begin(self, site: _Site, customer: _Customer, vehicle: Vehicle) -> None:
        vehicle.tend()
        power = site.station.recharge_power_w
        customer.end_s = self._now + vehicle.battery.time_to_soc_s(customer.to_soc, power)
        vehicle.charging = Charge(customer.to_soc, power)
        vehicle.event(f"charges at {site.station.id}: {percent(vehicle.battery.soc)} to {percent(customer.to_soc)}")
        if customer.end_s <= self._now:
            customer.end_s = math.inf
            self._charged(site, customer, vehicle)

    def _charged(self, site: _Site, customer: _Customer, vehicle: Vehicle) -> None:
        vehicle.tend()
        vehicle.battery.soc = max(vehicle.battery.soc, min(customer.to_soc, 1.0))  # and the pad keeps it there
        vehicle.event(f"is charged to {percent(vehicle.battery.soc)} at {site.station.id}")

    # Other drones

    def _rates(self, site: _Site, at_s: float) -> tuple[float, float]:
        """Arrivals per second and mean charging time of an instant."""
        if self.load is None:
            return 0.0, 3600.0
        if not site.rates_from_s <= at_s < site.rates_from_s + _RATES_H * 3600.0:
            first_h = math.floor((self.world.epoch_s + at_s) / 3600.0)
            arrivals, charging = self.load.hourly(site.row, first_h * 3600.0, _RATES_H)
            site.rates_from_s = first_h * 3600.0 - self.world.epoch_s
            site.rates = (arrivals.tolist(), charging.tolist())
        hour = min(int((at_s - site.rates_from_s) / 3600.0), _RATES_H - 1)
        return site.rates[0][hour], site.rates[1][hour]

    def _arrival_after(self, site: _Site, at_s: float) -> float:
        """Next arrival of a Poisson process whose rate changes by the hour; infinite where nobody comes in a week."""
        wanted = site.generator.expovariate(1.0)
        for _ in range(7 * 24):
            rate = self._rates(site, at_s)[0]
            hour_ends = (math.floor((self.world.epoch_s + at_s) / 3600.0) + 1) * 3600.0 - self.world.epoch_s
            if rate > 0.0 and at_s + wanted / rate < hour_ends:
                return at_s + wanted / rate
            wanted -= rate * (hour_ends - at_s)
            at_s = hour_ends
        return math.inf

    # The service

    def status(self, station: str) -> StationStatus:
        """Return the pads of a station now."""
        site = self._site(station)
        remaining = sorted(g.end_s - self._now for g in site.on_pads if math.isfinite(g.end_s))
        return StationStatus(
            station=station,
            posix_s=self.world.epoch_s + self._now,
            pads=site.station.pads,
            busy=len(site.on_pads),
            remaining_s=tuple(remaining),
            waiting=len(site.line),
            holding_spots=site.station.holding_spots,
            holding_free=max(0, site.station.holding_spots - len(site.line)),
            drones=tuple(self._tell(site, g, g.vehicle) for g in (*site.on_pads, *site.line) if g.vehicle is not None),
        )

    def charge(self, station: str, drone: str, to_soc: float) -> DroneOnPad:
        """Ask for a pad and charging."""
        site = self._site(station)
        vehicle = self._vehicle(drone)
        if vehicle is None:
            raise PadServiceError(f"no drone {drone!r} here; drones are named by their MAVLink system id")
        if not 0.0 < to_soc <= 1.0:
            raise PadServiceError(f"cannot charge to {to_soc:g}: a state of charge is above 0 and at most 1")
        if vehicle.active or vehicle.station() != station:
            raise PadServiceError(
                f"drone {drone} is not disarmed on the ground at {station}: land there and disarm first"
            )
        customer = self._find(site, vehicle)
        if customer is None:
            free = len(site.on_pads) < site.station.pads
            if not free and len(site.line) >= site.station.holding_spots:
                raise PadServiceError(f"no pad and no holding spot is free at {station}: divert")
            if site.station.pads == 0:
                raise PadServiceError(f"{station} has no pads")
            customer = _Customer(vehicle=vehicle, to_soc=to_soc)
            site.line.append(customer)
            if site not in self._hosts:
                self._hosts.append(site)
            self._fill(site)
            if customer in site.line:
                vehicle.event(f"waits for a pad at {station}, place {len(site.line)} in the line")
        elif customer.to_soc != to_soc:
            customer.to_soc = to_soc
            if customer in site.on_pads and not site.shut:
                self._begin(site, customer, vehicle)
        self._reschedule()
        return self._tell(site, customer, vehicle)

    def release(self, station: str, drone: str) -> DroneOnPad:
        """Give the pad, or the place in the line, back."""
        site = self._site(station)
        vehicle = self._vehicle(drone)
        customer = None if vehicle is None else self._find(site, vehicle)
        if vehicle is not None and customer is not None:
            self._remove(site, customer, vehicle)
        return DroneOnPad(drone=drone, state="absent")

    def _tell(self, site: _Site, customer: _Customer, vehicle: Vehicle) -> DroneOnPad:
        vehicle.tend()
        drone, epoch = str(vehicle.config.system), self.world.epoch_s
        if site.shut and customer in site.on_pads and vehicle.battery.soc < customer.to_soc:
            opens_s = epoch + site.closed[0][1]
            return DroneOnPad(drone=drone, state="waiting", to_soc=customer.to_soc, place_in_line=0, pad_free_s=opens_s)
        if customer in site.line:
            place = site.line.index(customer)
            free_s = self._pad_free_s(site, place)
            if site.shut and free_s is not None:
                free_s = max(free_s, site.closed[0][1])
            elif site.shut and len(site.on_pads) + place < site.station.pads:
                free_s = site.closed[0][1]
            return DroneOnPad(
                drone=drone,
                state="waiting",
                to_soc=customer.to_soc,
                place_in_line=place,
                pad_free_s=None if free_s is None else epoch + free_s,
            )
        charging = math.isfinite(customer.end_s)
        return DroneOnPad(
            drone=drone,
            state="charging" if charging else "done",
            soc=vehicle.battery.soc,
            to_soc=customer.to_soc,
            done_s=epoch + customer.end_s if charging else None,
        )

    @staticmethod
    def _pad_free_s(site: _Site, place: int) -> float | None:
        """When the one at a place in the line gets a pad, where every stay before it is known."""
        ends = sorted(customer.end_s for customer in site.on_pads)
        for customer in list(site.line)[:place]:
            if customer.vehicle is not None or not ends or not math.isfinite(ends[0]):
                return None
            ends = sorted([*ends[1:], ends[0] + customer.stay_s])
        return ends[0] if ends and math.isfinite(ends[0]) else None

    def _site(self, station: str) -> _Site:
        site = self._sites.get(station)
        if site is None:
            raise PadServiceError(f"no station {station[:40]!r} here")
        return site

    def _vehicle(self, drone: str) -> Vehicle | None:
        return self.world.vehicles.get(int(drone)) if drone.isascii() and drone.isdigit() and len(drone) < 4 else None

    @staticmethod
    def _find(site: _Site, vehicle: Vehicle) -> _Customer | None:
        return next((g for g in (*site.on_pads, *site.line) if g.vehicle is vehicle), None)
