"""A bound of the arrival at once: the way flown in the best hours, as if a drone could land, charge and go on anywhere.

Let U be the direction from the origin to the destination and D their distance along it. In slot k a drone gets on along U by no more than

    v_k = min(S + max over sites s of w_ks . U, greatest ground speed),    0 where every wind between the sites is over the limit

a second, with S its airspeed and w_ks the wind there. To fly f seconds it needs, besides, a climb and a descent for each battery, and to charge what
that takes: N(f) seconds. So it does not arrive before the first T for which the f best seconds until T, f + N(f) = T, bring it D.
Waits, pads and where stations stand are forgotten; the wind of each hour and the battery are not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.planner.exact.stop_labels import costs_of, longest_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Costs
    from skyway.planner.problem.problem import Problem

_STRAIGHT = 0.995
"""No way along geodesics is shorter than this share of the straight line."""
_ROUNDS = 26
_EARTH_M = 6.35e6


def fluid_bound_s(problem: Problem) -> NDArray[np.float64]:
    """Return a time for each member before which no delivery in its wind arrives, gusts aside, POSIX seconds, shape (members,)."""
    p, costs = problem, costs_of(problem, 0.0)
    ends = [p.origin, p.destination]
    place = geodesy.earth_xyz(np.column_stack((p.network.lat[ends], p.network.lon[ends])))
    distance_m = _STRAIGHT * float(np.linalg.norm(place[1] - place[0]))
    rate, slot_s = _along(p), p.air.slot_s
    begin_s = p.air.start_s + slot_s * np.arange(rate.shape[1])
    low = np.full(len(rate), float(p.depart_s))
    high = low + 4.0 * (begin_s[-1] + slot_s - p.depart_s)
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        ends_s = np.append(begin_s[1:], np.inf)
        inside = np.clip(np.minimum(ends_s, middle[:, None]) - np.maximum(begin_s, p.depart_s), 0.0, None)
        reached = _best(rate, inside, _flown_s(p, costs, middle - p.depart_s)) >= distance_m
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return np.asarray(np.maximum(low, p.earliest_s))


def _along(problem: Problem) -> NDArray[np.float64]:
    """Greatest speed from the origin towards the destination in each slot of each member, m/s, shape (members, slots)."""
    p, air = problem, problem.air
    lat, lon = p.network.lat, p.network.lon
    o, d = p.origin, p.destination
    _, bearing = geodesy.inverse(lat[[o]], lon[[o]], lat[[d]], lon[[d]])
    angle = float(np.radians(bearing[0]))
    # North and east turn over the network, by the angle that its radius is seen under and by how meridians come together.
    far_m = geodesy.coarse_distance_m(float(lat[o]), float(lon[o]), lat, lon).max()
    turn = float(far_m) / _EARTH_M * (1.0 + float(np.abs(np.tan(np.radians(lat))).max()))
    factor = air.weight.sum(axis=1)
    least, most = float(factor.min(initial=np.inf)), float(factor.max(initial=0.0))
    strength = np.hypot(air.north, air.east)
    tail = (air.north * np.cos(angle) + air.east * np.sin(angle) + turn * strength).max(axis=2)
    along = air.airspeed_mps + np.where(tail > 0.0, most, least) * tail
    rate = np.clip(along, 0.0, air.max_ground_speed_mps)
    # Every wind between the sites is at least as strong as the weakest one seen along their mean.
    north, east = air.north.mean(axis=2, keepdims=True), air.east.mean(axis=2, keepdims=True)
    size = np.maximum(np.hypot(north, east), 1e-9)
    weakest = least * ((air.north * north + air.east * east) / size).min(axis=2)
    shut = air.shut[: rate.shape[1]].all(axis=1)
    return np.where((weakest > air.wind_limit_mps) | shut, 0.0, rate)


def _flown_s(problem: Problem, costs: Costs, span_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for how long a drone can cruise within so many seconds at most, charged as fast as can be."""
    battery_s = max(longest_s(problem) - costs.landing_s, 1.0)
    fixed = min(costs.soc_fixed, 0.0)
    low, high = np.zeros_like(span_s), np.maximum(span_s, 0.0)
    for _ in range(_ROUNDS):
        cruise = 0.5 * (low + high)
        flights = np.maximum(np.ceil(cruise / battery_s - 1e-9), 1.0)
        aloft = cruise + flights * costs.landing_s
        taken = costs.reserve + costs.soc_per_s * aloft + fixed * flights - problem.soc
        enough = aloft + np.maximum(taken, 0.0) / costs.rate_per_s <= span_s
        low, high = np.where(enough, cruise, low), np.where(enough, high, cruise)
    return np.asarray(high)


def _best(
    rate: NDArray[np.float64], inside_s: NDArray[np.float64], flown_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far the best seconds bring a drone, m: `rate` and `inside_s`, shape (members, slots), of which it flies `flown_s`."""
    order = np.argsort(-rate, axis=1)
    rate, inside_s = np.take_along_axis(rate, order, axis=1), np.take_along_axis(inside_s, order, axis=1)
    until = np.minimum(np.cumsum(inside_s, axis=1), flown_s[:, None])
    return np.asarray((np.diff(until, axis=1, prepend=0.0) * rate).sum(axis=1))
