"""Energy that the preflight check requires of flights, relative to the mean: a fleet is planned with it, so that take-offs need not wait for charge.

It is computed with the check itself (`planner.online.departure_gate`), in the present forecast, for legs from slow to fast. A wind error w along a leg
of ground speed v makes its time longer by the share w / v; so the required energy is (a + b / v) of the mean, with a and b by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.composition.composition import State
from skyway.planner.dispatch.flight_times import charge_of, fixed_s
from skyway.planner.online.departure_gate import DepartureGate
from skyway.planner.online.following import Step
from skyway.planner.online.information import Information
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.problem.request import Request
from skyway.planner.problem.speeds import MeanSpeeds

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.drones.drag import DragModel
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters

LEGS = 15
SHORTEST, LONGEST = 0.1, 0.45
"""Mean energy of the legs that are used, as shares of a battery: flights that need more are seldom begun, and for
less the margin hardly matters."""
QUANTILE = 0.6
"""Quantile of the deviations from the line that is added to it: with too low a margin a drone waits for charge at
take-off, with too high a margin it has charged too long."""


@dataclass(frozen=True)
class DepartureMargin:
    """Ratio of required to mean energy: `share` + `pace_mps` / ground speed, within the range of the legs used."""

    share: float
    pace_mps: float
    least: float
    most: float
    deviations: tuple[float, ...] = (0.0,)
    """Deviations from it of the legs that it was computed for."""

    def of(self, speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the required energy above the mean, as a share of it, for some ground speeds."""
        wanted = self.share + self.pace_mps / np.maximum(speed_mps, 1e-3)
        found: NDArray[np.float64] = np.clip(wanted, self.least, self.most) - 1.0
        return found


def departure_margin(
    scenario: Scenario, forecast: WindEnsemble, depart: datetime, drone: str, parameters: PlannerParameters, *,
    drag: DragModel | None, reserve: float,
) -> DepartureMargin | None:  # fmt: skip
    """Return the departure margin; None if the network has no leg to compute it from."""
    network, rules = scenario.network, scenario.rules
    stops = [number for number, one in enumerate(network.stations) if one.pads and not one.flyover]
    if len(stops) < 2:
        return None
    names = [network.stations[one].id for one in stops[:2]]
    request = Request(state=State(depart, names[0], None, 1.0), destination=names[1], payload_kg=0.0, drone=drone, reserve_soc=reserve, escape=False)  # fmt: skip
    policy = OnlinePolicy(scenario, request, parameters, drag=drag)
    belief = policy.drone.energy_belief
    known = Information(
        time_s=depart.timestamp(), soc=1.0, forecast=forecast.at_height(rules.cruise_height_m, rules.wind_profile_exponent),
        belief=belief if drag is None else belief.counting_airspeed(), station=names[0],
    )  # fmt: skip
    found, speeds = [], []
    for segment, takes, speed_mps in _legs(policy, known, set(stops)):
        here = replace(known, station=network.stations[int(network.tail[segment])].id)
        least = DepartureGate(policy, here, policy.problem(here)).check(Step((segment,), 1.0)).soc
        found.append(((1.0 if least is None else least) - reserve) / takes)
        speeds.append(speed_mps)
    return fitted(np.array(speeds), np.array(found)) if found else None


def fitted(speed_mps: NDArray[np.float64], share: NDArray[np.float64]) -> DepartureMargin:
    """Fit the ratios of legs of some ground speeds; a constant for less than four of them, or if all have one speed."""
    one, pace_mps = 0.0, 0.0
    if len(share) > 3 and np.ptp(1.0 / speed_mps) > 1e-4:
        one, pace_mps = np.linalg.lstsq(np.stack((np.ones(len(share)), 1.0 / speed_mps), axis=1), share, rcond=None)[0]
    beside = float(np.quantile(share - one - pace_mps / speed_mps, QUANTILE))
    margin = DepartureMargin(float(one) + beside, float(pace_mps), max(float(share.min()), 1.0), float(share.max()))
    return replace(margin, deviations=tuple((share - 1.0 - margin.of(speed_mps)).tolist()))


def _legs(policy: OnlinePolicy, known: Information, stops: set[int]) -> list[tuple[int, float, float]]:
    """Segments between stations with pads, from slow to fast: mean charge without a package, and ground speed, m/s."""
    p = policy.problem(known)
    every = np.arange(len(p.network.tail))
    slot = int(max((known.time_s - p.air.start_s) // p.air.slot_s, 0.0))
    speed = MeanSpeeds(p.air, p.probability, policy.all_parameters.robust.speed_hours).over(slot, slot, every)[0]
    open_ = every[(speed > 0.0) & np.isin(p.network.tail, list(stops)) & np.isin(p.network.head, list(stops))]
    takes = charge_of(p, p.air.distance_m[open_] / speed[open_] + fixed_s(p))
    mean_mps = speed[open_]
    order = [number for number in np.lexsort((takes, mean_mps)) if SHORTEST <= takes[number] <= LONGEST]
    if not order:
        return []
    picked = np.unique(np.linspace(0, len(order) - 1, LEGS).round().astype(int))
    return [(int(open_[order[one]]), float(takes[order[one]]), float(mean_mps[order[one]])) for one in picked]
