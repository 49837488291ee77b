"""Drone services, the stops between them and their places (Definition 1 of the paper)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from skyway.models.base.units import J_PER_WH

if TYPE_CHECKING:
    from skyway.models.composition.heights import LegHeights
    from skyway.models.network.station import Station
    from skyway.models.wind.summary import Wind


@dataclass(frozen=True, slots=True)
class Place:
    """Where a station or delivery target is."""

    lat: float
    lon: float
    """Degrees, WGS-84."""
    elevation_m: float | None = None
    """Height of the ground above mean sea level; None is unknown."""
    name: str | None = None
    pads: int = 0
    """Recharging pads; 0 is a delivery target."""
    least_m: float | None = None
    least_agl_m: float | None = None
    """Of a place that is only flown over: between two of them the way is at least so high, above mean sea level and above the ground."""

    @classmethod
    def of(cls, station: Station) -> Place:
        """Return the place of a station of a network."""
        least = (one if math.isfinite(one) else None for one in (station.least_m, station.least_agl_m))
        return cls(station.lat, station.lon, station.elevation_m, station.name, station.pads, *least)

    @property
    def least(self) -> tuple[float, float]:
        """As `models.flight.way_heights` takes them."""
        sea, ground = (-math.inf if one is None else one for one in (self.least_m, self.least_agl_m))
        return sea, ground


@dataclass(frozen=True, slots=True)
class LegSegment:
    """One segment of a leg."""

    head: str
    """Station that it leads to."""
    distance_m: float
    bearing_deg: float
    """Its length and initial bearing."""
    wind: Wind
    """Forecast for the time and height at which it is flown."""
    tailwind_mps: float
    crosswind_mps: float
    """Mean components of the forecast along it (tailwind positive) and across it (from the left positive)."""


@dataclass(frozen=True, slots=True)
class DroneService:
    """One flight of the drone (Definition 1): function and qualities, on the typical schedule.

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
    p_hold, p_hold_room : float or None
        Probabilities that the drone, ready to leave, holds on the ground before the flight: for the wind, and for room at
        the station where it lands; None is unknown.
    wind : Wind
        Forecast for the time and height at which the leg is flown.
    tailwind_mps, crosswind_mps : float
        Mean components of the forecast along (tailwind positive) and across (from the left positive) the course; of a leg
        that bends the mean over its segments, by time.
    segments : tuple of LegSegment
        In order; empty is unknown.
    course_wind : Wind or None
        The wind of the typical schedule itself, averaged as a vector over the flight: times, ground speed and charge are
        those in it. None is unknown.
    diverts : tuple of str
        Stations that stay in reach along the flight, nearest first.
    heights : LegHeights or None
        Heights flown over a terrain model; None without one.
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
    p_hold_room: float | None = None
    segments: tuple[LegSegment, ...] = ()
    course_wind: Wind | None = None
    heights: LegHeights | None = None

    @property
    def flight_time_s(self) -> float:
        """From take-off to touch-down, climb and descent included."""
        return (self.arrive - self.depart).total_seconds()

    @property
    def energy_wh(self) -> float:
        """The energy in watt-hours."""
        return self.energy_j / J_PER_WH


@dataclass(frozen=True, slots=True)
class Stop:
    """A stay at a station between two services, on the typical schedule.

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
    hold_s, hold_room_s : float
        Further stay, charged; the part of it that is for room at the next station. The rest is for the wind.
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
    hold_room_s: float = 0.0

    @property
    def leave(self) -> datetime:
        """Time of the next take-off."""
        return self.arrive + timedelta(seconds=self.wait_s + self.recharge_s + self.hold_s)
