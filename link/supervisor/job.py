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
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService
    from skyway.models.drones.drag import DragModel
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request

Asking = Literal["each", "once", "never"]
"""Take-offs for which the operator's confirmation is requested."""
FlownKind = Literal["multirotor", "helicopter"]
"""Kinds of vehicles that skyway flies."""


def nobody_observes(_: float) -> tuple[WindObservation, ...]:
    """Return no observations: only the drone itself measures the wind."""
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DeliveryJob:
    """One delivery to be supervised."""

    composition: Composition
    scenario: Scenario
    request: Request
    """The request, with the drone named."""
    forecast: WindEnsemble
    """Forecast at the start."""
    observed: Callable[[float], Sequence[WindObservation]] = nobody_observes
    """Winds observed by stations and other drones up to a time, POSIX seconds, each at its own height; called
    repeatedly."""
    options: MissionOptions = field(default_factory=MissionOptions)
    """How missions are built, and who releases the package."""
    drag: DragModel | None = None
    """Drag of the drone, for the wind from its tilt; None if unknown."""
    replanning: bool = True
    """The online policy decides; otherwise the plan is flown unchanged."""
    work: WorkPlanner | None = None
    """Planner of the flights of a cut mission; None for the delivery of a package."""
    dispatched: bool = False
    """The plan is part of a dispatcher's plan: on the ground the drone keeps to it, with charges that are only ever raised, and stops if it becomes
    infeasible; in the air it may divert as any other."""
    longest_wait_s: float = math.inf
    """Longest wait at a station for wind or free pads before the next leg; after that the flight ends there."""
    not_before_s: float = -math.inf
    """Earliest first take-off, POSIX seconds: the package is not ready before."""
    hands_over: bool = True
    """The package is released at the end; otherwise the flight only moves the drone."""
    parameters: PlannerParameters = USUAL
    """Parameters of the online policy, and of its planners."""
    asking: Asking = "once"
    """Confirmation before ``each`` take-off, ``once``, or ``never``."""
    set_parameters: bool = True
    """Set parameters that a leg needs; they are listed before the take-off and confirmed with it."""
    restore_parameters: bool = True
    """Restore the changed parameters at the end."""
    traffic: TrafficRule = field(default_factory=TrafficRule)
    """Reaction to other aircraft that come near."""
    remote_id: RemoteId = NOBODY
    """Identity of the operator for the vehicle's Remote ID module."""
    vehicle_kind: FlownKind | None = None
    """Kind of the vehicle, for one that does not report it; None: such a vehicle does not take off."""
    health: HealthBook | None = None
    """Store of the checks of calibration and health, which each vehicle needs once a day; None: no checks."""

    @property
    def delivers(self) -> bool:
        """Whether a package is to be handed over: not on a flight that only moves the drone, or of a cut mission."""
        return self.hands_over and self.work is None

    @property
    def onward(self) -> DroneService | None:
        """Flight from the target that belongs to the same mission: if the package is released in the air, else None."""
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
    """Reason, a sentence."""
    station: str | None
    """Station at which the vehicle stands; None elsewhere."""
    flights: int
    proof: str = ""
    """Result for the package: ``delivered``, ``not delivered`` or ``unsure``; empty if no release was planned."""
    proof_reason: str = ""
    handed_over: bool = False
    """The package was delivered, whatever happened to the drone on its way back."""

    @property
    def delivered(self) -> bool:
        """Whether the package was delivered."""
        return self.state == "delivered" or self.handed_over

    @property
    def done(self) -> bool:
        """Whether the work was done."""
        return self.state == "done"

    @property
    def exit_code(self) -> int:
        """Exit code of a command: 0 delivered, or all work done, and back if planned; 1 not or not surely, but safe on the ground; 3 released from control, crashed, or away from a station."""
        if self.done:
            return 0
        if self.state == "delivered":
            return 0 if self.proof in ("", "delivered") else 1
        return 1 if self.state == "stopped-safe" else 3
