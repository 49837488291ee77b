"""Parameters shared by all planners: the typical schedule, waits, and the departures of a window."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class ScheduleParameters(Parameters):
    """Of `planner.schedule` and `planner.departure`."""

    typical_candidates: int = parameter(
        48, "simulated deliveries nearest to the medians that are candidates for the typical schedule", 1, 10_000
    )
    landings_weight: float = parameter(
        0.25, "weight of the landings on the way relative to the delivery, for the same choice", 0, 100
    )
    max_diverts: int = parameter(3, "maximum number of divert stations of a leg of a plan", 0, 100)
    divert_members: int = parameter(8, "members of the forecast in which they must be in reach", 1, 1000)
    divert_every_m: float = parameter(
        2000.0, "distance between the points of the leg from which they must be in reach", 10, 10**5, unit="m"
    )
    departure_step_s: float = parameter(1800.0, "step between the departures of a window", 60, 86_400, unit="s")
    min_window_s: float = parameter(60.0, "shortest window of departures", 1, 86_400, unit="s")
    max_departures: int = parameter(25, "maximum number of departures of a window", 1, 1000)
