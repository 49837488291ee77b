"""A cut mission as a composition, for journals, reports and the page."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from skyway.models.base import geodesy
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.service import DroneService, Place, Stop
from skyway.models.wind.summary import Wind, summary_of
from skyway.recharge.summary import phases_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from skyway.missions.recharge.spans import Span
    from skyway.recharge.cutting import Flight, Recharged
    from skyway.recharge.flying.places import WorkPlaces
    from skyway.recharge.simulated import SimulatedFlights

PLANNER = "recharge"


def composition_of(
    found: Recharged, flown: SimulatedFlights, spans: Sequence[Span], places: WorkPlaces, time_s: float, identity: str
) -> Composition:
    """Return the flights as the services of a composition, and the stays on pads as its stops; `time_s` is now, POSIX seconds."""
    conditions, transit = found.problem.options.conditions, found.problem.options.transit
    begin = from_posix(time_s)
    wind = _wind(found)
    services = tuple(
        _service(number, flight, span, found, places, begin, wind)
        for number, (flight, span) in enumerate(zip(found.told, spans, strict=True), start=1)
    )
    stops = tuple(
        Stop(
            places.of(stop.pad, end=True),
            begin + timedelta(seconds=stop.arrive_s),
            *phases_of(stop, found.problem.options),
            stop.soc_arrive,
            stop.soc_leave,
        )
        for stop in found.plan.stops
    )
    known = {one.id: Place.of(one) for one in (*places.pads, *places.more)}
    mean, p50, p95 = (begin + timedelta(seconds=one) for one in (flown.end_s, flown.end_p50_s, flown.end_late_s))
    drone = conditions.drone
    heights = [step.height_m for step in found.problem.work.steps]
    return Composition(
        id=identity,
        planner=PLANNER,
        drone=drone.id,
        payload_kg=conditions.payload_kg,
        airspeed_mps=min(transit.speed_mps, drone.max_airspeed_mps),
        max_ground_speed_mps=max(transit.speed_mps, *(point.speed_mps for point in found.problem.work.points)),
        cruise_height_m=max(heights),
        climb_rate_mps=conditions.climb_rate_mps,
        descent_rate_mps=conditions.descent_rate_mps,
        reserve_soc=conditions.reserve_soc,
        depart=begin + timedelta(seconds=found.plan.depart_s),
        origin=services[0].origin,
        destination=services[-1].destination,
        stations=known,
        services=services,
        stops=stops,
        arrival=ArrivalDistribution(mean, p50, p95, runs=flown.runs),
        planning_time_s=0.0,
        seed=found.problem.options.seed,
        success_probability=flown.p_reserve,
    )


def _wind(found: Recharged) -> Wind:
    """Summarise the winds in the middle of the work, at its beginning."""
    import numpy as np

    weather = found.problem.options.conditions.weather
    lat, lon = np.mean(found.problem.work.places, axis=0)
    height = np.array([max(step.height_m for step in found.problem.work.steps)])
    north, east = weather.at(np.array([lat]), np.array([lon]), np.zeros((len(weather.probability), 1)), height)
    return summary_of(north[:, 0], east[:, 0], np.asarray(weather.probability)).wind


def _service(
    number: int,
    flight: Flight,
    span: Span,
    found: Recharged,
    places: WorkPlaces,
    begin: datetime,
    wind: Wind,
) -> DroneService:
    """Return one flight as a service."""
    legs = flight.report.legs
    origin = places.of(None if span.begin is None else span.begin[1], end=False)
    destination = places.of(None if span.end is None else span.end[1], end=True)
    known = {one.id: one for one in (*places.pads, *places.more)}
    here, there = known[origin], known[destination]
    length, bearing = geodesy.inverse(here.lat, here.lon, there.lat, there.lon)
    depart = begin + timedelta(seconds=flight.depart_s)
    last = legs[-1]
    return DroneService(
        id=f"flight-{number}",
        origin=origin,
        destination=destination,
        depart=depart,
        arrive=depart + timedelta(seconds=sum(leg.time_s or 0.0 for leg in legs)),
        distance_m=sum(leg.distance_m for leg in legs),
        bearing_deg=float(bearing) % 360.0 if float(length) > 1.0 else 0.0,
        ground_speed_mps=found.problem.options.transit.speed_mps,
        energy_j=sum(leg.energy_j or 0.0 for leg in legs),
        soc_depart=flight.soc_start,
        soc_arrive=0.0 if last.soc_end is None else last.soc_end,
        wind=wind,
        tailwind_mps=0.0,
        crosswind_mps=0.0,
        p_reserve=last.p_reserve,
    )
