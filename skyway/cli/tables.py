"""Plans as a pilot reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from rich import box
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from datetime import datetime

    from models.services import Composition, DroneService, Stop
    from planner.explain import Bought
    from planner.result import Comparison, PlanResult
    from planner.robust import RobustAnswer

WIDTH = 118
"""Columns where the output is no terminal."""


def console() -> Console:
    """Console on standard output, as wide as the terminal and at least wide enough for a plan.

    Names from files are printed as they are: brackets are no markup.
    """
    found = Console(highlight=False, markup=False, emoji=False)
    if not found.is_terminal or found.width < WIDTH:
        return Console(width=WIDTH, highlight=False, markup=False, emoji=False)
    return found


def print_table(out: Console, table: Table) -> None:
    """Print a table as wide as it needs, without the blanks that would end its lines."""
    out.width = max(out.width, 250)
    with out.capture() as capture:
        out.print(table)
    lines = [line.rstrip() for line in capture.get().splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    out.file.write("\n".join(lines) + "\n")


def say(out: Console, text: str) -> None:
    """Print a line that a terminal may break and a file may not."""
    out.print(text, soft_wrap=True)


def duration(seconds: float) -> str:
    """Return a duration such as ``1:02:35`` or ``4:09``."""
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"


def percent(fraction: float | None, digits: int = 0) -> str:
    """Return a percentage; a probability just below 1 does not round up to it, nor one just above 0 down."""
    if fraction is None:
        return "unknown"
    text = f"{100 * fraction:.{digits}f}"
    if fraction < 1.0 and float(text) >= 100.0:
        return ">99.9 %"
    if fraction > 0.0 and float(text) == 0.0:
        return f"<{10.0**-digits:g} %"
    return f"{text} %"


def spent(seconds: float) -> str:
    """Return computing time such as ``4.1 ms`` or ``12.3 s``."""
    return f"{1000 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


def print_plan(result: PlanResult) -> None:
    """Print a plan: what flies, leg by leg and stop by stop, and what the forecast makes of it."""
    c = result.composition
    out = console()
    zone = ZoneInfo(result.problem.scenario.timezone)
    first, last = c.stations[c.origin], c.stations[c.destination]
    say(out, f"{first.name or c.origin}  >  {last.name or c.destination}")
    say(
        out,
        f"{c.drone_parameters.get('name', c.drone)} ({c.drone}), {c.payload_kg:g} kg, airspeed {c.airspeed_mps:g} m/s, "
        f"departs {c.depart.astimezone(zone):%Y-%m-%d %H:%M %Z}, planner {c.planner}",
    )
    for line in course_lines(c, zone):
        say(out, line)
    _print_totals(out, result, zone)


def course_lines(c: Composition, zone: ZoneInfo) -> list[str]:
    """The nominal course, leg by leg and stop by stop, in columns."""
    names = {service.id: _leg_name(service) for service in c.services}
    wide = min(max(len("leg"), *(len(name) for name in names.values())) + 1, 44)
    clock = max(len(_clock(stop.arrive, zone, c.depart)) for stop in (c.services[-1], *c.services)) + 1
    head = f"{'time':<{clock}}{'leg':<{wide}}{'km':>6}{'course':>8}{'wind':>6}{'from':>6}{'tail':>7}{'cross':>7}{'speed':>7}"
    head += f"{'takes':>9}{'charge':>12}{'reserve':>9}{'hold':>7}"
    unit = f"{'':<{clock}}{'':<{wide}}{'':>6}{'':>8}{'m/s':>6}{'':>6}{'m/s':>7}{'m/s':>7}{'m/s':>7}{'':>9}{'%':>12}{'kept':>9}{'wind':>7}"
    lines = ["", head, unit]
    stops = {stop.station: stop for stop in c.stops}
    for service in c.services:
        if service.origin in stops:
            stop = stops.pop(service.origin)
            lines.append(f"{_clock(stop.arrive, zone, c.depart):<{clock}}{_stop_text(stop)}")
        lines.append(f"{_clock(service.depart, zone, c.depart):<{clock}}{_leg_text(service, names[service.id], wide)}")
    lines.append(f"{_clock(c.arrive, zone, c.depart):<{clock}}{c.destination}: delivered")
    lines.append("")
    return lines


def _leg_name(leg: DroneService) -> str:
    return f"{leg.origin} > " + "".join(f"({key}) > " for key in leg.via) + leg.destination


def _leg_text(leg: DroneService, name: str, wide: int) -> str:
    charge = f"{100 * leg.soc_depart:.0f} > {100 * leg.soc_arrive:.0f}"
    shown = name if len(name) < wide else name[: wide - 2] + "…"
    return (
        f"{shown:<{wide}}{leg.distance_m / 1000:>6.1f}{round(leg.bearing_deg) % 360:>7}°"
        f"{leg.wind.speed_mps:>6.1f}{leg.wind.direction_text:>9}{leg.tailwind_mps:>+7.1f}{leg.crosswind_mps:>+7.1f}"
        f"{leg.ground_speed_mps:>7.1f}{duration(leg.flight_time_s):>9}{charge:>12}{percent(leg.p_reserve, 1):>9}"
        f"{percent(leg.p_hold):>7}"
    )


def _stop_text(stop: Stop) -> str:
    doing = []
    if stop.recharge_s > 0:
        doing.append(f"wait {duration(stop.wait_s)} for a pad (free on arrival {percent(stop.p_pad_free)})")
        doing.append(f"charge {duration(stop.recharge_s)} to {100 * stop.soc_to:.0f} %")
    if stop.hold_s >= 0.5:
        doing.append(f"hold {duration(stop.hold_s)}")
    return f"  {stop.station}: {', '.join(doing) or 'land and leave'}"


def _print_totals(out: Console, result: PlanResult, zone: ZoneInfo) -> None:
    c = result.composition
    say(
        out,
        f"Delivery in {duration(c.delivery_time_s)}: flight {duration(c.flight_time_s)}, wait {duration(c.wait_time_s)}, "
        f"recharge {duration(c.recharge_time_s)}; {c.distance_m / 1000:.1f} km, {c.energy_j / 3600:.0f} Wh, "
        f"lowest charge {100 * c.min_soc:.0f} % (reserve {100 * c.reserve_soc:.0f} %)",
    )
    a = c.arrival
    if a.mean is not None and a.p50 is not None and a.p95 is not None:
        mean, middle, late = (_clock(instant, zone, c.depart) for instant in (a.mean, a.p50, a.p95))
        say(out, f"Arrival mean {mean}, p50 {middle}, p95 {late}")
        members = len(result.problem.probability)
        known = "the wind given" if members == 1 else f"{members} possible courses of the wind"
        sampled = "sampled queues"
        if result.robust is not None:
            known = known if members == 1 else f"each of {known} forecast by the others"
            sampled = f"sampled queues, gusts and vehicles, {len(result.robust.rehearsal.weight)} rehearsed deliveries"
        kept = percent(c.success_probability, 1)
        say(out, f"Every landing keeps the reserve with probability {kept} ({known}, {sampled})")
    if result.robust is not None:
        _print_rehearsal(out, result.robust)
    objective = result.problem.request.objective
    if objective.deadline is not None:
        due, on_time = _clock(objective.deadline, zone, c.depart), percent(objective.on_time(result.outcome), 1)
        say(out, f"On time, by {due}, with probability {on_time}")
    if result.outcome.p_arrive < 1.0 - 1e-9:
        never = percent(1.0 - result.outcome.p_arrive, 1)
        say(out, f"With probability {never} the wind does not open every leg within the forecast")
    for note in c.notes:
        say(out, f"Note: {note}")
    for drone, why in result.rejected.items():
        say(out, f"Not {drone}: {why}")
    say(out, f"Planned in {spent(result.planning_time_s)}, {result.looked_at} evaluated")


def _print_rehearsal(out: Console, answer: RobustAnswer) -> None:
    """What the plan would do otherwise, and how far it may be from the best."""
    from planner.explain import charge_ranges, stop_names, wait_and_see

    for one in charge_ranges(answer):
        often = f"; {percent(one.idle)} leave without" if one.idle >= 0.005 else ""
        say(
            out,
            f"At {one.station} charge by the wind then: {percent(one.low)} to {percent(one.high)} in 8 of 10 runs{often}",
        )
    others = [one for one in answer.candidates[1:] if stop_names(one) != stop_names(answer.candidates[0])]
    if others:
        later = (others[0].outcome.mean_s - answer.candidates[0].outcome.mean_s) / 60.0
        way = "by " + " > ".join(stop_names(others[0])) if stop_names(others[0]) else "without a stop"
        say(out, f"Else {way}: {later:+.1f} min in the mean")
    bound = wait_and_see(answer)
    if bound is not None:
        say(
            out,
            f"Told the wind and the queues beforehand nobody takes less than {duration(bound.bound_s)} in the mean; this plan takes "
            f"{duration(bound.plan_s)}, {percent(bound.gap, 1)} more (wait-and-see bound, no gusts)",
        )


def _clock(instant: datetime, zone: ZoneInfo, depart: datetime) -> str:
    """Local time of day, with the days since the departure where it is not the same."""
    local = instant.astimezone(zone)
    days = (local.date() - depart.astimezone(zone).date()).days
    return f"{local:%H:%M:%S}" + (f" +{days}d" if days else "")


def print_comparison(answers: list[Comparison]) -> None:
    """Print planners side by side."""
    out = console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    names = (
        "planner",
        "drone",
        "delivery",
        "flight",
        "wait",
        "recharge",
        "stops",
        "mean",
        "p95",
        "kept",
        "km",
        "planned in",
    )
    for name in names:
        table.add_column(name, justify="left" if name in ("planner", "drone") else "right", no_wrap=True)
    for answer in answers:
        if answer.result is None:
            continue
        c = answer.result.composition
        begin = c.depart.timestamp()
        mean, late = answer.result.outcome.mean_s - begin, answer.result.outcome.quantile_s(0.95) - begin
        table.add_row(
            answer.planner + ("" if answer.result.complete else " (cut off)"),
            c.drone,
            duration(c.delivery_time_s),
            duration(c.flight_time_s),
            duration(c.wait_time_s),
            duration(c.recharge_time_s),
            str(len(c.stops)),
            duration(mean),
            duration(late),
            percent(c.success_probability, 1),
            f"{c.distance_m / 1000:.1f}",
            spent(answer.result.planning_time_s),
        )
    if any(answer.result is not None for answer in answers):
        print_table(out, table)
        say(
            out,
            "delivery = flight + wait + recharge of the nominal course; mean, p95: delivery time over the forecast;",
        )
        say(
            out,
            "kept: probability that every landing keeps the reserve (gusts and vehicles: in the figures of robust alone)",
        )
        if any(answer.planner == "ies" and answer.result is not None for answer in answers):
            say(
                out,
                "ies is told the true wind and queues, the others know the forecast: its figures are for that one truth",
            )
        say(out, "")
    _print_bought(out, answers)
    for answer in answers:
        if answer.error is not None:
            say(out, f"{answer.planner}: {answer.error}")
        elif answer.result is not None:
            say(out, f"{answer.planner}: {' > '.join(answer.result.composition.route)}")


def _print_bought(out: Console, answers: list[Comparison]) -> None:
    """Say in plain words what the robust plan buys."""
    from planner.explain import bought
    from planner.plan import CLAIRVOYANT_PLANNERS

    robust = next((one.result for one in answers if one.result is not None and one.result.robust is not None), None)
    if robust is None:
        return
    for answer in answers:
        if answer.result is None or answer.result is robust or answer.planner in CLAIRVOYANT_PLANNERS:
            continue
        one = bought(robust, answer.result)
        say(out, f"robust against {one.planner}: {_saved(one)}; {_safer(one)}")
        say(out, f"  why: {_bought_by(one)}")
    say(out, "(both flown in the same rehearsed worlds: winds, queues, gusts and vehicles that the plan did not know)")
    say(out, "")


def _saved(one: Bought) -> str:
    """Minutes."""
    minutes = abs(one.sooner_s) / 60.0
    if minutes < 0.5:
        return f"as fast in the mean ({duration(one.mean_s)})"
    what = "saved" if one.sooner_s > 0.0 else "lost"
    return f"{minutes:.0f} min {what} in the mean ({duration(one.mean_s)} instead of {duration(one.mean_there_s)})"


def _safer(one: Bought) -> str:
    """Risk."""
    here, there = percent(one.broken, 1), percent(one.broken_there, 1)
    if one.broken_there <= 0.0 and one.broken <= 0.0:
        return "neither breaks the reserve"
    if here == there:
        return f"both break the reserve in {here} of deliveries"
    return f"{here} of deliveries break the reserve instead of {there}"


def _bought_by(one: Bought) -> str:
    """What the difference comes from."""
    if one.sooner_s < -30.0 and one.broken < one.broken_there:
        return "it charges, or waits for the wind, where the other takes off with less than the flight may need"
    reasons = []
    if one.drone != one.drone_there:
        reasons.append(f"{one.drone} instead of {one.drone_there}")
    less = round((one.recharge_there_s - one.recharge_s) / 60.0)
    if less:
        reasons.append(f"{abs(less)} min {'less' if less > 0 else 'more'} on pads")
    if one.stops != one.stops_there:
        reasons.append(f"{one.stops} {'stop' if one.stops == 1 else 'stops'} instead of {one.stops_there}")
    if one.stops:
        reasons.append("each charge decided at its stop, by the wind and the queues then")
    return ", ".join(reasons) or "the same way without a stop; robust leaves when the wind allows"
