"""Plan of a dispatcher: the steps of each drone, and the outcome of each order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from skyway.models.base.units import iso

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.ledger.window import Window

SCHEMA = "skyway.dispatch/1"
Phase = Literal["to the package", "with the package", "home"]
PHASES: tuple[Phase, ...] = ("to the package", "with the package", "home")


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One flight, or one charge on a pad."""

    kind: Literal["fly", "charge"]
    order: str | None
    """Order of the step; None on the way home."""
    phase: Phase
    origin: str
    destination: str
    """Ids of stations; for a charge both are its station."""
    begin: datetime
    end: datetime
    soc_begin: float
    soc_end: float
    """State of charge, 0 to 1 of the battery's present capacity; a flight's charge has the margin that keeps the
    reserve."""
    pad: int | None = None
    """Number of the pad, from 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """Route of one drone."""

    drone: str
    type: str
    orders: tuple[str, ...]
    steps: tuple[Step, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlook:
    """Expected outcome of an order, from simulating the plan in many worlds (`planner.promises`)."""

    by: datetime
    """Promised delivery time."""
    chance: float
    """Probability that it is delivered by then."""
    p50: datetime | None
    p95: datetime | None
    """Quantiles of the delivery time; None if it is delivered in fewer worlds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Outcome of one order."""

    order: str
    status: Literal["served", "refused"]
    drone: str | None = None
    fetched: datetime | None = None
    delivered: datetime | None = None
    """Take-off and landing with the package."""
    late_s: float = 0.0
    reason: str | None = None
    """Reason of a refusal."""
    hopeless: bool = False
    """Whether it is infeasible even as the only order."""
    windows: tuple[Window, ...] = ()
    """Pads of its flights, including those on the way home after it."""
    outlook: Outlook | None = None
    """Available if the plan was simulated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DispatchPlan:
    """A plan for a fleet.

    Attributes
    ----------
    depart : datetime
        Beginning of the plan.
    answers : tuple of Answer
        Outcome of all orders, in the given sequence.
    routes : tuple of Route
        Routes of the drones with orders.
    cost_s, bound_s : float
        Cost (`planner.parameters.dispatch`), in seconds, and a lower bound of the cost of any plan of this fleet.
    energy_j : float
        Energy of all flights, with margins.
    iterations : int
        Iterations of the search.
    planning_time_s : float
        Wall time.
    below_reserve : float or None
        Share of landings below the reserve, if the plan was simulated.
    """

    depart: datetime
    answers: tuple[Answer, ...]
    routes: tuple[Route, ...]
    cost_s: float
    bound_s: float
    energy_j: float
    iterations: int
    planning_time_s: float
    below_reserve: float | None = None

    @property
    def served(self) -> int:
        """Orders served."""
        return sum(one.status == "served" for one in self.answers)

    @property
    def late(self) -> int:
        """Orders served after they are due."""
        return sum(one.late_s > 0.5 for one in self.answers)


def document_of(plan: DispatchPlan) -> dict[str, Any]:
    """Return a plan as JSON values (``skyway.dispatch/1``)."""
    return {
        "schema": SCHEMA,
        "depart": iso(plan.depart),
        "served": plan.served,
        "refused": len(plan.answers) - plan.served,
        "late": plan.late,
        "cost_s": plan.cost_s,
        "bound_s": plan.bound_s,
        "energy_j": plan.energy_j,
        "iterations": plan.iterations,
        "planning_time_s": plan.planning_time_s,
        "below_reserve": plan.below_reserve,
        "orders": [
            {
                "id": one.order,
                "status": one.status,
                "drone": one.drone,
                "fetched": None if one.fetched is None else iso(one.fetched),
                "delivered": None if one.delivered is None else iso(one.delivered),
                "late_s": one.late_s,
                "reason": one.reason,
                "chance": None if one.outlook is None else one.outlook.chance,
                "p50": None if one.outlook is None or one.outlook.p50 is None else iso(one.outlook.p50),
                "p95": None if one.outlook is None or one.outlook.p95 is None else iso(one.outlook.p95),
            }
            for one in plan.answers
        ],
        "drones": [
            {
                "id": route.drone,
                "type": route.type,
                "orders": route.orders,
                "steps": [
                    {
                        "kind": one.kind,
                        "order": one.order,
                        "phase": one.phase,
                        "from": one.origin,
                        "to": one.destination,
                        "pad": one.pad,
                        "begin": iso(one.begin),
                        "end": iso(one.end),
                        "soc_begin": one.soc_begin,
                        "soc_end": one.soc_end,
                    }
                    for one in route.steps
                ],
            }
            for route in plan.routes
        ],
    }
