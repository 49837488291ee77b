"""Table of a comparison of planners."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import duration, kilometres, later_text, minutes, share, spent

if TYPE_CHECKING:
    from skyway.models.base.figure import Figure
    from skyway.planner.explain import RobustGain
    from skyway.planner.result import Comparison


def print_comparison(answers: list[Comparison]) -> None:
    """Print planners side by side; all but those with perfect information are counted in the same simulated deliveries."""
    from skyway.planner.registry import CLAIRVOYANT_PLANNERS

    columns = [
        Column("planner", justify="left"), Column("drone", justify="left"), Column("on average", "min"),
        Column("half within", "min"), Column("95 % within", "min"), Column("reserve", "kept", words="reserve kept {}"), Column("flight"),
        Column("wait"), Column("recharge"), Column("stops", words="{} stops"), Column("", "km"), Column("planned", words="planned in {}"),
    ]  # fmt: skip
    sheet = Sheet(columns, names=2)
    for answer in answers:
        if answer.result is None:
            continue
        c, outcome = answer.result.composition, answer.result.outcome
        cut = "" if answer.result.complete else " (cut off)"
        certain = outcome.crossed is None  # a planner with perfect information
        sheet.add(
            answer.planner + cut,
            c.drone,
            minutes(outcome.delivery),
            "" if certain else _about(outcome.delivery_quantile(0.5)),
            "" if certain else _about(outcome.delivery_quantile(0.95)),
            "" if certain else share(outcome.success),
            duration(c.flight_time_s),
            duration(c.wait_time_s),
            duration(c.recharge_time_s),
            str(len(c.stops)),
            kilometres(c.distance_m),
            spent(answer.result.planning_time_s),
        )
    if sheet.rows:
        sheet.show()
        say("")
        say(
            "flight, wait and recharge: typical schedule. Other columns: the same simulated deliveries for all planners"
        )
        clairvoyant = [one.planner for one in answers if one.result and one.planner in CLAIRVOYANT_PLANNERS]
        for name in clairvoyant:
            say(
                f"{name} has perfect information (wind and queues): its delivery time is for that one realization, without gusts"
            )
        say("")
    _print_gains(answers)
    for answer in answers:
        if answer.error is not None:
            say(f"{answer.planner}: {answer.error}")
        elif answer.result is not None:
            say(f"{answer.planner}: {' > '.join(answer.result.composition.route)}")


def _about(figure: Figure) -> str:
    return minutes(figure).split(" ± ", maxsplit=1)[0]


def _print_gains(answers: list[Comparison]) -> None:
    """Say in plain words what the robust plan gains."""
    from skyway.planner.explain import robust_gain
    from skyway.planner.registry import CLAIRVOYANT_PLANNERS

    robust = next((one.result for one in answers if one.result is not None and one.result.robust is not None), None)
    if robust is None:
        return
    for answer in answers:
        if answer.result is None or answer.result is robust or answer.planner in CLAIRVOYANT_PLANNERS:
            continue
        one = robust_gain(robust, answer.result)
        say(f"{one.planner} against robust: {later_text(one.sooner)}; {_safer(one)}")
        say(f"  why: {_reasons(one)}")
    say("")


def _safer(one: RobustGain) -> str:
    """Risk."""
    here, there = share(one.broken), share(one.broken_there)
    if here == there:
        return f"both land below the reserve in {here} of the deliveries"
    return f"{there} of the deliveries land below the reserve, with robust {here}"


def _reasons(one: RobustGain) -> str:
    """What the difference comes from."""
    if one.sooner.high < 0.0 and one.broken.value < one.broken_there.value:
        return "robust charges or waits for the wind where the other takes off with less than the flight may need"
    reasons = []
    if one.drone != one.drone_there:
        reasons.append(f"robust takes {one.drone} instead of {one.drone_there}")
    less = round((one.recharge_there_s - one.recharge_s) / 60.0)
    if less:
        reasons.append(f"{abs(less)} min {'less' if less > 0 else 'more'} on pads in a typical schedule")
    if one.stops != one.stops_there:
        reasons.append(f"{one.stops} {'stop' if one.stops == 1 else 'stops'} instead of {one.stops_there}")
    if one.stops:
        reasons.append("charges decided at each stop, by wind and queues at that time")
    return ", ".join(reasons) or "the same route without a stop; robust takes off when the wind allows"
