"""Small random worlds that planners are tested on."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.forecast import WindEnsemble
from skyway.planner.problem.request import Request

DEPART = datetime(2026, 6, 1, 9, 20, tzinfo=UTC)


def make_wind(rng, *, members=1, mean_mps=6.0, slots=48, slot_s=3600.0, turn_back=40.0) -> WindEnsemble:
    """Winds that change speed and turn from slot to slot, the same over the whole region."""
    speed = np.maximum(rng.normal(mean_mps, 0.5 * mean_mps + 0.1, (members, slots)), 0.0)
    direction = np.cumsum(rng.normal(0.0, turn_back, (members, slots)), axis=1) + rng.uniform(0, 360, (members, 1))
    angle = np.radians(direction)
    return WindEnsemble(
        site_lat=np.array([52.5]),
        site_lon=np.array([13.4]),
        start_s=float(np.floor(DEPART.timestamp() / slot_s) * slot_s),
        slot_s=slot_s,
        north=(-speed * np.cos(angle))[:, :, None],
        east=(-speed * np.sin(angle))[:, :, None],
        probability=np.full(members, 1.0 / members),
        labels=tuple(f"member-{k}" for k in range(members)),
        height_m=60.0,
    )


def on_level_ground(scenario: Scenario) -> Scenario:
    """The same with all stations at sea level, so that every leg is flown in the wind of the cruise height."""
    level = tuple(replace(one, elevation_m=0.0) for one in scenario.network.stations)
    return replace(scenario, network=replace(scenario.network, stations=level))


def make_world(
    rng, stations=6, *, length_m=40_000.0, width_m=8_000.0, max_length_m=16_000.0, utilisation=0.5, target=False
):
    """A scenario of stations strewn along a strip west to east near Berlin, first to last, with random pads."""
    along = np.linspace(0.0, length_m, stations) + rng.uniform(-0.35, 0.35, stations) * length_m / stations
    across = rng.uniform(-0.5, 0.5, stations) * width_m
    placed = [
        Station(
            f"s{k}",
            f"Station {k}",
            52.5 + across[k] / 111_000.0,
            13.0 + along[k] / 67_800.0,
            40.0,
            int(rng.integers(1, 4)),
            int(rng.integers(0, 4)),
        )
        for k in range(stations)
    ]
    if target:
        placed[-1] = replace(placed[-1], pads=0, holding_spots=0)
    network = build_network(placed, ConnectionRule("max-length", max_length_m))
    arrivals = utilisation * network.pads[:, None] / 3600.0 * np.ones(168)
    load = PadLoad(arrivals, np.full((stations, 168), 3600.0), "UTC")
    return Scenario("random", network, (M200_V2,), FlightRules(), load)


def make_request(scenario, rng, **changes) -> Request:
    """From the first station to the last, with a random payload and charge."""
    values = {
        "state": State(DEPART, scenario.network.stations[0].id, None, float(rng.uniform(0.35, 1.0))),
        "destination": scenario.network.stations[-1].id,
        "payload_kg": float(rng.uniform(0.0, 1.45)),
        "seed": int(rng.integers(1_000_000)),
    }
    return Request(**(values | changes))


def best_time(search):
    """Run a search: the best itinerary and its time in seconds; None and infinity where there is no route."""
    try:
        itinerary = search.solve()
    except NoRouteError:
        return None, math.inf
    return itinerary, search.best_s - search.problem.depart_s
