"""A cut mission in flight: its flights for the supervisor, replanned with measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.legs import LegMission
from skyway.link.supervisor.work.task import Aloft, Judgement, Known, WorkFlight, WorkPlan
from skyway.missions.checks.energy import FlightConditions, fly_leg
from skyway.missions.checks.route import RouteLeg, fly
from skyway.missions.checks.weather import ForecastWind
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.recharge.parts import PartBuilder
from skyway.missions.recharge.spans import Span, spans_of
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration, modelled, percent
from skyway.models.drones.energy_belief import SOC_SD
from skyway.models.flight.energy import FlightPower
from skyway.recharge.cutting import MAX_ROUNDS, ROUNDED, Recharged, cuts_of, flights_of
from skyway.recharge.flying import rest
from skyway.recharge.flying.as_composition import composition_of
from skyway.recharge.output import parameters_of
from skyway.recharge.problem import MORE_SURE, sure_ratio_of, surer
from skyway.recharge.reasons import no_plan
from skyway.recharge.simulated import simulated

if TYPE_CHECKING:
    from skyway.missions.autopilots.family import Family
    from skyway.missions.recharge.spans import Done
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.recharge.cutting import Flight
    from skyway.recharge.flying.places import WorkPlaces
    from skyway.recharge.flying.rest import RestPlan
    from skyway.recharge.problem import RechargeOptions, RechargeProblem

RUNS = 1000
WHOLE_PERCENT = 100.0
EARLIER_ROUNDS = 8


@dataclass(eq=False, slots=True)
class SetPlanner:
    """Plans the flights of one cut mission.

    Attributes
    ----------
    found : Recharged
        The mission after cutting.
    document : MissionDocument
        The mission that was cut, with its fence and rally points.
    places : WorkPlaces
        Stations of its pads, its start and its end.
    exponent : float
        How the wind grows with height.
    zero_s : float
        POSIX seconds of the first take-off, from which windows of pads count.
    """

    found: Recharged
    document: MissionDocument
    places: WorkPlaces
    exponent: float
    zero_s: float
    identity: str
    """Of the set; the composition of every plan has it."""
    _made: dict[tuple[str, Span], tuple[WorkFlight, RouteLeg]] = field(default_factory=dict)

    @property
    def epsilon(self) -> float:
        """A landing may miss the reserve with this probability."""
        return self.found.problem.options.epsilon

    @property
    def transit_mps(self) -> float:
        """Ground speed of ways to pads."""
        return self.found.problem.options.transit.speed_mps

    # Called by the supervisor

    def pad_of(self, station: str | None) -> int | None:
        """Return the pad at a station."""
        return self.places.pad_of(station)

    def point_at(self, done: Done | None) -> int:
        """Return the last completed point at which the work may be left."""
        if done is None:
            return 0
        points = self.found.problem.work.points
        behind = (
            number
            for number, point in enumerate(points)
            if point.hinders is None and (point.step, point.share) <= (done[0], done[1] + rest.AHEAD)
        )
        return max(behind, default=0)

    def is_done(self, span: Span, done: Done | None) -> bool:
        """Whether all work of a flight is done."""
        work = self.found.problem.work
        if span.only_moves:
            return True
        if done is None:
            return False
        if span.end is None:
            return done[0] >= len(work.steps) - 1
        point = work.points[span.end[0]]
        return done >= (point.step, point.share - rest.AHEAD)

    def plan(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Plan the remaining work."""
        problem = rest.with_known(self.found.problem, self._options(known))
        options = problem.options
        belief = known.belief.next_flight()
        sure = max(belief.mean_ratio, ROUNDED * sure_ratio_of(options, problem.work))
        planned: RestPlan | None = None
        for _ in range(MAX_ROUNDS):
            ratios = (belief.mean_ratio, sure)
            planned = (
                rest.from_start(problem, known.soc, ratios)
                if begin is None
                else rest.from_pad(problem, begin, known.soc, ratios)
            )
            if planned is None:
                raise no_plan(problem, sure)
            flights = self._checked(family, problem, begin, planned)
            least = flights[0].report.legs[-1].p_reserve or 0.0
            if least >= 1.0 - options.epsilon - 1e-9:
                break
            sure = surer(sure, least, options)
        if planned is None:
            raise no_plan(problem, sure)
        return self._told(family, problem, begin, planned, known)

    def as_cut(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Return the remaining work as cut before the first take-off."""
        spans = spans_of(self.found.cuts)
        number = next((k for k, span in enumerate(spans) if span.begin == begin), None)
        if number is None:
            raise InputError(
                "the drone stands where no flight of the set begins", remedy="let it replan: remove --no-replan"
            )
        plan = self.found.plan
        stops = plan.stops[number:]
        first = None if number == 0 else plan.stops[number - 1]
        depart_s = plan.depart_s if first is None else first.leave_s
        soc = self.found.problem.options.conditions.soc_start if first is None else first.soc_leave
        moved = tuple(
            replace(
                one, arrive_s=one.arrive_s - depart_s, on_pad_s=one.on_pad_s - depart_s, leave_s=one.leave_s - depart_s
            )
            for one in stops
        )
        left = replace(plan, stops=moved, depart_s=0.0, end_s=plan.end_s - depart_s)
        planned = rest.RestPlan(cuts_of(left), 0.0, soc, left)
        problem = rest.with_known(self.found.problem, self._options(known))
        return self._told(family, problem, begin, planned, known)

    def flight(self, family: Family, span: Span, known: Known) -> WorkFlight:
        """Make the mission of a flight, with its time and energy by present knowledge."""
        made, leg = self._mission(family, span)
        conditions = self._conditions(known)
        mission = made.mission.document.mission
        flown = fly_leg(
            mission, leg, conditions, conditions.payload_kg, np.zeros(len(conditions.weather.probability)), 0.0
        )
        weight = np.where(flown.flyable, conditions.weather.probability, 0.0)
        if not weight.sum() > 0.0:
            weight = np.asarray(conditions.weather.probability)  # no take-off in such a wind: the checklist prevents it
        weight = weight / weight.sum()
        soc = np.where(flown.flyable, flown.energy_j, 0.0) / conditions.drone.battery_j
        seconds = np.where(flown.flyable, flown.time_s, 0.0)
        mean = float(weight @ soc)
        spread = math.sqrt(max(float(weight @ soc**2) - mean**2, 0.0))
        belief = known.belief
        sd = math.sqrt((mean * belief.leg_sd) ** 2 + (spread * belief.mean_ratio) ** 2 + SOC_SD**2)
        land = known.soc - mean * belief.mean_ratio
        return replace(made, planned_s=float(weight @ seconds), modelled_soc=mean, soc_land=land, soc_sd=sd)

    def judge(self, family: Family, aloft: Aloft) -> Judgement:
        """Predict the rest of the current flight."""
        return self._judge(family, aloft, aloft.span)

    def earlier(self, family: Family, aloft: Aloft, judged: Judgement) -> tuple[Span, Judgement] | None:
        """Return the flight that leaves the work early enough to keep the reserve; the best available if none does."""
        options = self._options(aloft)
        problem = rest.with_known(self.found.problem, options)
        first = self._next_point(aloft)
        if first is None:
            return None
        tail = self._tail(problem, aloft.span, first)
        left = max(judged.left_s - tail[0], 0.0), max(judged.left_soc - tail[1], 0.0)
        belief = aloft.belief
        sure = belief.mean_ratio + belief.sd_between * belief.sigmas(1.0 - options.epsilon)
        best: tuple[Span, Judgement] | None = None
        for _ in range(EARLIER_ROUNDS):
            planned = rest.in_air(problem, first, left, aloft.soc, (belief.mean_ratio, sure))
            if planned is None or not planned.cuts:
                break
            cut = planned.cuts[0]
            span = Span(aloft.span.begin, (cut.point, cut.pads[0]))
            then = self._judge(family, aloft, span)
            if best is None or then.p_below < best[1].p_below:
                best = span, then
            if then.p_below <= options.epsilon:
                return best
            sure *= MORE_SURE
        nearest = self._nearest(family, problem, aloft, first)
        if nearest is not None and (best is None or nearest[1].p_below < best[1].p_below):
            best = nearest
        return best

    def refuge(self, aloft: Aloft) -> tuple[str, Judgement] | None:
        """Return the pad with the lowest charge to reach from here: straight, as from the last point of the work."""
        conditions, ways = self._conditions(aloft), self.found.problem.ways
        transit = self.found.problem.options.transit
        power = FlightPower.of(conditions.drone, conditions.payload_kg)
        at = self.point_at(aloft.done)
        behind = ways.level_m[at]
        best: tuple[str, Judgement] | None = None
        for number, pad in enumerate(ways.pads):
            if not math.isfinite(behind[number]) or (at, number) in ways.via:  # the way is straight
                continue
            own = 0.0 if aloft.span.begin is None else ways.ground_m[aloft.span.begin[1]]
            descent_s = max(aloft.height_m + own - ways.ground_m[number], 0.0) / conditions.descent_rate_mps
            level_s = geodesy.distance_m(*aloft.place, pad.lat, pad.lon) / transit.speed_mps
            soc = float(power.energy_j(0.0, level_s, descent_s)) / power.battery_j  # type: ignore[arg-type]
            p_below = float(_below(aloft.soc - conditions.reserve_soc, np.array(soc), aloft.belief))
            land = aloft.soc - soc * aloft.belief.mean_ratio
            if best is None or land > best[1].soc_land:
                best = pad.id, Judgement(left_s=level_s + descent_s, left_soc=soc, soc_land=land, p_below=p_below)
        return best

    # Helpers

    def _nearest(
        self, family: Family, problem: RechargeProblem, aloft: Aloft, first: int
    ) -> tuple[Span, Judgement] | None:
        """Return the flight to the pad with the lowest charge from the first place ahead at which the work may be left."""
        points = problem.work.points
        ahead = next((k for k in range(first, len(points)) if points[k].hinders is None), None)
        if ahead is None or not np.isfinite(problem.hops.to_s[0, ahead]).any():
            return None
        pad = int(np.argmin(np.where(np.isfinite(problem.hops.to_s[0, ahead]), problem.hops.to_soc[0, ahead], np.inf)))
        span = Span(aloft.span.begin, (ahead, pad))
        return span, self._judge(family, aloft, span)

    def _next_point(self, aloft: Aloft) -> int | None:
        """Return the first point ahead with a part of the work done; None if there is none."""
        points = self.found.problem.work.points
        begin = 0 if aloft.span.begin is None else aloft.span.begin[0]
        least = points[begin].step, points[begin].share
        following = rest.next_point(self.found.problem.work, max(aloft.done or least, least))
        return None if following is None else max(following, begin + 1)

    @staticmethod
    def _tail(problem: RechargeProblem, span: Span, first: int) -> tuple[float, float]:
        """Return seconds and charge from the next point of the work to the end of a flight."""
        hops = problem.hops
        end = len(problem.work.points) - 1 if span.end is None else span.end[0]
        if first > end:
            return 0.0, 0.0
        seconds, soc = float(hops.work_s[0, first:end].sum()), float(hops.work_soc[0, first:end].sum())
        if span.end is not None:
            seconds += float(hops.to_s[0, end, span.end[1]])
            soc += float(hops.to_soc[0, end, span.end[1]])
        return (seconds, soc) if math.isfinite(seconds) else (0.0, 0.0)

    def _judge(self, family: Family, aloft: Aloft, span: Span) -> Judgement:
        made, leg = self._mission(family, span)
        conditions = self._conditions(aloft)
        steps = [step for step in leg.steps if step.item >= aloft.item]
        rest_of = RouteLeg(aloft.item, leg.item_to, Point.of_degrees(*aloft.place), steps, leg.landing)
        weight = conditions.weather.probability
        flown = fly_leg(
            made.mission.document.mission,
            rest_of,
            conditions,
            conditions.payload_kg,
            np.zeros(len(weight)),
            aloft.height_m,
            0.0,
        )
        battery_j, belief = conditions.drone.battery_j, aloft.belief
        typical = float(weight @ np.where(flown.flyable, flown.energy_j, 0.0)) / max(
            float(weight @ flown.flyable), 1e-9
        )
        soc = np.where(flown.flyable, flown.energy_j, typical) / battery_j
        seconds = np.where(flown.flyable, flown.time_s, 0.0)
        mean = float(weight @ soc)
        p_below = float(weight @ _below(aloft.soc - conditions.reserve_soc, soc, belief))
        return Judgement(
            left_s=float(weight @ seconds) / max(float(weight @ flown.flyable), 1e-9),
            left_soc=mean,
            soc_land=aloft.soc - mean * belief.mean_ratio,
            p_below=p_below,
        )

    def _mission(self, family: Family, span: Span) -> tuple[WorkFlight, RouteLeg]:
        """Make a flight; cached."""
        key = family.name, span
        if key not in self._made:
            problem = self.found.problem
            builder = PartBuilder(problem.work, problem.ways, problem.options.transit, family)
            mission = builder.flight(span)
            document = MissionDocument(mission, self.document.fence, self.document.rally)
            route = fly(mission, autopilot=family)
            points = [mission.home.point] if mission.home is not None else []
            way = tuple((one.lat, one.lon) for one in [*points, *(step.point for step in route.steps)])
            flight = WorkFlight(
                span=span,
                mission=LegMission(document, parameters_of(self.found, family.name, [document]), way),
                reaches=builder.reaches(span),
                origin=self.places.of(None if span.begin is None else span.begin[1], end=False),
                destination=self.places.of(None if span.end is None else span.end[1], end=True),
                diverts=self._diverts(span),
                planned_s=0.0,
                modelled_soc=0.0,
                soc_land=0.0,
                soc_sd=0.0,
                speed_mps=problem.options.transit.speed_mps,
            )
            self._made[key] = flight, route.legs[0]
        return self._made[key]

    def _diverts(self, span: Span) -> tuple[str, ...]:
        """Return the pads that can be reached from every point of a flight, except for its destination."""
        ways = self.found.problem.ways
        first = 0 if span.begin is None else span.begin[0]
        last = len(ways.level_m) if span.end is None else span.end[0] + 1
        open_to = np.isfinite(ways.level_m[first:last]).all(axis=0)
        own = None if span.end is None else span.end[1]
        return tuple(self.places.of(int(pad), end=True) for pad in np.flatnonzero(open_to) if pad != own)

    def _options(self, known: Known) -> RechargeOptions:
        options = self.found.problem.options
        past_s = known.time_s - self.zero_s
        windows = {
            name: tuple((begin - past_s, end - past_s) for begin, end in found)
            for name, found in options.windows.items()
        }
        return replace(options, conditions=self._conditions(known), queues=None, windows=windows)

    def _conditions(self, known: Known) -> FlightConditions:
        """Return the conditions of flight: the present winds, and the beliefs about the drone."""
        conditions = self.found.problem.options.conditions
        return replace(
            conditions,
            drone=replace(conditions.drone, energy_belief=known.belief),
            soc_start=min(max(known.soc, 0.0), 1.0),
            weather=ForecastWind(known.forecast, known.time_s, self.exponent),
        )

    def _checked(
        self, family: Family, problem: RechargeProblem, begin: tuple[int, int] | None, planned: RestPlan
    ) -> tuple[Flight, ...]:
        """Check the remaining flights as written."""
        conditions = replace(problem.options.conditions, soc_start=planned.soc_leave)
        problem = replace(problem, options=replace(problem.options, conditions=conditions))
        plan = replace(planned.plan, depart_s=planned.depart_s)
        return flights_of(self.document, problem, plan, planned.cuts, family, begin)

    def _told(
        self, family: Family, problem: RechargeProblem, begin: tuple[int, int] | None, planned: RestPlan, known: Known
    ) -> WorkPlan:
        """Return a plan and the report on it."""
        flights = self._checked(family, problem, begin, planned)
        conditions = replace(problem.options.conditions, soc_start=planned.soc_leave)
        problem = replace(problem, options=replace(problem.options, conditions=conditions))
        plan = replace(planned.plan, depart_s=planned.depart_s)
        left = Recharged(problem, plan, planned.cuts, {family.name: flights}, (), {})
        flown = simulated(left, runs=RUNS)
        spans = spans_of(planned.cuts, begin)
        composition = composition_of(left, flown, spans, self.places, known.time_s, self.identity)
        to = self.places.of(None if spans[0].end is None else spans[0].end[1], end=True)
        soc = min(math.ceil(WHOLE_PERCENT * planned.soc_leave - 1e-6) / WHOLE_PERCENT, 1.0)
        if self.found.problem.options.swap_s is not None and begin is not None:
            soc = 1.0
        said = (
            f"to {to} with {percent(soc)}, {len(spans) - 1} more stop{'' if len(spans) == 2 else 's'}; the work ends in"
            f" {duration(flown.end_s)} ({duration(flown.end_p50_s)} in half of the cases, {duration(flown.end_late_s)} in 95 %),"
            f" all landings keep the reserve with probability {modelled(flown.p_reserve)}"
        )
        figures = {
            "p_reserve": flown.p_reserve, "end_mean_s": flown.end_s, "end_p05_s": flown.end_early_s, "end_p50_s": flown.end_p50_s,
            "end_p95_s": flown.end_late_s, "stops": len(spans) - 1, "charge_to": soc,
        }  # fmt: skip
        return WorkPlan(
            span=spans[0],
            charge_to=soc,
            leave_s=known.time_s + planned.depart_s - self._handled_s(begin, known.soc, planned.soc_leave),
            composition=composition,
            said=said,
            figures=figures,
        )

    def _handled_s(self, begin: tuple[int, int] | None, before: float, after: float) -> float:
        """Return the duration of the stay on the present pad, by the plan: charging, and the preparation of the take-off."""
        problem = self.found.problem
        if begin is None:
            return 0.0
        if after <= before or problem.options.swap_s is not None:
            return problem.options.ground_s
        pad = problem.ways.pads[begin[1]]
        curve = problem.options.conditions.drone.charging_curve(pad.recharge_power_w)
        return problem.options.ground_s + float(curve.duration_s(max(before, 0.0), np.float64(after)))


def _below(budget_soc: float, cost: np.ndarray, belief: EnergyBelief) -> np.ndarray:
    """Probability of landing below a charge in each wind, by the belief about this flight and the uncertainty of the charge."""
    from scipy.special import ndtr

    spread = np.maximum(np.hypot(cost * belief.sd_between, SOC_SD), 1e-9)
    return np.asarray(ndtr(belief.normal_deviate((cost * belief.mean_ratio - budget_soc) / spread)))
