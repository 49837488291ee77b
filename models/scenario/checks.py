"""Plausibility checks of a whole scenario: parts that are each valid, but do not fit together."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.airspace.ways import columns
from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, refuse
from skyway.models.base.formatting import distance_text
from skyway.models.base.units import S_PER_H
from skyway.models.network.overs import USUAL_MOST_M
from skyway.models.network.zoned import ground_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.airspace.ways import Ways
    from skyway.models.network.network import Network
    from skyway.models.network.station import Station
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.terrain.obstacles import Obstacles
    from skyway.models.wind.history import WindSite

LOST_M = 1_000_000.0
"""A point farther than this from all others, but near them with lat and lon swapped, is assumed to be swapped."""
WIND_FAR_M = 300_000.0
"""Wind measured farther away than this is not representative of the wind at a station."""
FEW = 20
"""Of more zones or obstacles than this, all must look swapped."""
OBSTACLES_FAR_M = 100_000.0
"""Obstacles farther away than this from everything are not those of the region."""
NO_SEGMENTS = "no segment joins any stations: is network.max_length_m long enough, in metres?"
"""Warning of a network in which nothing can be planned."""
_SWAPPED = "lat and lon look swapped"


def position_faults(stations: Sequence[Station], sites: Sequence[WindSite], file: str, toml: str) -> list[Fault]:
    """Find stations and wind sites that lie in another part of the world unless their lat and lon are exchanged.

    Stations are compared with the wind sites and with the middle of all stations; a wind site with the stations.
    """
    here = _positions(stations)
    there = _positions(sites)
    lost = _swapped(here, there)
    if len(sites) and lost.all():
        remedy = "compare them with lat and lon of [[wind.sites]]"
        return [Fault(f"{_SWAPPED} in all stations", file, None, "lat", _at(here[0]), remedy)]
    lost |= _swapped(here, np.median(here, axis=0, keepdims=True))
    found = np.flatnonzero(lost).tolist()
    faults = [Fault(_SWAPPED, file, None, f"station {stations[i].id}", _at(here[i])) for i in found]
    wrong = np.flatnonzero(_swapped(there, here[~lost])).tolist()
    return faults + [Fault(_SWAPPED, toml, None, f"wind.sites[{i}].lat", _at(there[i])) for i in wrong]


def zone_faults(stations: Sequence[Station], zones: Airspace, stations_file: str, own_file: str) -> list[Fault]:
    """Find stations inside a zone of the user's own that is always closed, and zones with longitude and latitude exchanged."""
    here = _positions(stations)
    inside = zones.holding(here[:, 0], here[:, 1], _climbs(stations, zones))
    faults = [
        Fault(f"lies in the no-fly zone {zone.name}", stations_file, None, f"station {stations[i].id}")
        for i, zone in sorted(inside.items())
        if zone.source == own_file and zone.kind == "prohibited" and zone.activation.is_permanent
    ]
    return faults + swapped_zones(here, zones, "the stations")


def swapped_zones(here: NDArray[np.float64], zones: Airspace, what: str) -> list[Fault]:
    """Find zones with longitude and latitude exchanged: far from the destinations, shape (n, 2), and near them if exchanged."""
    middle = np.array([(p.centroid.y, p.centroid.x) for p in zones.polygons]).reshape(-1, 2)
    wrong = _swapped(middle, np.median(here, axis=0, keepdims=True))
    if not wrong.all() and len(wrong) > FEW:  # of all the zones of a country some may be anywhere
        return []
    remedy = f"GeoJSON has longitude first, then latitude; or lat and lon of {what} are swapped"
    sources = [zones.zones[i].source for (i, _), closed in zip(zones.volumes, zones.closed, strict=True) if closed]
    return [Fault(_SWAPPED, sources[i], None, zones.names[i], _at(middle[i]), remedy) for i in np.flatnonzero(wrong)]


def misplaced_obstacles(here: NDArray[np.float64], obstacles: Obstacles, what: str) -> list[str]:
    """Return a note on each file of obstacles of which none lies near the destinations, shape (n, 2).

    An `InputError` names those that lie near them only with latitude and longitude exchanged.
    """
    faults: list[Fault] = []
    notes: list[str] = []
    middle = np.median(here, axis=0, keepdims=True)
    for file, part in obstacles.by_file():
        near = len(part.within(here[:, 0], here[:, 1], OBSTACLES_FAR_M))
        if not len(part) or (near and len(part) > FEW):
            continue
        at = np.column_stack((part.lat, part.lon))
        wrong = _swapped(at, middle)
        remedy = f"lat and lon as columns, longitude first in GeoJSON; or those of {what} are swapped"
        if wrong.all() and len(part) > 1:
            faults.append(Fault(f"{_SWAPPED} in all obstacles", file, None, part.names[0], _at(at[0]), remedy))
        elif wrong.any() and len(part) <= FEW:
            found = np.flatnonzero(wrong).tolist()
            faults += [Fault(_SWAPPED, file, None, part.names[i], _at(at[i]), remedy) for i in found]
        elif not near:
            away = distance_text(float(_nearest_m(at, middle).min()))
            notes.append(f"{file}: no obstacle lies near {what}: the nearest is {away} away")
    refuse(faults)
    return notes


def _climbs(stations: Sequence[Station], zones: Airspace) -> Ways:
    """Climbs over stations, to the greatest height of flights if that is stated."""
    here = _positions(stations)
    top_m = max(zones.cruise_height_m, zones.max_height_m if math.isfinite(zones.max_height_m) else USUAL_MOST_M)
    return columns(here[:, 0], here[:, 1], ground_of(stations), top_m)


def zone_warnings(stations: Sequence[Station], zones: Airspace) -> list[str]:
    """Return which stations are closed by zones at the heights flown there, and heights that cannot be compared."""
    here = _positions(stations)
    inside = zones.holding(here[:, 0], here[:, 1], _climbs(stations, zones))
    found = []
    if inside:
        listed = _listed([f"{stations[i].id} in {zone.label}" for i, zone in sorted(inside.items())])
        found.append(f"stations in zones that close them at times, or until authorized: {listed}")
    unknown = [station.id for station in stations if station.elevation_m is None]
    over_the_sea = any(
        not agl
        for _, volume in zones.volumes
        for value, agl in (volume.floor.lowest(), volume.ceiling.highest())
        if math.isfinite(value)
    )
    if unknown and over_the_sea:
        found.append(
            f"zones have heights above the sea, and the ground of {len(unknown)} stations is not known ({_listed(unknown)}): "
            "there such zones count at all heights"
        )
    return found


def fit_warnings(network: Network, sites: Sequence[WindSite]) -> list[str]:
    """Return warnings for a person: outlying stations, distant wind, stations at one place, separate parts."""
    stations = [station for station in network.stations if not station.flyover]
    here = _positions(stations)
    ids = [station.id for station in stations]
    warnings = []
    far = _nearest_m(here, np.median(here, axis=0, keepdims=True))
    warnings += [f"station {ids[i]} lies {distance_text(far[i])} from the others" for i in np.flatnonzero(far > LOST_M)]
    if len(sites):
        wind = _nearest_m(here, _positions(sites))
        distant = np.flatnonzero(wind > WIND_FAR_M)
        if len(distant):
            worst = int(np.argmax(wind))
            farthest = f"station {ids[worst]}, {distance_text(wind[worst])}"
            warnings.append(f"{len(distant)} stations lie more than 300 km from every wind site (farthest: {farthest})")
    places = Counter((station.lat, station.lon) for station in stations)
    shared = [station.id for station in stations if places[station.lat, station.lon] > 1]
    if shared:
        warnings.append(f"stations that stand at the same place, no segment joins them: {_listed(shared)}")
    parts = network.parts()
    if len(ids) > 1 and not len(network.tail):
        warnings.append(NO_SEGMENTS)
    elif len(parts) > 1:
        apart = _listed([part[0] for part in parts[1:]])
        warnings.append(f"the network falls into {len(parts)} parts that no segment joins (apart: {apart})")
    return warnings


def planning_faults(scenario: Scenario, hours: int) -> list[Fault]:
    """Find why no request can be planned in a scenario that was read without faults: no segments, or too short a record of wind.

    A plan needs the wind of so many hours from its departure, without a gap; a scenario's own forecast is not checked.
    """
    faults = []
    if not len(scenario.network.tail):
        remedy = "raise network.max_length_m, in metres, or name the segments in network.segments"
        faults.append(Fault(NO_SEGMENTS.partition(":")[0], scenario.path, field="network", remedy=remedy))
    history = scenario.history
    if history is not None and not scenario.has_forecast:
        needed = math.ceil(hours * S_PER_H / history.slot_s)
        gaps = np.flatnonzero(~np.concatenate(([False], history.complete, [False])))
        longest = int(np.diff(gaps).max(initial=1)) - 1
        if longest < needed:
            problem = f"no {hours} hours in a row without a gap: too short to plan with"
            remedy = "give a longer record, of some weeks at least, or a forecast"
            faults.append(Fault(problem, history.source or scenario.path, value=history.covers, remedy=remedy))
    return faults


def _positions(places: Sequence[Station] | Sequence[WindSite]) -> NDArray[np.float64]:
    """(lat, lon) of each, shape (places, 2)."""
    return np.array([(place.lat, place.lon) for place in places], dtype=np.float64).reshape(-1, 2)


def _swapped(here: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which positions are far from every reference, but near one with lat and lon exchanged."""
    if not len(reference) or not len(here):
        return np.zeros(len(here), dtype=bool)
    possible = np.abs(here[:, 1]) <= 90.0
    swapped = np.where(possible[:, None], here[:, ::-1], here)
    far, near = _nearest_m(here, reference), _nearest_m(swapped, reference)
    return np.asarray((far > LOST_M) & possible & (near < LOST_M))


def _nearest_m(here: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each position to the nearest reference, shape (positions,)."""
    nearest = np.full(len(here), np.inf)
    for lat, lon in reference:
        nearest = np.minimum(nearest, geodesy.inverse(lat, lon, here[:, 0], here[:, 1])[0])
    return nearest


def _at(position: NDArray[np.float64]) -> str:
    return f"{position[0]:g},{position[1]:g}"


def _listed(names: list[str], most: int = 4) -> str:
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")
