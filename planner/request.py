"""What is asked of a planner."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from models.errors import Fault, InputError
from planner.objective import Objective

if TYPE_CHECKING:
    from models.services import Recharge, State

DEFAULT_RESERVE_SOC = 0.2
DEFAULT_EPSILON = 1e-3


@dataclass(frozen=True, kw_only=True)
class Request:
    """One delivery, from where it stands now.

    Attributes
    ----------
    state : State
        Where the drone is, when, with which charge; see `models.services.State`.
    destination : str
        Station id.
    payload_kg : float
        Mass of the package.
    drone : str or None
        Drone id; None lets the planner choose from the skyline of the fleet.
    airspeed_mps : float or None
        Planned airspeed; None is the drone's cruise airspeed.
    reserve_soc : float
        No landing below it, except with probability `epsilon`.
    epsilon : float
        See `reserve_soc`.
    recharge : ``full`` or ``enough``
        Charge to 100 % at each stop, or what the next flight needs (planners that choose by themselves ignore it).
    escape : bool
        At a target without pads the drone must still reach a station at or above the reserve.
    seed : int
        Of everything that is sampled.
    objective : Objective
        Of the planner ``robust``; the others know the mean only.
    """

    state: State
    destination: str
    payload_kg: float
    drone: str | None = None
    airspeed_mps: float | None = None
    reserve_soc: float = DEFAULT_RESERVE_SOC
    epsilon: float = DEFAULT_EPSILON
    recharge: Recharge = "enough"
    escape: bool = True
    seed: int = 0
    objective: Objective = field(default_factory=Objective)

    def __post_init__(self) -> None:
        faults = []

        def check(field: str, value: float, low: float, high: float, remedy: str) -> None:
            if not low <= value <= high:
                faults.append(Fault("out of range", field=field, value=value, remedy=remedy))

        check("payload_kg", self.payload_kg, 0.0, 1000.0, "kilograms, 0 or more")
        check("reserve_soc", self.reserve_soc, 0.0, 0.95, "a fraction from 0 to 0.95 (--reserve 0 to 95 percent)")
        check("state.soc", self.state.soc, 0.0, 1.0, "a fraction from 0 to 1 (--soc 0 to 100 percent)")
        check("epsilon", self.epsilon, 0.0, 0.5, "a probability from 0 to 0.5")
        if self.airspeed_mps is not None:
            check("airspeed_mps", self.airspeed_mps, 1.0, 150.0, "metres per second, 1 to 150")
        if (self.state.station is None) == (self.state.position is None):
            faults.append(Fault("either a station or a position must be given", field="state"))
        if faults:
            raise InputError(faults)
