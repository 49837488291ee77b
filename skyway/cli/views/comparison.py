"""Report of a comparison of planners: JSON and table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import msgspec

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import (
    duration,
    kilometres,
    later_text,
    minutes,
    money,
    probability,
    promised,
    share,
    spent,
    watt_hours,
)
from skyway.models.base.units import J_PER_WH
from skyway.models.base.views import counted
from skyway.models.composition.file import to_json
from skyway.planner.uncertainties import record_days

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.base.statistics import Figure
    from skyway.planner.explain import RobustGain
    from skyway.planner.report import ComparisonReport
    from skyway.planner.schedule.outcome import Outcome


class PlannerAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of one planner: its composition (`models.composition.file.to_json`), or the reason for none."""

    planner: str
    status: Literal["ok", "infeasible"]
    error: str | None
    composition: dict[str, object] | None


class CompareDocument(msgspec.Struct, frozen=True, kw_only=True):
    """Output of ``skyway compare --json``."""

    schema: str = "skyway.compare/1"
    plans: list[PlannerAnswer]


def document_of(report: ComparisonReport) -> CompareDocument:
    """Return the report for machines."""
    plans = [
        PlannerAnswer(
            planner=answer.planner,
            status="ok" if answer.result else "infeasible",
            error=None if answer.error is None else str(answer.error),
            composition=None if answer.result is None else to_json(answer.result.composition),
        )
        for answer in report.answers
    ]
    return CompareDocument(plans=plans)


def print_comparison(report: ComparisonReport) -> None:
    """Print planners side by side; all except those with perfect information are evaluated in the same simulated deliveries."""
    from skyway.planner.registry import CLAIRVOYANT_PLANNERS

    columns = [
        Column("planner", justify="left"), Column("drone", justify="left"), Column("on average", "min"),
        Column("half within", "min"), Column("95 % within", "min"), Column("reserve", "kept", words="reserve kept {}"), Column("flight"),
        Column("wait"), Column("recharge"), Column("stops", words="{} stops"), Column("", "km"), Column("planned", words="planned in {}"),
    ]  # fmt: skip
    found = [one.result.composition for one in report.answers if one.result is not None]
    energy, costs = any(c.energy for c in found), next((c.costs for c in found if c.costs), None)
    columns += [Column("energy", "Wh", words="energy {} Wh")] if energy else []
    columns += [Column("cost", costs.currency, words=f"cost {{}} {costs.currency}")] if costs else []
    sheet = Sheet(columns, names=2)
    for answer in report.answers:
        if answer.result is None:
            continue
        c, outcome = answer.result.composition, answer.result.outcome
        cut = "" if answer.result.complete else " (cut off)"
        certain = outcome.crossed is None  # a planner with perfect information
        sheet.add(
            answer.planner + cut,
            c.drone,
            minutes(outcome.delivery),
            *(["", ""] if certain else [_about(one) for one in _quantiles(outcome)]),
            "" if certain else share(outcome.success),
            duration(c.flight_time_s),
            duration(c.wait_time_s),
            duration(c.recharge_time_s),
            str(len(c.stops)),
            kilometres(c.distance_m),
            spent(answer.result.planning_time_s),
            *(["" if c.energy is None else watt_hours(c.energy.mean.value * J_PER_WH)] if energy else []),
            *(["" if c.costs is None else money(c.costs.mean.value)] if costs else []),
        )
    if sheet.rows:
        sheet.show()
        say("")
        _print_columns(report)
        say('Columns "flight" to "km": typical schedule')
        clairvoyant = [one.planner for one in report.answers if one.result and one.planner in CLAIRVOYANT_PLANNERS]
        for name in clairvoyant:
            say(
                f"{name} has perfect information (wind and queues): its delivery time is for that one realization, without gusts"
            )
        say("")
    _print_gains(report.gains)
    for answer in report.answers:
        if answer.error is not None:
            say(f"{answer.planner}: {answer.error}")
        elif answer.result is not None:
            say(f"{answer.planner}: {' > '.join(answer.result.composition.route)}")


def _print_columns(report: ComparisonReport) -> None:
    """Describe the simulated deliveries behind the figures, and for which planners some of them do not arrive."""
    found = [one.result for one in report.answers if one.result is not None and one.result.composition.arrival.runs]
    if not found:
        return
    runs = max(one.composition.arrival.runs or 0 for one in found)
    members = len(found[0].problem.probability)
    kind = "day" if record_days(found[0].problem.ensemble) else "member"
    winds = (
        "one wind"
        if members == 1
        else f"the wind of {counted(members, kind)}" + (" of the record" if kind == "day" else " of the forecast")
    )
    say(
        f'Columns "on average" to "reserve kept": {runs:,} simulated deliveries in {winds}, the same for all planners. ±: 95 % confidence interval'
    )
    for one in found:
        never = 1.0 - one.outcome.p_arrive
        if never > 1e-9:
            say(
                f"{one.composition.planner}: in {probability(never, 1)} of the deliveries the drone stays at a stop until the end of the forecast; its figures are of the others"
            )


def _quantiles(outcome: Outcome) -> list[Figure]:
    return promised(outcome.delivery_quantile(0.5), outcome.delivery_quantile(0.95))


def _about(figure: Figure) -> str:
    return minutes(figure).split(" ± ", maxsplit=1)[0]


def _print_gains(gains: Sequence[RobustGain]) -> None:
    """Describe the gain of the robust plan in plain words."""
    for one in gains:
        say(f"{one.other.composition.planner} against robust: {later_text(one.sooner)}; {_safer(one)}")
        say(f"  why: {_reasons(one)}")
    if gains:
        say("")


def _safer(one: RobustGain) -> str:
    """Risk."""
    here, there = (share(result.outcome.success.rest) for result in (one.robust, one.other))
    if here == there:
        return f"both land below the reserve in {here} of the deliveries"
    return f"{there} of the deliveries land below the reserve, with robust {here}"


def _reasons(one: RobustGain) -> str:
    """Causes of the difference."""
    here, there = one.robust.composition, one.other.composition
    if one.sooner.high < 0.0 and one.robust.outcome.success.value > one.other.outcome.success.value:
        return "robust charges or waits for the wind where the other takes off with less than the flight may need"
    reasons = []
    if here.drone != there.drone:
        reasons.append(f"robust takes {here.drone} instead of {there.drone}")
    less = round((there.recharge_time_s - here.recharge_time_s) / 60.0)
    if less:
        reasons.append(f"{abs(less)} min {'less' if less > 0 else 'more'} on pads in a typical schedule")
    stops, stops_there = len(here.stops), len(there.stops)
    if stops != stops_there:
        reasons.append(f"{stops} {'stop' if stops == 1 else 'stops'} instead of {stops_there}")
    if stops:
        reasons.append("charges decided at each stop, by wind and queues at that time")
    return ", ".join(reasons) or "the same route without a stop; robust takes off when the wind allows"
