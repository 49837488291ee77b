"""A world made true for the runs of one order: winds, gusts, vehicles, batteries and strangers, each from its own seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.delivery import LONGEST_S, Setting
from benchmarks.independent.pads import Stations
from benchmarks.independent.vehicle import battery
from benchmarks.independent.vehicle.craft import Air
from benchmarks.independent.vehicle.energy import Flat, Momentum
from benchmarks.independent.weather.profile import PowerLaw, Stability
from benchmarks.independent.weather.series import SiteWinds
from benchmarks.independent.weather.turbulence import Harmonics, Relaxing
from benchmarks.independent.weather.wind import LENGTH_M, InverseDistance, LeftOut, RandomField, leave_one_out

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.ground import Ground, Plane
    from benchmarks.independent.information import Order
    from benchmarks.independent.vehicle.craft import Flying
    from benchmarks.independent.vehicle.energy import DataSheet, Power
    from benchmarks.independent.weather.reports import Site
    from benchmarks.independent.weather.turbulence import Gusts
    from benchmarks.independent.weather.wind import TrueWind
    from benchmarks.independent.worlds import World

HOURS = LONGEST_S / 3600.0 + 4.0
VEHICLE_ERROR = 0.05
USUAL_TEMP_C = 12.0
LENGTHS = 16
"""The field's length is one of so many in its range: what the record says of each is worked out once."""
_SERIES, _FIELD, _GUSTS, _PROFILE, _VEHICLE, _BATTERY, _PADS, _POWER = range(8)


@dataclass(frozen=True, eq=False)
class City:
    """A region: its record, its network, and a drone.

    Attributes
    ----------
    plant : callable
        Another law of power, by payload; see `benchmarks.independent.product.planning`.
    exponent : float
        Of the profile that the product assumes.
    hour : (int, int)
        UTC hours between which orders leave.
    """

    name: str
    sites: tuple[Site, ...]
    ground: Ground
    sheet: DataSheet
    how: Flying
    exponent: float
    plant: Callable[[float], Power]
    hour: tuple[int, int]


def setting_for(
    world: World, city: City, order: Order, shift_s: NDArray[np.float64], seeds: Sequence[tuple[int, ...]]
) -> Setting:
    """Make the truth of an order's runs.

    Parameters
    ----------
    shift_s : ndarray, shape (runs,)
        Days of the record are laid onto the order: its time plus this is the record's.
    seeds : sequence of tuple of int
        Of each run; the same in all worlds, so that they differ in their deviations alone.
    """
    sites = tuple(site.as_metars() for site in city.sites) if world.clock == "observed" else city.sites

    def rngs(purpose: int) -> list[np.random.Generator]:
        return [np.random.default_rng((*seed, purpose)) for seed in seeds]

    begin = order.depart_s + shift_s
    profile = (
        PowerLaw(city.exponent)
        if world.profile == "fixed"
        else Stability(rngs(_PROFILE), begin, HOURS, city.ground.plane.lon)
    )
    air = Air(_wind(world, city, sites, begin, rngs), profile, city.how.height_m)
    power = _power(world, city, order, rngs(_POWER))
    vehicle = np.array([1.0 + VEHICLE_ERROR * rng.uniform(-1.0, 1.0) for rng in rngs(_VEHICLE)])
    if world.battery == "old":
        batteries = battery.old(rngs(_BATTERY), city.sheet.battery_j)
    elif world.battery == "cold":
        batteries = battery.cold(rngs(_BATTERY), city.sheet.battery_j, _temperature(sites[0], begin))
    else:
        batteries = battery.new(len(seeds), city.sheet.battery_j)
    stations = [
        Stations(
            city.ground, (*seed, _PADS), order.depart_s, int(HOURS), world.strangers, world.charging, broken=world.broken_pads
        )
        for seed in seeds
    ]  # fmt: skip

    def gusts(leg: int) -> Gusts:
        drawn = [np.random.default_rng((*seed, _GUSTS, leg)) for seed in seeds]
        return Relaxing(drawn) if world.gusts == "relaxing" else Harmonics(drawn, city.how.height_m)

    return Setting(
        ground=city.ground,
        air=air,
        gusts=gusts,
        power=power,
        vehicle=vehicle,
        how=city.how,
        batteries=batteries,
        charging=battery.Charging(city.sheet.recharge_s),
        stations=stations,
        told=tuple(site for site in sites if site.id != world.kept_back),
        shift_s=shift_s,
        begin_s=order.depart_s,
    )


def _wind(
    world: World,
    city: City,
    sites: tuple[Site, ...],
    begin_s: NDArray[np.float64],
    rngs: Callable[[int], list[np.random.Generator]],
) -> TrueWind:
    series = SiteWinds(sites, world.between, begin_s, HOURS, rngs(_SERIES))
    xy = city.ground.plane.xy([site.lat for site in sites], [site.lon for site in sites])
    if world.space == "inverse-distance":
        return InverseDistance(xy, series)
    drawn = rngs(_FIELD)
    low, high = LENGTH_M
    lengths = low + (high - low) * np.array([rng.integers(LENGTHS) for rng in drawn]) / (LENGTHS - 1)
    return RandomField(
        xy, series, lengths, [_left_out(city.sites, city.ground.plane, length) for length in lengths.tolist()], drawn
    )


@lru_cache(maxsize=128)
def _left_out(sites: tuple[Site, ...], plane: Plane, length_m: float) -> LeftOut:
    return leave_one_out(sites, plane, length_m)


def _power(world: World, city: City, order: Order, rngs: list[np.random.Generator]) -> Power:
    if world.energy == "momentum":
        return Momentum(city.sheet, order.payload_kg, rngs)
    return city.plant(order.payload_kg) if world.energy == "plant" else Flat(city.sheet, order.payload_kg)


def _temperature(site: Site, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.isfinite(site.temp_c)
    if not known.any():
        return np.full(len(time_s), USUAL_TEMP_C)
    return np.interp(time_s, site.time_s[known], site.temp_c[known])
