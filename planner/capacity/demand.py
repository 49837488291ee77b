"""Orders and drones of a simulated day: drawn so that more orders, or one more drone, leave the others unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import refuse
from skyway.models.base.geodesy import coarse_distance_m
from skyway.models.base.units import S_PER_H
from skyway.models.orders.fitting import fit
from skyway.models.orders.order import Order, Vehicle
from skyway.models.orders.rows import fault_at

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario

MASSES_KG = (0.2, 0.5, 0.8)
LEAST_SOC = 0.5
"""Drones begin a day with at least this charge."""
ORDERS, DRONES, ENERGY, STRANGERS = range(4)
"""Streams of random numbers of a day."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """Demand of a study.

    Attributes
    ----------
    most_per_h : float
        Orders an hour of the busiest day that is studied: other days have a part of its orders.
    hours : float
        Time in which orders arrive.
    within_m : float
        From one station with pads to another one within this distance, in a straight line.
    pattern : tuple of (str, str, float)
        Origin, destination and mass of each order of a file, in place of stations at random: each order is one of them.
    """

    most_per_h: float
    hours: float = 4.0
    within_m: float = 20_000.0
    pattern: tuple[tuple[str, str, float], ...] = ()


def draws(seed: int, day: int, stream: int) -> np.random.Generator:
    """Return the random numbers of one stream of a day."""
    return np.random.default_rng((seed, day, stream))


def orders_of(
    scenario: Scenario, demand: Demand, rate_per_h: float, promise_s: float, begin: datetime, seed: int, day: int, mass_kg: float
) -> tuple[Order, ...]:  # fmt: skip
    """Return the orders of a day, in order of time: each due a given time after it is ready; packages are no heavier than `mass_kg`."""
    random = draws(seed, day, ORDERS)
    count = int(random.poisson(demand.most_per_h * demand.hours))
    at_s = np.sort(random.uniform(0.0, demand.hours * S_PER_H, count))
    mark = random.uniform(size=count)
    ways = _ways(scenario, demand, random, count, mass_kg)
    found = []
    for number in np.flatnonzero(mark < rate_per_h / demand.most_per_h).tolist():
        origin, destination, mass = ways[number]
        ready = begin + timedelta(seconds=round(float(at_s[number]), 3))
        found.append(
            Order(
                id=f"o{number}", origin=origin, destination=destination, mass_kg=mass, ready=ready, due=ready + timedelta(seconds=promise_s)
            )
        )  # fmt: skip
    return tuple(found)


def _ways(
    scenario: Scenario, demand: Demand, random: np.random.Generator, count: int, mass_kg: float
) -> list[tuple[str, str, float]]:
    if demand.pattern:
        return [demand.pattern[int(one)] for one in random.integers(len(demand.pattern), size=count)]
    stations = [one for one in scenario.network.stations if one.pads and not one.flyover]
    lat, lon = np.array([one.lat for one in stations]), np.array([one.lon for one in stations])
    near = [_near(float(lat[one]), float(lon[one]), lat, lon, one, demand.within_m) for one in range(len(stations))]
    masses = [one for one in MASSES_KG if one <= mass_kg] or [mass_kg]
    found = []
    for origin in random.integers(len(stations), size=count).tolist():
        destination = int(random.choice(near[origin]))
        found.append((stations[origin].id, stations[destination].id, float(random.choice(masses))))
    return found


def _near(lat: float, lon: float, lats: NDArray[np.float64], lons: NDArray[np.float64], own: int, within_m: float) -> NDArray[np.int64]:  # fmt: skip
    """Numbers of the other stations within a distance; the nearest one if there are none."""
    far_m = coarse_distance_m(lat, lon, lats, lons)
    far_m[own] = np.inf
    found = np.flatnonzero(far_m <= within_m)
    return found if len(found) else np.array([int(far_m.argmin())])


def drones_of(
    scenario: Scenario, drone: str, count: int, seed: int, day: int, more_at: Sequence[str] = ()
) -> tuple[Vehicle, ...]:
    """Return drones at stations with pads, in the order in which pads are distributed, and additional ones at some stations."""
    random = draws(seed, day, DRONES)
    stations = [one.id for one in scenario.network.stations for _ in range(one.pads) if not one.flyover]
    dealt: list[str] = []
    while len(dealt) < count:
        dealt += [stations[int(one)] for one in random.permutation(len(stations))]
    soc = random.uniform(LEAST_SOC, 1.0, count)
    homes = [*zip(dealt[:count], soc.tolist(), strict=True), *((one, 1.0) for one in more_at)]
    return tuple(
        Vehicle(id=f"d{number}", type=drone, home=home, place=home, soc=charge)
        for number, (home, charge) in enumerate(homes)
    )


def pattern_of(scenario: Scenario, orders: Sequence[Order], drone: Drone) -> tuple[tuple[str, str, float], ...]:
    """Return origin, destination and mass of each of some orders; an `InputError` lists those that do not fit, and those too heavy for the drone."""
    anywhere = next(one.id for one in scenario.network.stations if one.pads and not one.flyover)
    fleet = [Vehicle(id="any", type=drone.id, home=anywhere, place=anywhere)]
    work = fit(scenario, orders, fleet)
    refuse(
        [
            fault_at(
                one.source,
                "mass_kg",
                f"is heavier than {drone.id} carries",
                one.mass_kg,
                f"up to {drone.max_payload_kg:g} kg",
            )
            for one in work.orders
            if not work.carriers(one)
        ]
    )

    def named(found: str, typed: str) -> str:
        return found if found in scenario.network.index else typed  # a target is added to the network of each day again

    return tuple(
        (named(one.origin, as_typed.origin), named(one.destination, as_typed.destination), one.mass_kg)
        for one, as_typed in zip(work.orders, orders, strict=True)
    )
