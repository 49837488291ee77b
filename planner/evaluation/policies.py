"""Policies that decide during a delivery, and the information state of their decisions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from skyway.models.base.errors import InfeasibleError
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import State
from skyway.planner.plan import plan

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.information import Departure
    from skyway.planner.problem.request import Request
    from skyway.planner.schedule.itinerary import Itinerary, Leg


@dataclass(frozen=True, eq=False)
class Standing:
    """Information state of a policy's decision: a drone that has just landed, or is about to leave its origin."""

    node: int
    station: str
    """Where it stands."""
    time_s: float
    soc: float
    """POSIX seconds and charge at the landing."""
    visited: tuple[str, ...]
    """Stations landed at before, in order."""
    wind: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Shape (sites,). (north, east) m/s TOWARDS measured at the sites in this hour, at the height of measurement."""
    busy: dict[str, int]
    """Others on the pads and in line at each station, as the pad services tell; where it stands, those before it."""
    energy_ratios: tuple[float, ...]
    """Energy that each leg flown has taken as a multiple of the model's."""
    under_way: float | None = None
    """The same of the leg so far that it flies."""
    behind: int = 0
    """Others that came where it stands after it."""
    before: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...] = ()
    """The same as `wind` in the hours before this one since the departure, the last one first."""

    def state(self) -> State:
        """The same as the state that a request starts from."""
        soc = min(max(self.soc, 0.0), 1.0)
        visited = frozenset(self.visited)
        return State(from_posix(self.time_s), self.station, None, soc, busy_pads=self.busy, visited=visited)


class Policy(Protocol):
    """A policy: decides at every stop from the information there, without knowledge of the truth."""

    def decide(self, standing: Standing) -> Leg | None:
        """Return the next leg and the stop before it, or None if there is no onward route."""


@runtime_checkable
class Adaptive(Protocol):
    """Decides at every stop, again at each new wind measurement there, and over stations on the way."""

    def leave(self, standing: Standing) -> Departure | None:
        """Return how to leave a stop, or None if there is no onward route."""

    def over(self, flying: Standing, rest: tuple[int, ...]) -> tuple[int, ...]:
        """Segments to continue with over a station with pads; none: land there.

        Time and charge are set back by a climb, as if it took off there.
        """


@dataclass(frozen=True)
class OpenLoop:
    """A fixed itinerary as a policy."""

    itinerary: Itinerary

    def decide(self, standing: Standing) -> Leg | None:
        """The leg that the itinerary has at this stop."""
        number = len(standing.visited)
        return self.itinerary[number] if number < len(self.itinerary) else None


@dataclass(frozen=True)
class Rolling:
    """Plans again at every stop with a named planner, and flies the first leg of each plan."""

    scenario: Scenario
    request: Request
    """As at the departure; the drone is named."""
    planner: str
    """See `planner.plan`."""
    forecast: Callable[[Standing], WindEnsemble]
    """The forecast of a moment: held out, perhaps weighted by the wind measured until then."""

    def decide(self, standing: Standing) -> Leg | None:
        """The first leg of the plan from here."""
        request = self.request.onward(standing.state())
        try:
            return plan(self.scenario, request, planner=self.planner, forecast=self.forecast(standing)).itinerary[0]
        except InfeasibleError:
            return None
