"""Calibration and health in the checklist before a take-off: checked once a day, and stored; what changes by the minute each time."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.link.vehicle.health import look_again, look_at
from skyway.models.base.formatting import date_clock
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import Context
    from skyway.link.vehicle.health import HealthItem, Verdict


def health_of_day(ctx: Context) -> tuple[Verdict, str] | None:
    """Return whether the drone was found healthy today, and still is, and the findings; None if no check is configured.

    Raises a `VehicleTimeoutError` if it does not answer.
    """
    book, uid = ctx.job.health, ctx.observed.uid
    if book is None:
        return None
    passed = book.passed_today(uid, ctx.now_s)
    if passed is not None:
        verdict, said = _verdict(tuple(look_again(ctx.vehicle)))
        if verdict != "ok":
            return verdict, said
        unknown = [one.name for one in passed.items if one.verdict == "unknown"]
        zone = ZoneInfo(ctx.job.scenario.timezone)
        return (
            "ok",
            f"checked at {date_clock(parse_instant(passed.time), zone, named=True)}; now: {said}{_not_known(unknown)}",
        )
    items = tuple(look_at(ctx.vehicle, book.last_flight(uid)))
    book.add(uid, ctx.now_s, items)
    return _verdict(items)


def _verdict(items: Sequence[HealthItem]) -> tuple[Verdict, str]:
    wrong = [one for one in items if not one.ok]
    if wrong:
        verdict: Verdict = "no" if any(one.verdict == "no" for one in wrong) else "unknown"
        return verdict, "; ".join(f"{one.name}: {one.said}" for one in wrong)
    unknown = [one.name for one in items if one.verdict == "unknown"]
    good = ", ".join(one.name for one in items if one.verdict == "ok")
    return "ok", f"{good}{_not_known(unknown)}"


def _not_known(names: Sequence[str]) -> str:
    return f"; unknown: {', '.join(names)}" if names else ""
