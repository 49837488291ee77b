"""Rules that make segments between stations: by length, by nearest neighbours, or the Gabriel graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models import geodesy
from models.errors import Fault, InputError
from models.network import ConnectionRule, Network, Station

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from scipy.spatial import cKDTree

    from models.zones import NoFlyZones

RULES = ("max-length", "nearest", "gabriel")
MAX_PAIRS = 20_000_000


def build_network(stations: Sequence[Station], rule: ConnectionRule, *, zones: NoFlyZones | None = None) -> Network:
    """Join stations by a rule; every segment is flown both ways, none is longer than ``rule.max_length_m``.

    ``max-length`` joins all pairs, ``nearest`` each station to its ``rule.nearest`` nearest, ``gabriel`` two
    stations when the circle on the line between them holds no third (Gabriel & Sokal 1969).

    Raises
    ------
    InputError
        Unknown rule, lengths or counts out of range, or so many pairs that the network would not be usable.
    """
    if rule.kind not in RULES:
        raise InputError(
            Fault("unknown rule", field="network.rule", value=rule.kind, remedy="one of " + ", ".join(RULES))
        )
    if not rule.max_length_m > 0:
        raise InputError(Fault("must be above 0", field="network.max_length_m", value=rule.max_length_m))
    if len(stations) < 2:
        return Network.from_pairs(stations, np.empty((0, 2), dtype=np.int64), rule=rule, zones=zones)
    pairs = {"max-length": _within, "nearest": _nearest, "gabriel": _gabriel}[rule.kind](stations, rule)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    lat = np.array([s.lat for s in stations])
    lon = np.array([s.lon for s in stations])
    length, _ = geodesy.inverse(lat[pairs[:, 0]], lon[pairs[:, 0]], lat[pairs[:, 1]], lon[pairs[:, 1]])
    pairs = pairs[(length <= rule.max_length_m) & (length > 0.0)]
    return Network.from_pairs(stations, np.concatenate((pairs, pairs[:, ::-1])), rule=rule, zones=zones)


def _tree(stations: Sequence[Station]) -> tuple[cKDTree, NDArray[np.float64]]:
    """KD-tree of the stations as points on a sphere of the Earth's mean radius, metres."""
    from scipy.spatial import cKDTree  # imported late: 100 ms

    lat = np.radians([s.lat for s in stations])
    lon = np.radians([s.lon for s in stations])
    xyz = geodesy.EARTH_RADIUS_M * np.column_stack((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)))
    return cKDTree(xyz), xyz


def _within(stations: Sequence[Station], rule: ConnectionRule) -> NDArray[np.int64]:
    tree, _ = _tree(stations)
    reach = min(rule.max_length_m * 1.006, 2.0 * geodesy.EARTH_RADIUS_M)  # sphere against ellipsoid: within 0.6 %
    count = (int(tree.count_neighbors(tree, reach)) - len(stations)) // 2
    if count > MAX_PAIRS:
        remedy = f"shorten network.max_length_m or use rule nearest: {count} segments are more than {MAX_PAIRS}"
        raise InputError(
            Fault("joins too many pairs", field="network.max_length_m", value=rule.max_length_m, remedy=remedy)
        )
    return np.asarray(tree.query_pairs(reach, output_type="ndarray"), dtype=np.int64).reshape(-1, 2)


def _nearest(stations: Sequence[Station], rule: ConnectionRule) -> NDArray[np.int64]:
    if rule.nearest < 1:
        raise InputError(Fault("must be at least 1", field="network.nearest", value=rule.nearest))
    tree, xyz = _tree(stations)
    count = min(rule.nearest + 1, len(stations))
    _, found = tree.query(xyz, k=count)
    start = np.repeat(np.arange(len(stations)), count)
    return np.column_stack((start, np.asarray(found, dtype=np.int64).ravel()))


def _gabriel(stations: Sequence[Station], rule: ConnectionRule) -> NDArray[np.int64]:
    tree, xyz = _tree(stations)
    candidates = _delaunay_edges(stations)
    if candidates is None:
        candidates = _within(stations, rule)
    a, b = xyz[candidates[:, 0]], xyz[candidates[:, 1]]
    middle = (a + b) / 2.0
    radius = np.linalg.norm(a - b, axis=1) / 2.0
    nearest, _ = tree.query(middle, k=1)
    return candidates[nearest >= radius * (1.0 - 1e-9)]


def _delaunay_edges(stations: Sequence[Station]) -> NDArray[np.int64] | None:
    """Edges of the Delaunay triangulation, which holds the Gabriel graph; None for fewer than 4 or collinear points."""
    from scipy.spatial import Delaunay, QhullError

    lat = np.array([s.lat for s in stations])
    lon = np.array([s.lon for s in stations])
    north, east = geodesy.local_offsets_m(lat, lon, float(lat.mean()), float(lon.mean()))
    try:
        simplices = Delaunay(np.column_stack((east, north))).simplices
    except (QhullError, ValueError):
        return None
    edges = np.concatenate((simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]))
    return np.unique(np.sort(edges, axis=1), axis=0).astype(np.int64)
