"""The report of a plan besides its composition, computed before any of it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.planner.between_sites import between_sites
from skyway.planner.evaluation.as_flown import as_flown
from skyway.planner.explain import charge_ranges, robust_gain, stop_reasons, wait_and_see
from skyway.planner.plan import alternative_plans
from skyway.planner.registry import CLAIRVOYANT_PLANNERS
from skyway.planner.uncertainties import not_counted, uncertainties

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.planner.between_sites import BetweenSites
    from skyway.planner.departure import Departure
    from skyway.planner.evaluation.as_flown import AsFlown
    from skyway.planner.explain import ChargeRange, RobustGain, StopReason, WaitAndSee
    from skyway.planner.result import Comparison, PlanResult
    from skyway.planner.uncertainties import Uncertainty


@dataclass(frozen=True, eq=False)
class PlanReport:
    """A plan, and the additional results that were requested."""

    result: PlanResult
    """The plan."""
    departures: tuple[Departure, ...]
    """Departures that were tried."""
    bound: WaitAndSee | None
    """Of plans by `robust`."""
    charges: tuple[ChargeRange, ...]
    """Of plans by `robust`."""
    between_sites: BetweenSites | None
    """Of plans by `robust` that rest on a record."""
    alternatives: tuple[PlanResult, ...] | None
    """The plan and others; None where nobody asked."""
    reasons: tuple[StopReason, ...] | None
    """Why each stop is made; None where nobody asked."""
    rests_on: tuple[Uncertainty, ...] | None
    """What the promise rests on; None where nobody asked."""
    not_counted: tuple[str, ...]
    """What it does not count; empty where nobody asked."""
    as_flown: AsFlown | None
    """When it arrives as `fly` flies it; None where nobody asked."""


def plan_report(
    result: PlanResult,
    departures: Sequence[Departure] = (),
    alternatives: int = 1,
    *,
    explain: bool = False,
    flown_runs: int = 0,
    told: Callable[[int, int, float], None] | None = None,
) -> PlanReport:
    """Compute the report of a plan; the bound, alternatives and reasons are searches of their own.

    With `flown_runs` so many deliveries are simulated as `fly` decides them, and `told` how far that is (`planner.evaluation.as_flown`).
    Raises an `InputError` if this cannot be done for this plan.
    """
    robust = result.robust
    if flown_runs and robust is None:
        remedy = "plan with robust, as fly decides"
        named = result.composition.planner
        raise InputError("only plans of robust can be simulated as flown", field="planner", value=named, remedy=remedy)
    return PlanReport(
        result=result,
        departures=tuple(departures),
        bound=None if robust is None else wait_and_see(robust, careful=explain),
        charges=() if robust is None else tuple(charge_ranges(robust)),
        between_sites=None if robust is None else between_sites(robust),
        alternatives=tuple(alternative_plans(result, alternatives)) if alternatives > 1 else None,
        reasons=tuple(stop_reasons(result)) if explain else None,
        rests_on=tuple(uncertainties(result)) if explain else None,
        not_counted=tuple(not_counted(result)) if explain else (),
        as_flown=as_flown(result, flown_runs, told=told) if flown_runs else None,
    )


@dataclass(frozen=True, eq=False)
class ComparisonReport:
    """Answers of several planners to one request."""

    answers: tuple[Comparison, ...]
    """In the order asked."""
    gains: tuple[RobustGain, ...]
    """What the robust plan gains against each other that has no perfect information; empty without a robust plan."""


def comparison_report(answers: Sequence[Comparison]) -> ComparisonReport:
    """Compute the report of a comparison."""
    results = [one.result for one in answers if one.result is not None]
    robust = next((one for one in results if one.robust is not None), None)
    others = [
        one.result
        for one in answers
        if one.result is not None and one.result is not robust and one.planner not in CLAIRVOYANT_PLANNERS
    ]
    gains = () if robust is None else tuple(robust_gain(robust, other) for other in others)
    return ComparisonReport(tuple(answers), gains)
