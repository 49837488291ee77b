"""Routes of free order on a plane: units that may be flown from either end, pads about them, winds that change."""

import math

import numpy as np

from skyway.models.flight.kernels import Slots
from skyway.planner.fixed_route.charging_stops import FixedRoute
from skyway.planner.fixed_route.orders import FreeOrder, Stretch
from skyway.planner.fixed_route.way_kernels import Hops

SLOT_S = 90.0


def free_order(seed, *, units=3, slots=1, pads=2, two_groups=False):
    """Units as places and lines on a plane, some of which may be flown from their end, in winds that change by slot."""
    rng = np.random.default_rng(seed)
    per_s = float(rng.uniform(0.0015, 0.004))
    wind = rng.uniform(0.8, 1.3, slots)
    home = rng.uniform(-20.0, 20.0, 2)
    stands = rng.uniform(-60.0, 60.0, (pads, 2))
    lines = rng.uniform(-60.0, 60.0, (units, 2, 2))

    def times(one, other):
        """By slot, at 1 m/s and slower or faster in the winds."""
        away = np.linalg.norm(np.asarray(one)[:, None] - np.asarray(other)[None, :], axis=-1) + 2.0
        return away[None] * wind[:, None, None]

    def stretch(spots):
        spots = np.asarray(spots)
        work_s = np.stack([times(spots[:-1], spots[1:])[:, one, one] for one in range(len(spots) - 1)], axis=1)
        to_s, from_s = times(spots, stands) + 1.0, np.swapaxes(times(stands, spots), 1, 2) + 2.0
        leave = np.ones(len(spots), dtype=bool)
        return Stretch(work_s, work_s * per_s, to_s, to_s * per_s, from_s, from_s * per_s, leave)

    def points(begin, end):
        return [begin, (begin + end) / 2.0, end]

    turns = []
    for begin, end in lines:
        turns += [stretch(points(begin, end)), stretch(points(end, begin)) if rng.random() < 0.6 else None]
    ends = [spot for begin, end in lines for spot in (end, begin)] + [home]
    begins = [spot for begin, end in lines for spot in (begin, end)] + [home]
    way_s = times(ends, begins)
    there_is = np.array([one is not None for one in turns] + [True])
    way_s[:, ~there_is, :] = math.inf
    way_s[:, :, ~there_is] = math.inf
    way_soc = np.where(np.isfinite(way_s), way_s, 0.0) * per_s
    between = times(stands, stands)
    none = np.zeros((slots, 0))
    hops = Hops(
        none, none, np.zeros((slots, 1, pads)), np.zeros((slots, 1, pads)), np.zeros((slots, 1, pads)),
        np.zeros((slots, 1, pads)), between, between * per_s, np.arange(1),
    )  # fmt: skip
    curves = []
    for _ in range(pads):
        knee, fast = rng.uniform(0.5, 0.9), rng.uniform(30.0, 90.0)
        curves.append((np.array([0.0, fast, fast * rng.uniform(1.5, 3.0)]), np.array([0.0, knee, 1.0])))
    waits = tuple(np.array([[0.0, float(wait)]]) for wait in rng.choice([0.0, 0.0, 5.0], pads))
    mean = float(rng.uniform(0.9, 1.1))
    route = FixedRoute(
        hops,
        Slots(0.0, SLOT_S, slots),
        np.ones(1, dtype=bool),
        tuple(curves),
        waits,
        0.0,
        float(rng.uniform(0.5, 1.0)),
        0.1,
        mean,
        mean * float(rng.uniform(1.0, 1.3)),
    )
    inside = stretch([home, home])
    groups = tuple(one // 2 for one in range(units)) if two_groups else (0,) * units
    return FreeOrder(route, inside, inside, tuple(turns), groups, way_s, way_soc, (1,) * pads)
