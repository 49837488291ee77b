"""The way on from a target without pads: the charge reserved for it, and its simulation.

The charge is sufficient by the forecast in all but a share epsilon of cases, as that of every flight
(`planner.robust.required_soc_kernels`), as known at the departure; it is simulated in the same realizations as the way out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import slot_of
from skyway.planner.robust.free_capacity import blocking_probabilities
from skyway.planner.robust.information_kernels import energy_belief_after
from skyway.planner.robust.required_soc_kernels import flight_energy
from skyway.planner.schedule.itinerary import Leg, fly_expected
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from numpy.typing import NDArray

    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.information_kernels import Known
    from skyway.planner.schedule.gust_kernels import Disturbance
    from skyway.planner.schedule.itinerary import Itinerary

    Fly: TypeAlias = Callable[
        [Problem, Itinerary, Disturbance, NDArray[np.int64], PackedPaths, float], NDArray[np.float64]
    ]

_LATEST_H = 12.0
_TOGETHER_S = 600.0
"""Ways on that begin within this time are simulated together, s."""
_FRESH_GUSTS = np.uint64(0x9E3779B97F4A7C15)


def way_on_energy(problem: Problem, known: Known, time_s: float) -> tuple[float, tuple[int, ...]]:
    """Return the charge of the best way on that begins at a time, and that way; infinite in winds that forbid all of them.

    The best way is that of least charge, of those to stations that probably have a free place, if there are any.

    Computed once for each slot of the forecast.
    """
    air = problem.air
    slot = int(slot_of(air, time_s))
    found = problem.onward_energies.get((slot, known.epsilon))
    if found is None:
        unseen = known._replace(measured=False, smoothing=0.0)
        expected, deviation = energy_belief_after(known, 0.0, 0)
        still = np.zeros(air.north.shape[2])
        per_s, fixed = problem.onward_cost
        begin = max(time_s, air.start_s + slot * air.slot_s)
        full = blocking_probabilities(problem)
        often = problem.parameters.robust.full_share * problem.epsilon
        ways: list[tuple[bool, float, tuple[int, ...]]] = []
        for way in problem.ways_on:
            segments = np.array(way, dtype=np.int64)
            cost = float(per_s), float(fixed)
            energy = expected * float(flight_energy(unseen, 0, segments, begin, still, still, cost, deviation)[0])
            crowded = bool(full[problem.network.head[way[-1]]] > often)
            ways.append((crowded or not math.isfinite(energy), energy, way))
        found = min(ways, default=(True, math.inf, ()))[1:]
        problem.onward_energies[slot, known.epsilon] = found
    return found


def kept_for_way_on(problem: Problem, itinerary: Itinerary, known: Known) -> float:
    """Return the charge reserved for the way on after an itinerary: the greatest of the hours in which it arrives by the forecast.

    Hours in which no wind permits the departure do not count: it waits on the ground. More than a full battery if there are no other hours.
    """
    arrival = fly_expected(problem, itinerary)[:, -1, TOUCH_DOWN]
    arrival = arrival[np.isfinite(arrival)]
    latest = problem.depart_s + _LATEST_H * S_PER_H
    first, last = (float(arrival.min()), float(arrival.max())) if len(arrival) else (problem.depart_s, latest)
    dwell, slot_s = problem.request.dwell_s, problem.air.slot_s
    times = [*np.arange(first, min(last, max(latest, first)), slot_s), last]
    found = [way_on_energy(problem, known, float(time) + dwell)[0] for time in times]
    return max((one for one in found if math.isfinite(one)), default=2.0)


def fly_on(
    problem: Problem,
    known: Known,
    arrival_s: NDArray[np.float64],
    members: NDArray[np.int64],
    disturbance: Disturbance,
    sample_set: int,
    fly: Fly,
) -> NDArray[np.float64]:
    """Return the charge of the way on in realizations, shape (runs,): 0 for runs that never arrive, or never leave again.

    Each takes the way of least charge by the forecast of its hour, when the wind and the free capacity at its end permit it: until then it stands at
    the target; `fly` simulates one flight of that charge, as a `ChargePolicy` does: shape (runs, 1, 7). The vehicle's energy is that of the last column of the disturbance.
    """
    taken = np.zeros(len(arrival_s))
    off = arrival_s + problem.request.dwell_s
    together = np.where(np.isfinite(off), np.floor((off - problem.depart_s) / _TOGETHER_S), -1.0)
    for group in np.unique(together[together >= 0.0]).tolist():
        runs = np.flatnonzero(together == group)
        begin = float(off[runs].mean())
        needed, way = way_on_energy(problem, known, begin)
        way = way or next(iter(problem.ways_on), ())
        if not way:
            taken[runs] = 2.0
            continue
        end = int(problem.network.head[way[-1]])
        leaving = problem.standing_at(problem.destination, begin, 1.0).bound_for(end)
        leaving.request = replace(problem.request, escape=False)
        leaving.soc_per_s, leaving.soc_fixed = problem.onward_cost
        sky = disturbance._replace(
            queue=disturbance.queue[runs],
            energy=np.ascontiguousarray(disturbance.energy[runs, -1:]),
            gust_key=disturbance.gust_key[runs] ^ _FRESH_GUSTS,
        )
        paths = problem.many_queues(
            [problem.destination, end], sample_set, int(disturbance.queue.max()) + 1
        )  # as in the simulation of the way out
        needed = needed if math.isfinite(needed) else 1.0
        landed = fly(leaving, (Leg(way),), sky, members[runs], paths, needed)[:, -1, SOC_LANDING]
        taken[runs] = np.where(np.isfinite(landed), 1.0 - landed, 0.0)
    return taken
