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
    from planner.result import Comparison, PlanResult

WIDTH = 118
"""Columns where the output is no terminal."""


def console() -> Console:
    """Console on standard output, as wide as the terminal and at least wide enough for a plan."""
    found = Console(highlight=False)
    if not found.is_terminal or found.width < WIDTH:
        return Console(width=WIDTH, highlight=False)
    return found


def duration(seconds: float) -> str:
    """Return a duration such as ``1:02:35`` or ``4:09``."""
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"


def percent(fraction: float | None, digits: int = 0) -> str:
    """Return a percentage; a probability just below 1 does not round up to it."""
    if fraction is None:
        return "unknown"
    text = f"{100 * fraction:.{digits}f}"
    if fraction < 1.0 and float(text) >= 100.0:
        return ">99.9 %"
    return f"{text} %"


def print_plan(result: PlanResult) -> None:
    """Print a plan: what flies, leg by leg and stop by stop, and what the forecast makes of it."""
    c = result.composition
    out = console()
    zone = ZoneInfo(result.problem.scenario.timezone)
    first, last = c.stations[c.origin], c.stations[c.destination]
    out.print(f"{first.name or c.origin}  >  {last.name or c.destination}")
    out.print(
        f"{c.drone_parameters.get('name', c.drone)} ({c.drone}), {c.payload_kg:g} kg, airspeed {c.airspeed_mps:g} m/s, "
        f"departs {_clock(c.depart, zone, date=True)}, planner {c.planner}"
    )
    for line in course_lines(c, zone):
        out.print(line, markup=False, soft_wrap=True)
    _print_totals(out, result, zone)


def course_lines(c: Composition, zone: ZoneInfo) -> list[str]:
    """The nominal course, leg by leg and stop by stop, in columns."""
    names = {service.id: _leg_name(service) for service in c.services}
    wide = max(len("leg"), *(len(name) for name in names.values()))
    wide = min(wide, 44)
    head = f"{'time':<9}{'leg':<{wide}}{'km':>7}{'course':>8}{'wind':>7}{'from':>6}{'tail':>7}{'cross':>7}{'speed':>7}"
    head += f"{'takes':>9}{'charge %':>12}{'reserve':>9}{'hold':>6}"
    unit = f"{'':<9}{'':<{wide}}{'':>7}{'':>8}{'m/s':>7}{'':>6}{'m/s':>7}{'m/s':>7}{'m/s':>7}{'':>9}{'':>12}{'kept':>9}{'wind':>6}"
    lines = ["", head, unit]
    stops = {stop.station: stop for stop in c.stops}
    for service in c.services:
        if service.origin in stops:
            lines.append(_stop_line(stops.pop(service.origin), zone))
        lines.append(_leg_line(service, names[service.id], wide, zone))
    lines.append(f"{_clock(c.arrive, zone):<9}{c.destination}: delivered")
    lines.append("")
    return lines


def _leg_name(leg: DroneService) -> str:
    return f"{leg.origin} > " + "".join(f"({key}) > " for key in leg.via) + leg.destination


def _leg_line(leg: DroneService, name: str, wide: int, zone: ZoneInfo) -> str:
    charge = f"{100 * leg.soc_depart:.0f} > {100 * leg.soc_arrive:.0f}"
    shown = name if len(name) <= wide else name[: wide - 1] + "…"
    return (
        f"{_clock(leg.depart, zone):<9}{shown:<{wide}}{leg.distance_m / 1000:>7.1f}{leg.bearing_deg:>7.0f}°"
        f"{leg.wind.speed_mps:>7.1f}{leg.wind.from_deg:>5.0f}°{leg.tailwind_mps:>+7.1f}{leg.crosswind_mps:>+7.1f}"
        f"{leg.ground_speed_mps:>7.1f}{duration(leg.flight_time_s):>9}{charge:>12}{percent(leg.p_reserve, 1):>9}"
        f"{percent(leg.p_hold):>6}"
    )


def _stop_line(stop: Stop, zone: ZoneInfo) -> str:
    doing = []
    if stop.recharge_s > 0:
        doing.append(f"wait {duration(stop.wait_s)} for a pad (free on arrival {percent(stop.p_pad_free)})")
        doing.append(f"charge {duration(stop.recharge_s)} to {100 * stop.soc_to:.0f} %")
    if stop.hold_s >= 0.5:
        doing.append(f"hold {duration(stop.hold_s)}")
    return f"{_clock(stop.arrive, zone):<9}  {stop.station}: {', '.join(doing) or 'land and leave'}"


def _print_totals(out: Console, result: PlanResult, zone: ZoneInfo) -> None:
    c = result.composition
    out.print(
        f"Delivery in {duration(c.delivery_time_s)}: flight {duration(c.flight_time_s)}, wait {duration(c.wait_time_s)}, "
        f"recharge {duration(c.recharge_time_s)}; {c.distance_m / 1000:.1f} km, {c.energy_j / 3600:.0f} Wh, "
        f"lowest charge {100 * c.min_soc:.0f} % (reserve {100 * c.reserve_soc:.0f} %)"
    )
    a = c.arrival
    if a.mean is not None and a.p50 is not None and a.p95 is not None:
        members = len(result.problem.probability)
        known = (
            "the wind and queues given"
            if members == 1
            else f"{members} possible courses of the wind and sampled queues"
        )
        out.print(
            f"Arrival mean {_clock(a.mean, zone)}, p50 {_clock(a.p50, zone)}, p95 {_clock(a.p95, zone)}; "
            f"every landing above reserve with probability {percent(c.success_probability, 1)} ({known})"
        )
    if result.outcome.p_arrive < 1.0 - 1e-9:
        out.print(
            f"With probability {percent(1.0 - result.outcome.p_arrive, 1)} the wind never opens every leg within the forecast"
        )
    for note in c.notes:
        out.print(f"Note: {note}")
    for drone, why in result.rejected.items():
        out.print(f"Not {drone}: {why}")
    out.print(f"Planned in {1000 * result.planning_time_s:.1f} ms, {result.looked_at} evaluated")


def _clock(instant: datetime, zone: ZoneInfo, *, date: bool = False) -> str:
    local = instant.astimezone(zone)
    return local.strftime("%Y-%m-%d %H:%M %Z") if date else local.strftime("%H:%M:%S")


def print_comparison(answers: list[Comparison]) -> None:
    """Print planners side by side."""
    out = console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for name in (
        "planner",
        "drone",
        "delivery",
        "flight",
        "wait",
        "recharge",
        "stops",
        "arrival mean",
        "p95",
        "kept",
        "km",
        "planned in",
    ):
        table.add_column(name, justify="left" if name in ("planner", "drone") else "right")
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
            f"+{duration(mean)}",
            f"+{duration(late)}",
            percent(c.success_probability, 1),
            f"{c.distance_m / 1000:.1f}",
            f"{1000 * answer.result.planning_time_s:.1f} ms",
        )
    out.print(table)
    for answer in answers:
        if answer.error is not None:
            out.print(f"{answer.planner}: {answer.error}")
        elif answer.result is not None:
            out.print(f"{answer.planner}: {' > '.join(answer.result.composition.route)}")
    if any(answer.planner == "ies" and answer.result is not None for answer in answers):
        out.print(
            "ies knows the true wind and queues; the others know the forecast, and their times are for its median course."
        )
