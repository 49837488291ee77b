"""Plans for the page: computed by the functions of ``skyway plan``, as documents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import msgspec
import numpy as np

from skyway.models.base.errors import SkywayError
from skyway.models.base.formatting import (
    about,
    between,
    by,
    date_clock,
    duration,
    headline,
    minutes,
    money,
    percent,
    promised,
    share,
)
from skyway.models.composition.file import to_json
from skyway.models.composition.way_back_words import way_back_lines
from skyway.plan_document import UNCERTAINTIES, between_sites_words, size_words, why_here, why_so_much
from skyway.planner.parameters.planner import USUAL
from skyway.planner.registry import CLAIRVOYANT_PLANNERS
from skyway.planner.report import plan_report
from skyway.planning import Conditions, avoiding, solve, solve_window, with_pads
from skyway.plots.charge_band import charge_by_leg
from skyway.web.work.question import MOST_PLANS, ROBUST, Question, conditions, pads
from skyway.web.work.region import loaded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.departure import Departure
    from skyway.planner.result import PlanResult

TIME_LIMIT_S = 60.0
"""Time limit of planners that search for the best, as in the command: a shorter one would give another plan on a busy machine."""
BINS = 48
"""Number of bars of the distribution of the arrival."""
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of the charge."""


def plan(scenario: str | None, asked: dict[str, Any], timezone: str | None = None) -> dict[str, Any]:
    """Return the plan for a question as a document, and those of other planners. Raises a `SkywayError` with the reason if there is none.

    The failure of a planner for comparison is in ``without``. Times are shown in a zone, or in the region's own.
    """
    question = msgspec.convert(asked, Question)
    world = loaded(scenario)
    how = conditions(question, scenario)
    first, tried, wide = _solved(world, question, how, question.planner)
    results, without = [first], []
    for name in question.others:
        if len(results) >= MOST_PLANS or name == question.planner:
            continue
        try:
            results.append(_solved(world, question, how, name)[0])
        except SkywayError as error:
            without.append({"planner": name, "why": str(error)})
    zone = ZoneInfo(timezone or wide.timezone)
    return {
        "timezone": wide.timezone,
        "plans": [_plan(one, zone) for one in results],
        "departures": _departures(first, tried, zone),
        "rejected": dict(first.rejected),
        "without": without,
        "commands": [question.command(scenario, one.composition.planner) for one in results],
    }


def explained(scenario: str | None, asked: dict[str, Any], timezone: str | None = None) -> dict[str, Any]:
    """Return the slower extras beside a plan: other routes of the planner, reasons, and the assumptions of the promise."""
    question = msgspec.convert(asked, Question)
    first, tried, wide = _solved(loaded(scenario), question, conditions(question, scenario), question.planner)
    report = plan_report(first, tried, question.alternatives, explain=question.planner == ROBUST)
    zone = ZoneInfo(timezone or wide.timezone)
    return {
        "alternatives": [_plan(one, zone) for one in (report.alternatives or ())[1:]],
        "reasons": [{"station": one.station, "why": why_here(one), "charge": why_so_much(one)} for one in report.reasons or ()],
        "rests_on": [
            {
                "what": UNCERTAINTIES[one.name], "size": size_words(one), "source": one.source, "remedy": one.remedy or "",
                "gain": "no route" if one.gain is None else f"{minutes(one.gain)} min",
                "clear": one.gain is not None and one.gain.low > 0.0,
            }
            for one in report.rests_on or ()
        ],
        "between_sites": [] if report.between_sites is None else between_sites_words(report.between_sites, first.problem.epsilon),
        "not_counted": list(report.not_counted),
        "bound": None if report.bound is None else duration(report.bound.bound_s),
    }  # fmt: skip


def _solved(
    world: Scenario, question: Question, how: Conditions, planner: str
) -> tuple[PlanResult, list[Departure], Scenario]:
    """Plan as ``skyway plan`` does."""
    world = avoiding(world, how.avoid or ())
    asked = question.delivery().request(world, how.instant, question.objective if planner == ROBUST else "mean")
    if question.window.strip() and planner not in CLAIRVOYANT_PLANNERS:
        result, tried = solve_window(*asked, how, question.window, planner, parameters=USUAL)
        return result, tried, asked[0]
    (wide, request), busy = with_pads(asked, how, pads())
    result = solve(wide, request, how, planner, time_limit_s=TIME_LIMIT_S, parameters=USUAL, busy=busy)
    return result, [], wide


def _spending(c: Composition) -> list[dict[str, str]]:
    """Cost of a delivery in words; empty if the scenario has no prices."""
    if c.costs is None:
        return []
    parts = (("energy", c.costs.energy), ("pads", c.costs.pad_fees), ("refill", c.costs.refill), ("wear", c.costs.wear))
    small = ", ".join(f"{name} {money(value)}" for name, value in parts if value > 0.0)
    value = f"{money(c.costs.mean.value)} {c.costs.currency}"
    return [{"name": "cost", "value": value, "small": f"95 % within {money(c.costs.p95.value)}; {small}"}]


def _plan(result: PlanResult, zone: ZoneInfo) -> dict[str, Any]:
    """One plan: figures with their words, bars, distribution and charge."""
    c, outcome = result.composition, result.outcome
    arrival = c.arrival
    deadline = result.problem.request.objective.deadline
    figures = [("on average", arrival.delivery_mean)]
    if arrival.delivery_p50 is not None and arrival.delivery_p95 is not None:
        figures += zip(
            ("half within", "95 % within"), promised(arrival.delivery_p50, arrival.delivery_p95), strict=True
        )
    return {
        "composition": to_json(c),
        "planner": c.planner,
        "drone": c.drone,
        "headline": headline(c, zone),
        "route": list(c.route),
        "stops": [stop.station for stop in c.stops],
        "path": _path(result),
        "figures": [
            {"name": name, "value": about(one), "minutes": minutes(one), "range": between(one), "by": by(one, c, zone)}
            for name, one in figures
            if one is not None
        ],
        "mean_s": None if arrival.delivery_mean is None else arrival.delivery_mean.value,
        "on_time": None if c.on_time is None or deadline is None else share(c.on_time),
        "kept": None if c.success is None else share(c.success),
        "reserve": percent(c.reserve_soc, None),
        "reserve_soc": c.reserve_soc,
        "energy_j": c.energy_j,
        "mean_energy_j": result.mean_energy_j,
        "spending": _spending(c),
        "distance_m": c.distance_m,
        "never": None if outcome.p_arrive > 1.0 - 1e-9 else percent(1.0 - outcome.p_arrive, 1),
        "depart_s": c.depart.timestamp(),
        "deadline_s": None if deadline is None else deadline.timestamp(),
        "promise_s": None if arrival.p95 is None else arrival.p95.timestamp(),
        "bars": _bars(result),
        "arrivals": _arrivals(result),
        "charge": _charge(result),
        "heights": _heights(c),
        "notes": [*way_back_lines(c, zone), *c.notes],
        "diverts": sorted({name for leg in c.services for name in leg.diverts}),
    }


def _path(result: PlanResult) -> list[list[list[float]]]:
    """Legs as lines of latitude and longitude, bends around zones included."""
    c = result.composition.there_and_back
    return [
        [[c.stations[name].lat, c.stations[name].lon] for name in (leg.origin, *leg.via, leg.destination)]
        for leg in c.services
    ]


def _bars(result: PlanResult) -> list[dict[str, Any]]:
    """Actions of the drone in the typical schedule, in order: fly, wait, charge, hold; POSIX seconds."""
    c = result.composition.there_and_back
    stops = list(c.stops)
    found: list[dict[str, Any]] = []

    def add(kind: str, begin_s: float, length_s: float, where: str) -> float:
        if length_s >= 0.5:
            found.append({"kind": kind, "begin_s": begin_s, "end_s": begin_s + length_s, "where": where})
        return begin_s + max(length_s, 0.0)

    for leg in c.services:
        stop = stops.pop(0) if stops and stops[0].station == leg.origin and stops[0].arrive <= leg.depart else None
        if stop is not None:
            at_s = add("wait", stop.arrive.timestamp(), stop.wait_s, stop.station)
            at_s = add("charge", at_s, stop.recharge_s, stop.station)
            add("hold", at_s, leg.depart.timestamp() - at_s, stop.station)
        elif not found:
            add("hold", c.depart.timestamp(), leg.depart.timestamp() - c.depart.timestamp(), leg.origin)
        way = f"{leg.origin} to {leg.destination}"
        add("fly", leg.depart.timestamp(), (leg.arrive - leg.depart).total_seconds(), way)
    return found


def _arrivals(result: PlanResult) -> dict[str, Any] | None:
    """Share of the simulated deliveries by arrival; the last half percent is not drawn."""
    outcome = result.outcome
    if not len(outcome.weight) or float(np.ptp(outcome.arrival_s)) < 1.0:
        return None
    begin_s, end_s = float(outcome.arrival_s.min()), outcome.quantile_s(0.995)
    shown = outcome.arrival_s <= end_s
    counts, edges = np.histogram(
        outcome.arrival_s[shown], BINS, (begin_s, max(end_s, begin_s + 60.0)), weights=outcome.weight[shown]
    )
    late = float(outcome.weight[~shown].sum())
    quantiles = {str(q): outcome.quantile_s(q) for q in (0.5, 0.95)}
    return {
        "edges_s": edges.tolist(),
        "share": counts.tolist(),
        "beyond": late,
        "mean_s": outcome.mean_s,
        "quantiles_s": quantiles,
    }


def _charge(result: PlanResult) -> dict[str, Any]:
    """Charge at the take-off and the landing of each leg, the way back too: in the typical schedule, and quantiles of the simulated deliveries.

    The quantiles end with the delivery: of the way back there is only the schedule.
    """
    legs = result.composition.there_and_back.services
    fan = charge_by_leg(result, LEVELS)
    simulated = 0 if fan is None else len(fan)
    return {
        "levels": list(LEVELS),
        "legs": [
            {
                "from": leg.origin, "to": leg.destination, "typical": [leg.soc_depart, leg.soc_arrive],
                "fan": np.round(fan[number], 4).tolist() if fan is not None and number < simulated else None,
                "back": number >= len(result.composition.services),
            }
            for number, leg in enumerate(legs)
        ],
    }  # fmt: skip


def _heights(composition: Composition) -> list[dict[str, Any]]:
    """Heights of the legs over terrain; empty if the ground is unknown below them."""
    found = []
    for leg in composition.there_and_back.services:
        if leg.heights is not None:
            ends = {
                "from": leg.origin,
                "to": leg.destination,
                "obstacles": [[one.along_m, one.top_m, one.name] for one in leg.heights.obstacles],
            }
            names = ("along_m", "ground_m", "top_m", "path_along_m", "path_height_m", "least_m", "least_along_m")
            found.append(ends | {name: getattr(leg.heights, name) for name in names})
    return found


def _departures(result: PlanResult, tried: Sequence[Departure], zone: ZoneInfo) -> list[dict[str, Any]]:
    return [
        {
            "depart": date_clock(one.depart, zone), "chosen": one.depart == result.composition.depart,
            "mean": "no route" if one.delivery is None else f"{minutes(one.delivery)} min",
            "on_time": None if one.p_on_time is None else percent(one.p_on_time),
        }
        for one in tried
    ]  # fmt: skip
