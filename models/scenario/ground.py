"""A scenario over a terrain model: ground heights filled in and compared, with their contradictions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import height_text, place_text
from skyway.models.flight.way_heights import Over, segment_heights
from skyway.models.network.builders import with_zones
from skyway.models.scenario.air import fleet_in_air
from skyway.models.scenario.checks import misplaced_obstacles
from skyway.models.terrain.obstacles import FOOT_M

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.models.network.station import Station
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.terrain.terrain import Terrain

DIFFER_M = 15.0
"""A larger difference between the ground of a station and that of the terrain model is reported: a roof, or another datum or unit."""
FEW = 4
"""At least this many stations must differ by the same factor before their unit is questioned."""


def over_terrain(scenario: Scenario, terrain: Terrain) -> Scenario:
    """Return a scenario with a terrain model.

    Raises an `InputError` if the model covers another region, or if obstacles have lat and lon exchanged. Grounds that
    stations lack are filled in. Differences, unknown values, and segments omitted because of them are reported in its warnings.
    """
    ground_m = terrain.ground_m(scenario.network.lat, scenario.network.lon)
    if not np.isfinite(ground_m).any():
        raise InputError(_elsewhere(scenario.network, terrain))
    scenario = _zoned_again(scenario, terrain)
    network = scenario.network
    ground_m = terrain.ground_m(network.lat, network.lon)
    flown = network.over_terrain(Over(terrain, scenario.rules.clearance, scenario.rules.cruise_height_m))
    places = np.column_stack((network.lat, network.lon))
    misplaced = misplaced_obstacles(places, terrain.obstacles, "the stations")
    notes = (*terrain.notes, *misplaced, *_unknown(network, flown, ground_m))
    flown = replace(flown, over=Over(terrain, scenario.rules.clearance, scenario.rules.cruise_height_m, notes))
    warnings = (*scenario.warnings, *notes, *_differences(network, ground_m))
    return fleet_in_air(replace(scenario, network=flown, warnings=warnings))


def grounded(stations: Sequence[Station], terrain: Terrain) -> tuple[Station, ...]:
    """Return stations, those whose ground is unknown with that of the terrain model."""
    found = terrain.ground_m(np.array([one.lat for one in stations]), np.array([one.lon for one in stations]))
    return tuple(
        replace(one, elevation_m=round(float(ground), 2)) if one.elevation_m is None and np.isfinite(ground) else one
        for one, ground in zip(stations, found, strict=True)
    )


def _zoned_again(scenario: Scenario, terrain: Terrain) -> Scenario:
    """Return a scenario whose zones are compared with the ground that is now known: over unknown ground, zones with heights above the sea close every height."""
    network = scenario.network
    real = [one for one in network.stations if not one.flyover]
    stations = grounded(real, terrain)
    if network.zones is None or network.rule is None or stations == tuple(real):
        return scenario
    again = with_zones(replace(network, stations=stations), network.zones)
    return replace(scenario, network=again, load=scenario.load.first(len(real)).extended(len(again) - len(real)))


def _elsewhere(network: Network, terrain: Terrain) -> Fault:
    """The problem if a terrain model has no height at any station."""
    south, west, north, east = terrain.raster_box()
    here = place_text(float(np.median(network.lat)), float(np.median(network.lon)))
    box = f"{south:g} to {north:g} N, {west:g} to {east:g} E"
    swapped = terrain.ground_m(*(np.clip(one, -90.0, 90.0) for one in (network.lon, network.lat)))
    remedy = f"take the tiles about {here}"
    inside = (south <= network.lat) & (network.lat <= north) & (west <= network.lon) & (network.lon <= east)
    if inside.any():
        problem = f"is void at every station: {int(inside.sum())} of {len(network)} lie in it"
        return Fault(
            problem,
            terrain.files[0],
            value=here,
            remedy="take a model that has heights there, such as Copernicus GLO-30",
        )
    if np.isfinite(swapped).any():
        remedy = "lat and lon of the stations look swapped"
    return Fault(
        f"no height at any station: the terrain model reaches over {box}", terrain.files[0], value=here, remedy=remedy
    )


def _differences(network: Network, ground_m: NDArray[np.float64]) -> Iterator[str]:
    """Warn of stations whose ground differs from that of the terrain model."""
    off = network.ground_m - ground_m
    known = np.isfinite(off) & np.array([not one.flyover for one in network.stations])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = network.ground_m[known] / ground_m[known]
    high = ratio[np.abs(ground_m[known]) > 2.0 * DIFFER_M]
    if len(high) >= FEW:
        for name, factor, where in (("stations", 1.0 / FOOT_M, "elevation_m"), ("terrain", FOOT_M, "FILE@ft says so")):
            if abs(float(np.median(high)) / factor - 1.0) < 0.1:
                yield f"the grounds of the {name} look like feet taken for metres ({where})"
                return
    if int(known.sum()) >= FEW and float(np.ptp(off[known])) < DIFFER_M < abs(float(np.median(off[known]))):
        shift = height_text(abs(float(np.median(off[known]))))
        yield f"all stations are {'above' if np.median(off[known]) > 0 else 'below'} the terrain by about {shift}: does one of them count from the ellipsoid?"  # fmt: skip
        return
    for node in np.flatnonzero(known & (np.abs(off) > DIFFER_M)):
        station = network.stations[node]
        yield f"station {station.id}: ground {height_text(station.elevation_m)}, and {height_text(float(ground_m[node]))} by the terrain model"  # fmt: skip


def _unknown(network: Network, flown: Network, ground_m: NDArray[np.float64]) -> Iterator[str]:
    """Warn of stations and segments over unknown ground."""
    missing = [network.stations[node].id for node in np.flatnonzero(np.isnan(ground_m))]
    if missing:
        some = ", ".join(missing[:4]) + (", …" if len(missing) > 4 else "")
        yield f"{len(missing)} stations lie over a void of the terrain model, or beyond it: {some}"
    kept = set(zip(flown.tail.tolist(), flown.head.tolist(), strict=True))
    pairs = [pair for pair in zip(network.tail.tolist(), network.head.tolist(), strict=True) if pair not in kept]
    if not pairs or flown.over is None:
        return
    left_out = np.array(pairs, dtype=np.int64)  # some for zones that they enter at these heights
    heights = segment_heights(flown.lat, flown.lon, flown.ground_m, left_out, flown.over)
    lost = int(np.isnan(heights.up_m).sum())
    if lost:
        yield f"{lost} segments pass over a void of the terrain model, or beyond it, and are removed"
