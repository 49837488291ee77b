"""Output of a plan: expected delivery, typical schedule, and notes."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import (
    about,
    between,
    by,
    clock,
    date_clock,
    direction_text,
    distance_text,
    duration,
    energy_text,
    from_to,
    headline,
    kept_share,
    kilometres,
    later_text,
    percent,
    probability,
    promised,
    share,
    spent,
)
from skyway.models.composition.way_back_words import delivered_text, end_text, way_back_lines
from skyway.plan_document import as_flown_words, between_sites_words, spending_words
from skyway.planner.schedule.airspace_notes import WAITS

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService, LegSegment, Stop
    from skyway.planner.report import PlanReport
    from skyway.planner.result import PlanResult
    from skyway.planner.robust.robust import RobustAnswer


def print_plan(report: PlanReport) -> None:
    """Print a plan."""
    result = report.result
    c = result.composition
    zone = ZoneInfo(result.problem.scenario.timezone)
    say(headline(c, zone))
    first, last = c.stations[c.origin], c.stations[c.destination]
    say(f"{first.name or c.origin}  >  {last.name or c.destination}")
    say(
        f"{c.drone_parameters.get('name', c.drone)} ({c.drone}), {c.payload_kg:g} kg, airspeed {c.airspeed_mps:g} m/s, "
        f"departs {date_clock(c.depart, zone, named=True)}, planner {c.planner}"
    )
    say("")
    _print_expected(result, zone)
    if report.between_sites is not None:
        for line in between_sites_words(report.between_sites, result.problem.epsilon):
            say(line)
    if report.as_flown is not None:
        deadline = result.problem.request.objective.deadline
        due = "" if deadline is None else clock(deadline, zone, c.depart)
        for line in as_flown_words(report.as_flown, deadline, due):
            say(line)
    say("")
    time = duration(c.delivery_time_s)
    say(f"The schedule, {time}:" if c.arrival.delivery_mean is None else f"A typical schedule, {time}:")
    schedule_sheet(c, zone).show()
    say("")
    _print_totals(report, zone)


def _print_expected(result: PlanResult, zone: ZoneInfo) -> None:
    """The delivery time with the ranges of its figures, and the probabilities of keeping reserve and deadline."""
    from skyway.planner.uncertainties import record_days

    c, a = result.composition, result.composition.arrival
    if a.delivery_mean is None or a.delivery_p50 is None or a.delivery_p95 is None:
        return
    sheet = Sheet([Column("delivery", justify="left"), Column("time"), Column("range"), Column("by")])
    middle, late = promised(a.delivery_p50, a.delivery_p95)
    rows = (("on average", a.delivery_mean), ("half within", middle), ("95 % within", late))
    for name, figure in rows:
        sheet.add(name, about(figure), between(figure), by(figure, c, zone))
    sheet.show()
    objective = result.problem.request.objective
    if objective.deadline is not None and c.on_time is not None:
        say(f"On time, by {clock(objective.deadline, zone, c.depart)}: {share(c.on_time)}")
    if c.success is not None:
        say(f"Every landing keeps the reserve of {percent(c.reserve_soc, None)}: {share(c.success)} of the deliveries")
    for line in spending_words(c):
        say(line)
    if result.outcome.p_arrive < 1.0 - 1e-9:
        never = percent(1.0 - result.outcome.p_arrive, 1)
        why = "until the end of the forecast the wind blocks the next leg, or the leg takes more than a full battery"
        say(f"In {never} of the deliveries the drone stays at a stop: {why}. The times above are of the others")
    members = len(result.problem.probability)
    kind = "days of wind" if record_days(result.problem.ensemble) else "members of the forecast"
    winds = "the wind given" if members == 1 else f"{members} {kind}"
    if result.robust is not None and members > 1:
        winds += ", each forecast from the others"
    say(
        f"({a.runs:,} simulated deliveries: {winds}, sampled queues, gusts and vehicles. Ranges: 95 % "
        "confidence intervals)"
    )


def schedule_sheet(c: Composition, zone: ZoneInfo) -> Sheet:
    """The typical schedule, leg by leg and stop by stop."""
    columns = [
        Column("time", justify="left"), Column("leg", justify="left"), Column("", "km"), Column("course"),
        Column("wind", "m/s"), Column("from"), Column("tail", "m/s"), Column("cross", "m/s"),
        Column("speed", "m/s", words="ground speed {} m/s"), Column("takes"), Column("charge", "%"),
        Column("reserve", "kept", words="reserve kept {}"), Column("hold for", "wind", words="hold for wind {}"),
        Column("hold for", "capacity", words="hold for capacity {}"),
    ]  # fmt: skip
    sheet = Sheet(columns, names=2)
    _add_flights(sheet, c, zone, c.depart)
    sheet.note(f"{clock(c.arrive, zone, c.depart)}  {c.destination}: {delivered_text(c)}")
    back = None if c.way_back is None else c.way_back.plan
    if back is not None:
        _add_flights(sheet, back, zone, c.depart)
        sheet.note(f"{clock(back.arrive, zone, c.depart)}  {back.destination}: {end_text(back)}")
    return sheet


def _add_flights(sheet: Sheet, c: Composition, zone: ZoneInfo, day: datetime) -> None:
    """Add the legs of a plan, each after the stop before it; times on another day include the date."""
    runs = c.arrival.runs
    for leg in c.services:
        stop = c.stop_before(leg)
        if stop is not None:
            zoned = any(note.endswith(WAITS.format(stop.station)) for note in c.notes)
            opens = any(one.startswith(f"waits at {stop.station} for {leg.destination} to open") for one in c.notes)
            timed = opens or (c.not_before is not None and leg is c.services[-1])
            said = stop_text(stop, leg.destination, for_a_zone=zoned, for_a_time=timed)
            sheet.note(f"{clock(stop.arrive, zone, day)}  {said}")
        sheet.add(clock(leg.depart, zone, day), *_leg_cells(leg, runs))
        if len(leg.segments) > 1:
            for segment in leg.segments:
                sheet.add("", *_segment_cells(segment))


def leg_name(leg: DroneService) -> str:
    """Stations of a leg; those overflown in brackets."""
    return f"{leg.origin} > " + "".join(f"({key}) > " for key in leg.via) + leg.destination


def _leg_cells(leg: DroneService, runs: int | None) -> tuple[str, ...]:
    bends = len(leg.segments) > 1
    return (
        leg_name(leg),
        kilometres(leg.distance_m),
        "" if bends else direction_text(leg.bearing_deg),
        leg.wind.range_text,
        leg.wind.direction_text,
        "" if bends else f"{leg.tailwind_mps:+.1f}",
        "" if bends else f"{leg.crosswind_mps:+.1f}",
        f"{leg.ground_speed_mps:.1f}",
        duration(leg.flight_time_s),
        from_to(leg.soc_depart, leg.soc_arrive),
        kept_share(leg.p_reserve, runs),
        probability(leg.p_hold),
        probability(leg.p_hold_room),
    )


def _segment_cells(segment: LegSegment) -> tuple[str, ...]:
    return (
        f"  to {segment.head}",
        kilometres(segment.distance_m),
        direction_text(segment.bearing_deg),
        segment.wind.range_text,
        segment.wind.direction_text,
        f"{segment.tailwind_mps:+.1f}",
        f"{segment.crosswind_mps:+.1f}",
        *[""] * 6,
    )


def stop_text(stop: Stop, bound_for: str, *, for_a_zone: bool = False, for_a_time: bool = False) -> str:
    """Describe the actions at a stop, each wait by its reason."""
    doing = []
    if stop.recharge_s > 0:
        wait = f"wait {duration(stop.wait_s)} for a pad" if stop.wait_s >= 0.5 else "a pad at once"
        doing.append(f"{wait} (free on arrival {probability(stop.p_pad_free)})")
        doing.append(f"charge {duration(stop.recharge_s)} to {percent(stop.soc_to)}")
    if stop.hold_room_s >= 0.5:
        what = f"until {bound_for} may be landed at" if for_a_time else f"for free capacity at {bound_for}"
        doing.append(f"hold {duration(stop.hold_room_s)} {what}")
    if stop.hold_s - stop.hold_room_s >= 0.5:
        doing.append(f"hold {duration(stop.hold_s - stop.hold_room_s)} for {'a zone' if for_a_zone else 'the wind'}")
    return f"{stop.station}: {', '.join(doing) or 'land and take off again'}"


def _print_totals(report: PlanReport, zone: ZoneInfo) -> None:
    result = report.result
    c = result.composition
    parts = [f"flight {duration(c.flight_time_s)}"]
    if c.recharge_time_s or c.wait_time_s:
        parts += [f"wait {duration(c.wait_time_s)}", f"recharge {duration(c.recharge_time_s)}"]
    mean = "" if result.mean_energy_j is None else f" ({energy_text(result.mean_energy_j)} on average)"
    say(
        f"Typical total: {', '.join(parts)}; {distance_text(c.distance_m)}, {energy_text(c.energy_j)}{mean}, "
        f"lowest charge {percent(c.min_soc)} (reserve {percent(c.reserve_soc, None)})"
    )
    say("Wind: mean and 80 % range of the speed at the place, time and height of the flight; tail and cross: averages")
    for line in way_back_lines(c, zone):
        say(line)
    if result.robust is not None:
        _print_choices(result.robust, report)
    for note in c.notes:
        say(f"Note: {note}")
    for drone, why in result.rejected.items():
        say(f"Not {drone}: {why}")
    say(f"Planned in {spent(result.planning_time_s)}, {result.labels_expanded:,} evaluated")


def _print_choices(answer: RobustAnswer, report: PlanReport) -> None:
    """Alternatives to the plan, and its distance from the optimum."""
    from skyway.planner.explain import stop_names
    from skyway.planner.schedule.outcome import later

    for one in report.charges:
        often = f"; {probability(one.idle)} of the deliveries leave at once" if one.idle >= 0.005 else ""
        low, high = percent(one.low), percent(one.high)
        between_ = low if low == high else f"{low} to {high}"
        say(f"At {one.station} the charge depends on the wind at that time: {between_} in 8 of 10 deliveries{often}")
    others = [one for one in answer.candidates[1:] if stop_names(one) != stop_names(answer.candidates[0])]
    if others:
        way = "with stops at " + ", ".join(stop_names(others[0])) if stop_names(others[0]) else "without a stop"
        say(f"Next best route, {way}: {later_text(later(others[0].outcome, answer.candidates[0].outcome))}")
    bound = report.bound
    if bound is not None:
        say(
            f"Lower bound with perfect forecast: {duration(bound.bound_s)} on average; "
            f"this plan takes {percent(max(bound.gap, 0.0))} longer"
        )
        if bound.careful_s is not None and bound.careful_gap is not None:
            say(
                f"Lower bound that also keeps the reserve, without turning back in the air: {duration(bound.careful_s)}; "
                f"this plan takes {percent(max(bound.careful_gap, 0.0))} longer"
            )
