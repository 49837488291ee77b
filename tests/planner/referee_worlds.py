"""Random deliveries whose segments take from a tenth of a slot of the wind to many slots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from worlds import DEPART, make_request, make_wind, make_world

from skyway.models.composition.composition import State
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule
from skyway.planner.problem.problem import Problem

LONG_RANGE = replace(
    M200_V2,
    id="long-range",
    battery_j=8.0 * M200_V2.battery_j,
    endurance_empty_s=4.0 * 3600.0,
    endurance_full_s=3.0 * 3600.0,
)
SLOTS_MIN = (5, 10, 20, 60, 180)
KINDS = ("short", "long", "wild", "long wild")
"""``long``: a drone that flies for hours, over long segments. ``wild``: a slow drone that may fly in any wind, so that single
segments are closed in some slots; slow climbs, pads of several powers, some deliveries that begin in flight."""


def instance(seed, slot_min, kind, *, stations=None):
    """A problem with 3 to 6 nodes and its queues."""
    rng = np.random.default_rng((seed, slot_min, KINDS.index(kind)))
    count = stations or int(rng.integers(3, 6))
    scale = 5.0 if "long" in kind else 1.0
    scenario = make_world(
        rng,
        count,
        length_m=scale * 9_000.0 * count,
        width_m=scale * 8_000.0,
        max_length_m=scale * 16_000.0,
        utilisation=float(rng.choice([0.0, 0.0, 0.5, 0.9])),
        target=bool(rng.random() < 0.35),
    )
    drone, changes = LONG_RANGE if "long" in kind else M200_V2, {}
    if "wild" in kind:
        drone = replace(drone, wind_limit_mps=40.0)
        changes["airspeed_mps"] = float(rng.uniform(7.0, 16.0))
        powers = [float(rng.choice([140.0, 220.0, 600.0])) for _ in range(count)]
        placed = [
            replace(one, recharge_power_w=power if one.pads else None)
            for one, power in zip(scenario.network.stations, powers, strict=True)
        ]
        climb, descent = float(rng.choice([1.0, 5.0])), float(rng.choice([1.0, 3.0]))
        rules = FlightRules(float(rng.choice([60.0, 120.0])), climb, descent)
        network = build_network(placed, ConnectionRule("max-length", scale * 16_000.0))
        scenario = replace(scenario, network=network, rules=rules)
        if rng.random() < 0.3:
            a, b = network.stations[:2]
            part = rng.uniform(0.2, 0.8)
            here = part * a.lat + (1.0 - part) * b.lat + 0.01, part * a.lon + (1.0 - part) * b.lon
            changes["state"] = State(DEPART, None, here, float(rng.uniform(0.3, 0.9)))
    scenario = replace(scenario, drones=(drone,))
    wind = make_wind(
        rng,
        mean_mps=float(rng.choice([2.0, 5.0, 8.0])),
        turn_back=float(rng.choice([10.0, 60.0])),
        slots=24 * 60 // slot_min,
        slot_s=60.0 * slot_min,
    )
    reserve, payload = float(rng.choice([0.1, 0.2, 0.3])), float(rng.uniform(0.0, 1.0))
    request = make_request(scenario, rng, reserve_soc=reserve, payload_kg=payload, **changes)
    if not scenario.network.stations[-1].pads:
        there = np.random.default_rng((seed, slot_min, 93))
        dwell_s = float(there.choice([0.0, 240.0, 2_000.0]))
        in_air = request.state.station is None  # where it began, it does not tell
        request = replace(
            request, dwell_s=dwell_s, undelivered_to="back" if there.random() < 0.4 and not in_air else None
        )
    problem = Problem(scenario, request, drone, wind)
    return problem, problem.queue_paths(range(len(problem.network)), 0)
