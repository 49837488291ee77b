"""A plan for a fleet as tables: orders, drones, and its quality."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import UNKNOWN, clock, date_clock, duration, percent, spent, watt_hours

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.orders.fitting import Work
    from skyway.planner.dispatch.result import DispatchPlan, Route

SHOWN = 60
"""Rows of each table; all are in the JSON."""


def print_dispatch(work: Work, plan: DispatchPlan) -> None:
    """Print a plan."""
    zone = ZoneInfo(work.scenario.timezone)
    orders = {one.id: one for one in work.orders}
    refused = len(plan.answers) - plan.served
    say(f"From {date_clock(plan.depart, zone)}: {plan.served} of {len(plan.answers)} orders served, {plan.late} late, {refused} refused; "
        f"{len(plan.routes)} of {len(work.vehicles)} drones used.")  # fmt: skip
    say("")
    simulated = plan.below_reserve is not None
    promises = [Column("in time"), Column("by 95 %")] if simulated else []
    columns = [Column("order", justify="left"), Column("from", justify="left"), Column("to", justify="left"), Column("due"), Column("drone", justify="left"),
               Column("fetched"), Column("delivered"), Column("spare"), *promises, Column("reason", justify="left")]  # fmt: skip
    sheet = Sheet(columns, names=1)
    for answer in plan.answers[:SHOWN]:
        order = orders[answer.order]
        times, spare, chance = ["", ""], "", [""] * len(promises)  # a refused order has none of them
        if answer.fetched is not None and answer.delivered is not None:
            times = [clock(one, zone, plan.depart) for one in (answer.fetched, answer.delivered)]
            spare = duration((order.due - answer.delivered).total_seconds(), signed=True)
        if answer.outlook is not None:
            late = answer.outlook.p95
            chance = [percent(answer.outlook.chance), UNKNOWN if late is None else clock(late, zone, plan.depart)]
        sheet.add(order.id, order.origin, order.destination, _due(order.due, zone, plan.depart), answer.drone or "", *times, spare, *chance, answer.reason or "")  # fmt: skip
    sheet.show()
    if len(plan.answers) > SHOWN:
        say(f"… and {len(plan.answers) - SHOWN} more orders: --json has them all")
    say("")
    routes = Sheet([Column("drone", justify="left"), Column("orders", justify="left"), Column("stops", justify="left"), Column("flying"), Column("on pads"),
                    Column("home"), Column("charge")], names=1)  # fmt: skip
    for route in plan.routes[:SHOWN]:
        flown, charged = (sum((one.end - one.begin).total_seconds() for one in route.steps if one.kind == kind) for kind in ("fly", "charge"))  # fmt: skip
        last = route.steps[-1]
        routes.add(route.drone, ", ".join(route.orders), _stops(route), duration(flown), duration(charged), clock(last.end, zone, plan.depart), percent(last.soc_end))  # fmt: skip
    routes.show()
    if len(plan.routes) > SHOWN:
        say(f"… and {len(plan.routes) - SHOWN} more drones")
    say("")
    stated = [one.outlook.chance for one in plan.answers if one.outlook is not None]
    if stated and plan.below_reserve is not None:
        say(
            f"Simulated in many realizations: {percent(sum(stated) / len(stated))} of the served orders are in time, "
            f"{percent(plan.below_reserve, 2)} of the landings are below the reserve."
        )
    bound = ""
    if plan.bound_s > 0.0:
        gap = (plan.cost_s - plan.bound_s) / plan.bound_s
        bound = f"; lower bound {duration(plan.bound_s)}, at most {percent(gap)} above it"
    say(f"Weighted cost {duration(plan.cost_s)}{bound}. "
        f"Energy {watt_hours(plan.energy_j)} Wh; {plan.iterations} iterations, {spent(plan.planning_time_s)}.")  # fmt: skip


def _due(due: datetime, zone: ZoneInfo, depart: datetime) -> str:
    """Time when an order is due, with its date if it is before `depart`."""
    return clock(due, zone, depart) if due >= depart else date_clock(due, zone)


def _stops(route: Route) -> str:
    """Return where a drone charges, each stop once, in order."""
    found: list[str] = []
    for one in route.steps:
        if one.kind == "charge":
            name = f"{one.origin} {one.pad}"
            if not found or found[-1] != name:
                found.append(name)
    return ", ".join(found)
