"""When a delivery arrives that lands at some station at some time with some charge: what a turn in the air is weighed by.

The exact planner composes what follows on average-value problem flight times and waits (`planner.problem.mean_value`). A later leg takes the
energy with which it will be begun: its charge must keep the reserve in all but a hundredth, so a later leg is planned with that
quantile of what is believed, and where that gives no way with the mean and a standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InfeasibleError
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import State
from skyway.models.drones.energy import ScaledEnergy
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.problem.mean_value import HOURS, ExpectedQueues
from skyway.planner.problem.problem import ExpectedWaits, Problem
from skyway.planner.problem.speeds import MeanSpeeds

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.problem.request import Request

DEPART_SIGMAS = 2.33
"""A leg is begun with the charge for this many standard deviations: 1 % take more."""
PLAN_SIGMAS = 1.0
WAITS_S = 1800.0
"""Waits at pads that were worked out so long ago still count."""
MIN_SOC = 0.01


@dataclass(slots=True)
class Onward:
    """What follows a landing; one for a flight.

    Parameters
    ----------
    scenario, request, drone
        The delivery.
    """

    scenario: Scenario
    request: Request
    drone: Drone
    _waits: ExpectedWaits | None = None
    _worlds: list[_World] = field(default_factory=list)

    def look(self, time_s: float, forecast: WindEnsemble, factors: tuple[float, ...]) -> None:
        """Take a new forecast, and factors of energy to compose with, the most cautious first."""
        if self._waits is not None and time_s > self._waits.start_s + WAITS_S:
            self._waits = None
        self._worlds = []
        for factor in factors:
            drone = replace(self.drone, energy=ScaledEnergy(self.drone.energy_model, factor))
            state = State(from_posix(time_s), self.request.destination, None, 1.0)
            request = replace(self.request, state=state)
            try:
                problem = Problem(self.scenario, request, drone, forecast, waits=self._waits)
            except InfeasibleError:
                continue
            self._waits = problem.waits
            self._worlds.append(_World(problem))

    def arrival_s(self, station: str, time_s: float, soc: float) -> float:
        """Expected arrival at the destination, POSIX seconds; infinite where no way is known.

        Parameters
        ----------
        station : str
            Where it lands.
        time_s, soc : float
            When, and with which charge.
        """
        if station == self.request.destination:
            return time_s
        return next((s for world in self._worlds if np.isfinite(s := world.arrival_s(station, time_s, soc))), np.inf)


class _World:
    """The mean-value problem for one factor of energy."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._speeds = MeanSpeeds(problem.air, problem.probability, HOURS)
        self._queues = ExpectedQueues(problem)

    def arrival_s(self, station: str, time_s: float, soc: float) -> float:
        node = self._problem.network.index[station]
        problem = self._problem.standing_at(node, time_s, min(max(soc, MIN_SOC), 1.0))
        search = ExactSearch(problem, self._queues, speeds=self._speeds)
        return search.best_s if search.find() is not None else np.inf
