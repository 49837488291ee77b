"""Replanning: what to do now, on the ground and in the air, under what is known now; each answer with a sentence.

On the ground the rest of the present plan is flown through the newest forecast, beside what a planner says from here. The
present plan is kept unless it breaks the reserve or another is better by a margin, so that noise does not turn a delivery
to and fro. In the air see `planner.online.replan_flight`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from skyway.models.base.errors import AuditError, InfeasibleError, NoRouteError
from skyway.models.base.units import S_PER_H, S_PER_MIN, from_posix
from skyway.models.composition.composition import State
from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.models.drones.energy import ScaledEnergy
from skyway.planner.online.diverts import Reach
from skyway.planner.online.replan_candidates import Candidate, best_charges, itinerary_of
from skyway.planner.online.replan_departure import charge_needed, held_by_wind
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.registry import ROBUST
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.composing import compose
from skyway.planner.schedule.itinerary import typical_member

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.models.composition.composition import Composition
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.energy_belief import EnergyBelief
    from skyway.planner.problem.request import Request
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome

Action = Literal["continue", "speed", "charge", "wait", "station", "divert", "land", "stop"]
MORE = (1.15, 1.3, 1.5)
"""Where the first flight of a plan cannot be begun, it is left out, and more energy is planned with, before it is given up."""
DEFAULT_PLANNER = ROBUST
"""Planner of replanning where none is named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplanSettings:
    """When a plan is left for another.

    Attributes
    ----------
    epsilon_depart : float
        A leg is begun only with a charge that lands below the reserve with no more than this probability, counting wind
        and what is not known of the energy.
    epsilon_flight : float
        In flight, above this probability of landing below the reserve what else can be done is weighed.
    epsilon_later : float
        Charges of later legs, which are decided again when they are near, may be too low in this share of the forecast.
    plan_sigmas, strict_sigmas : float
        Plans are made with the energy factor so many standard deviations above its mean; with the second where no plan of
        the first can be flown.
    margin_s, margin_share : float
        Another plan must arrive earlier by both: seconds, and a share of the time left.
    divert_share : float
        A divert lands above this share of the reserve, wherever it is begun.
    speed_step_mps, speed_every_s : float
        The ground speed is sent again when it changed by so much, and no oftener than this.
    confirm : int
        Looks in a row that must say the same before a flight is diverted.
    better_every_s : float
        How often in flight a better composition is looked for.
    wait_s : float
        How long to wait for wind or a pad before looking again.
    later_s : tuple of float
        Where nothing can be flown now: how much later that is looked at again, at once by the forecast and by waiting.
    charge_step : float
        Charge targets closer than this are the same.
    """

    epsilon_depart: float = 0.01
    epsilon_flight: float = 0.05
    epsilon_later: float = 0.1
    plan_sigmas: float = 1.0
    strict_sigmas: float = 2.5
    margin_s: float = 180.0
    margin_share: float = 0.05
    divert_share: float = 0.5
    speed_step_mps: float = 0.5
    speed_every_s: float = 30.0
    confirm: int = 3
    better_every_s: float = 60.0
    wait_s: float = 300.0
    later_s: tuple[float, ...] = (1800.0, 3600.0, 7200.0, 14400.0, 21600.0)
    charge_step: float = 0.02


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do now.

    Attributes
    ----------
    action : str
        ``continue``; ``speed``: fly on at another ground speed; ``charge``: to another state of charge; ``wait``;
        ``station``: another next station; ``divert``: to a station, now; ``land``: here, now; ``stop``: stay on the ground.
    reason : str
        A sentence with figures.
    figures : mapping
        What it was decided by.
    composition : Composition or None
        The plan from here, on the ground always and in the air where it changes.
    station : str or None
        Where to, for ``divert`` and ``station``.
    speed_mps : float or None
        For ``speed``.
    charge_to : float or None
        Charge to leave with, on the ground.
    diverts : tuple of str
        Divert stations of the next leg, on the ground.
    until_s : float or None
        For ``wait``: POSIX seconds at which to look again.
    """

    action: Action
    reason: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    composition: Composition | None = None
    station: str | None = None
    speed_mps: float | None = None
    charge_to: float | None = None
    diverts: tuple[str, ...] = ()
    until_s: float | None = None


@dataclass(frozen=True, slots=True)
class Grounded:
    """A drone that stands at a station.

    Attributes
    ----------
    station : str
        Station id.
    time_s, soc : float
        Now, POSIX seconds, and its charge.
    visited : frozenset of str
        Stations it has landed at before.
    busy_pads : mapping
        Busy pads seen at stations now.
    unusable : frozenset of str
        Stations that must not be flown to now.
    planned_soc : float or None
        Charge that the present plan leaves with; None where it does not charge here.
    """

    station: str
    time_s: float
    soc: float
    visited: frozenset[str] = frozenset()
    busy_pads: Mapping[str, int] = field(default_factory=dict)
    unusable: frozenset[str] = frozenset()
    planned_soc: float | None = None


def cautious_drone(drone: Drone, factor: float) -> Drone:
    """Return the drone with its energy scaled."""
    return replace(drone, energy=ScaledEnergy(drone.energy_model, factor))


class GroundReplanner:
    """Decides at every landing, and again before each take-off.

    Parameters
    ----------
    scenario : Scenario
        The region.
    request : Request
        As at the departure; the drone is named.
    planner : str
        See `planner.plan.plan`.
    settings : ReplanSettings
        When a plan is left for another.
    drag : DragModel, optional
        Of the drone: it tells how the energy depends on airspeed.
    """

    def __init__(
        self,
        scenario: Scenario,
        request: Request,
        planner: str = DEFAULT_PLANNER,
        settings: ReplanSettings | None = None,
        *,
        drag: DragModel | None = None,
    ) -> None:
        self.scenario, self.request, self.planner = scenario, request, planner
        self.settings = settings or ReplanSettings()
        self.drone = scenario.drone(request.drone or "")
        self.load = None if drag is None else AirspeedLoad(drag)

    def reach(self, forecast: WindEnsemble, belief: EnergyBelief) -> Reach:
        """Return what can be flown under a forecast."""
        request = self.request
        return Reach(
            self.scenario, forecast, self.drone, request.payload_kg, belief, airspeed_mps=request.airspeed_mps,
            load=self.load,
        )  # fmt: skip

    def decide(
        self, standing: Grounded, current: Composition | None, forecast: WindEnsemble, belief: EnergyBelief
    ) -> Decision:
        """Return what to do at a station.

        Parameters
        ----------
        standing : Grounded
            Where the drone stands.
        current : Composition or None
            The plan from this station on; None where there is none.
        forecast : WindEnsemble
            Brought up to date.
        belief : EnergyBelief
            How much energy flights take.
        """
        decision = self._decide_now(standing, current, forecast, belief)
        return self._wait_for_better(standing, decision, forecast, belief) if decision.action == "stop" else decision

    def _wait_for_better(
        self, standing: Grounded, stop: Decision, forecast: WindEnsemble, belief: EnergyBelief
    ) -> Decision:
        """Where nothing can be flown now, look whether the forecast lets it later, and wait for that on the ground."""
        for wait_s in self.settings.later_s:
            then = replace(standing, time_s=standing.time_s + wait_s, busy_pads={})
            later = self._decide_now(then, None, forecast, belief)
            if later.action != "stop":
                until_s = standing.time_s + min(wait_s, self.settings.later_s[0])
                reason = f"{stop.reason}; in {wait_s / S_PER_H:.1f} h the forecast lets it fly to {later.station}: wait"
                return replace(
                    stop, action="wait", reason=reason, until_s=until_s, figures={**stop.figures, "wait_s": wait_s}
                )
        return stop

    def _decide_now(
        self, standing: Grounded, current: Composition | None, forecast: WindEnsemble, belief: EnergyBelief
    ) -> Decision:
        """Return what to do with what can be flown now."""
        reach = self.reach(forecast, belief.next_flight())
        load = reach.mean_load(reach.way(standing.station, (), self.request.destination), standing.time_s)
        most = load if reach.load is None else max(load, float(reach.load.factor(reach.airspeed_mps)))
        usual, strict = (reach.belief.cautious(s) for s in (self.settings.plan_sigmas, self.settings.strict_sigmas))
        reason = ""
        for factor in (load * usual, most * usual, most * strict, *(more * most * strict for more in MORE)):
            problem = self._problem(standing, forecast, factor)
            kept = None if current is None else self._kept(problem, current, standing)
            fresh, why_not = self._fresh(standing, problem, forecast)
            reason = reason or why_not
            barred = ""
            for action, candidate, why in self._choose(standing, kept, fresh, why_not):
                decision = self._with_charge(standing, problem, action, candidate, why, reach)
                if decision.action != "stop":
                    new = candidate is not kept
                    return replace(decision, figures={**decision.figures, "new_plan": new})
                reason, barred = decision.reason, decision.station or "" if candidate is fresh else barred
            if factor >= most * usual and barred not in ("", self.request.destination):
                standing = replace(
                    standing, unusable=standing.unusable | {barred}
                )  # a way that begins with another flight
        return Decision("stop", reason, {"station": standing.station, "soc": standing.soc})

    # The candidates

    def _problem(self, standing: Grounded, forecast: WindEnsemble, factor: float) -> Problem:
        drone = cautious_drone(self.drone, factor)
        drones = tuple(drone if d.id == drone.id else d for d in self.scenario.drones)
        network = self.scenario.network
        if standing.unusable:
            stations = [replace(one, pads=0) if one.id in standing.unusable else one for one in network.stations]
            network = replace(network, stations=tuple(stations))
        scenario = replace(self.scenario, drones=drones, network=network)
        soc = min(max(standing.soc, 0.0), 1.0)
        visited = standing.visited | standing.unusable
        state = State(from_posix(standing.time_s), standing.station, None, soc, standing.busy_pads, visited)
        return Problem(scenario, replace(self.request, state=state), drone, forecast)

    def _fresh(self, standing: Grounded, problem: Problem, forecast: WindEnsemble) -> tuple[Candidate | None, str]:
        if self.request.destination in standing.unusable:
            return None, f"{self.request.destination} cannot be used now"
        try:
            itinerary, outcome = self._composed(problem, forecast)
        except (InfeasibleError, AuditError) as error:
            return None, str(error)
        found = best_charges(problem, itinerary, self.settings.epsilon_later)
        return found or Candidate(itinerary, outcome), ""

    def _composed(self, problem: Problem, forecast: WindEnsemble) -> tuple[Itinerary, Outcome]:
        """Compose; of ``robust`` the way is taken, for its charges and its promise are worked out again here."""
        if self.planner == ROBUST:
            best = RobustSearch(problem).candidates()[0]
            return best.policy.itinerary, best.outcome
        answer = plan(problem.scenario, problem.request, planner=self.planner, forecast=forecast)
        return answer.itinerary, answer.outcome

    def _kept(self, problem: Problem, current: Composition, standing: Grounded) -> Candidate | None:
        """Return the rest of the present plan, with charges that fit, flown through the newest forecast."""
        if any(service.destination in standing.unusable for service in current.services[:1]):
            return None
        itinerary = itinerary_of(problem, current)
        found = None if itinerary is None else best_charges(problem, itinerary, self.settings.epsilon_later)
        return found if found is not None and found.arrives else None

    def _choose(
        self, standing: Grounded, kept: Candidate | None, fresh: Candidate | None, why_not: str
    ) -> list[tuple[Action, Candidate, str]]:
        """Keep the present plan unless another is better by the margin, or it will not do; the second choice follows."""
        if kept is None:
            reason = "the present plan is no longer feasible" if fresh is not None else why_not
            return [] if fresh is None else [("station", fresh, reason)]
        if fresh is None:
            return [("continue", kept, f"the planner has no other ({why_not})")]
        gain_s = kept.outcome.mean_s - fresh.outcome.mean_s
        left_s = kept.outcome.mean_s - standing.time_s
        margin_s = max(self.settings.margin_s, self.settings.margin_share * left_s)
        surer = fresh.outcome.p_success - kept.outcome.p_success
        same = tuple(leg.segments for leg in kept.itinerary) == tuple(leg.segments for leg in fresh.itinerary)
        turn: Action = "continue" if kept.itinerary[0].segments == fresh.itinerary[0].segments else "station"
        if gain_s > margin_s and surer > -self.settings.epsilon_flight and not same:
            minutes = f"{gain_s / S_PER_MIN:.1f} min earlier (margin {margin_s / S_PER_MIN:.1f} min)"
            return [
                (turn, fresh, f"the new plan arrives {minutes}"),
                ("continue", kept, "the new plan is not feasible"),
            ]
        reason = "a new plan is the same"
        if not same:
            gained = f"{abs(gain_s) / S_PER_MIN:.1f} min {'earlier' if gain_s > 0 else 'later'}"
            reason = f"the best other plan arrives {gained}, a margin of {margin_s / S_PER_MIN:.1f} min is asked for"
            if gain_s > margin_s:
                sure, surest = 100 * fresh.outcome.p_success, 100 * kept.outcome.p_success
                reason = f"the best other plan arrives {gained}, but keeps the reserve in {sure:.0f} % only, not {surest:.0f} %"
        return [("continue", kept, reason), (turn, fresh, "the present plan is not feasible")]

    # The charge

    def _with_charge(
        self, standing: Grounded, problem: Problem, action: Action, chosen: Candidate, why: str, reach: Reach
    ) -> Decision:
        """Complete a candidate: enough charge for the next leg and its diverts, and wind that lets it leave."""
        settings = self.settings
        try:
            member, schedule = typical_member(problem, chosen.itinerary)
        except NoRouteError as error:
            return Decision("stop", str(error), {"station": standing.station, "soc": standing.soc})
        told = compose(
            problem, chosen.itinerary, schedule, member, chosen.outcome, planner=self.planner, planning_time_s=0.0
        )
        service = told.services[0]
        planned = chosen.itinerary[0].charge_to or 0.0
        need = charge_needed(service, standing, reach, settings, self.request.reserve_soc)
        figures: dict[str, Any] = {
            "next": service.destination,
            "via": list(service.via),
            "soc": standing.soc,
            "needed_soc": need.soc,
            "planned_soc": planned,
            "arrival_mean_s": chosen.outcome.mean_s,
            "p_success": chosen.outcome.p_success,
            "energy_factor": reach.belief.factor,
            "energy_sigma": reach.belief.sigma,
        }
        if need.soc is None:
            reason = f"the leg to {service.destination} is not flown: {need.why}"
            return Decision("stop", reason, figures, station=service.destination)
        here = self.scenario.network.stations[self.scenario.network.index[standing.station]]
        target = max(planned, need.soc)
        wanted = target if target > standing.soc + 0.5 * settings.charge_step else None
        if wanted is not None and here.pads == 0:
            reason = f"the leg to {service.destination} needs {100 * need.soc:.0f} %, and there is no pad here"
            return Decision("stop", reason, figures)
        held = held_by_wind(service, standing, reach, settings.wait_s) if wanted is None else None
        if held is not None:
            until_s = standing.time_s + settings.wait_s
            return Decision(
                "wait",
                held.reason,
                figures | held.figures,
                told,
                service.destination,
                None,
                None,
                need.diverts,
                until_s,
            )
        minutes = (chosen.outcome.mean_s - standing.time_s) / S_PER_MIN
        reason = f"next {service.destination}, {minutes:.0f} min to the delivery: {why}"
        if wanted is not None:
            reason += f"; charge from {100 * standing.soc:.0f} to {100 * wanted:.0f} %"
        before = standing.planned_soc
        if before is not None and abs((wanted or standing.soc) - max(before, standing.soc)) > settings.charge_step:
            action = "charge" if action == "continue" else action
            reason += (
                f" instead of {100 * before:.0f} %" if wanted is not None else f"; no charging to {100 * before:.0f} %"
            )
        return Decision(action, reason, figures, told, service.destination, None, wanted, need.diverts)
