"""`exact` equals frvcpy, the published solver of the fixed-route vehicle charging problem (Kullman, Froger et al.).

frvcpy is given a fixed sequence of customers and inserts visits to charging stations, each with as much charging as
serves, so that the whole takes the least time; the charging function is piecewise linear and concave, times and energies
between nodes are constant. To put the same problem to both:

- The wind is constant and pads are always free, so flights take the same time and energy whenever they leave.
- The customers are the origin and the destination; every station on the way is a charging station. On a route, a chain of
  stations with segments between neighbours only, that is fixed-route charging: where to land, and how much to charge
  there. On a network the choice of the route is added.
- Times are take-off to touch-down, over the segments of the quickest walk (stations may be overflown); energies are SoC.
- frvcpy knows no reserve: its charge is ours above the reserve, its charging function ours from the reserve on. It cannot
  begin below it, so no drone here does.
- Our drone can charge at the origin: a charging station stands there too, at no distance.
- frvcpy wants to be able to reach a charging station from the last customer; that costs no energy here.

Both are exact, so they are equal but for rounding: 1e-8 of the time is allowed.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from skyway.models.base.errors import NoRouteError
from skyway.models.network.builders import build_network
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.problem.problem import Problem

frvcpy_solver = pytest.importorskip("frvcpy.solver", reason="frvcpy, of the extra dev, is not installed")
RELATIVE = 1e-8


def instance(seed, *, chain):
    """Constant wind, free pads of two powers; a chain of stations or a network."""
    rng = np.random.default_rng((seed, chain))
    stations = int(rng.integers(4, 9))
    scenario = make_world(rng, stations, length_m=float(rng.uniform(8_000.0, 12_000.0)) * stations, utilisation=0.0)
    placed = [
        replace(station, recharge_power_w=float(rng.choice([140.0, 220.0]))) for station in scenario.network.stations
    ]
    network = build_network(placed, ConnectionRule("max-length", 16_000.0))
    if chain:
        along = np.arange(stations - 1)
        network = Network.from_pairs(placed, np.column_stack((along, along + 1)))
    scenario = replace(scenario, network=network)
    wind = make_wind(rng, mean_mps=3.0)
    wind = replace(
        wind, north=np.zeros_like(wind.north) + wind.north[:, :1], east=np.zeros_like(wind.east) + wind.east[:, :1]
    )
    reserve = float(rng.choice([0.1, 0.2, 0.3, 0.5]))
    request = make_request(scenario, rng, reserve_soc=reserve, payload_kg=float(rng.uniform(0.0, 0.8)))
    charged = replace(request.state, soc=float(rng.uniform(reserve, 1.0)))
    return Problem(scenario, replace(request, state=charged), scenario.drones[0], wind)


def quickest(problem):
    """Take-off to touch-down between all nodes, seconds, infinite where segments do not join them (Floyd-Warshall)."""
    network, air = problem.network, problem.air
    time = np.full((len(network), len(network)), math.inf)
    for segment, (a, b) in enumerate(zip(network.tail, network.head, strict=True)):
        off = math.atan2(air.east[0, 0, 0], air.north[0, 0, 0]) - math.radians(network.bearing_deg[segment])
        wind = math.hypot(air.north[0, 0, 0], air.east[0, 0, 0])
        ground = wind * math.cos(off) + math.sqrt(air.airspeed_mps**2 - (wind * math.sin(off)) ** 2)
        time[a, b] = network.distance_m[segment] / min(ground, air.max_ground_speed_mps)
    for k in range(len(network)):
        time = np.minimum(time, time[:, k, None] + time[None, k, :])
    time += air.climb_s + air.descent_s
    np.fill_diagonal(time, 0.0)
    return time


def with_frvcpy(problem):
    """Least delivery time that frvcpy finds, infinite where it finds none; its nodes: ours, and the origin's station."""
    time = quickest(problem)
    energy = np.where(time > 0.0, problem.soc_fixed + problem.soc_per_s * time, 0.0)
    origin, destination, size = problem.origin, problem.destination, len(time)
    time, energy = (np.pad(values, ((0, 1), (0, 1))) for values in (time, energy))
    for values in (time, energy):
        values[size, :size], values[:size, size] = values[origin, :size], values[:size, origin]
    energy[destination] = 0.0
    time[~np.isfinite(time)] = energy[~np.isfinite(energy)] = 1e9
    kinds = []
    for number, (seconds, soc) in enumerate(problem.curves):
        full = np.interp(problem.reserve, soc, seconds)
        above = soc > problem.reserve
        kinds.append(
            {
                "cs_type": number,
                "time": [0.0, *(seconds[above] - full).tolist()],
                "charge": [0.0, *(soc[above] - problem.reserve).tolist()],
            }
        )
    middle = [node for node in range(size) if node not in (origin, destination)]
    places = [*((node, node) for node in middle), (size, origin)]
    solver = frvcpy_solver.Solver(
        {
            "energy_matrix": energy.tolist(),
            "time_matrix": time.tolist(),
            "process_times": [0.0] * (size + 1),
            "max_q": kinds[0]["charge"][-1],
            "css": [{"node_id": node, "cs_type": int(problem.curve_of[of])} for node, of in places],
            "breakpoints_by_type": kinds,
        },
        [origin, destination],
        problem.soc - problem.reserve,
        multi_insert=True,
    )
    found, _ = solver.solve()
    return math.inf if found is None else float(found)


def with_exact(problem):
    search = ExactSearch(problem, problem.queue_paths(range(len(problem.network)), 0))
    try:
        itinerary = search.solve()
    except NoRouteError:
        return math.inf, 0
    return search.best_s - problem.depart_s, len(itinerary)


def compare(seeds, *, chain):
    """Number solved by both, with stops on the way, and by neither."""
    solved = with_stops = infeasible = 0
    worst = 0.0
    for seed in seeds:
        problem = instance(seed, chain=chain)
        ours, flights = with_exact(problem)
        theirs = with_frvcpy(problem)
        assert math.isinf(ours) == math.isinf(theirs), seed
        if math.isinf(ours):
            infeasible += 1
            continue
        assert ours == pytest.approx(theirs, rel=RELATIVE), seed
        solved += 1
        worst = max(worst, abs(ours - theirs) / theirs)
        with_stops += flights > 1
    print(
        f"{solved} solved, {with_stops} with stops, {infeasible} infeasible; largest difference {worst:.1e} of the time"
    )
    return solved, with_stops, infeasible


def test_charging_on_fixed_routes_takes_as_long_as_frvcpy_says():
    solved, with_stops, infeasible = compare(range(160), chain=True)
    assert solved >= 100
    assert with_stops >= 60
    assert infeasible >= 5


def test_routes_through_networks_take_as_long_as_frvcpy_says():
    solved, with_stops, _ = compare(range(70), chain=False)
    assert solved >= 25
    assert with_stops >= 15
