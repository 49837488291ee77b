"""Compositions small enough to check by hand."""

from datetime import UTC, datetime, timedelta
from itertools import pairwise
from types import SimpleNamespace

import pytest

from skyway.models.base import geodesy
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.service import DroneService, Place, Stop
from skyway.models.wind.summary import Wind

NOON = datetime(2026, 5, 4, 12, 0, tzinfo=UTC)
STATIONS = {
    "hill": Place(40.70, -74.00, 120.0, "Hill hospital", 5),
    "harbour": Place(40.72, -73.95, 2.0, "Harbour", 5),
    "mast": Place(40.74, -73.92, 30.0, "Mast", 5),
    "park": Place(40.76, -73.88, 45.0, "Park", 0),
    "school": Place(40.71, -73.90, 10.0, "School", 5),
}


def service(number, origin, destination, *, depart, via=(), diverts=(), speed=15.0, stations=None):
    places = [(stations or STATIONS)[key] for key in (origin, *via, destination)]
    legs = [geodesy.distance_m(a.lat, a.lon, b.lat, b.lon) for a, b in pairwise(places)]
    seconds = sum(legs) / speed + 60 / 5 + 60 / 3
    return DroneService(
        id=f"leg-{number}",
        origin=origin,
        destination=destination,
        via=tuple(via),
        depart=depart,
        arrive=depart + timedelta(seconds=seconds),
        distance_m=sum(legs),
        bearing_deg=45.0,
        ground_speed_mps=speed,
        energy_j=seconds * 800.0,
        soc_depart=0.9,
        soc_arrive=0.6,
        wind=Wind(4.0, 270.0),
        tailwind_mps=3.0,
        crosswind_mps=1.0,
        diverts=tuple(diverts),
    )


def compose(services, stops, stations=None):
    return Composition(
        id="c1",
        planner="exact",
        drone="m200-v2",
        payload_kg=1.0,
        airspeed_mps=15.0,
        max_ground_speed_mps=20.0,
        cruise_height_m=60.0,
        climb_rate_mps=5.0,
        descent_rate_mps=3.0,
        reserve_soc=0.2,
        depart=services[0].depart,
        origin=services[0].origin,
        destination=services[-1].destination,
        stations=stations or STATIONS,
        services=tuple(services),
        stops=tuple(stops),
        arrival=ArrivalDistribution(None, None, None),
        planning_time_s=0.1,
    )


@pytest.fixture
def small():
    """What it takes to make a composition of one's own."""
    return SimpleNamespace(compose=compose, service=service, NOON=NOON)


@pytest.fixture
def two_legs():
    """From the hill down to the mast over the harbour, a recharge of 20 minutes after 5 of waiting, on to the park."""
    first = service(0, "hill", "mast", via=("harbour",), diverts=("harbour", "school"), depart=NOON)
    stop = Stop("mast", first.arrive, 300.0, 1200.0, 0.0, 0.6, 0.9)
    second = service(1, "mast", "park", diverts=("school",), depart=stop.leave)
    return compose((first, second), (stop,))
