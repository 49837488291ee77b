"""Kernels of the chargers at the depot: jobs with deadlines on a few machines.

A tour that takes the energy e and leaves at d at the latest is a job of p(e) periods, done by period floor(d / period) - 1: it leaves after the last one. On
each charger jobs follow each other by deadline, without a break; no order is better there (Jackson 1955). So a schedule is a choice of a charger for each
job. Taken by deadline, a state is the time from which each charger is free. The states that are least late are kept, of those that are equally late the
least even ones: a long job fits onto a charger that is free early.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.planner.tours.label_kernels import travel_back

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.route_kernels import Plan


class Queue(NamedTuple):
    """Jobs, and states of the chargers."""

    job: NDArray[np.int64]
    """Shape (vehicles, 3): periods, deadline and route, by deadline."""
    free: NDArray[np.int64]
    """Shape (2, states, chargers): from when each charger is free, in order; before and after a job."""
    late: NDArray[np.int64]
    uneven: NDArray[np.int64]
    """Shape (2, states) each: how late jobs are in sum, and the sum of the squares of `free`."""
    came: NDArray[np.int64]
    """Shape (vehicles, states, 2): the state before a job, and when it begins."""


@compiled_lean
def job(tours: Tours, plan: Plan, route: int) -> tuple[int, int]:
    """Return the periods that a tour charges, and by which it must have.

    Takes a route of the plan, labelled by `relabel`.
    """
    energy = 0.0
    for position in range(plan.length[route] + 1):
        way = plan.way[route, position]
        energy += tours.ways.energy[way, 0] + plan.aboard[route, position] * tours.ways.lift[way, 0]
    low, line, last = plan.behind[route, 0, 0], plan.behind[route, 0, 1], plan.behind[route, 0, 2]
    _, _, last = travel_back(tours, plan.way[route, 0], plan.aboard[route, 0], low, line, last)
    return tours.depot.periods[int(np.ceil(energy - 1e-6))], int(np.floor(last / tours.depot.period + 1e-6)) - 1


@compiled_lean
def queue_up(tours: Tours, plan: Plan, queue: Queue) -> int:
    """Write the jobs of all tours by deadline; returns how many there are.

    Takes a plan whose routes are labelled, and a queue with room for all of them.
    """
    count = 0
    for route in range(len(plan.length)):
        if plan.length[route]:
            periods, by = job(tours, plan, route)
            at = count
            while at > 0 and queue.job[at - 1, 1] > by:
                for part in range(3):
                    queue.job[at, part] = queue.job[at - 1, part]
                at -= 1
            queue.job[at, 0], queue.job[at, 1], queue.job[at, 2] = periods, by, route
            count += 1
    return count


@compiled_lean
def offer(queue: Queue, side: int, states: int, number: int, before: int, charger: int, periods: int, by: int) -> int:
    """Put a job onto a charger of a state; the new state is kept where there is room, or a worse one; returns how many there are."""
    chargers = queue.free.shape[2]
    begin = queue.free[side, before, charger]
    end = begin + periods
    late = queue.late[side, before] + max(end - by, 0)
    uneven = queue.uneven[side, before] + end * end - begin * begin
    new = 1 - side
    worst = 0
    for one in range(states):
        if queue.late[new, one] == late and queue.uneven[new, one] == uneven:
            return states
        if (queue.late[new, one], -queue.uneven[new, one]) > (queue.late[new, worst], -queue.uneven[new, worst]):
            worst = one
    at = states
    if states == queue.free.shape[1]:
        if (late, -uneven) >= (queue.late[new, worst], -queue.uneven[new, worst]):
            return states
        at = worst
    else:
        states += 1
    queue.late[new, at], queue.uneven[new, at] = late, uneven
    queue.came[number, at, 0], queue.came[number, at, 1] = before, begin
    place = 0  # the chargers stay in order of when they are free
    for one in range(chargers):
        if one != charger and queue.free[side, before, one] <= end:
            queue.free[new, at, place] = queue.free[side, before, one]
            place += 1
    queue.free[new, at, place] = end
    place += 1
    for one in range(chargers):
        if one != charger and queue.free[side, before, one] > end:
            queue.free[new, at, place] = queue.free[side, before, one]
            place += 1
    return states


@compiled_lean
def schedule(queue: Queue, count: int) -> tuple[int, int]:
    """Schedule the jobs; returns how late they are in sum, and the number of the last state (`Queue.came` leads back from it).

    Takes the jobs that `queue_up` wrote, and their number.
    """
    chargers = queue.free.shape[2]
    side, states = 0, 1
    queue.late[0, 0] = queue.uneven[0, 0] = 0
    for charger in range(chargers):
        queue.free[0, 0, charger] = 0
    for number in range(count):
        grown = 0
        for state in range(states):
            for charger in range(chargers):
                if charger and queue.free[side, state, charger] == queue.free[side, state, charger - 1]:
                    continue
                grown = offer(queue, side, grown, number, state, charger, queue.job[number, 0], queue.job[number, 1])
        side, states = 1 - side, grown
    best = 0
    for state in range(1, states):
        if queue.late[side, state] < queue.late[side, best]:
            best = state
    return queue.late[side, best], best


@compiled_lean
def fits_as_listed(queue: Queue, count: int) -> bool:
    """Whether all jobs are done in time where each goes onto the charger that is free first."""
    chargers = queue.free.shape[2]
    for charger in range(chargers):
        queue.free[0, 0, charger] = 0
    for number in range(count):
        first = 0
        for charger in range(1, chargers):
            if queue.free[0, 0, charger] < queue.free[0, 0, first]:
                first = charger
        queue.free[0, 0, first] += queue.job[number, 0]
        if queue.free[0, 0, first] > queue.job[number, 1]:
            return False
    return True


@compiled_lean
def late_jobs(tours: Tours, plan: Plan, queue: Queue) -> float:
    """Return by how many periods tours are charged too late at the depot, in sum."""
    count = queue_up(tours, plan, queue)
    if fits_as_listed(queue, count):
        return 0.0
    late, _ = schedule(queue, count)
    return float(late)
