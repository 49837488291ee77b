"""Registry of planners by name; each is imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from skyway.models.base.lazy import load

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


class Search(Protocol):
    """A planner at work on one problem."""

    @property
    def labels_expanded(self) -> int:
        """Number of labels expanded or flights evaluated."""

    def solve(self) -> Itinerary:
        """Return the itinerary to fly, or raise `NoRouteError`."""


FORECAST_PLANNERS: Mapping[str, str] = {
    "shortest": "skyway.planner.baselines.shortest:ShortestFlight",
    "pfs": "skyway.planner.baselines.pfs:ForwardSearch",
    "pfs-strict": "skyway.planner.baselines.pfs_strict:StrictForwardSearch",
    "pfs-charge-aware": "skyway.planner.baselines.pfs:ChargeAwareSearch",
}
"""Planners that know the forecast only: callables from a `Problem` to a `Search`."""
CLAIRVOYANT_PLANNERS = ("ies", "exact")
"""Planners that have perfect information."""
ROBUST = "robust"
"""The planner that decides charges at each stop."""
PLANNERS = (ROBUST, *FORECAST_PLANNERS, *CLAIRVOYANT_PLANNERS)


def forecast_planner(name: str) -> Callable[[Problem], Search]:
    """Return one of `FORECAST_PLANNERS`."""
    planner: Callable[[Problem], Search] = load(FORECAST_PLANNERS[name])
    return planner
