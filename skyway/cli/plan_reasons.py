"""What a plan has to say beyond itself: departures tried, alternatives, and reasons."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from rich import box
from rich.table import Table

from models.units import J_PER_WH, iso
from skyway.cli.tables import console, duration, percent, print_table, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from planner.departure import Departure
    from planner.explain import StopReason
    from planner.result import PlanResult


def print_more(result: PlanResult, tried: Sequence[Departure], count: int, *, explain: bool) -> None:
    """Print what was asked for beside the plan."""
    if tried:
        _print_departures(result, tried)
    if count > 1:
        _print_alternatives(result, count)
    if explain:
        _print_reasons(result)


def as_json(result: PlanResult, tried: Sequence[Departure], count: int, *, explain: bool) -> dict[str, object]:
    """Return the same for machines: keys that the composition does not have."""
    from planner.explain import wait_and_see

    found: dict[str, object] = {}
    bound = None if result.robust is None else wait_and_see(result.robust)
    if bound is not None:
        found["bound"] = vars(bound) | {"gap": bound.gap}
    if tried:
        found["departures"] = [
            {"depart": iso(one.depart), "delivery_mean_s": _finite(one.delivery_s), "p_on_time": one.p_on_time}
            for one in tried
        ]
    if count > 1:
        from models.composition_file import to_json
        from planner.plan import alternative_plans

        found["alternatives"] = [to_json(plan.composition) for plan in alternative_plans(result, count)[1:]]
    if explain:
        from planner.explain import charge_ranges, stop_reasons

        found["explanation"] = {
            "stops": [vars(one) | {"later_s": _finite(one.later_s)} for one in stop_reasons(result)],
            "charges": [] if result.robust is None else [vars(one) for one in charge_ranges(result.robust)],
        }
    return found


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None


def _print_departures(result: PlanResult, tried: Sequence[Departure]) -> None:
    out = console()
    zone = ZoneInfo(result.problem.scenario.timezone)
    deadline = result.problem.request.objective.deadline
    say(out, "")
    say(out, "Departures tried (mean delivery time" + (", on time):" if deadline else "):"))
    for one in tried:
        chosen = "  < chosen" if one.depart == result.composition.depart else ""
        time = duration(one.delivery_s) if one.delivery_s < float("inf") else "no route"
        on_time = f"  {percent(one.p_on_time, 1):>8}" if deadline else ""
        say(out, f"  {one.depart.astimezone(zone):%Y-%m-%d %H:%M}  {time:>9}{on_time}{chosen}")


def _print_alternatives(result: PlanResult, count: int) -> None:
    from planner.explain import stop_names
    from planner.plan import alternative_plans

    out = console()
    plans = alternative_plans(result, count)
    say(out, "")
    if len(plans) == 1:
        if result.robust is None:
            say(out, f"The planner {result.composition.planner} has one answer; robust compares routes")
        else:
            say(out, "No alternative: no other route that was found is better in anything (mean, p95, reserve, energy)")
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for name in ("", "stops at", "mean", "p95", "reserve kept", "Wh"):
        table.add_column(name, justify="left" if name in ("", "stops at") else "right", no_wrap=True)
    for number, plan in enumerate(plans):
        c, outcome, begin = plan.composition, plan.outcome, plan.problem.depart_s
        table.add_row(
            str(number + 1),
            " > ".join(stop_names(plan.robust.candidates[0])) or "no stop"
            if plan.robust
            else " > ".join(c.route[1:-1]),
            duration(outcome.mean_s - begin),
            duration(outcome.quantile_s(0.95) - begin),
            percent(outcome.p_success, 1),
            f"{_energy_wh(plan):.0f}",
        )
    say(out, "Alternatives, none of them worse in everything: (1 is the plan above)")
    print_table(out, table)


def _energy_wh(plan: PlanResult) -> float:
    if plan.robust is None:
        return plan.composition.energy_j / J_PER_WH
    return plan.robust.rehearsal.charge_used * plan.problem.drone.battery_j / J_PER_WH


def _print_reasons(result: PlanResult) -> None:
    from planner.explain import stop_reasons

    out = console()
    say(out, "")
    if result.robust is None:
        say(out, f"The planner {result.composition.planner} gives no reasons; robust does")
        return
    for one in stop_reasons(result):
        say(out, f"{one.station}: {_why_here(one)}")
        say(out, f"  {_why_so_much(one)}")
    if not result.composition.stops:
        say(out, "No stop is needed: the charge is enough for the whole way")


def _why_here(one: StopReason) -> str:
    if one.runner_up is None:
        return "there is no way without this stop"
    way = " > ".join(one.runner_up) or "no stop at all"
    if one.later_s >= 0.0:
        return f"without it the best way stops at {way} and arrives {one.later_s / 60.0:.1f} min later in the mean"
    return f"without it a way by {way} arrives {-one.later_s / 60.0:.1f} min earlier in the mean, but is less safe"


def _why_so_much(one: StopReason) -> str:
    """What the charge at a stop is for."""
    parts = (
        f"{percent(one.leaves)} in the mean: {percent(one.expected)} for the flight, {percent(one.margin)} in case of worse wind, "
        f"gusts or a hungry vehicle, {percent(one.reserve)} that must be left on landing"
    )
    if one.idle >= 1.0 - 1e-9:
        return f"it never charges there in the rehearsed runs, and leaves with {parts}"
    if one.idle > 0.5:
        return f"{percent(one.idle)} of runs leave at once; the others, in worse wind, charge to {parts}"
    return f"it charges to {parts}"
