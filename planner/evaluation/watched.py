"""A delivery simulated as `skyway fly` supervises it: decided at stops, and all along each flight, in wind that differs between the sites.

The flight goes piece by piece. Each piece tells the drone the wind that it met there; every two and a half minutes of that are an observation, which updates the
forecast, and the online policy is asked whether to fly on, as in `planner.online.in_air`. Who is turned lands where it was turned to, has measured the wind
that turned it, and decides again. The airports report each hour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy
from skyway.models.flight.heights import wind_factors
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import MEASURED_S, SLOT_S, slot_variance, update_forecast
from skyway.models.wind.estimation.roughness import roughness
from skyway.models.wind.gusts import GUST_TIME_S
from skyway.models.wind.observed.reading import STATION_ERROR_MPS
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS, along_across, ground_speed
from skyway.planner.evaluation.decisions import MAX_WAIT_S
from skyway.planner.evaluation.flights import DELIVERED, GAVE_UP, STRANDED, Flown
from skyway.planner.evaluation.local_wind import LocalWind
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.schedule.gust_kernels import LATERAL
from skyway.planner.uncertainties import record_days

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.queues.paths import QueuePath
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.evaluation.realizations import Realizations
    from skyway.planner.online.information import Decision
    from skyway.planner.problem.problem import Problem
    from skyway.planner.reach.reach import Place

PIECE_M, PIECE_S, LEAST_M = 500.0, 25.0, 60.0
"""So often it is thought over whether to fly on: after the first or, at its last ground speed, the second, but not after less than the third. `fly` does so
every ten seconds. It must be well within `OnlineParameters.ahead_s`: so far ahead it makes sure that it can still turn."""
SURE, SURE_S = 1e-3, 150.0
"""A flight that lands below the reserve with less than that is thought over after so long."""
FILTERED = 0.05
"""Variance of a component of the wind that a drone finds, m2/s2."""
LEARN_SOC = 0.04
"""From so much charge on, the energy of the very flight is learnt from."""
REDECIDE_S = 600.0
"""Who waits for a pad thinks again after so long."""
AGAIN_S = 30.0
DONE = 1e-6


class _Piece(NamedTuple):
    """A piece that was flown: its middle, and the wind there."""

    time_s: float
    place: Place
    wind: tuple[float, float]


@dataclass(eq=False)
class _Under:
    """The delivery under way."""

    node: int
    came_s: float
    """When it landed where it stands."""
    time_s: float
    soc: float
    belief: EnergyBelief
    origins: list[int] = field(default_factory=list)
    """Where each flight took off, in order."""
    measured: dict[float, WindObservation] = field(default_factory=dict)
    measured_at: Place | None = None
    plan: Composition | None = None
    landings: list[float] = field(default_factory=list)
    flight_s: float = 0.0
    recharge_s: float = 0.0


class WatchedDelivery:
    """One delivery of some realizations, of one run, told a forecast.

    Parameters
    ----------
    realizations : Realizations
        Of one run.
    told : Problem
        As at the departure, with the forecast that the drone is told.
    rng : Generator
        Of the wind between the sites and of gusts.
    plan : Composition, optional
        In force at the departure, as `fly` was given it: it is left for a clear gain only.
    """

    def __init__(
        self, realizations: Realizations, told: Problem, rng: np.random.Generator, plan: Composition | None = None
    ) -> None:
        self.realizations, self.told, self.plan = realizations, told, plan
        self.truth = realizations.problem(told.drone.id)
        rules = told.rules
        self._base = told.forecast.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
        self._wind = self.truth.ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
        error = told.scenario.field_error
        self._local = LocalWind(
            replace(error, variance=0.0) if not record_days(told.forecast) else error, self._wind, rng
        )
        self._rng = rng
        request = replace(told.request, drone=told.drone.id)
        self.policy = OnlinePolicy(told.scenario, request, told.parameters, errors=realizations.errors)
        self._ids = [one.id for one in told.network.stations]

    def fly(self) -> Flown:
        """Fly it to its end."""
        p = self.truth
        belief = self.realizations.errors.energy_of(p.drone)
        now = _Under(p.origin, p.depart_s, p.depart_s, p.soc, belief, plan=self.plan)
        ending = GAVE_UP
        while len(now.origins) < p.parameters.evaluation.max_stops:
            decision = self._stay(now)
            if decision is None:
                break
            self._flight(now, decision)
            if now.soc < 0.0:
                ending = STRANDED
                break
            if now.node == p.destination:
                ending = DELIVERED
                break
        return self._flown(now, ending)

    def _flown(self, now: _Under, ending: int) -> Flown:
        there, lowest = ending == DELIVERED, min(now.landings, default=math.inf)
        delivery = now.time_s - self.truth.depart_s
        parts = (delivery, now.flight_s, delivery - now.flight_s - now.recharge_s, now.recharge_s)
        return Flown(
            self.realizations.block, np.array([ending]), np.array([lowest < self.truth.reserve - 1e-9]), np.array([lowest]),
            *(np.array([one if there else math.nan]) for one in parts),
        )  # fmt: skip

    # On the ground

    def _stay(self, now: _Under) -> Decision | None:
        """Stay until it takes off; None where it gives up."""
        p, wind = self.truth, self.truth.ensemble
        node, landed, at_landing = now.node, now.time_s, now.soc
        pad_s = float(self._queue(node).pad_time(now.came_s)) if p.has_pads(node) else math.inf
        pad_s = max(pad_s, landed)

        def soc_at(time_s: float) -> float:
            return p.soc_after(node, at_landing, p.charging_s(node, pad_s, time_s)) if time_s > pad_s else at_landing

        end_s = min(wind.start_s + wind.slots * wind.slot_s, landed + MAX_WAIT_S)
        while now.time_s < end_s:
            now.soc = soc_at(now.time_s)
            decision = self.policy.on_ground(self._standing(now), tell=True)
            now.plan = decision.composition or now.plan
            if decision.action == "stop":
                return None
            report_s = wind.start_s + (wind.slot_at(now.time_s) + 1) * wind.slot_s
            wanted = decision.charge_to
            charges = wanted is not None and wanted > now.soc + DONE
            if wanted is not None and charges and pad_s < math.inf:
                until_s = p.charged_at(node, pad_s, p.charge_time_s(node, at_landing, wanted))
                if pad_s > now.time_s:
                    until_s = min(until_s, now.time_s + REDECIDE_S)
            elif charges or decision.action == "wait" or decision.departure is None or not decision.departure.segments:
                until_s = min(decision.until_s or 0.0, report_s)
            else:
                time_s, soc = p.curve(node)
                now.recharge_s += float(np.interp(now.soc, soc, time_s) - np.interp(at_landing, soc, time_s))
                return decision
            now.time_s = max(until_s, now.time_s + AGAIN_S)
        return None

    def _standing(self, now: _Under) -> Information:
        network = self.told.network
        visited, here = frozenset(self._ids[node] for node in now.origins), self._ids[now.node]
        forecast = self._forecast(now, self._base.slot_s)
        present, behind = self._present(now)
        return Information(
            time_s=now.time_s, soc=now.soc, forecast=forecast, near_forecast=self._forecast(now, SLOT_S), belief=now.belief,
            roughness=self._roughness(now), station=here, visited=visited, left=visited - {here},
            plan=now.plan,
            busy_pads={self._ids[k]: present[k] for k in np.flatnonzero(network.pads > 0).tolist()}, behind=behind,
        )  # fmt: skip

    def _present(self, now: _Under, *, aloft: bool = False) -> tuple[dict[int, int], int]:
        """Others at each station with pads now; where it stands those before it, and how many came after it."""
        nodes = np.flatnonzero(self.told.network.pads > 0).tolist()
        paths = self.realizations.queues(self.truth, nodes, int(self.realizations.queue[0]))
        found = {node: paths[node].present_at(now.time_s) for node in nodes}
        if aloft or now.node not in found or not now.time_s > now.came_s:
            return found, 0
        path = paths[now.node]
        left = int(np.diff(np.searchsorted(path.left_s, [now.came_s, now.time_s], side="right"))[0])
        before = max(path.present_at(now.came_s) - left, 0)
        behind = max(found[now.node] - before, 0)
        return found | {now.node: before}, behind

    def _queue(self, node: int) -> QueuePath:
        return self.realizations.queues(self.truth, [node], int(self.realizations.queue[0]))[node]

    # What is known

    def _forecast(self, now: _Under, slot_s: float) -> WindEnsemble:
        """The forecast with the sites' last reports and what was measured on the way."""
        truth, scenario = self.truth.ensemble, self.told.scenario
        rules, online = self.told.rules, self.told.parameters.online
        slot = truth.slot_at(now.time_s)
        time_s = truth.start_s + slot * truth.slot_s
        told = [
            WindObservation(
                time_s, lat, lon, float(north), float(east), STATION_ERROR_MPS**2, truth.height_m
            ).at_height(rules.cruise_height_m, rules.wind_profile_exponent)
            for lat, lon, north, east in zip(
                truth.site_lat.tolist(), truth.site_lon.tolist(), truth.north[0, slot], truth.east[0, slot], strict=True
            )
        ]
        return update_forecast(
            self._base, [*told, *now.measured.values()], ResidualModel(tau_s=online.residual_tau_s), slot_s=slot_s,
            least_members=online.least_members, field=scenario.field_error, here=now.measured_at,
        )  # fmt: skip

    def _roughness(self, now: _Under) -> float:
        return roughness(list(now.measured.values()), self.told.scenario.field_error)

    def _note(self, now: _Under, pieces: Sequence[_Piece]) -> None:
        """Keep what was measured, averaged over slots; the slot under way grows."""
        now.measured_at = pieces[-1].place
        for slot, found in groupby(pieces, lambda one: one.time_s // MEASURED_S):
            some = list(found)
            time_s, lat, lon, north, east = np.mean(
                [(one.time_s, *one.place, *one.wind) for one in some], axis=0
            ).tolist()
            variance = FILTERED + slot_variance(math.hypot(north, east), some[-1].time_s - some[0].time_s)
            now.measured[slot] = WindObservation(
                time_s, lat, lon, north, east, variance, self.told.rules.cruise_height_m
            )

    def _modelled(self, flight_s: float) -> float:
        return float(self.told.soc_fixed + self.told.soc_per_s * flight_s)

    # In the air

    def _flight(self, now: _Under, decision: Decision) -> None:
        """Fly as was decided, or where it is turned to, until there is a place to land."""
        p, network = self.truth, self.truth.network
        begun, off_s, left_with = now.node, now.time_s, now.soc
        ratio = self.realizations.energy_ratio(p.drone, 0, len(now.origins))
        segments = decision.departure.segments if decision.departure is not None else ()
        now.soc -= ratio * (p.soc_fixed + p.soc_per_s * p.air.climb_s)
        now.time_s += p.air.climb_s
        gust = self._rng.standard_normal(2)
        pieces: list[_Piece] = []
        speed_mps = math.inf
        memory, next_look_s = FlightMemory(speed_s=math.inf), 0.0
        target: int | None = None
        for number, segment in enumerate(segments):
            ends = [
                (float(network.lat[k]), float(network.lon[k])) for k in (network.tail[segment], network.head[segment])
            ]
            length_m = left_m = float(p.air.distance_m[segment])
            while left_m > 0.0 and target is None:
                piece_m = min(PIECE_M, max(speed_mps * PIECE_S, LEAST_M))
                piece_m = left_m if left_m <= 1.5 * piece_m else piece_m
                place = _between(ends, 1.0 - (left_m - 0.5 * piece_m) / length_m)
                before_s, left_m = now.time_s, left_m - piece_m
                gust = self._along(now, segment, piece_m, place, gust, ratio, pieces)
                speed_mps = piece_m / (now.time_s - before_s)
                rest = [int(network.head[one]) for one in segments[number if left_m > 0.0 else number + 1 :]]
                if not rest or now.time_s < next_look_s:
                    continue
                here = _between(ends, 1.0 - left_m / length_m)
                answer = self._aloft(now, decision, pieces, (here, begun, rest), (off_s, left_with), memory)
                next_look_s = now.time_s + (SURE_S if float(answer.figures.get("p_below_reserve", 1.0)) < SURE else 0.0)
                if answer.action == "land":
                    now.soc = -1.0
                    now.landings.append(now.soc)
                    return
                if answer.action in ("divert", "station") and answer.station is not None:
                    target = network.index[answer.station]
                    self._straight(now, here, target, gust, ratio, pieces)
            if target is not None:
                break
        self._land(now, int(network.head[segments[-1]]) if target is None else target, ratio, pieces)
        now.origins.append(begun)
        now.flight_s += now.time_s - off_s
        now.belief = now.belief.learnt(left_with - now.soc, self._modelled(now.time_s - off_s))

    def _along(
        self, now: _Under, segment: int, length_m: float, place: Place, gust: NDArray[np.float64], ratio: float,
        pieces: list[_Piece],
    ) -> NDArray[np.float64]:  # fmt: skip
        """Fly a piece of a segment; returns the gust after it."""
        air = self.truth.air
        slot, weight = self.truth.ensemble.slot_at(now.time_s), air.weight[segment]
        mean = float(air.north[0, slot] @ weight), float(air.east[0, slot] @ weight)
        course = float(air.cos_bearing[segment]), float(air.sin_bearing[segment])
        return self._cruise(now, place, mean, course, length_m, gust, ratio, pieces)

    def _cruise(
        self, now: _Under, place: Place, mean: tuple[float, float], course: tuple[float, float], length_m: float,
        gust: NDArray[np.float64], ratio: float, pieces: list[_Piece],
    ) -> NDArray[np.float64]:  # fmt: skip
        """Fly straight through the mean wind, what no site tells of it, and a gust."""
        p, errors = self.truth, self.realizations.errors
        speed = math.hypot(*mean)
        north, east = (a + b for a, b in zip(mean, self._local.at(*place, now.time_s, speed), strict=True))
        along = 1.0 + errors.gust_sd * gust[0]
        across = LATERAL * errors.gust_sd * gust[1]
        north, east = along * north - across * east, along * east + across * north
        tail, side = along_across(north, east, *course)
        fast = float(ground_speed(p.air.airspeed_mps, tail, side, math.inf, p.air.max_ground_speed_mps))
        took_s = length_m / max(fast, MIN_GROUND_SPEED_MPS)
        pieces.append(_Piece(now.time_s + 0.5 * took_s, place, (north, east)))
        now.time_s += took_s
        now.soc -= ratio * p.soc_per_s * took_s
        fade = math.exp(-took_s / GUST_TIME_S)
        return fade * gust + math.sqrt(1.0 - fade**2) * self._rng.standard_normal(2)

    def _straight(
        self, now: _Under, here: Place, target: int, gust: NDArray[np.float64], ratio: float, pieces: list[_Piece]
    ) -> None:
        """Fly straight to a station; it is not thought over again."""
        network, wind = self.truth.network, self._wind
        end = float(network.lat[target]), float(network.lon[target])
        length_m, bearing = geodesy.way(*here, *end)
        ground_m = network.ground_at_m(*np.array((here, end)).T)
        factor = float(wind_factors(self.truth.rules, (ground_m[:1], ground_m[1:]))[0])
        course = math.cos(math.radians(bearing)), math.sin(math.radians(bearing))
        count = max(round(length_m / PIECE_M), 1)
        for part in range(count):
            place = _between((here, end), (part + 0.5) / count)
            slot, weight = wind.slot_at(now.time_s), wind.weights(*place)[0]
            mean = factor * float(wind.north[0, slot] @ weight), factor * float(wind.east[0, slot] @ weight)
            gust = self._cruise(now, place, mean, course, length_m / count, gust, ratio, pieces)

    def _aloft(
        self,
        now: _Under,
        decision: Decision,
        pieces: Sequence[_Piece],
        way: tuple[Place, int, Sequence[int]],
        begun: tuple[float, float],
        memory: FlightMemory,
    ) -> Decision:
        """Ask what to do from a place between stations; `way` is the place, where it took off, and the stations ahead, `begun` when, and with which charge."""
        here, origin, ahead = way
        self._note(now, pieces)
        used, modelled = begun[1] - now.soc, self._modelled(now.time_s - begun[0])
        names = [self._ids[node] for node in ahead]
        left = frozenset(self._ids[node] for node in (*now.origins, origin))
        info = Information(
            time_s=now.time_s, soc=now.soc, forecast=self._forecast(now, SLOT_S), roughness=self._roughness(now),
            belief=now.belief.in_flight(used, modelled) if used > LEARN_SOC else now.belief.next_flight(),
            visited=frozenset(self._ids[node] for node in now.origins),
            busy_pads={self._ids[node]: count for node, count in self._present(now, aloft=True)[0].items()},
            here=here, via=tuple(names[:-1]), destination=names[-1],
            diverts=tuple(dict.fromkeys((*decision.diverts, self._ids[origin], *self._over(decision)))), left=left, flight=memory,
        )  # fmt: skip
        answer = self.policy.in_air(info)
        while 0 < memory.doubtful < self.policy.parameters.confirm:  # `fly` looks again after ten seconds
            answer = self.policy.in_air(info)
        return answer

    def _over(self, decision: Decision) -> list[str]:
        """Stations that a leg leads over: those behind it can be turned to as well."""
        segments = () if decision.departure is None else decision.departure.segments
        return [self._ids[int(self.truth.network.head[one])] for one in segments[:-1]]

    def _land(self, now: _Under, node: int, ratio: float, pieces: Sequence[_Piece]) -> None:
        """Descend, and hover until there is a place."""
        p = self.truth
        now.time_s += p.air.descent_s
        now.soc -= ratio * p.soc_per_s * p.air.descent_s
        now.came_s = now.time_s
        down_s = float(self._queue(node).land_time(now.time_s)) if p.has_pads(node) else now.time_s
        now.soc -= ratio * p.soc_per_s * (down_s - now.time_s)
        now.node, now.time_s = node, down_s
        now.plan = None if now.plan is None else now.plan.after(self._ids[node])
        now.landings.append(now.soc)
        if pieces:
            self._note(now, pieces)


def _between(ends: Sequence[Place], share: float) -> Place:
    """Place on a straight way of some kilometres."""
    (lat, lon), (lat2, lon2) = ends
    return lat + share * (lat2 - lat), lon + share * (lon2 - lon)
