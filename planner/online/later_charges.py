"""Charges that later legs leave with: what the check before their take-off will most probably ask for (decision 136).

A search for the best way in a future charges for what flights take in it. The check asks for more: for winds other than the expected one, and for
divert stations at every point, where a head wind may ask for twice what the flight itself takes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import slot_of
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import MEASURED_S, slot_variance, update_forecast
from skyway.planner.online.departure_gate import DepartureGate, Gated
from skyway.planner.online.following import Step

if TYPE_CHECKING:
    from skyway.models.network.station import Station
    from skyway.planner.online.information import Information
    from skyway.planner.online.policy import OnlinePolicy
    from skyway.planner.problem.problem import Problem


class LaterCharges:
    """Asks the gate about later departures, with the information there in the expected wind, or in that of a member of the forecast.

    Parameters
    ----------
    policy : OnlinePolicy
        Whose departures they are.
    info : Information
        On the ground, now.
    problem : Problem
        The rest of the delivery.
    """

    def __init__(self, policy: OnlinePolicy, info: Information, problem: Problem) -> None:
        self._policy, self._info, self._problem = policy, info, problem
        self._shares: dict[tuple[tuple[int, ...], int], float] = {}

    def gated(self, step: Step, landed_s: float, soc: float) -> Gated:
        """Check a leg in the expected wind after a landing, POSIX seconds, with a charge; no charge below that of the step is asked about."""
        return self._gate(step, landed_s, soc, None).charged(step, step.charge)

    def _gate(self, step: Step, landed_s: float, soc: float, member: int | None) -> DepartureGate:
        p = self._problem
        node = int(p.network.tail[step.segments[0]])
        there = self._landed(p.network.stations[node], landed_s, soc, member)
        return DepartureGate(self._policy, there, p.standing_at(node, landed_s, soc))

    def charge(self, step: Step, landed_s: float, soc: float, member: int | None = None) -> float | None:
        """Charge that a leg most probably leaves with: what its check asks for, and what lets it be flown on over stations; None: no charge opens it."""
        gate = self._gate(step, landed_s, soc, member)
        required = gate.charged(step, step.charge).soc
        if required is None or not step.last:
            return required
        return min(max(required, gate.through_soc(replace(step, charge=max(step.charge, required)))), 1.0)

    def share(self, step: Step, landed_s: float, soc: float) -> float:
        """Required charge above the reserve, as a multiple of what the leg takes as far as it must be sure of it; worked out once for each slot of the forecast.

        Where no charge opens the leg, that of a full battery.
        """
        sure = step.segments[: step.sure or len(step.segments)]
        key = sure, slot_of(self._problem.air, landed_s)
        if key not in self._shares:
            gated = self.gated(Step(sure, 0.0, step.sure), landed_s, soc)
            required = 1.0 if gated.soc is None else gated.soc
            self._shares[key] = (required - self._policy.request.reserve_soc) / gated.used_soc
        return self._shares[key]

    def _landed(self, station: Station, time_s: float, soc: float, member: int | None) -> Information:
        """Information after a landing: where the drone measures the wind on its way, it is known by then."""
        parameters = self._policy.parameters
        there = replace(self._info, station=station.id, time_s=time_s, soc=soc, behind=0)
        if not there.measures_wind:
            return there
        forecast = self._info.forecast
        winds = forecast.at_times(np.array([station.lat]), np.array([station.lon]), np.array([time_s]))
        north, east = (float(forecast.probability @ one[:, 0] if member is None else one[member, 0]) for one in winds)
        variance = slot_variance(math.hypot(north, east), MEASURED_S)
        measured = WindObservation(time_s, station.lat, station.lon, north, east, variance)
        residual = ResidualModel(tau_s=parameters.residual_tau_s)
        updated = update_forecast(forecast, [measured], residual, least_members=parameters.least_members)
        return replace(there, near_forecast=updated, wind_measured_s=time_s)
