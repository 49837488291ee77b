"""The job of a supervisor: a plan, its region, and its options."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from skyway.link.supervisor.flight.give_way import TrafficRule
from skyway.missions.builder.mission_options import MissionOptions
from skyway.models.composition.release import hovers
from skyway.models.scenario.remote_id import NOBODY, RemoteId
from skyway.planner.parameters.planner import USUAL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.supervisor.work.task import WorkPlanner
    from skyway.link.vehicle.health_book import HealthBook
    from skyway.models.composition.composition import Composition, DroneService
    from skyway.models.drones.drag import DragModel
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request

Asking = Literal["each", "once", "never"]
"""Before which take-offs the operator is asked."""


def nobody_observes(_: float) -> tuple[WindObservation, ...]:
    """No wind but what the drone itself measures."""
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DeliveryJob:
    """One delivery to be supervised."""

    composition: Composition
    scenario: Scenario
    request: Request
    """What was asked, the drone named."""
    forecast: WindEnsemble
    """Wind as it is expected at the start."""
    observed: Callable[[float], Sequence[WindObservation]] = nobody_observes
    """Winds that stations and other drones have observed by an instant, POSIX seconds, each at its own height; asked again and again."""
    options: MissionOptions = field(default_factory=MissionOptions)
    """How missions are made, and who releases the package."""
    drag: DragModel | None = None
    """Of the drone, for the wind by its tilt; None is unknown."""
    replanning: bool = True
    """Under the online policy; else the plan is flown as it is, whatever comes."""
    work: WorkPlanner | None = None
    """Who plans the flights of a cut mission; None: a package is delivered."""
    dispatched: bool = False
    """A dispatcher has planned it around others: on the ground it keeps to its plan, whose charges are only ever raised, and stops where that
    does not lead on; in the air it is turned as any other."""
    not_before_s: float = -math.inf
    """It does not take off for the first time before, POSIX seconds: the package is not ready."""
    hands_over: bool = True
    """At its end the package is released; else the flight brings the drone to a place, and nothing is released there."""
    parameters: PlannerParameters = USUAL
    """Of the online policy, and of the planners that it asks."""
    asking: Asking = "once"
    """``each`` take-off, ``once``, or ``never``."""
    set_parameters: bool = True
    """Set parameters that a leg needs, told before the take-off and requested with it."""
    restore_parameters: bool = True
    """Give the vehicle back at the end what was set."""
    traffic: TrafficRule = field(default_factory=TrafficRule)
    """What is done about other aircraft that come near."""
    remote_id: RemoteId = NOBODY
    """Who flies, as the vehicle's Remote ID module is told."""
    health: HealthBook | None = None
    """Where checks of calibration and health are kept, of which each vehicle needs one a day; None looks at none."""

    @property
    def onward(self) -> DroneService | None:
        """Flight from the target on that belongs to the mission there: where the package is released in the air, else None."""
        way = self.composition.way_back
        if way is None or way.plan is None or not hovers(self.options.release):
            return None
        return way.plan.services[0]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a supervised delivery."""

    state: str
    """The last state."""
    reason: str
    """A sentence."""
    station: str | None
    """Where the vehicle stands, as far as that is a station."""
    flights: int
    proof: str = ""
    """What became of the package: ``delivered``, ``not delivered`` or ``unsure``; empty where it was never to be released."""
    proof_reason: str = ""
    handed_over: bool = False
    """The package was delivered, whatever became of the drone on its way back."""

    @property
    def delivered(self) -> bool:
        """Whether the package arrived."""
        return self.state == "delivered" or self.handed_over

    @property
    def done(self) -> bool:
        """Whether the work was done."""
        return self.state == "done"

    @property
    def exit_code(self) -> int:
        """Of a command: 0 delivered, or all work done, and back where that was planned, 1 not or not surely, but safe on the ground, 3 left to itself, crashed, or away from a station."""
        if self.done:
            return 0
        if self.state == "delivered":
            return 0 if self.proof in ("", "delivered") else 1
        return 1 if self.state == "stopped-safe" else 3
