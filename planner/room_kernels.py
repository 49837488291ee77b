"""Compiled: is there room at the next station when the drone gets there, as seen from its pads and line now?"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from planner.course_kernels import Queues

_NEGLIGIBLE = 1e-12


class Room(NamedTuple):
    """Stations at the end of each hop, for the chance to find one full; shape (hops,).

    Attributes
    ----------
    pads, spots : ndarray of int
        Pads, and holding spots beside them.
    arrivals_per_s, services_per_s : ndarray
        Others that arrive, and that leave one busy pad, at the busiest hour that can matter.
    most : float
        Greatest chance with which a flight is begun; 1: nobody looks at the pads.
    """

    pads: NDArray[np.int64]
    spots: NDArray[np.int64]
    arrivals_per_s: NDArray[np.float64]
    services_per_s: NDArray[np.float64]
    most: float


@compiled
def chance_full(pads: int, spots: int, arrivals: float, services: float, line: int, free: bool) -> float:
    """Chance that all pads and spots are taken after a while in which `arrivals` others are expected.

    Parameters
    ----------
    pads, spots : int
        Of the station.
    arrivals, services : float
        Expected number of arrivals, and of departures from one busy pad, in the while.
    line : int
        Others in line now.
    free : bool
        A pad is free now: then all others are taken to be busy, which is the most there can be.

    Returns
    -------
    float
        P(arrivals - departures >= room), both Poisson, of which the departures are those of the busy pads.
    """
    room = spots + 1 if free else spots - line
    if room <= 0:
        return 1.0
    leaving = services * ((pads - 1) if free else pads)
    gone = math.exp(-leaving)  # probability of `count` departures
    count = 0
    total = 0.0
    while True:
        below, term = 0.0, math.exp(-arrivals)
        for k in range(room + count):
            below += term
            term *= arrivals / (k + 1)
        late = max(1.0 - below, 0.0)
        total += gone * late
        count += 1
        gone *= leaving / count
        if late < _NEGLIGIBLE or count > 60:
            return total


@compiled
def seen_pads(queues: Queues, entry: int, time_s: float) -> tuple[int, bool]:
    """What the others look like at a time: how many are in line, and whether a pad is free."""
    low, high = queues.offset[entry], queues.offset[entry + 1]
    last = max(low + np.searchsorted(queues.arrival_s[low:high], time_s, side="right") - 1, low)
    line = 0
    k = last
    while k > low and max(queues.arrival_s[k], queues.pad_s[k - 1]) > time_s:
        line += 1
        k -= 1
    return line, queues.pad_s[last] <= time_s


@compiled
def is_room(room: Room, hop: int, queues: Queues, entry: int, time_s: float, flight_s: float) -> bool:
    """Tell whether the station at the end of a hop has room, likely enough, after a flight that begins at a time."""
    line, free = seen_pads(queues, entry, time_s)
    full = chance_full(
        room.pads[hop],
        room.spots[hop],
        room.arrivals_per_s[hop] * flight_s,
        room.services_per_s[hop] * flight_s,
        line,
        free,
    )
    return full <= room.most
