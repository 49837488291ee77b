"""Networks that benchmarks are run on, made from a seed: the same everywhere."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.loads import scaled_to
from skyway.missions.examples import NEW_YORK
from skyway.models.base import geodesy
from skyway.models.drones.drone import M200_V2
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.file import read_scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.models.scenario.scenario import Scenario

CENTRE = 40.73, -73.97
"""Middle of the random networks: where the wind record of New York holds."""
SEGMENT_M = 10_000.0
"""Longest segment of the random networks."""
CITY_M = 60_000.0
"""Side of the square of the dense networks."""
NEIGHBOURS = 14.0
"""Mean number of stations within reach of one, which sets the density of the random networks."""


@lru_cache(maxsize=1)
def new_york() -> Scenario:
    """The built-in scenario."""
    return read_scenario(NEW_YORK)


def geometric(stations: int, seed: int, *, pads: int = 5, utilisation: float = 0.5) -> Scenario:
    """Stations strewn evenly over a square about New York, joined within 10 km; wind, rules and load profile of there.

    The square grows with the number of stations, so that each has about `NEIGHBOURS` neighbours. The load of each
    station is that of a station of New York drawn at random, scaled to the mean utilisation asked for.
    """
    side_m = math.sqrt(stations * math.pi * SEGMENT_M**2 / NEIGHBOURS)
    return _strewn(f"geometric-{stations}-{seed}", stations, seed, side_m, pads, utilisation)


def dense(stations: int, seed: int, *, pads: int = 5, utilisation: float = 0.5) -> Scenario:
    """As `geometric`, on a square of `CITY_M` whatever their number; the loads of stations differ by up to a tenth."""
    base = _strewn(f"dense-{stations}-{seed}", stations, seed, CITY_M, pads, utilisation)
    share = 1.0 + 0.1 * np.random.default_rng((seed, stations, 1)).uniform(-1.0, 1.0, (stations, 1))
    return replace(base, load=replace(base.load, arrivals_per_s=base.load.arrivals_per_s * share))


def _strewn(name: str, stations: int, seed: int, side_m: float, pads: int, utilisation: float) -> Scenario:
    rng = np.random.default_rng((seed, stations))
    north, east = rng.uniform(-0.5, 0.5, (2, stations)) * side_m
    lat = CENTRE[0] + north / 111_045.0
    lon = CENTRE[1] + east / (111_320.0 * np.cos(np.radians(lat)))
    # Written with six decimals in the published instances: the coordinates are these very numbers.
    placed = [
        Station(f"s{k}", f"Station {k}", round(float(lat[k]), 6), round(float(lon[k]), 6), 0.0, pads)
        for k in range(stations)
    ]
    network = build_network(placed, ConnectionRule("max-length", SEGMENT_M))
    base = new_york()
    row = rng.integers(0, len(base.load), stations)
    load = PadLoad(base.load.arrivals_per_s[row], base.load.mean_charging_s[row], base.load.timezone)
    return replace(
        base,
        name=name,
        network=network,
        drones=(M200_V2,),
        load=scaled_to(load, utilisation, network.pads),
        path=None,
        sha256=None,
        warnings=(),
    )


def random_pairs(
    network: Network, count: int, seed: int, *, least_m: float = 0.0, most_m: float = math.inf
) -> list[tuple[str, str]]:
    """Draw pairs of different stations that are joined by segments, that far apart (geodesic)."""
    rng = np.random.default_rng((seed, len(network), count))
    part = _parts(network)
    pairs: list[tuple[str, str]] = []
    for _ in range(1000 * count):
        a, b = (int(node) for node in rng.integers(0, len(network), 2))
        if a == b or part[a] != part[b]:
            continue
        one, other = network.stations[a], network.stations[b]
        if least_m <= geodesy.distance_m(one.lat, one.lon, other.lat, other.lon) <= most_m:
            pairs.append((one.id, other.id))
            if len(pairs) == count:
                break
    return pairs


def _parts(network: Network) -> NDArray[np.int64]:
    """Number of the connected part of each station, shape (nodes,)."""
    part = np.full(len(network), -1, dtype=np.int64)
    for start in range(len(network)):
        if part[start] >= 0:
            continue
        part[start] = start
        open_nodes = [start]
        while open_nodes:
            node = open_nodes.pop()
            for other in network.head[network.first[node] : network.first[node + 1]].tolist():
                if part[other] < 0:
                    part[other] = start
                    open_nodes.append(other)
    return part
