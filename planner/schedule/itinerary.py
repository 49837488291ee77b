"""Itineraries: a planner's decisions, flown through a forecast."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import weighted_quantile
from skyway.models.queues.paths import no_queue, pack
from skyway.planner.problem.kernel_inputs import check_itinerary, check_runs
from skyway.planner.schedule.gust_kernels import no_disturbance
from skyway.planner.schedule.no_route import grounded_leg, never_leaves
from skyway.planner.schedule.schedule_kernels import (
    TAKE_OFF,
    TOUCH_DOWN,
    Legs,
    Queues,
    Waits,
    fly_under,
    no_queues,
)
from skyway.planner.schedule.shut_kernels import Shut

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.paths import PackedPaths, QueuePath
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.gust_kernels import Disturbance

SAMPLES_PER_MEMBER = 8
"""Sampled queues that each member of the forecast is flown with."""
TYPICAL_SLOTS = 8
"""Slots of the forecast in which the winds of members are compared for the typical schedule."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One flight and the stop before it."""

    segments: tuple[int, ...]
    """Segments flown, without a landing between."""
    charge_to: float | None = None
    """Charge at the stop before; None uses no pad."""
    not_before_s: float = -math.inf
    """Stay at the stop before at least until then, POSIX seconds."""


Itinerary = tuple[Leg, ...]


def fly_expected(problem: Problem, itinerary: Itinerary) -> NDArray[np.float64]:
    """Fly an itinerary in every member with expected waits, shape (members, legs, 7); see `schedule_kernels`."""
    nodes = stop_nodes(problem, itinerary)
    problem.waits.need(nodes)
    waits = Waits(problem.waits.start_s, problem.waits.step_s, problem.waits.wait_s[nodes])
    members = np.arange(len(problem.probability))
    return fly_as_it_stands(problem, itinerary, members, no_disturbance(len(members)), None, waits)


def fly_sampled(
    problem: Problem, itinerary: Itinerary, samples: int = SAMPLES_PER_MEMBER
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fly an itinerary in every member with sampled queues: (runs, shape (runs, legs, 7); probability, shape (runs,))."""
    nodes = place_nodes(problem, itinerary)
    sets = problem.queue_sets(nodes, range(samples))
    paths = pack([found[node] for node in nodes for found in sets])
    members = np.repeat(np.arange(len(problem.probability)), samples)
    disturbance = no_disturbance(len(members))._replace(queue=np.tile(np.arange(samples), len(problem.probability)))
    runs = fly_as_it_stands(problem, itinerary, members, disturbance, paths)
    return runs, np.repeat(problem.probability / samples, samples)


def fly_true(problem: Problem, itinerary: Itinerary, queues: Mapping[int, QueuePath]) -> NDArray[np.float64]:
    """Fly an itinerary in the first member with given queues, shape (1, legs, 7)."""
    paths = pack([queues.get(node) or no_queue() for node in place_nodes(problem, itinerary)])
    return fly_as_it_stands(problem, itinerary, np.zeros(1, dtype=np.int64), no_disturbance(1), paths)


def place_nodes(problem: Problem, itinerary: Itinerary) -> list[int]:
    """Nodes whose queues a delivery meets: the stop before each leg, and the end of the last leg."""
    return [*stop_nodes(problem, itinerary), int(problem.network.head[itinerary[-1].segments[-1]])]


def stop_nodes(problem: Problem, itinerary: Itinerary) -> list[int]:
    """Node of the stop before each leg; an `InputError` if the itinerary is invalid."""
    check_itinerary(problem.network, itinerary)
    return [int(problem.network.tail[leg.segments[0]]) for leg in itinerary]


def fly_as_it_stands(
    problem: Problem,
    itinerary: Itinerary,
    members: NDArray[np.int64],
    disturbance: Disturbance,
    paths: PackedPaths | None,
    waits: Waits | None = None,
) -> NDArray[np.float64]:
    """Fly an itinerary in members, shape (runs, legs, 7).

    With sampled queues: sets named by `disturbance`, paths in order (place, set); without any, with expected waits.
    """
    start = (float(problem.depart_s), float(problem.soc))
    cost = (float(problem.soc_per_s), float(problem.soc_fixed))
    legs = legs_of(problem, itinerary)
    check_runs(members, len(problem.air.north), disturbance, paths, len(itinerary) + 1)
    queues = no_queues() if paths is None else Queues.of(paths)
    waits = waits or Waits(0.0, 1.0, np.zeros((len(itinerary), 1)))
    schedule = fly_under(disturbance, problem.air, members, legs, queues, waits, start, cost)
    schedule[held_in_the_air(problem, schedule)] = math.inf
    return schedule


def held_in_the_air(problem: Problem, schedule: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the runs in which the wind prevents an immediate start although the drone is in the air and cannot hold, shape (runs,)."""
    late = schedule[:, 0, TAKE_OFF] > problem.depart_s + 1e-3
    return np.asarray(late if problem.in_flight else np.zeros_like(late))


def legs_of(problem: Problem, itinerary: Itinerary) -> Legs:
    """Lay an itinerary out as arrays for `schedule_kernels`."""
    stops = stop_nodes(problem, itinerary)
    offset = np.cumsum([0, *(len(leg.segments) for leg in itinerary)])
    curve_s, curve_soc = problem.padded_curves
    kinds = problem.curve_of[stops]
    return Legs(
        offset=offset.astype(np.int64),
        segments=np.array([segment for leg in itinerary for segment in leg.segments], dtype=np.int64),
        charge_to=np.array([math.nan if leg.charge_to is None else leg.charge_to for leg in itinerary]),
        not_before_s=np.array([leg.not_before_s for leg in itinerary], dtype=np.float64),
        curve_s=curve_s[kinds],
        curve_soc=curve_soc[kinds],
        has_pads=np.array([problem.has_pads(node) for node in stops], dtype=np.bool_),
        shut=shut_at(problem, place_nodes(problem, itinerary)),
    )


def shut_at(problem: Problem, nodes: Sequence[int]) -> Shut:
    """Lay out for kernels when some places are closed."""
    if not problem.closures and math.isinf(problem.earliest_s):
        return Shut(np.zeros(len(nodes) + 1, dtype=np.int64), np.empty((0, 2)), np.zeros(len(nodes), dtype=np.bool_))
    closed = [problem.closures[node].closed_s if node in problem.closures else np.empty((0, 2)) for node in nodes]
    barred = [problem.no_landing(node) for node in nodes]
    closed = [one if bar is None else bar.closed_s for one, bar in zip(closed, barred, strict=True)]
    return Shut(
        np.cumsum([0, *map(len, closed)]).astype(np.int64),
        np.ascontiguousarray(np.concatenate(closed)),
        np.array([bar is not None for bar in barred], dtype=np.bool_),
    )


def typical_member(problem: Problem, itinerary: Itinerary) -> tuple[int, NDArray[np.float64]]:
    """Member for the typical schedule, and that schedule with expected waits, shape (legs, 7).

    Of the tenth of the members whose arrival is nearest to the median arrival, the one whose wind is nearest to that of
    all the others (least mean vector distance over the first hours). Raises a `NoRouteError` if no member lets the drone
    arrive.
    """
    runs = fly_expected(problem, itinerary)
    arrival = runs[:, -1, TOUCH_DOWN]
    arrives = np.flatnonzero(np.isfinite(arrival))
    if not len(arrives):
        raise never_leaves(problem, itinerary, grounded_leg(runs))
    middle = weighted_quantile(arrival[arrives], problem.probability[arrives], 0.5)
    off = np.abs(arrival[arrives] - middle)
    near = arrives[off <= np.sort(off)[max(1, len(arrives) // 10) - 1] + 1.0]
    air = problem.air
    wind = (air.north + 1j * air.east)[:, :TYPICAL_SLOTS].reshape(len(air.north), -1)
    distance = [float(problem.probability @ np.abs(wind - wind[member]).mean(axis=1)) for member in near]
    member = int(near[int(np.argmin(distance))])
    return member, runs[member]
