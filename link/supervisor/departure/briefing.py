"""The briefing before a take-off: the checklist as it is completed, and then everything that the operator's "yes" confirms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from skyway.link.supervisor.departure.parameter_changes import change_lines
from skyway.link.supervisor.journal.entries import Briefed, CheckDone, Waiting
from skyway.link.supervisor.journal.parts import ParameterToSet, winds
from skyway.models.base.formatting import duration, minute_clock, percent, zone_clock

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.departure.preflight import Check
    from skyway.link.supervisor.legs import Leg

LATE_S = 120.0
"""The take-off time is stated with the times of a plan if it is at least this far ahead, s."""
REMIND_S = 30.0
"""Interval at which the reason of a delayed take-off is shown again, s."""


class Checklist:
    """The checklist of one departure: each entry is journaled at its first verdict, and when its verdict changes."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx
        self._verdicts: dict[str, str] = {}
        self._reminded_s = ctx.clock.now_s()

    def take(self, check: Check) -> Check:
        """Take an entry; time passes between two of them, so that input and messages are processed."""
        if self._verdicts.get(check.name) != check.verdict:
            self._verdicts[check.name] = check.verdict
            entry = CheckDone(name=check.name, verdict=check.verdict, said=check.said, waits=check.waits)
            self._ctx.note(entry, str(check))
        self._ctx.tick(0.0)
        return check

    def waits(self, reason: str, left_s: float) -> None:
        """Print at intervals the reason for a wait, and its remaining time."""
        now = self._ctx.clock.now_s()
        if now < self._reminded_s + REMIND_S:
            return
        self._reminded_s = now
        left_s = max(left_s, 0.0)
        self._ctx.note(Waiting(left_s=left_s), f"waiting for at most {duration(left_s)} more: {reason}")


def brief(ctx: Context, leg: Leg) -> None:
    """Print the basis of a take-off decision: flight, wind, diverts, parameters, and automatic actions."""
    first = ctx.delivery.flight == 0
    alone = ctx.vehicle.family.failsafes.by_itself(ctx.failsafes.values)
    changes = ctx.parameters.proposed
    wind = ctx.wind.on_way(leg.mission.way, ctx.now_s, leg.planned_s)
    lines = [
        _flight_line(ctx, leg),
        *_delivery_lines(ctx),
        f"wind on the way: {wind} ({ctx.wind.origin})",
        f"divert stations on the way: {', '.join(leg.diverts)}",
    ]
    lines += change_lines(changes, restored=ctx.job.restore_parameters)
    if first:
        lines += ["what the drone does without commands:", *(f"  {line}" for line in alone)]
    to_set = tuple(ParameterToSet(name=one.name, now=one.before, then=one.after, why=one.why) for one in changes)
    ctx.note(
        Briefed(
            lines=tuple(lines),
            diverts=leg.diverts,
            by_itself=tuple(alone),
            wind=winds(wind),
            wind_origin=ctx.wind.origin,
            parameters=to_set,
        ),
        lines[0],
    )
    for line in lines:
        ctx.tell(line)


def _flight_line(ctx: Context, leg: Leg) -> str:
    """The requested flight in words; legs are numbered from 1."""
    left = len(ctx.delivery.plan.services) if ctx.delivery.plan is not None else 1
    number = ctx.delivery.flight + 1
    kept = f" (reserve {percent(ctx.job.request.reserve_soc)})"
    via = f" over {', '.join(leg.via)}" if leg.via else ""
    return (
        f"leg {number} of {number + left - 1}: {leg.origin} > {leg.destination}{via}, {duration(leg.planned_s)} on average, "
        f"charge {percent(ctx.battery.soc)} to {percent(leg.planned_soc)}{kept}"
    )


def _delivery_lines(ctx: Context) -> list[str]:
    """Delivery time of the package by the plan in force, in words."""
    plan = ctx.delivery.plan
    if plan is None:
        return []
    zone = ZoneInfo(ctx.job.scenario.timezone)
    arrival: dict[str, Any] = {
        "on average": plan.arrival.mean,
        "half by": plan.arrival.p50,
        "95 % by": plan.arrival.p95,
    }
    known = [f"{word} {minute_clock(at, zone)}" for word, at in arrival.items() if at is not None]
    if not known:
        return []
    begins = min([plan.depart, *(service.depart for service in plan.services[:1])])
    late = abs(begins.timestamp() - ctx.now_s) >= LATE_S
    planned = f" (planned for a departure at {zone_clock(begins, zone)})" if late else ""
    what = f"delivery at {plan.destination}" if ctx.job.work is None else "the work ends"
    return [f"{what}{planned}: {', '.join(known)}"]
