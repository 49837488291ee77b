"""Cutting: from a mission and pads to one mission for each battery."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.missions.checks.report import check
from skyway.missions.checks.weather import ForecastWind
from skyway.missions.items.document import MissionDocument
from skyway.missions.recharge.parts import PartBuilder
from skyway.missions.recharge.spans import Cut
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import duration, probability
from skyway.models.base.views import counted
from skyway.recharge.problem import RechargeOptions, problem_of, sure_ratio_of, surer
from skyway.recharge.reasons import no_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.report import CheckReport
    from skyway.missions.items.finding import Finding
    from skyway.planner.fixed_route.charging_stops import ChargingPlan
    from skyway.recharge.order.ordering import OrderTold
    from skyway.recharge.preparing import Prepared
    from skyway.recharge.problem import RechargeProblem

MAX_ROUNDS = 6
"""Largest number of rounds in which flights get more charge because of the winds of a forecast, or of turns."""
ROUNDED = 1.003
"""Allowance for rounded places and heights in files, as a factor on the energy."""
LATE_S = 1.0


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight from the ground to the ground, on one battery."""

    document: MissionDocument
    report: CheckReport
    depart_s: float
    """After the first take-off."""
    soc_start: float


@dataclass(frozen=True, eq=False, slots=True)
class Recharged:
    """A mission cut at pads."""

    problem: RechargeProblem
    plan: ChargingPlan
    cuts: tuple[Cut, ...]
    flights: dict[str, tuple[Flight, ...]]
    """By the name of the autopilot."""
    notes: tuple[str, ...]
    whole: dict[str, MissionDocument]
    """All flights in one mission, by the name of each autopilot that can fly one."""
    order: OrderTold | None = None
    """Report on the order, if its parts may be reordered."""

    @property
    def told(self) -> tuple[Flight, ...]:
        """Flights of the first autopilot, to which all figures apply."""
        return next(iter(self.flights.values()))


def cut_as_planned(ready: Prepared, options: RechargeOptions) -> Recharged:
    """Cut a mission as `recharged` does, without a slack at pads that are available for a limited time (`skyway.recharge.pad_slack`)."""
    document, families, notes, left_out = ready.document, ready.families, ready.notes, [*ready.left_out]
    work = ready.work(options)
    ways = ready.ways(work, options)
    problem = problem_of(work, ways, options)
    sure, least_sure = ROUNDED * sure_ratio_of(options, work), ROUNDED * sure_ratio_of(options)
    for number in range(MAX_ROUNDS):
        plan = problem.stops(sure)
        if plan is None and number == 0 and sure > least_sure:  # perhaps no flight has as many turns as the mean
            sure = least_sure
            plan = problem.stops(sure)
        if plan is None:
            raise no_plan(problem, sure)
        if options.swap_s is not None:
            plan = _with_full_batteries(plan)
        cuts = cuts_of(plan)
        flights = {family.name: flights_of(document, problem, plan, cuts, family) for family in families}
        least = min(flight.report.legs[-1].p_reserve or 0.0 for flown in flights.values() for flight in flown)
        if least >= 1.0 - options.epsilon - 1e-9:
            break
        sure = surer(sure, least, options)
    else:
        raise InputError(
            f"a landing keeps the reserve with probability {probability(least, 1)} only: the winds of the forecast differ too much, or there are too many turns",
            field="--epsilon",
            remedy="allow a larger --epsilon, or wait for a better forecast",
        )
    faults = {family.name: _faults(flights[family.name], family) for family in families}
    fit = {name: flown for name, flown in flights.items() if not faults[name]}
    if not fit:
        raise InputError([fault for found in faults.values() for fault in found])
    left_out += [f"no missions for {name}: {found[0].problem}" for name, found in faults.items() if found]
    route = work.route
    told = tuple(
        f"item {number} jumps back without end: flown {options.laps + 1} times" for number in route.endless_jumps
    )
    whole: dict[str, MissionDocument] = {}
    if options.single and len(next(iter(fit.values()))) > 1:
        for family in families:
            if family.name in fit:
                builder = PartBuilder(work, ways, options.transit, family)
                whole[family.name], begins = _in_one(fit[family.name], builder)
                left_out += _set_by_hand(family, begins)
    if plan.depart_s >= LATE_S:
        left_out.append(
            f"the first take-off is {duration(plan.depart_s)} later than possible, since pads are available later"
        )
    found = Recharged(problem, plan, cuts, fit, (*notes, *told, *left_out), whole)
    if options.swap_s is None or not plan.stops:
        return found
    if options.packs is not None:
        waits_s = sum(stop.leave_s - options.ground_s - options.swap_s - stop.on_pad_s for stop in plan.stops)
        told_of_packs = f"of {counted(options.packs, 'pack')}, {options.chargers} charged at a time; total wait for full ones {duration(waits_s)}"
        return replace(found, notes=(*found.notes, told_of_packs))
    packs = f"{packs_needed(found)} batteries are needed, each charged as soon as it is removed"
    return replace(found, notes=(*found.notes, packs))


def _in_one(flights: Sequence[Flight], builder: PartBuilder) -> tuple[MissionDocument, tuple[int, ...]]:
    """Join flights to one mission, with the first item of each; an `InputError` reports the findings of its check."""
    mission, begins = builder.whole([flight.document.mission for flight in flights])
    document = replace(flights[0].document, mission=mission)
    errors = [one for one in check(document, dialect=builder.family).findings if one.severity == "error"]
    if errors:
        raise InputError([Fault(f"the single mission: {one.message}", field=one.code) for one in errors])
    return document, begins


def _set_by_hand(family: Family, begins: Sequence[int]) -> tuple[str, ...]:
    """Return manual actions before each flight of a single mission, if the autopilot does not continue automatically."""
    if family.stays_in_mission_after_landing:
        return ()
    items = ", ".join(
        f"{begin + family.home_items} for battery {number}" for number, begin in enumerate(begins[1:], start=2)
    )
    return (
        f"{family.name} returns to the first item of the single mission when it disarms: before arming, set the current item to {items}",
    )


def _with_full_batteries(plan: ChargingPlan) -> ChargingPlan:
    """Let every flight begin with its full battery, not only with the required charge."""
    stops = []
    gained = 0.0
    for stop in plan.stops:
        stops.append(replace(stop, soc_arrive=stop.soc_arrive + gained, soc_leave=1.0))
        gained = 1.0 - stop.soc_leave
    return replace(plan, stops=tuple(stops), soc_end=plan.soc_end + gained)


def packs_needed(found: Recharged) -> int:
    """Return the number of batteries required so that a full one is ready at every change, each charged as soon as it is removed."""
    curve = found.problem.options.conditions.drone.charging_curve()
    ready: list[float] = []
    packs = 1
    for stop in found.plan.stops:
        again = min((one for one in ready if one <= stop.leave_s), default=None)
        if again is None:
            packs += 1
        else:
            ready.remove(again)
        ready.append(stop.leave_s + float(curve.duration_s(max(stop.soc_arrive, 0.0), 1.0)))
    return packs


def cuts_of(plan: ChargingPlan) -> tuple[Cut, ...]:
    """Return the places at which the work is interrupted, with the landing pads before it resumes."""
    found: list[Cut] = []
    for stop in plan.stops:
        if found and found[-1].point == stop.position:
            found[-1] = Cut(stop.position, (*found[-1].pads, stop.pad))
        else:
            found.append(Cut(stop.position, (stop.pad,)))
    return tuple(found)


def flights_of(
    document: MissionDocument,
    problem: RechargeProblem,
    plan: ChargingPlan,
    cuts: Sequence[Cut],
    family: Family,
    begin: tuple[int, int] | None = None,
) -> tuple[Flight, ...]:
    """Make and check the flights of an autopilot, from the start or from a point and a pad on.

    Each starts at the time and with the charge of the plan.
    """
    conditions, transit = problem.options.conditions, problem.options.transit
    builder = PartBuilder(problem.work, problem.ways, transit, family)
    missions = builder.flights(cuts, begin)
    begins = [(plan.depart_s, conditions.soc_start), *((stop.leave_s, stop.soc_leave) for stop in plan.stops)]
    used = tuple(problem.ways.pads[number] for number in sorted({stop.pad for stop in plan.stops}))
    found = []
    for mission, (depart_s, soc) in zip(missions, begins, strict=True):
        part = MissionDocument(mission, document.fence, document.rally)
        flown_by = replace(conditions, soc_start=soc, stations=used)
        report = check(
            part,
            dialect=family,
            conditions=_later(flown_by, depart_s),
            zones=transit.zones,
            over=transit.over,
            depart_s=_instant(conditions, depart_s),
        )
        found.append(Flight(part, report, depart_s, soc))
    return tuple(found)


def _later(conditions: FlightConditions, by_s: float) -> FlightConditions:
    weather = conditions.weather
    if isinstance(weather, ForecastWind):
        return replace(conditions, weather=replace(weather, depart_s=weather.depart_s + by_s))
    return conditions


def _instant(conditions: FlightConditions, by_s: float) -> float | None:
    weather = conditions.weather
    return weather.depart_s + by_s if isinstance(weather, ForecastWind) else None


def _faults(flights: Sequence[Flight], family: Family) -> list[Fault]:
    """Return the reason why an autopilot would not fly: the error of a check, and its flight."""
    faults: list[Fault] = []
    for number, flight in enumerate(flights, start=1):
        errors: list[Finding] = [one for one in flight.report.findings if one.severity == "error"]
        for error in errors[:3]:
            where = "" if error.item is None else f", item {error.item}"
            problem = f"battery {number} for {family.name}{where}: {error.message}"
            faults.append(Fault(problem, field=error.code, remedy=error.remedy))
    return faults
