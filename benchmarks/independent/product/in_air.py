"""The product's decisions in flight, as `fly` asks for them (`planner.online.in_air`), in terms of the world."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.information import HERE
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import MEASURED_S, SLOT_S, slot_variance, update_forecast
from skyway.models.wind.estimation.roughness import roughness
from skyway.models.wind.observed.reading import STATION_ERROR_MPS
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.problem.error_model import USUAL_ERRORS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.independent.information import Aloft, Flown
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.problem.problem import Problem
    from skyway.planner.reach.reach import Place

VARIANCE = 0.05
"""Of a component of the wind that the filter finds, m2/s2."""
SURE = 1e-3
SURE_S = 120.0
"""A flight that lands below the reserve with less than that is looked at again after so long; `fly` looks every ten seconds."""
LEARN_SOC = 0.04
"""From so much charge used on, the energy of this very flight is counted in."""


class InAir:
    """Keeps what was measured in each run, and asks where to go on."""

    def __init__(self, start: Problem) -> None:
        self.start = start
        self.policy = RollingRobust(start).policy
        rules = start.rules
        self._height_m, self._exponent = rules.cruise_height_m, rules.wind_profile_exponent
        self._base = start.forecast.at_height(self._height_m, self._exponent)
        self._measured: dict[int, dict[float, WindObservation]] = {}
        self._measured_at: dict[int, Place] = {}
        self._memory: dict[tuple[int, int], FlightMemory] = {}
        self._next_look_s: dict[tuple[int, int], float] = {}

    def forget(self) -> None:
        """Drop what was noted of deliveries before."""
        self._measured.clear()
        self._measured_at.clear()
        self._memory.clear()
        self._next_look_s.clear()

    def forecast(
        self,
        run: int,
        reports: Mapping[str, tuple[float, float, float]],
        *,
        by_hour: bool = False,
    ) -> WindEnsemble:
        """Bring the forecast up to date by reports and by what the drone measured on its flights, as `fly` does."""
        online, scenario = self.start.parameters.online, self.start.scenario
        told = [
            WindObservation(
                reports[one.id][0], one.lat, one.lon, *reports[one.id][1:], STATION_ERROR_MPS**2, scenario.measured_at_m
            ).at_height(self._height_m, self._exponent)
            for one in scenario.wind_sites
            if one.id in reports
        ]
        return update_forecast(
            self._base, [*told, *self._measured.get(run, {}).values()],
            ResidualModel(tau_s=online.residual_tau_s), slot_s=self._base.slot_s if by_hour else SLOT_S,
            least_members=online.least_members, field=scenario.field_error, here=self._measured_at.get(run),
        )  # fmt: skip

    def roughness(self, run: int) -> float:
        """How much the wind changed along the flights so far."""
        return roughness(list(self._measured.get(run, {}).values()), self.start.scenario.field_error)

    def belief(self, flights: Sequence[Flown]) -> EnergyBelief:
        """How much energy flights take, by those before."""
        found = USUAL_ERRORS.energy_of(self.start.drone)
        for one in flights:
            used = one.told_off - one.told_down
            if used > LEARN_SOC:
                found = found.learnt(used, self._modelled(one.down_s - one.off_s))
        return found

    def turns(self, seen: Aloft, diverts: Sequence[int]) -> int | None:
        """Where to turn to, of some stations; None to fly on."""
        key = (seen.run, len(seen.flights))
        if seen.time_s < self._next_look_s.get(key, 0.0):
            return None
        self._note(seen)
        memory = self._memory.setdefault(key, FlightMemory(speed_s=math.inf))
        network = self.start.network
        ids = [one.id for one in network.stations]
        rest = seen.segments[seen.segments.index(seen.segment) :]
        ends = [ids[int(network.head[one])] for one in rest] if seen.turned is None else [ids[seen.turned]]
        belief, used = self.belief(seen.flights), seen.told_off - seen.told
        modelled = self._modelled(seen.time_s - seen.off_s)
        info = Information(
            time_s=seen.time_s,
            soc=seen.told,
            forecast=self.forecast(seen.run, seen.reports),
            roughness=self.roughness(seen.run),
            belief=belief.in_flight(used, modelled) if used > LEARN_SOC else belief.next_flight(),
            visited=frozenset(ids[one.origin] for one in seen.flights),
            busy_pads={one.id: seen.line(node) for node, one in enumerate(network.stations) if one.pads},
            here=self._measured_at[seen.run],
            via=tuple(ends[:-1]),
            destination=ends[-1],
            diverts=tuple(ids[node] for node in diverts),
            left=frozenset((ids[seen.origin], *(ids[one.origin] for one in seen.flights))),
            flight=memory,
        )
        decision = self.policy.in_air(info)
        while 0 < memory.doubtful < self.policy.parameters.confirm:  # `fly` looks again after ten seconds
            decision = self.policy.in_air(info)
        sure = float(decision.figures.get("p_below_reserve", 1.0)) < SURE
        self._next_look_s[key] = seen.time_s + (SURE_S if sure else 0.0)
        if decision.action == "land":
            return HERE
        if decision.action in ("divert", "station") and decision.station is not None:
            self._next_look_s[key] = 0.0  # now it flies elsewhere
            return network.index[decision.station]
        return None

    def _note(self, seen: Aloft) -> None:
        """Keep what was measured, averaged over slots as `fly` does; the slot under way grows."""
        self._measured_at[seen.run] = seen.place
        measured = self._measured.setdefault(seen.run, {})
        for slot, found in groupby(seen.pieces, lambda one: one.time_s // MEASURED_S):
            some = list(found)
            time_s, lat, lon, north, east = np.mean(
                [(one.time_s, *one.place, *one.wind) for one in some], axis=0
            ).tolist()
            variance = VARIANCE + slot_variance(math.hypot(north, east), some[-1].time_s - some[0].time_s)
            measured[slot] = WindObservation(time_s, lat, lon, north, east, variance, self._height_m)

    def _modelled(self, flight_s: float) -> float:
        return float(self.start.soc_fixed + self.start.soc_per_s * flight_s)
