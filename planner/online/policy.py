"""The online policy: the next step of a delivery under way from the current information; each answer has a reason.

On the ground hindsight optimisation chooses the next step (`planner.online.hindsight`); then the gate of a departure raises its
charge, lets it wait for the wind, or closes the leg, and the next best step is looked for (`planner.online.departure_gate`). In the
air see `planner.online.in_air`. `planner.online.evaluated` has the same object fly in sampled realizations.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration, percent
from skyway.models.base.units import S_PER_H, from_posix
from skyway.models.composition.composition import State
from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.planner.online.departure_gate import DepartureGate, Gated, Later
from skyway.planner.online.following import Step
from skyway.planner.online.hindsight import Hindsight
from skyway.planner.online.in_air import FlightDecision
from skyway.planner.online.information import Decision, Departure
from skyway.planner.online.later_charges import LaterCharges
from skyway.planner.online.told_plan import itinerary_of, segments_of, told_plan
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.problem import MIN_EPSILON, Problem
from skyway.planner.reach.reach import Reach
from skyway.planner.reach.wind_ahead import WindAhead
from skyway.planner.robust.charge_policy import known_at
from skyway.planner.robust.way_on import way_on_energy

if TYPE_CHECKING:
    from skyway.models.composition.composition import Composition
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.information import Action, Information
    from skyway.planner.online.options import Option
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.request import Request
    from skyway.planner.reach.reach import Place
    from skyway.planner.schedule.itinerary import Leg


WAY_ON_HOURS = 12
"""So many hours of wind are looked at for a way on from a target without pads."""


class OnlinePolicy:
    """Decides at every landing and again before each take-off, and in the air.

    Parameters
    ----------
    scenario : Scenario
        The region.
    request : Request
        As at the departure; the drone is named.
    parameters : PlannerParameters
        Its part `online` says how careful it is.
    errors : Errors
        Gusts that no forecast tells.
    drag : DragModel, optional
        Of the drone: it tells how the energy depends on airspeed.
    """

    def __init__(
        self,
        scenario: Scenario,
        request: Request,
        parameters: PlannerParameters = USUAL,
        *,
        errors: Errors = USUAL_ERRORS,
        drag: DragModel | None = None,
    ) -> None:
        self.scenario, self.request, self.errors = scenario, request, errors
        self.all_parameters, self.parameters = parameters, parameters.online
        self.drone = scenario.drone(request.drone or "")
        self.load = None if drag is None else AirspeedLoad(drag)

    # What both need

    @property
    def epsilon(self) -> float:
        """Probability with which a watched flight may land below the reserve: that of the request.

        It is not shared out among the flights of a delivery: what is met is a tenth of it (decision 120).
        """
        return max(self.request.epsilon, MIN_EPSILON)

    def epsilon_of(self, info: Information) -> float:
        """The same where this is known: more where the wind is not measured on the way, since a forecast alone hardly lets a drone promise as much."""
        return self.epsilon if info.measures_wind else max(self.epsilon, self.parameters.p_unmeasured)

    def keeps_reserve(self, option: Option, epsilon: float) -> bool:
        """Whether a landing keeps the reserve but for epsilon (`epsilon_of`), and most probably finds a place."""
        return option.p_reserve <= epsilon and option.p_no_room <= self.parameters.p_no_room

    def reach(
        self,
        forecast: WindEnsemble,
        belief: EnergyBelief,
        *,
        watched: bool = True,
        cleared_m: float = -math.inf,
        roughness: float = 1.0,
    ) -> Reach:
        """Return what can be flown under a forecast; `watched` and `cleared_m` as in `Reach`, `roughness` as in `Information`."""
        request = self.request
        ahead = WindAhead.of(self.scenario, self.errors.in_forecast(forecast, forecast.start_s))
        return Reach(
            self.scenario, forecast, self.drone, request.payload_kg, belief, airspeed_mps=request.airspeed_mps,
            load=self.load, parameters=self.parameters,
            watched=watched, cleared_m=cleared_m, ahead=replace(ahead, roughness=roughness) if watched else None,
        )  # fmt: skip

    def problem(self, info: Information) -> Problem:
        """The rest of the delivery from a station."""
        soc = min(max(info.soc, 0.0), 1.0)
        state = State(from_posix(info.time_s), info.station, None, soc, busy_pads=info.busy_pads, visited=info.visited)
        return Problem(
            self.scenario, self.request.onward(state), self.drone, info.forecast, parameters=self.all_parameters
        )

    def way_on_soc(self, info: Information, station: str) -> float:
        """Charge above the reserve that a landing at a station keeps for the way on: at a target without pads, else none.

        What it takes by the forecast in all but a share epsilon; in winds that forbid it, what it takes when they let it.
        """
        network = self.scenario.network
        stays = network.pads[network.index[station]] > 0 and not self.request.in_air
        if station != self.request.destination or not self.request.escape or stays:
            return 0.0
        p = self.problem(replace(info, station=self.request.state.station))
        known = known_at(p, self.errors.in_forecast(info.forecast, info.time_s), measured=False, epsilon=p.epsilon)
        hours = (info.time_s + self.request.dwell_s + S_PER_H * k for k in range(WAY_ON_HOURS))
        found = (way_on_energy(p, known, time_s)[0] for time_s in hours)
        return next((one for one in found if math.isfinite(one)), 1.0)

    def hindsight(
        self, info: Information, futures: int | None = None, *, start: Place | None = None, quick: bool = False
    ) -> Hindsight:
        """Compare next steps from a station, or from over one; `start` is where the way begins whose airspeed counts, `quick` as in `Following`."""
        now = self.problem(info)
        kept: tuple[int, ...] = ()
        in_flight = bool(info.destination)
        if in_flight:
            now = now.standing_at(now.origin, info.time_s, info.soc, in_flight=True)
        elif info.plan is not None and info.plan.services:
            itinerary = itinerary_of(now, info.plan)
            kept = itinerary[0].segments if itinerary else ()
        belief = info.belief if in_flight else info.belief.next_flight()
        if self.load is not None and info.station is not None:
            reach = self.reach(info.forecast, belief)
            load = reach.mean_load(reach.way(start or info.station, (), self.request.destination), info.time_s)
            belief = belief.times(load)
        later = LaterCharges(self, info, now) if info.watched and not in_flight else None
        return Hindsight(
            now, self.errors.in_forecast(info.forecast, info.time_s), belief, behind=info.behind, futures=futures, kept=kept,
            margin=self.clear_gain_s, measured=info.measured, watched=info.watched, left=info.left, quick=quick, later=later,
        )  # fmt: skip

    def clear_gain_s(self, left_s: float) -> float:
        """By how much another way must be earlier, by how long the delivery still takes."""
        return max(self.parameters.margin_s, self.parameters.margin_share * left_s)

    # The two questions

    def in_air(self, info: Information) -> Decision:
        """Return what to do in flight; asked about every ten seconds, and over stations on the way."""
        return FlightDecision(self, info).decide()

    def refuges(self, info: Information) -> list[Option]:
        """Return where else it could land now, and with what: for those who watch."""
        return FlightDecision(self, info).refuges()

    def on_ground(self, info: Information, *, tell: bool = False) -> Decision:
        """Return what to do at a station: leave for where, with how much charge; wait; or stop.

        `tell` adds the plan from there to a decision to leave, for those who show it and make missions of it.
        """
        seen = self.hindsight(info)
        p = seen.problem
        gate = DepartureGate(self, info, p)
        closed: list[tuple[Gated, Later]] = []
        turning = gate if info.watched else None
        step = seen.choose(turning)
        while step.segments and len(closed) < self.parameters.max_closed:
            gated = gate.charged(step)
            if gated.hopeless and 0 < step.sure < len(step.segments):
                step = replace(step, segments=step.segments[: step.sure], last=0)
                gated = gate.charged(step)
            full = float(p.curve(p.origin)[1][-1]) if p.has_pads(p.origin) else info.soc
            if gated.soc is not None and gated.soc <= max(full, info.soc) + 1e-9:
                return self._leaving(info, seen, step, gated, gated.soc, turning=turning, tell=tell)
            later = gate.later(step) if gated.soc is None else Later(None, may_open=False)
            if gated.soc is not None:
                why = f"the leg needs {percent(gated.soc)}, and there is no pad here"
                gated = replace(gated, soc=None, why=why)
            closed.append((gated, later))
            until_s = math.inf if later.wait_s is None else info.time_s + later.wait_s
            seen.close(step.segments[(step.sure or len(step.segments)) - 1], until_s)
            seen.arrives = False
            step = seen.choose(turning)
        return self._staying(info, seen, closed)

    def keep_to_plan(self, info: Information, *, charged: bool = False) -> Decision:
        """Return the action at a station under a plan that must be followed: leave as planned, with more charge where the leg needs it, or stop.

        What it says of charging here is done once; `charged` says that it was.
        """
        plan, here = info.plan, info.station or ""
        if plan is None or not plan.services or plan.services[0].origin != here:
            return self._stopped(info, f"the plan has no leg from {here}")
        service = plan.services[0]
        p = self.problem(info)
        segments = segments_of(p.network, [here, *service.via, service.destination])
        if not segments:
            return self._stopped(info, f"the network has no route to {service.destination} as planned")
        stop = plan.stop_before(service)
        charges = stop is not None and stop.recharge_s > 0.0 and not charged
        planned = max(stop.soc_to, info.soc) if stop is not None and charges else info.soc
        gated = DepartureGate(self, info, p).check(Step(segments, planned))
        if gated.soc is None:
            return self._stopped(info, gated.why)
        figures = {
            "next": service.destination,
            "via": list(service.via),
            "soc": info.soc,
            "needed_soc": gated.soc,
            "planned_soc": planned,
        }
        wanted = max(planned, gated.soc)
        if wanted <= info.soc + 0.5 * self.parameters.charge_step:
            if gated.held:
                until_s = info.time_s + self.parameters.look_s
                figures |= dict(gated.figures)
                return Decision("wait", gated.held, figures, diverts=gated.diverts, until_s=until_s)
            reason = f"to {service.destination} as planned"
            return Decision(
                "continue", reason, figures, plan, service.destination, diverts=gated.diverts, least_soc=gated.soc
            )
        if not p.has_pads(p.origin):
            return self._stopped(
                info, f"the leg to {service.destination} needs {percent(gated.soc)}, and there is no pad here"
            )
        reason = f"to {service.destination} as planned; charge from {percent(info.soc)} to {percent(wanted)}"
        more = f": the leg needs {percent(gated.soc)} now" if wanted > planned else ""
        return Decision(
            "charge", reason + more, figures, plan, service.destination, charge_to=wanted, diverts=gated.diverts
        )

    def _told(
        self, info: Information, seen: Hindsight, step: Step, charge_to: float | None, p_turned: float
    ) -> Composition | None:
        """Return the plan that begins with a step: later legs leave with what the gate will most probably ask for."""
        relative = info.belief.times(1.0 / info.belief.mean_ratio)
        errors = replace(self.errors.in_forecast(info.forecast, info.time_s), energy=relative)

        later = LaterCharges(self, info, seen.problem)

        def required(leg: Leg, landed_s: float, soc: float, member: int | None) -> float | None:
            sure, last = seen.sure_of(leg.segments), seen.last_sure_of(leg.segments)
            return later.charge(Step(leg.segments, max(soc, leg.charge_to or 0.0), sure, last), landed_s, soc, member)

        first = Step(step.segments, info.soc if charge_to is None else charge_to)
        return told_plan(seen, first, charge_to, errors, required, p_turned)

    def _leaving(
        self,
        info: Information,
        seen: Hindsight,
        step: Step,
        gated: Gated,
        least: float,
        *,
        turning: DepartureGate | None,
        tell: bool,
    ) -> Decision:
        """Leave as a step says, with the charge that the gate asks for."""
        p, parameters = seen.problem, self.parameters
        charge = max(step.charge, least)  # of one that may turn back it is what is worth the try
        sure = step.segments[: step.sure]

        def required(time_s: float) -> float:
            if step.turn_back is None:
                return max(seen.need(sure, time_s), least)
            return max(step.charge, least) if seen.turns.in_time(step.turn_back, step.charge, time_s) else math.inf

        needs = max(charge, required(info.time_s))
        if needs <= 1.0:
            charge = needs
        departure = Departure(step.segments, step.charge, required, self._look_s(info, seen), step.turn_back)
        names = gated.names
        figures = {
            "next": names[-1],
            "via": list(names[1:-1]),
            "soc": info.soc,
            "needed_soc": least,
            "planned_soc": step.charge,
            "arrival_mean_s": step.arrival_s,
            "energy_factor": info.belief.mean_ratio,
            "energy_sigma": info.belief.sd_between,
            "turns_back": step.turn_back is not None,
        }
        wanted = charge if charge > info.soc + 0.5 * parameters.charge_step else None
        p_turned = 0.0
        if turning is not None:
            p_turned = turning.p_turned(replace(step, charge=max(info.soc, wanted or 0.0)))
            figures["p_turned"] = p_turned
        station = names[-1]
        if wanted is None and gated.held:
            until_s = min(seen.new_wind_s, info.time_s + 2.0 * parameters.look_s)
            return Decision(
                "wait", gated.held, figures | dict(gated.figures), station=station, diverts=gated.diverts,
                charge_to=self._charged_by(info, p, until_s), until_s=until_s, departure=departure,
            )  # fmt: skip
        planned = None if info.plan is None or not info.plan.services else info.plan.services[0]
        same = planned is not None and (planned.destination, *planned.via) == (names[-1], *names[1:-1])
        plan = self._told(info, seen, step, wanted, p_turned) if tell else None
        arrival_s = step.arrival_s if plan is None or plan.arrival.mean is None else plan.arrival.mean.timestamp()
        reason = f"next {station}, {duration(arrival_s - info.time_s)} to the delivery on average"
        reason += ", as planned" if same else ": arrives earliest with current information"
        if step.turn_back is not None:
            reason += "; it turns back if the gusts are too strong"
        action: Action = "continue" if same else "station"
        if wanted is not None:
            reason += f"; charge from {percent(info.soc)} to {percent(wanted)}"
        before = info.planned_soc
        if before is not None and abs((wanted or info.soc) - max(before, info.soc)) > parameters.charge_step:
            action = "charge" if action == "continue" else action
            reason += f" instead of {percent(before)}" if wanted is not None else f"; no charging to {percent(before)}"
        if wanted is not None and least > max(gated.leg_soc, step.charge) + parameters.charge_step:
            reason += f": with less, parts of the way have no divert station in reach ({', '.join(gated.diverts)}); the flight to its end needs {percent(gated.leg_soc)}"
        return Decision(
            action, reason, figures | {"new_plan": not same}, composition=plan, station=station, charge_to=wanted,
            diverts=gated.diverts, departure=departure, least_soc=least,
        )  # fmt: skip

    def _look_s(self, info: Information, seen: Hindsight) -> float:
        """When to look again: soon where it waits for a pad here or for room elsewhere."""
        p = seen.problem
        waits = p.has_pads(p.origin) and info.busy_pads.get(info.station or "", 0) >= p.network.pads[p.origin]
        return info.time_s + self.parameters.look_s if waits or not seen.roomy_way else math.inf

    def _staying(self, info: Information, seen: Hindsight, closed: list[tuple[Gated, Later]]) -> Decision:
        """Wait for better wind or free capacity, and charge meanwhile; stop if no later hour of the forecast and no other route allows a leg."""
        why = closed[0][0].why if closed else ""
        if closed:
            later = [one.wait_s for _, one in closed if one.wait_s is not None]
            may_open = any(one.may_open for _, one in closed)
            if not later and not may_open and not seen.arrives:
                return self._stopped(info, why)
            if later:
                why += f"; in {duration(min(later))} the forecast allows the flight"
            else:
                why += "; another route may open" if seen.arrives else "; the wind may fall"
        elif not seen.arrives:
            return self._stopped(info, "no route to the destination is flyable in the winds of the next hours")
        p = seen.problem
        look_s = self._look_s(info, seen)
        until_s = min(seen.new_wind_s, max(look_s, info.time_s + self.parameters.look_s), info.time_s + S_PER_H)
        charge = self._charged_by(info, p, until_s)
        reason = why or "for better wind or a free pad; leaving now would not deliver earlier"
        if charge is not None:
            reason += f"; charge from {percent(info.soc)} to {percent(charge)} meanwhile"
        departure = Departure((), 1.0, lambda _: math.inf, look_s)
        figures = {"station": info.station, "soc": info.soc}
        return Decision("wait", reason, figures, charge_to=charge, until_s=until_s, departure=departure)

    def _charged_by(self, info: Information, p: Problem, until_s: float) -> float | None:
        """Charge that it can have at a time while it waits; None where it cannot charge."""
        if not p.has_pads(p.origin):
            return None
        reached = p.soc_after(p.origin, info.soc, until_s - info.time_s)
        return reached if reached > info.soc + self.parameters.charge_step else None

    @staticmethod
    def _stopped(info: Information, why: str) -> Decision:
        departure = Departure((), 1.0, lambda _: math.inf)
        return Decision("stop", why, {"station": info.station, "soc": info.soc}, departure=departure)
