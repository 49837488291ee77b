"""10,000 zones against the segments of 1,000 stations, beside geopandas by the book.

By the book is `geopandas.sjoin` of all segments with all zones, which looks at the plan alone: heights, times and kinds of zones are not
asked for there, and are here.
"""

from __future__ import annotations

import importlib.util
import time
from typing import TYPE_CHECKING

import numpy as np
import shapely

from benchmarks.tables.figure import Figure
from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import USUAL_HEIGHT_MARGIN_M, USUAL_MARGIN_M, Airspace
from skyway.models.airspace.limits import GROUND, NO_CEILING, Limit
from skyway.models.airspace.zone import Kind, Volume, Zone
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station

if TYPE_CHECKING:
    from skyway.models.network.network import Network

STATIONS, ZONES, CORNERS = 1_000, 10_000, 64
TARGET_S, RATIO = 5.0, 1.0
RULE = ConnectionRule(max_length_m=10_000.0)


def region(seed: int = 0) -> tuple[list[Station], tuple[Zone, ...]]:
    """Stations over some 100 km, and zones of 50 to 400 m about them, of all kinds, heights and times."""
    rng = np.random.default_rng(seed)
    lat, lon = 47.0 + rng.uniform(-0.5, 0.5, STATIONS), 8.0 + rng.uniform(-0.7, 0.7, STATIONS)
    ground_m = rng.uniform(300.0, 600.0, STATIONS)
    places = zip(lat.tolist(), lon.tolist(), ground_m.tolist(), strict=True)
    stations = [Station(f"s{n}", f"S{n}", *place) for n, place in enumerate(places)]
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    zones = []
    for number in range(ZONES):
        x, y, radius = 8.0 + rng.uniform(-0.8, 0.8), 47.0 + rng.uniform(-0.6, 0.6), rng.uniform(0.0005, 0.004)
        area = shapely.Polygon(np.column_stack((x + 1.45 * radius * np.cos(angle), y + radius * np.sin(angle))))
        ceiling = Limit(120.0, "AGL") if rng.random() < 0.5 else NO_CEILING
        when = Activation() if rng.random() < 0.7 else Activation((Period(1.78e9, 1.78e9 + 7200.0),))
        kind: Kind = "prohibited" if rng.random() < 0.5 else "authorization"
        zones.append(Zone(f"z{number}", "", kind, (Volume(area, GROUND, ceiling),), when))
    return stations, tuple(zones)


def by_the_book_s(network: Network, zones: tuple[Zone, ...]) -> float:
    """Time of the spatial join of geopandas."""
    import geopandas

    tail = np.column_stack((network.lon[network.tail], network.lat[network.tail]))
    head = np.column_stack((network.lon[network.head], network.lat[network.head]))
    begun = time.perf_counter()
    lines = geopandas.GeoDataFrame(geometry=shapely.linestrings(np.stack((tail, head), axis=1)), crs=4326)
    areas = geopandas.GeoDataFrame(geometry=[zone.volumes[0].area for zone in zones], crs=4326)
    geopandas.sjoin(lines, areas, predicate="intersects")
    return time.perf_counter() - begun


def measure() -> list[Figure]:
    """Measure both; what is timed is all that building the network takes."""
    stations, zones = region()
    free = build_network(stations, RULE)
    figures = []
    for name, margins in (("no margin", (0.0, 0.0)), ("usual margins", (USUAL_MARGIN_M, USUAL_HEIGHT_MARGIN_M))):
        begun = time.perf_counter()
        network = build_network(stations, RULE, zones=Airspace(zones, *margins))
        spent_s = time.perf_counter() - begun
        note = f"{len(free.tail)} segments, of which {len(network.tail)} are left and {len(np.unique(network.restricted[:, 0]))} are closed at times; target {TARGET_S:g} s or less"
        figures.append(
            Figure(f"{ZONES} zones against {STATIONS} stations, {name}", round(spent_s, 2), "s", TARGET_S, note)
        )
    if importlib.util.find_spec("geopandas"):
        book_s = by_the_book_s(free, zones)
        spent_s = figures[0].value
        note = f"geopandas takes {book_s:.1f} s for the plan alone, ours {spent_s:.2f} s for heights and times as well; target {RATIO:g} or more"
        figures.append(Figure("geopandas over ours", round(book_s / max(spent_s, 1e-3), 2), "times", None, note))
    return figures
