"""Kernels that extend a stop label to every useful station."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.exact.relaxation_grid_kernels import Cells, slack
from skyway.planner.schedule.leg_profile_kernels import fly_profile, stop_profile
from skyway.planner.schedule.profile_kernels import covers, departure_profile

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Grounds(NamedTuple):
    """What kernels know of the stations."""

    queue_offset: NDArray[np.int64]
    """Shape (nodes + 1,). Entries of node i are ``queue_offset[i] : queue_offset[i + 1]`` of the next four."""
    arrival_s: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    land_s: NDArray[np.float64]
    delay_s: NDArray[np.float64]
    """Shape (entries,) each. Queue paths of all nodes, POSIX seconds (`delay_s`: seconds), packed:
    `models.queues.paths.PackedPaths`."""
    curve_of: NDArray[np.int64]
    """Shape (nodes,). Kind of pad."""
    curve_s: NDArray[np.float64]
    curve_soc: NDArray[np.float64]
    """Shape (kinds, points) each. Charging curves, padded by repeating the last point; `curve_points` says how many
    there are."""
    curve_points: NDArray[np.int64]
    """Shape (kinds,)."""


class Costs(NamedTuple):
    """Of flights and of charging: see `planner.problem.problem.Problem` and `stop_label_bound`."""

    soc_per_s: float
    soc_fixed: float
    """A flight of T seconds takes ``soc_fixed + soc_per_s * T``."""
    margin_soc_per_s: float
    """What it must keep on touch-down beyond the reserve, for each of its seconds."""
    reserve: float
    """What it must keep, SoC."""
    rate_per_s: float
    """Greatest rate of charging of any pad."""
    landing_s: float
    """Climb and descent together, s."""


class Offered(NamedTuple):
    """Departure profiles of the settled labels of each node, see `planner.exact.label_search.Settled`."""

    points: NDArray[np.float64]
    """Shape (points, 2). Profiles, one behind the other."""
    at: NDArray[np.int64]
    """Shape (nodes, 2). Where that of each node begins, and of how many points it is."""


@compiled
def in_order(flights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out take-offs of an arrival function after which another one is down no later.

    Where a segment opens with a slot, the way round it that was begun just before may arrive later than the straight
    way begun just after. A drone that waits for that has more charge, too.

    `flights` are pieces (t0, a0, t1, a1), shape (pieces, 4), sorted by take-off; so are those that are returned.
    O(pieces).
    """
    last = len(flights) - 1
    k = 0
    # The usual case: touch-downs are in order as they are.
    while k < last and flights[k, 3] <= flights[k + 1, 1]:
        k += 1
    if k >= last:
        return flights
    # From the last take-off backwards, keep what is down before all later ones.
    out = np.empty_like(flights)
    size = len(out)
    earliest = math.inf
    for i in range(last, -1, -1):
        t0, a0, t1, a1 = flights[i]
        if a0 >= earliest:
            continue
        # Cut the piece where it is down as early as they.
        if a1 > earliest:
            t1, a1 = t0 + (earliest - a0) / (a1 - a0) * (t1 - t0), earliest
        size -= 1
        out[size, 0], out[size, 1], out[size, 2], out[size, 3] = t0, a0, t1, a1
        earliest = a0
    return out[size:]


@compiled
def land_at(
    g: NDArray[np.float64], flights: NDArray[np.float64], node: int, grounds: Grounds, costs: Costs, best_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fly from a stop label to a station and put the drone on its pads: profiles z and h there, empty where it cannot.

    `g` is the departure profile of the stop label, shape (points, 2), `flights` the pieces of the arrival function to
    `node`, shape (pieces, 4). What lands after `best_s` does not matter.

    Takes a profile and pieces in order of time, and a node with pads.
    """
    # The flight: what keeps the reserve on touch-down.
    needed = np.array([[g[0, 0], costs.reserve]])
    flown, size = fly_profile(
        g, in_order(flights), costs.soc_per_s, costs.soc_fixed, costs.margin_soc_per_s, needed, best_s
    )
    if size == 0:
        return np.empty((0, 3)), np.empty((0, 3))
    # The queue and the pads.
    low, high = grounds.queue_offset[node], grounds.queue_offset[node + 1]
    kind = grounds.curve_of[node]
    last = grounds.curve_points[kind]
    return stop_profile(
        flown,
        size,
        costs.soc_per_s,
        costs.margin_soc_per_s,
        costs.reserve,
        grounds.arrival_s[low + 1 : high],
        grounds.pad_s[low:high],
        grounds.land_s[low:high],
        grounds.delay_s[low:high],
        grounds.curve_s[kind, :last],
        grounds.curve_soc[kind, :last],
    )


@compiled
def land_everywhere(
    g: NDArray[np.float64],
    targets: NDArray[np.int64],
    piece_offset: NDArray[np.int64],
    pieces: NDArray[np.float64],
    grounds: Grounds,
    costs: Costs,
    least_s: NDArray[np.float64],
    best_s: float,
) -> list[tuple[int, float, NDArray[np.float64], NDArray[np.float64]]]:
    """Fly from a stop label to each target and put the drone on its pads.

    Takes profiles and pieces in order of time, and nodes with pads.

    Parameters
    ----------
    g : ndarray, shape (points, 2)
        Charge the drone can leave with, by time.
    targets : ndarray of int, shape (targets,)
        Nodes with pads.
    piece_offset, pieces : ndarray
        Arrival functions: pieces of target i are ``pieces[piece_offset[i] : piece_offset[i + 1]]``.
    grounds, costs
        Stations and costs.
    least_s : ndarray, shape (nodes,)
        Lower bound of the flight time to the destination.
    best_s : float
        Arrivals from here on do not matter.

    Returns
    -------
    list of (node, bound, z, h)
        Profiles at each target that is reached and whose bound, see `stop_label_bound`, is below `best_s`.
    """
    found = [(0, 0.0, np.empty((0, 3)), np.empty((0, 3)))]
    for i in range(len(targets)):
        node = targets[i]
        z, h = land_at(g, pieces[piece_offset[i] : piece_offset[i + 1]], node, grounds, costs, best_s)
        if len(h) == 0:
            continue
        bound = stop_label_bound(z, h, least_s[node], costs)
        if bound < best_s:
            found.append((node, bound, z, h))
    return found[1:]


@compiled
def stop_label_bound(z: NDArray[np.float64], h: NDArray[np.float64], least_s: float, costs: Costs) -> float:
    """Earliest arrival at the destination that any continuation of a stop label can have, POSIX seconds.

    Let L be the least flight time from here at the best wind of any slot that is left, c the charge a second of flight
    takes, r the greatest rate of charging, and z the greatest charging potential. No arrival is earlier than (a) the
    stay's beginning plus L, nor than (b) reserve / r + L (1 + c / r) - z: potential is lost by L c / r to energy and by
    L to time in flight, waiting never gains any, and to land at T with the reserve, T + z must be at least reserve / r.
    """
    # L, with a climb and a descent at least.
    flight = least_s + costs.landing_s
    # z, in seconds of charging at r: off the pads, and on them.
    potential = h[-1, 1] / costs.rate_per_s - h[0, 0]
    if len(z) > 0:
        potential = max(potential, z[-1, 1])
    # c L, and what a flight costs beyond that where it is less than nothing.
    taken = flight * costs.soc_per_s + min(costs.soc_fixed, 0.0)
    # (b), and the later of both.
    by_charge = costs.reserve / costs.rate_per_s + flight + taken / costs.rate_per_s - potential
    return max(h[0, 0] + flight, by_charge)


@compiled
def stop_labels_after(
    g: NDArray[np.float64],
    targets: NDArray[np.int64],
    piece_offset: NDArray[np.int64],
    pieces: NDArray[np.float64],
    grounds: Grounds,
    costs: Costs,
    best_s: float,
    cells: Cells,
    climb_s: float,
    window: NDArray[np.int64],
    least_leave: NDArray[np.float64],
    offered: Offered,
    with_best: bool,
) -> list[tuple[int, float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
    """Fly from a stop label to each target and keep what settled labels do not cover and can still be on time, by `slack`.

    Takes what `land_everywhere` takes, with a window and a row of `least_leave` for each node and cell.

    Parameters
    ----------
    g, targets, grounds, costs, best_s
        As for `land_everywhere`.
    piece_offset, pieces : ndarray
        Arrival functions: those of node j are ``pieces[piece_offset[j] : piece_offset[j + 1]]``.
    cells, climb_s, window, least_leave
        Grid, s, ndarray of int of shape (nodes, 2), ndarray of shape (cells, nodes): see
        `planner.exact.relaxation.Guide`.
    offered : Offered
        What settled labels offer.
    with_best : bool
        Keep what has the most to spare even where settled labels cover it.

    Returns
    -------
    list of (node, slack, z, h, g)
        Profiles at each node that is kept, and by how much its charge exceeds what is asked for, s.
    """
    found = [(0, 0.0, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2)))]
    most, best_is_covered = -1.0, False
    for node in targets:
        flights = pieces[piece_offset[node] : piece_offset[node + 1]]
        if len(flights) == 0:
            continue
        z, h = land_at(g, flights, node, grounds, costs, best_s)
        if len(h) == 0:
            continue
        # The charge to leave with, against what the guide asks for.
        kind = grounds.curve_of[node]
        last = grounds.curve_points[kind]
        curve_s, curve_soc = grounds.curve_s[kind, :last], grounds.curve_soc[kind, :last]
        off = departure_profile(z, h, curve_s, curve_soc)
        begin, size = offered.at[node, 0], offered.at[node, 1]
        covered = size > 0 and covers(offered.points[begin : begin + size], off, 0.0)
        if covered and not with_best:
            continue
        spare = slack(off, node, cells, climb_s, (window[node, 0], window[node, 1]), least_leave, curve_s, curve_soc)
        if spare < 0.0 or (covered and spare <= most):
            continue
        if spare > most:
            most, best_is_covered = spare, covered
        if covered:
            found[0] = (node, spare, z, h, off)
        else:
            found.append((node, spare, z, h, off))
    return found if best_is_covered else found[1:]
