"""A plan for a fleet with its promises, booked in a ledger around what others hold there."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

from skyway.models.base.errors import refuse
from skyway.models.ledger.ledger import MAX_LEASE_S, TakenError, itinerary_of
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.rows import fault_at
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.promises.promises import promised

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import datetime

    from skyway.models.ledger.ledger import Hold, Lease, Ledger
    from skyway.models.orders.fitting import Work
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.result import DispatchPlan
    from skyway.planner.parameters.planner import PlannerParameters

ROUNDS = 5
"""How often it is replanned because another holder has booked a pad meanwhile."""
LEASE_S = 600.0
"""How long pads are booked in a holder's name by one process at least, beyond thrice the time of the search."""


def plan_fleet(
    work: Work,
    depart: datetime,
    forecast: WindEnsemble,
    parameters: PlannerParameters,
    *,
    reserve: float,
    time_limit_s: float,
    iterations: int = 10**9,
    seed: int = 0,
    ledger: str | None = None,
    holder: str = "dispatch",
    seen: PadsSeen = NOTHING_SEEN,
) -> DispatchPlan:
    """Plan for a fleet, and give each order its probability; with a ledger, around what others hold there, and booked in it order by order.

    What the holder booked for the same orders before is replaced. Where another one books a pad first, it is replanned around that.
    """

    def planned(holds: Sequence[Hold]) -> DispatchPlan:
        plan = dispatch(
            work, depart, forecast=forecast, holds=holds, reserve=reserve, time_limit_s=time_limit_s,
            iterations=iterations, seed=seed, parameters=parameters, seen=seen,
        )  # fmt: skip
        return promised(work, plan, forecast, parameters, reserve=reserve, seed=seed, holds=holds, seen=seen)

    return booked(planned, work, depart, ledger=ledger, holder=holder, time_limit_s=time_limit_s)


def booked(
    planned: Callable[[Sequence[Hold]], DispatchPlan], work: Work, depart: datetime, *, ledger: str | None, holder: str, time_limit_s: float
) -> DispatchPlan:  # fmt: skip
    """Return what is planned around what others hold; with a ledger, it is booked there."""
    if ledger is None:
        return planned(())
    ids = {one.id for one in work.orders}
    lasts_s = min(LEASE_S + 3.0 * time_limit_s, MAX_LEASE_S)
    with open_ledger(ledger) as book:
        lease = book.acquire(holder, f"{socket.gethostname()} {os.getpid()}", lasts_s)
        try:
            _refuse_under_way(book, work, holder)
            for number in range(ROUNDS):
                others = [one for one in book.holds(begin=depart) if one.holder != holder or one.name not in ids]
                plan = planned(others)
                lease = book.renew(lease, lasts_s)
                try:
                    _book(book, lease, plan)
                except TakenError:
                    if number == ROUNDS - 1:
                        _give_up(book, lease, ids)
                        raise
                else:
                    return plan
        finally:
            book.give_back(lease)
    raise AssertionError


def _refuse_under_way(book: Ledger, work: Work, holder: str) -> None:
    """Refuse orders whose drone stands on a pad already: their bookings must not be given up."""
    begun = {hold.name for hold in book.holds() if hold.holder == holder and hold.state in ("in use", "late")}
    remedy = "remove it: flights under way are not replanned"
    refuse([fault_at(one.source, "id", "is under way", one.id, remedy) for one in work.orders if one.id in begun])


def _book(book: Ledger, lease: Lease, plan: DispatchPlan) -> None:
    """Book the pads of each order; what was booked for the orders before is given up first."""
    _give_up(book, lease, {one.order for one in plan.answers})
    for one in plan.answers:
        if one.windows:
            book.book(lease, itinerary_of(lease.holder, one.order), one.windows)


def _give_up(book: Ledger, lease: Lease, ids: set[str]) -> None:
    """Release what the holder has booked for some orders."""
    mine = {hold.itinerary for hold in book.holds() if hold.holder == lease.holder and hold.name in ids}
    for itinerary in sorted(mine):
        book.mark(lease, itinerary, "released")
