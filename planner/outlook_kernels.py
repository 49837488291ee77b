"""Compiled expectations over the forecast: how long a flight takes, and what charge it needs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.compiled import compiled
from models.flight_kernels import NEVER, leg

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.flight import Air


class Need(NamedTuple):
    """What decides whether a flight can be made.

    Attributes
    ----------
    soc_per_s, soc_fixed : float
        Cost of a flight with the package.
    empty_per_s, empty_fixed : float
        Cost of a flight without it.
    epsilon : float
        Share of the members that may need more.
    destination : int
        Node where the package is left.
    escapes : ndarray of int
        Segments of the flight on from a destination without pads; empty where none is needed.
    needs_escape : bool
        Whether one is needed.
    """

    soc_per_s: float
    soc_fixed: float
    empty_per_s: float
    empty_fixed: float
    epsilon: float
    destination: int
    escapes: NDArray[np.int64]
    needs_escape: bool


@compiled
def escape_cost(air: Air, member: int, need: Need, time_s: float) -> float:
    """Least charge that takes the empty drone from the destination to a station; infinite where none is in reach."""
    best = NEVER
    for segment in need.escapes:
        off, down = leg(air, member, segment, time_s)
        if down < NEVER:
            best = min(best, need.empty_fixed + need.empty_per_s * (down - off))
    return best


@compiled
def flight_outlook(
    air: Air, probability: NDArray[np.float64], need: Need, segment: int, node: int, time_s: float
) -> tuple[float, float, float]:
    """Expectation of a one-segment flight to `node` over the forecast.

    Returns
    -------
    mean_s : float
        Mean time from `time_s` to touch-down over the members that can fly at once; over those held by the wind when
        none can; infinite when none ever can.
    charge : float
        SoC that the flight takes (with the escape from the destination) in all but a share epsilon of the members.
    p_hold : float
        Probability that the wind holds it.
    """
    members = len(probability)
    charge = np.empty(members)
    now_mass = 0.0
    now_sum = 0.0
    held_mass = 0.0
    held_sum = 0.0
    for member in range(members):
        off, down = leg(air, member, segment, time_s)
        if down == NEVER:
            charge[member] = NEVER
            continue
        charge[member] = need.soc_fixed + need.soc_per_s * (down - off)
        if node == need.destination and need.needs_escape:
            charge[member] += escape_cost(air, member, need, down)
        if off <= time_s:
            now_mass += probability[member]
            now_sum += probability[member] * (down - time_s)
        else:
            held_mass += probability[member]
            held_sum += probability[member] * (down - time_s)
    if now_mass + held_mass <= 0.0:
        return NEVER, NEVER, 1.0
    mean = now_sum / now_mass if now_mass > 0.0 else held_sum / held_mass
    flown = now_mass + held_mass
    return mean, _quantile(charge, probability, flown * (1.0 - need.epsilon) - 1e-12), 1.0 - now_mass / flown


@compiled
def _quantile(values: NDArray[np.float64], probability: NDArray[np.float64], mass: float) -> float:
    """Least value at or below which at least `mass` lies; infinite values carry none."""
    greatest = -NEVER
    total = 0.0
    lightest = NEVER
    for k in range(len(values)):
        if values[k] < NEVER:
            greatest = max(greatest, values[k])
            total += probability[k]
            lightest = min(lightest, probability[k])
    if total - lightest < mass:  # the usual case: not even the lightest member can be left out
        return greatest
    share = 0.0
    for k in np.argsort(values):
        share += probability[k]
        if share >= mass:
            return values[k]
    return greatest


@compiled
def mean_flight(air: Air, probability: NDArray[np.float64], segment: int, time_s: float) -> float:
    """Mean time to touch-down over the members that can fly at once; over all where none can."""
    now_mass = 0.0
    now_sum = 0.0
    held_mass = 0.0
    held_sum = 0.0
    for member in range(len(probability)):
        off, down = leg(air, member, segment, time_s)
        if down == NEVER:
            continue
        if off <= time_s:
            now_mass += probability[member]
            now_sum += probability[member] * (down - time_s)
        else:
            held_mass += probability[member]
            held_sum += probability[member] * (down - time_s)
    if now_mass > 0.0:
        return now_sum / now_mass
    return held_sum / held_mass if held_mass > 0.0 else NEVER


@compiled
def wait_at(start_s: float, step_s: float, wait_s: NDArray[np.float64], node: int, time_s: float) -> float:
    """Expected wait of an arrival, linear between grid points."""
    x = (time_s - start_s) / step_s
    last = wait_s.shape[1] - 1
    if x <= 0.0:
        return wait_s[node, 0]
    if x >= last:
        return wait_s[node, last]
    k = int(math.floor(x))
    return wait_s[node, k] + (x - k) * (wait_s[node, k + 1] - wait_s[node, k])


class Graph(NamedTuple):
    """The network as kernels read it, and the expected waits at its nodes."""

    first: NDArray[np.int64]
    head: NDArray[np.int64]
    wait_start_s: float
    wait_step_s: float
    wait_s: NDArray[np.float64]


@compiled
def beyond(
    air: Air,
    direct: Air,
    probability: NDArray[np.float64],
    graph: Graph,
    need: Need,
    node: int,
    came_from: int,
    time_s: float,
    budget: float,
    remaining_factor: float,
) -> tuple[float, float]:
    """Look from a station to the next-to-adjacent ones (Algorithm 1, line 12).

    Returns
    -------
    time_s : float
        Least of E[flight node to m] + E[wait at m] + `remaining_factor` E[flight m to destination], over stations m in
        reach with `budget` of charge; infinite where there is none.
    charge : float
        Charge that the flight to that m takes.
    """
    best, charge = NEVER, NEVER
    for segment in range(graph.first[node], graph.first[node + 1]):
        other = graph.head[segment]
        if other == came_from:
            continue
        mean, taken, _ = flight_outlook(air, probability, need, segment, other, time_s)
        if taken > budget:
            continue
        total = mean
        if other != need.destination:
            there = time_s + mean
            total += wait_at(graph.wait_start_s, graph.wait_step_s, graph.wait_s, other, there)
            total += remaining_factor * mean_flight(direct, probability, other, there)
        if total < best:
            best, charge = total, taken
    return best, charge
