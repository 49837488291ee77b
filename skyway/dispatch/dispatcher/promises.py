"""Answers to orders: promised, changed with a reason, refused, or handed over to a person."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.dispatch.records import CANCELLED, HANDED_OVER, ChangeRecord, Promise
from skyway.models.base.formatting import duration
from skyway.planner.dispatch.flights import latest_s
from skyway.planner.dispatch.improve import TOLERATED_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.dispatcher.reasons import Reasons
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import OrderRecord
    from skyway.planner.dispatch.result import Answer
    from skyway.planner.parameters.dispatch import DispatchParameters

TOLD_S = 60.0
"""Least share of a delay that is told, s."""


class Promises:
    """Answers to orders.

    Parameters
    ----------
    situation : Situation
        The state, changed here.
    say : callable
        Displays a line.
    """

    def __init__(self, situation: Situation, say: Callable[[str], None]) -> None:
        self._situation, self._say = situation, say

    def answer(self, now_s: float, name: str, answer: Answer, why: Reasons, planned_s: float | None = None) -> None:
        """Answer an order according to a plan; `planned_s` is its delivery in the plan before, POSIX seconds."""
        situation = self._situation
        state, order = situation.orders[name]
        before, after = order.promise, _promise_of(answer)
        how = _changed(before, after)
        if how:
            order.changes += 1
            drones = [one.drone for one in (before, after) if one is not None]
            reason = f"{how}: {why.why(drones)}{_shares(before, after, planned_s, why.delay_s(drones))}"
            number = f"{name} {order.changes}"
            situation.board.change(
                "change", number, "told", ChangeRecord(at_s=now_s, order=name, before=before, after=after, why=reason)
            )
            self._say(f"{name}: {reason}")
        if after is not None and (
            before is None or how or after.drone != before.drone or after.delivered_s < before.delivered_s - TOLERATED_S
        ):
            order.promise = after
            order.first = order.first or after
        elif after is None:
            order.promise = None
        elif before is not None:
            before.chance, before.p50_s, before.p95_s = after.chance, after.p50_s, after.p95_s
        flying = any(flight.order == name for _, flight in situation.flights.values())
        order.reason = "" if after is not None else answer.reason or "not planned"
        if answer.hopeless and not flying:
            self.refuse(name, order)
            return
        situation.change_order(name, state if flying else "promised" if after is not None else "new", order)

    def refuse(self, name: str, order: OrderRecord) -> None:
        """Refuse an order, with its stored reason."""
        self._say(f"{name} refused: {order.reason}")
        order.promise = None
        self._situation.change_order(name, "refused", order)

    def hand_over(self, name: str, order: OrderRecord) -> None:
        """Hand an order over to a person, with its stored reason."""
        self._say(f"{name} needs a person: {order.reason}")
        self._withdraw(order)
        self._situation.change_order(name, HANDED_OVER, order)

    def cancel(self, now_s: float, name: str, order: OrderRecord, by: str) -> None:
        """Cancel an order whose package is in no drone; one that flies to it stays at its next landing, and is then free."""
        order.reason, order.cancelled_s, order.cancelled_by = f"cancelled by {by}", now_s, by
        order.drone = order.promise = None
        self._say(f"{name} {order.reason}")
        self._situation.change_order(name, CANCELLED, order)

    @staticmethod
    def _withdraw(order: OrderRecord) -> None:
        """Withdraw the promise to an order; its drone is still told."""
        if order.promise is not None:
            order.drone = order.drone or order.promise.drone
            order.promise = None

    def refuse_too_late(self, now_s: float, weigh: DispatchParameters) -> None:
        """Refuse orders that can no longer be delivered in time."""
        for name, (state, order) in list(self._situation.orders.items()):
            if state == "new" and now_s > latest_s(order.order, weigh, promised=order.first is not None):
                self.refuse(name, order)


def _promise_of(answer: Answer) -> Promise | None:
    """Return the promise to an order; None if it is not served."""
    if answer.drone is None or answer.fetched is None or answer.delivered is None:
        return None
    outlook = answer.outlook
    return Promise(
        drone=answer.drone, fetched_s=answer.fetched.timestamp(), delivered_s=answer.delivered.timestamp(),
        chance=None if outlook is None else outlook.chance, p50_s=None if outlook is None or outlook.p50 is None else outlook.p50.timestamp(),
        p95_s=None if outlook is None or outlook.p95 is None else outlook.p95.timestamp(),
    )  # fmt: skip


def _changed(before: Promise | None, after: Promise | None) -> str:
    """Describe the change of a promise to its recipient; empty if nothing changes."""
    if before is None:
        return ""
    if after is None:
        return "it is no longer promised"
    later_s = after.delivered_s - before.delivered_s
    return f"{duration(later_s)} later" if later_s > TOLERATED_S else ""


def _shares(before: Promise | None, after: Promise | None, planned_s: float | None, delay_s: float | None) -> str:
    """Return the shares of a delay that its reason does not explain: what was planned already, and what comes with the new plan.

    `delay_s` is the delay of the reason, None if that is none; shares of less than `TOLD_S` are not told.
    """
    if before is None or after is None or planned_s is None:
        return ""
    already_s = planned_s - before.delivered_s
    more_s = after.delivered_s - planned_s - (delay_s or 0.0)
    already = f"; {duration(already_s)} of that was in the plan already" if already_s >= TOLD_S else ""
    more = f"; planning the fleet again around it adds {duration(more_s)}"
    return already + (more if delay_s is not None and more_s >= TOLD_S else "")
