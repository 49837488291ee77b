"""Output of departures tried, alternatives and reasons of a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import date_clock, duration, later_text, minutes, percent, share, speed_text
from skyway.models.base.units import J_PER_WH, iso
from skyway.models.composition.file import figure_json
from skyway.planner.uncertainties import ENERGY, GUSTS, NOT_COUNTED, PADS, WIND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.planner.departure import Departure
    from skyway.planner.explain import StopReason
    from skyway.planner.report import PlanReport
    from skyway.planner.result import PlanResult
    from skyway.planner.uncertainties import Uncertainty


def print_more(report: PlanReport) -> None:
    """Print what was asked for beside the plan."""
    if report.departures:
        _print_departures(report.result, report.departures)
    if report.alternatives is not None:
        _print_alternatives(report.result, report.alternatives)
    if report.reasons is not None:
        _print_reasons(report.result, report.reasons)
    if report.rests_on:
        _print_basis(report.rests_on)


def as_json(report: PlanReport) -> dict[str, object]:
    """Return the same for machines: keys that the composition does not have."""
    from skyway.models.composition.file import to_json

    found: dict[str, object] = {}
    if report.bound is not None:
        found["bound"] = vars(report.bound) | {"gap": report.bound.gap}
    if report.departures:
        found["departures"] = [
            {
                "depart": iso(one.depart),
                "delivery_mean_s": one.delivery_s,
                "delivery_mean": None if one.delivery is None else figure_json(one.delivery),
                "p_on_time": one.p_on_time,
            }
            for one in report.departures
        ]
    if report.alternatives is not None:
        found["alternatives"] = [to_json(plan.composition) for plan in report.alternatives[1:]]
    if report.reasons is not None:
        found["explanation"] = {
            "stops": [_reason_json(one) for one in report.reasons],
            "charges": [vars(one) for one in report.charges],
            "rests_on": [_uncertainty_json(one) for one in report.rests_on or ()],
            "not_counted": NOT_COUNTED,
        }
    return found


def _reason_json(one: StopReason) -> dict[str, object]:
    found = {name: value for name, value in vars(one).items() if name != "later"}
    later = None if one.later is None else figure_json(one.later)
    return found | {"later_s": None if one.later is None else one.later.value, "later": later}


def _uncertainty_json(one: Uncertainty) -> dict[str, object]:
    return vars(one) | {"gain": None if one.gain is None else figure_json(one.gain)}


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
    sheet = Sheet([*columns, Column("reserve", "kept", words="reserve kept {}"), Column("energy", "Wh")], names=2)
    for number, plan in enumerate(plans):
        stops = stop_names(plan.robust.candidates[0]) if plan.robust else plan.composition.route[1:-1]
        sheet.add(
            str(number + 1),
            " > ".join(stops) or "no stop",
            minutes(plan.outcome.delivery),
            minutes(plan.outcome.delivery_quantile(0.95)).split(" ± ", maxsplit=1)[0],
            share(plan.outcome.success),
            f"{_energy_wh(plan):.0f}",
        )
    say("Alternatives, each better than the others in some respect (1 is the plan above):")
    sheet.show()


def _energy_wh(plan: PlanResult) -> float:
    if plan.robust is None:
        return plan.composition.energy_j / J_PER_WH
    return plan.robust.out_of_sample.charge_used * plan.problem.drone.battery_j / J_PER_WH


def _print_reasons(result: PlanResult, reasons: Sequence[StopReason]) -> None:
    say("")
    if result.robust is None:
        say(f"The planner {result.composition.planner} gives no reasons; only robust does")
        return
    for one in reasons:
        say(f"{one.station}: {_why_here(one)}")
        say(f"  {_why_so_much(one)}")
    if not result.composition.stops:
        say("No stop is needed: the charge suffices for the whole route")


def _why_here(one: StopReason) -> str:
    if one.runner_up is None or one.later is None:
        return "without this stop there is no route"
    way = "the best route stops at " + ", ".join(one.runner_up) if one.runner_up else "the best route has no stop"
    safety = "" if one.later.value >= 0.0 else ", but is less safe"
    return f"without this stop {way}: {later_text(one.later)}{safety}"


def _why_so_much(one: StopReason) -> str:
    """What the charge at a stop is for."""
    parts = (
        f"{percent(one.leaves)} on average: {percent(one.expected)} for the flight, {percent(one.margin)} margin for "
        f"stronger wind, gusts and a vehicle that uses more energy, {percent(one.reserve)} reserve on landing"
    )
    if one.idle >= 1.0 - 1e-9:
        return f"in the simulated deliveries the drone never charges here; it leaves with {parts}"
    if one.idle > 0.5:
        return f"{percent(one.idle)} of the deliveries leave at once; the others charge to {parts}"
    return f"the drone charges to {parts}"


def _print_basis(found: Sequence[Uncertainty]) -> None:
    """What the promise rests on, and what would gain most."""
    say("")
    say("The promise rests on:")
    sheet = Sheet(
        [
            Column("", justify="left"),
            Column("uncertain by", justify="left"),
            Column("data", justify="left"),
            Column("half of it gains", "min on average", words="half of it gains {} min on average"),
        ]
    )
    for one in found:
        gain = "no route" if one.gain is None else minutes(one.gain)
        sheet.add(_NAMES[one.name], _SIZES[one.name](one.size), one.source, gain)
    sheet.show()
    most = found[0]
    if most.gain is not None and most.gain.low > 0.0:
        remedy = f"; {most.remedy}" if most.remedy else ""
        say(f"Most is gained by half of the {_NAMES[most.name]}: {minutes(most.gain)} min on average{remedy}")
    else:
        say("Half of any one of them makes no clear difference")
    say("Not counted: " + "; ".join(NOT_COUNTED))


_NAMES = {WIND: "wind ahead", GUSTS: "gusts", ENERGY: "energy of the drone", PADS: "other drones at pads"}
_SIZES: dict[str, Callable[[float], str]] = {
    WIND: lambda size: f"{speed_text(size)} a component",
    GUSTS: lambda size: f"{percent(size)} of the wind",
    ENERGY: lambda size: f"{percent(size)} of a flight's energy",
    PADS: lambda size: f"{duration(size)} of waiting",
}
"""How the size of each is said."""
