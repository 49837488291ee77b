"""Simulated deliveries in parts, by one process or many: the same deliveries, bit for bit, for any number of processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from skyway.models.compute.spreading import spread
from skyway.planner.evaluation.decisions import fly_policy
from skyway.planner.evaluation.flights import Flown, fly_charging, fly_itinerary, pooled
from skyway.planner.robust.charge_policy import ChargePolicy

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.planner.evaluation.policies import Adaptive, Policy
    from skyway.planner.evaluation.realizations import Realizations
    from skyway.planner.schedule.itinerary import Itinerary

    Flying: TypeAlias = Itinerary | ChargePolicy | Policy | Adaptive

PART = 1000
"""Deliveries of a part that are flown at once."""


@dataclass(frozen=True, slots=True)
class _Task:
    """What all parts have in common."""

    realizations: Realizations
    drone: str
    flying: Flying


def fly_parts(
    realizations: Realizations,
    drone: str,
    flying: Flying,
    *,
    workers: int = 1,
    cluster: str | None = None,
    told: Callable[[int, int, float], None] | None = None,
) -> Flown:
    """Fly an itinerary, a route that charges by what is known, or a policy in all realizations.

    Parameters
    ----------
    realizations : Realizations
        Whatever a run meets depends on itself alone.
    drone : str
        Of the fleet.
    flying : Itinerary, ChargePolicy, Policy or Adaptive
        A policy decides run by run, so that each is a part; others are flown `PART` runs at a time.
    workers : int
        Processes of this machine.
    cluster : str, optional
        Scheduler of a Dask cluster in place of them.
    told : callable, optional
        Is told deliveries done, deliveries in all, and about how long the rest takes, s.
    """
    count = len(realizations)
    size = PART if isinstance(flying, tuple | ChargePolicy) else 1
    parts = [(begin, min(begin + size, count)) for begin in range(0, count, size)]

    def said(done: int, _: int, left_s: float) -> None:
        if told is not None:
            told(min(done * size, count), count, left_s)

    task, processes = _Task(realizations, drone, flying), min(workers, len(parts))
    return pooled(spread(_fly_part, parts, common=task, workers=processes, cluster=cluster, told=said))


def _fly_part(task: _Task, part: tuple[int, int]) -> Flown:
    """Fly some of the runs."""
    some = task.realizations.part(*part)
    if isinstance(task.flying, tuple):
        return fly_itinerary(some, task.drone, task.flying)
    if isinstance(task.flying, ChargePolicy):
        return fly_charging(some, task.drone, task.flying)
    return fly_policy(some, task.drone, task.flying)[0]
