"""Rules that make segments between stations: by length, by nearest neighbours, or the Gabriel graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.network.network import Network

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.network.station import ConnectionRule, Station

RULES = ("max-length", "nearest", "gabriel")
MAX_PAIRS = 20_000_000
FEW = 150
"""Largest number of places for which all pairs are compared; above it, a tree is faster despite its import time."""
DECIMALS = 9
"""Decimals of a degree by which places are distinguished, 0.1 mm."""


def build_network(stations: Sequence[Station], rule: ConnectionRule, *, zones: Airspace | None = None) -> Network:
    """Join stations by a rule; every segment is flown both ways, none is longer than ``rule.max_length_m``.

    ``max-length`` joins all pairs, ``nearest`` each station to its ``rule.nearest`` nearest, ``gabriel`` two stations
    when the circle on the line between them holds no third (Gabriel & Sokal 1969). Stations whose latitude and
    longitude agree to `DECIMALS` stand at one place: they have the same neighbours, and no segment between them.

    Raises an `InputError` if there is no such rule, if lengths or counts are out of range, or if so many pairs
    would not make a usable network.
    """
    if rule.kind not in RULES:
        raise InputError("unknown rule", field="network.rule", value=rule.kind, remedy="one of " + ", ".join(RULES))
    if not rule.max_length_m > 0:
        raise InputError("must be above 0", field="network.max_length_m", value=rule.max_length_m)
    if rule.nearest < 1:
        raise InputError("must be at least 1", field="network.nearest", value=rule.nearest)
    lat = np.array([s.lat for s in stations], dtype=np.float64)
    lon = np.array([s.lon for s in stations], dtype=np.float64)
    rounded = np.asarray(np.round(np.column_stack((lat, lon)), DECIMALS), dtype=np.float64)
    places, place_of = np.unique(rounded, axis=0, return_inverse=True)
    pairs = np.empty((0, 2), dtype=np.int64)
    if len(places) > 1:
        joined = {"max-length": _within, "nearest": _nearest, "gabriel": _gabriel}[rule.kind](places, rule)
        length, _ = geodesy.inverse(*places[joined[:, 0]].T, *places[joined[:, 1]].T)
        pairs = _of_stations(joined[(length <= rule.max_length_m) & (length > 0.0)], place_of.ravel())
    return Network.from_pairs(stations, np.concatenate((pairs, pairs[:, ::-1])), rule=rule, zones=zones)


def with_zones(network: Network, zones: Airspace) -> Network:
    """Return a network with other zones: its segments made again by its rule, or the given ones, as far as the zones allow."""
    stations = tuple(station for station in network.stations if not station.flyover)  # they come first
    if network.rule is not None:
        found = build_network(stations, network.rule, zones=zones)
    else:
        pairs = np.column_stack((network.tail, network.head))
        found = Network.from_pairs(stations, pairs[(pairs < len(stations)).all(axis=1)], zones=zones)
    return found if network.over is None else found.over_terrain(network.over)


def _of_stations(pairs: NDArray[np.int64], place_of: NDArray[np.int64]) -> NDArray[np.int64]:
    """Turn pairs of places into pairs of the stations that stand there."""
    order = np.argsort(place_of, kind="stable")
    count = np.bincount(place_of)
    first = np.cumsum(count) - count
    if count.max() == 1:
        return order[pairs]
    here = [order[start : start + number] for start, number in zip(first, count, strict=True)]
    grids = [np.stack(np.meshgrid(here[a], here[b]), axis=-1).reshape(-1, 2) for a, b in pairs.tolist()]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *grids])


def _within(places: NDArray[np.float64], rule: ConnectionRule) -> NDArray[np.int64]:
    """All pairs whose chord is not longer than the rule allows: a geodesic is never shorter than its chord."""
    xyz = geodesy.earth_xyz(places)
    reach = min(rule.max_length_m, 3.0 * geodesy.SEMI_MAJOR_M)
    if len(places) <= FEW:
        near = np.triu(_chords(xyz, xyz) <= reach, k=1)
        return np.argwhere(near)
    from scipy.spatial import cKDTree  # imported late: 0.2 s

    tree = cKDTree(xyz)
    count = (int(tree.count_neighbors(tree, reach)) - len(places)) // 2
    if count > MAX_PAIRS:
        remedy = f"shorten network.max_length_m or use rule nearest: {count} segments are more than {MAX_PAIRS}"
        field, value = "network.max_length_m", rule.max_length_m
        raise InputError("joins too many pairs", field=field, value=value, remedy=remedy)
    return np.asarray(tree.query_pairs(reach, output_type="ndarray"), dtype=np.int64).reshape(-1, 2)


def _nearest(places: NDArray[np.float64], rule: ConnectionRule) -> NDArray[np.int64]:
    xyz = geodesy.earth_xyz(places)
    count = min(rule.nearest + 1, len(places))
    if len(places) <= FEW:
        found = np.argsort(_chords(xyz, xyz), axis=1, kind="stable")[:, :count]
    else:
        from scipy.spatial import cKDTree

        found = np.asarray(cKDTree(xyz).query(xyz, k=count)[1])
    start = np.repeat(np.arange(len(places)), count)
    return np.column_stack((start, found.ravel().astype(np.int64)))


def _gabriel(places: NDArray[np.float64], rule: ConnectionRule) -> NDArray[np.int64]:
    """Pairs whose ball (the chord is its diameter) holds no third place, of those that can have such a ball."""
    xyz = geodesy.earth_xyz(places)
    candidates = _within(places, rule) if len(places) <= FEW else _delaunay_edges(places)
    if candidates is None:
        candidates = _within(places, rule)
    a, b = xyz[candidates[:, 0]], xyz[candidates[:, 1]]
    middle = (a + b) / 2.0
    radius = np.linalg.norm(a - b, axis=1) / 2.0
    if len(places) <= FEW:
        closest = _chords(middle, xyz).min(axis=1, initial=np.inf)
    else:
        from scipy.spatial import cKDTree

        closest = np.asarray(cKDTree(xyz).query(middle, k=1)[0])
    return np.asarray(candidates[closest >= radius * (1.0 - 1e-9) - 1e-6], dtype=np.int64)


def _chords(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances in space, shape (len(a), len(b))."""
    square = np.zeros((len(a), len(b)))
    for axis in range(3):
        square += (a[:, axis, None] - b[None, :, axis]) ** 2
    return np.sqrt(square)


def _delaunay_edges(places: NDArray[np.float64]) -> NDArray[np.int64] | None:
    """Edges of the Delaunay triangulation, which holds the Gabriel graph; None for places that lie on one line.

    Seen in the stereographic projection about the middle, in which circles on the sphere stay circles.
    """
    from scipy.spatial import Delaunay, QhullError

    xyz = geodesy.earth_xyz(places).mean(axis=0)
    middle = np.degrees((np.arctan2(xyz[2], np.hypot(xyz[0], xyz[1])), np.arctan2(xyz[1], xyz[0])))
    offset = np.column_stack(geodesy.local_offsets_m(places[:, 0], places[:, 1], middle[0], middle[1]))
    angle = np.linalg.norm(offset, axis=1) / (2.0 * geodesy.EARTH_RADIUS_M)
    offset *= np.divide(np.tan(angle), angle, out=np.ones_like(angle), where=angle > 0.0)[:, None]
    try:
        simplices = Delaunay(offset).simplices
    except (QhullError, ValueError):
        return None
    edges = np.concatenate((simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]))
    return np.unique(np.sort(edges, axis=1), axis=0).astype(np.int64)
