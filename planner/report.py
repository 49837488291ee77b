"""All that is told of a plan beside its composition, worked out before any of it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.planner.explain import charge_ranges, stop_reasons, wait_and_see
from skyway.planner.plan import alternative_plans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.planner.departure import Departure
    from skyway.planner.explain import ChargeRange, StopReason, WaitAndSee
    from skyway.planner.result import PlanResult


@dataclass(frozen=True, eq=False)
class PlanReport:
    """A plan and what was asked for beside it.

    Attributes
    ----------
    result : PlanResult
        The plan.
    departures : tuple of Departure
        Departures that were tried.
    bound : WaitAndSee or None
        Of plans by `robust`.
    charges : tuple of ChargeRange
        Of plans by `robust`.
    alternatives : tuple of PlanResult or None
        The plan and others; None where nobody asked.
    reasons : tuple of StopReason or None
        Why each stop is made; None where nobody asked.
    """

    result: PlanResult
    departures: tuple[Departure, ...]
    bound: WaitAndSee | None
    charges: tuple[ChargeRange, ...]
    alternatives: tuple[PlanResult, ...] | None
    reasons: tuple[StopReason, ...] | None


def plan_report(
    result: PlanResult, departures: Sequence[Departure] = (), alternatives: int = 1, *, explain: bool = False
) -> PlanReport:
    """Work out what is told of a plan; the bound, alternatives and reasons are searches of their own."""
    robust = result.robust
    return PlanReport(
        result=result,
        departures=tuple(departures),
        bound=None if robust is None else wait_and_see(robust),
        charges=() if robust is None else tuple(charge_ranges(robust)),
        alternatives=tuple(alternative_plans(result, alternatives)) if alternatives > 1 else None,
        reasons=tuple(stop_reasons(result)) if explain else None,
    )
