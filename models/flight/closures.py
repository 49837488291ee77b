"""When the segments of a network are closed by its airspace, in the slots of a forecast."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.airspace.activation import Span
    from skyway.models.network.network import Network

MINUTE_S = 60.0
PARTS = (1, 2, 3, 4, 6, 12)
"""Number of parts into which slots are divided, so that zones begin and end at the start of a part."""
LEAST_SLOT_S = 300.0
AFTERWARDS_S = 86_400.0
"""The last slot continues; a zone that is active up to this long after it closes it."""


class Closures(NamedTuple):
    """Segments that are closed by zones, as kernels read them."""

    shut_of: NDArray[np.int64]
    """Column of `shut` for each segment, shape (segments,); column 0 is never closed."""
    shut: NDArray[np.bool_]
    """Whether it is closed in each slot, shape (slots, columns)."""


def closures(
    network: Network, start_s: float, slot_s: float, slots: int, too_high: NDArray[np.bool_] | None = None
) -> Closures:
    """Return in which slots segments are closed: those in any part of which a zone that they come into is active.

    Segments that are `too_high` for the drone are closed in all. Times are taken to the full minute, outwards.
    """
    shut_of = np.zeros(len(network.tail), dtype=np.int64)
    columns: dict[tuple[int, ...], int] = {(): 0}
    for segment, zones in closing_zones(network).items():
        shut_of[segment] = columns.setdefault(zones, len(columns))
    begin_s = start_s + slot_s * np.arange(slots)
    end_s = begin_s + slot_s
    end_s[-1] += AFTERWARDS_S
    shut = np.zeros((slots, len(columns) + 1), dtype=bool)
    spans: dict[int, list[Span]] = {}
    for zones, column in columns.items():
        for zone in zones:
            if zone not in spans:
                spans[zone] = _minutes(network, zone, start_s, float(end_s[-1]))
            for first, last in spans[zone]:
                shut[:, column] |= (begin_s < last) & (end_s > first)
    shut[:, -1] = True
    if too_high is not None:
        shut_of[too_high] = len(columns)
    return Closures(shut_of, shut)


def closing_zones(network: Network) -> dict[int, tuple[int, ...]]:
    """Return by segment the numbers of the zones that close it at some time; other segments are omitted."""
    airspace = network.zones
    if airspace is None or not len(network.restricted):
        return {}
    rows = network.restricted[airspace.closed[network.restricted[:, 1]]]
    zone_of = np.array([zone for zone, _ in airspace.volumes], dtype=np.int64)
    found: dict[int, tuple[int, ...]] = {}
    for segment, zone in np.unique(np.column_stack((rows[:, 0], zone_of[rows[:, 1]])), axis=0).tolist():
        found[segment] = (*found.get(segment, ()), zone)
    return found


def parts_of_slots(network: Network, start_s: float, slot_s: float, slots: int) -> int:
    """Return the number of parts into which slots are best divided, so that zones begin and end between slots; 1 if none does."""
    edges_s: set[float] = set()
    end_s = start_s + slots * slot_s
    for zone in {zone for zones in closing_zones(network).values() for zone in zones}:
        edges_s |= {edge for span in _minutes(network, zone, start_s, end_s) for edge in span if start_s < edge < end_s}
    possible = [parts for parts in PARTS if parts == 1 or slot_s / parts >= LEAST_SLOT_S]
    for parts in possible:
        length = slot_s / parts
        if all(abs((edge - start_s) / length - round((edge - start_s) / length)) * length < 1e-3 for edge in edges_s):
            return parts
    return possible[-1]


def _minutes(network: Network, zone: int, from_s: float, until_s: float) -> list[Span]:
    airspace = network.zones
    found = airspace.zones[zone].activation.spans(from_s, until_s) if airspace is not None else []
    return [(MINUTE_S * math.floor(a / MINUTE_S), MINUTE_S * math.ceil(b / MINUTE_S)) for a, b in found]
