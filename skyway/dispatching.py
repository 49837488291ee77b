"""Dispatching as it is asked for: files of orders and drones become a plan for a fleet, and bookings in a ledger."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

from skyway.models.base.units import iso
from skyway.models.ledger.ledger import TakenError
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.files import read_orders, read_vehicles
from skyway.models.orders.fitting import fit
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.dispatch.result import SCHEMA, DispatchPlan

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime
    from pathlib import Path
    from typing import Any

    from skyway.models.ledger.ledger import Hold, Lease, Ledger
    from skyway.models.orders.fitting import Work
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters

ROUNDS = 5
"""How often it is planned anew because another holder has booked a pad meanwhile."""
LEASE_S = 3600.0


def read_work(scenario: Scenario, orders: Path, fleet: Path) -> Work:
    """Read orders and drones and find them in a scenario; an `InputError` lists what is wrong."""
    return fit(scenario, read_orders(orders), read_vehicles(fleet))


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
) -> DispatchPlan:
    """Plan for a fleet; with a ledger, around what others hold there, and booked in it order by order.

    What the holder booked for the same orders before is replaced. Where another one books a pad first, it is planned anew around that.
    """

    def planned(holds: Sequence[Hold]) -> DispatchPlan:
        return dispatch(
            work, depart, forecast=forecast, holds=holds, reserve=reserve, time_limit_s=time_limit_s,
            iterations=iterations, seed=seed, parameters=parameters,
        )  # fmt: skip

    if ledger is None:
        return planned(())
    with open_ledger(ledger) as book:
        lease = book.acquire(holder, f"{socket.gethostname()} {os.getpid()}", LEASE_S)
        ids = {one.id for one in work.orders}
        for number in range(ROUNDS):
            others = [one for one in book.holds(begin=depart) if one.holder != holder or one.itinerary not in ids]
            plan = planned(others)
            lease = book.renew(lease, LEASE_S)
            try:
                _book(book, lease, plan)
            except TakenError:
                if number == ROUNDS - 1:
                    _give_up(book, lease, ids)
                    raise
            else:
                return plan
    raise AssertionError


def _book(book: Ledger, lease: Lease, plan: DispatchPlan) -> None:
    """Book the pads of each order; what was booked for the orders before is given up first."""
    _give_up(book, lease, {one.order for one in plan.answers})
    for one in plan.answers:
        if one.windows:
            book.book(lease, one.order, one.windows)


def _give_up(book: Ledger, lease: Lease, ids: set[str]) -> None:
    """Release what the holder has booked for some orders and not begun to use."""
    mine = {hold.itinerary for hold in book.holds() if hold.holder == lease.holder and hold.itinerary in ids}
    for itinerary in sorted(mine):
        book.mark(lease, itinerary, "released")


def document_of(plan: DispatchPlan) -> dict[str, Any]:
    """Return a plan as JSON values (``skyway.dispatch/1``)."""
    return {
        "schema": SCHEMA,
        "depart": iso(plan.depart),
        "served": plan.served,
        "refused": len(plan.answers) - plan.served,
        "late": plan.late,
        "cost_s": plan.cost_s,
        "bound_s": plan.bound_s,
        "energy_j": plan.energy_j,
        "iterations": plan.iterations,
        "planning_time_s": plan.planning_time_s,
        "orders": [
            {
                "id": one.order,
                "status": one.status,
                "drone": one.drone,
                "fetched": None if one.fetched is None else iso(one.fetched),
                "delivered": None if one.delivered is None else iso(one.delivered),
                "late_s": one.late_s,
                "reason": one.reason,
            }
            for one in plan.answers
        ],
        "drones": [
            {
                "id": route.drone,
                "type": route.type,
                "orders": route.orders,
                "steps": [
                    {
                        "kind": one.kind,
                        "order": one.order,
                        "phase": one.phase,
                        "from": one.origin,
                        "to": one.destination,
                        "pad": one.pad,
                        "begin": iso(one.begin),
                        "end": iso(one.end),
                        "soc_begin": one.soc_begin,
                        "soc_end": one.soc_end,
                    }
                    for one in route.steps
                ],
            }
            for route in plan.routes
        ],
    }
