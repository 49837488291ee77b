"""A dispatch problem as arrays: flights between places, drones, orders, pads and weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Flights(NamedTuple):
    """Flights between places without a landing, by mode (a drone with a class of packages) and slot of time."""

    time_s: NDArray[np.float64]
    """Shape (modes, slots, places, places): time of a flight, with that on the ground before and after it; infinite where infeasible."""
    need: NDArray[np.float64]
    """Same shape: charge of the flight, with the margin that keeps the reserve."""
    to_go_s: NDArray[np.float64]
    """Same shape: least time from one place to another, with the charging time of its energy."""
    escape: NDArray[np.float64]
    """Shape (modes, places): charge of the flight from a place to the nearest one with pads, in any slot; 0 at a
    place with pads."""
    start_s: float
    slot_s: float
    """Beginning of the first slot, POSIX seconds, and the length of each; the last one has no end."""
    pads: NDArray[np.int64]
    first_pad: NDArray[np.int64]
    """Shape (places,) each: number of pads of a place, and the index of its first pad among all pads."""
    stops: NDArray[np.int64]
    """Places with pads."""
    curve_of: NDArray[np.int64]
    """Shape (types, places): the charging curve of a type of drone at a place."""
    curve_s: NDArray[np.float64]
    curve_soc: NDArray[np.float64]
    """Shape (curves, points) each: charging from empty."""
    pace_s: NDArray[np.float64]
    """Shape (types,): seconds of charging for the whole battery at the fastest rate."""
    wait_s: NDArray[np.float64]
    """Shape (places, times): mean wait for a pad because of strangers, at steps from the start."""
    wait_step_s: float
    reserve: float


class Fleet(NamedTuple):
    """Drones, shape (drones,) each."""

    type: NDArray[np.int64]
    empty_mode: NDArray[np.int64]
    """Mode without a package."""
    place: NDArray[np.int64]
    home: NDArray[np.int64]
    soc: NDArray[np.float64]
    from_s: NDArray[np.float64]
    to_s: NDArray[np.float64]
    """Availability, POSIX seconds; infinite if it has no end."""
    scale: NDArray[np.float64]
    """Ratio of the capacity of a new battery to that of this one: 1 / health."""


class Orders(NamedTuple):
    """Orders, shape (orders,) each but `mode`."""

    origin: NDArray[np.int64]
    destination: NDArray[np.int64]
    ready_s: NDArray[np.float64]
    due_s: NDArray[np.float64]
    refusal_s: NDArray[np.float64]
    """Cost of refusing the order."""
    mode: NDArray[np.int64]
    """Shape (types, orders): mode of a type of drone that carries it; -1 where it is too heavy."""
    latest_s: NDArray[np.float64]
    """Latest delivery, POSIX seconds; an order that would be later is refused."""


class Weights(NamedTuple):
    """Weights of the cost, see `planner.parameters.dispatch`."""

    lateness: float
    energy_s: float
    home: float = 0.0
    """Weight of a second between the last delivery of a drone and its arrival at home."""


@dataclass(frozen=True)
class DispatchProblem:
    """A whole problem; `taken` has windows of pads that are booked already: pad, start and end."""

    flights: Flights
    fleet: Fleet
    orders: Orders
    weights: Weights
    taken: tuple[tuple[int, float, float], ...] = ()


def to_go(time_s: NDArray[np.float64], need: NDArray[np.float64], stops: NDArray[np.int64], pace_s: float, budget: float) -> NDArray[np.float64]:  # fmt: skip
    """Least time between places including charging for all energy, with landings only at `stops`; shape (..., places, places).

    Floyd and Warshall's recurrence over the stops: w_ij = min(w_ij, w_ik + w_kj), with w_ij = T_ij + pace E_ij for flights that a full
    battery can make.
    """
    ways = np.where(need <= budget + 1e-12, time_s + pace_s * need, np.inf)
    diagonal = np.arange(time_s.shape[-1])
    ways[..., diagonal, diagonal] = 0.0
    for stop in stops:
        np.minimum(ways, ways[..., :, stop, None] + ways[..., None, stop, :], out=ways)
    return ways


def escapes(need: NDArray[np.float64], stops: NDArray[np.int64]) -> NDArray[np.float64]:
    """Charge from each place to the nearest stop, in the worst slot in which one can be reached; shape (modes, places)."""
    least = need[:, :, :, stops].min(axis=3)
    worst = np.where(np.isfinite(least), least, -np.inf).max(axis=1)
    worst = np.where(np.isfinite(worst), worst, np.inf)
    worst[:, stops] = 0.0
    return worst
