"""Output of departures tried, alternatives and reasons of a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import date_clock, minutes, percent, promised, share, watt_hours
from skyway.plan_document import UNCERTAINTIES, most_gained, size_words, why_here, why_so_much

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.planner.departure import Departure
    from skyway.planner.explain import StopReason
    from skyway.planner.report import PlanReport
    from skyway.planner.result import PlanResult
    from skyway.planner.uncertainties import Uncertainty


def print_more(report: PlanReport) -> None:
    """Print the requested extras beside the plan."""
    if report.departures:
        _print_departures(report.result, report.departures)
    if report.alternatives is not None:
        _print_alternatives(report.result, report.alternatives)
    if report.reasons is not None:
        _print_reasons(report.result, report.reasons)
    if report.rests_on:
        _print_basis(report.rests_on, report.not_counted)


def _print_departures(result: PlanResult, tried: Sequence[Departure]) -> None:
    zone = ZoneInfo(result.problem.scenario.timezone)
    deadline = result.problem.request.objective.deadline
    columns = [Column("departure", justify="left"), Column("delivery on average", "min")]
    columns += [Column("on time")] if deadline else []
    sheet = Sheet([*columns, Column("", justify="left")])
    for one in tried:
        chosen = "< chosen" if one.depart == result.composition.depart else ""
        time = "no route" if one.delivery is None else minutes(one.delivery)
        on_time = [percent(one.p_on_time)] if deadline else []
        sheet.add(date_clock(one.depart, zone), time, *on_time, chosen)
    say("")
    sheet.show()


def _print_alternatives(result: PlanResult, plans: Sequence[PlanResult]) -> None:
    from skyway.planner.explain import stop_names

    say("")
    if len(plans) == 1:
        if result.robust is None:
            say(f"The planner {result.composition.planner} gives one plan; only robust compares routes")
        else:
            say(
                "No alternative: no other route found is better in any respect (mean, 95th percentile, reserve, energy)"
            )
        return
    columns = [
        Column(""),
        Column("stops at", justify="left"),
        Column("on average", "min"),
        Column("95 % within", "min"),
    ]
    sheet = Sheet(
        [*columns, Column("reserve", "kept", words="reserve kept {}"), Column("energy on average", "Wh")], names=2
    )
    for number, plan in enumerate(plans):
        stops = stop_names(plan.robust.candidates[0]) if plan.robust else plan.composition.route[1:-1]
        sheet.add(
            str(number + 1),
            " > ".join(stops) or "no stop",
            minutes(plan.outcome.delivery),
            minutes(promised(plan.outcome.delivery_quantile(0.95))[0]).split(" ± ", maxsplit=1)[0],
            share(plan.outcome.success),
            "" if plan.mean_energy_j is None else watt_hours(plan.mean_energy_j),
        )
    say("Alternatives, each better than the others in some respect (1 is the plan above):")
    sheet.show()


def _print_reasons(result: PlanResult, reasons: Sequence[StopReason]) -> None:
    say("")
    if result.robust is None:
        say(f"The planner {result.composition.planner} gives no reasons; only robust does")
        return
    for one in reasons:
        say(f"{one.station}: {why_here(one)}")
        say(f"  {why_so_much(one)}")
    if not result.composition.stops:
        say("No stop is needed: the charge suffices for the whole route")


def _print_basis(found: Sequence[Uncertainty], not_counted: Sequence[str]) -> None:
    """Assumptions of the promise, and the changes with the greatest gain."""
    say("")
    say("The forecast of this delivery rests on:")
    sheet = Sheet(
        [
            Column("", justify="left"),
            Column("uncertain by", justify="left"),
            Column("data", justify="left"),
            Column("halving it gains", "min on average", words="halving it gains {} min on average"),
        ]
    )
    for one in found:
        gain = "no route" if one.gain is None else minutes(one.gain)
        sheet.add(UNCERTAINTIES[one.name], size_words(one), one.source, gain)
    sheet.show()
    say(most_gained(found))
    say("Not counted: " + "; ".join(not_counted))
