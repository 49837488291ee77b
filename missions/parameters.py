"""Parameters of the vehicle that a mission relies on: part of what is handed over with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

Rule = Literal["equal", "at-least", "at-most", "bits", "read"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter and what it must be.

    Attributes
    ----------
    name : str
        The autopilot's name.
    rule : str
        ``equal``, ``at-least``, ``at-most``; ``bits``: these bits set, others as they are; ``read``: any value, but
        read it before flying and tell the operator what it means.
    value : float or None
        In the autopilot's unit; None for ``read``.
    why : str
        What happens otherwise.
    """

    name: str
    rule: Rule
    value: float | None
    why: str

    def accepts(self, actual: float) -> bool:
        """Whether a value read from the vehicle will do."""
        if self.value is None or self.rule == "read":
            return True
        slack = 1e-6 * max(1.0, abs(self.value))  # parameters are 32-bit floats on the wire
        if self.rule == "at-least":
            return actual >= self.value - slack
        if self.rule == "at-most":
            return actual <= self.value + slack
        if self.rule == "bits":
            return int(actual) & int(self.value) == int(self.value)
        return abs(actual - self.value) <= slack


@dataclass(frozen=True, slots=True)
class FlightNeeds:
    """What a mission asks of the vehicle's settings.

    Attributes
    ----------
    ground_speed_mps, climb_rate_mps, descent_rate_mps : float
        Greatest planned.
    return_height_m : float
        Height above home at which a return clears the ground everywhere on the route.
    fenced, has_rally_points, continues_after_landing, stays_armed, uses_gripper : bool
        What the mission has.
    """

    ground_speed_mps: float
    climb_rate_mps: float
    descent_rate_mps: float
    return_height_m: float
    fenced: bool = False
    has_rally_points: bool = False
    continues_after_landing: bool = False
    stays_armed: bool = False
    uses_gripper: bool = False


def dumps(parameters: Sequence[Parameter]) -> str:
    """Return the text of a Mission Planner parameter file, which QGroundControl's users can read too.

    Parameters that must only be read first are comments.
    """
    lines = ["# Parameters that this mission needs: NAME,VALUE"]
    for parameter in parameters:
        lines.append(f"# {parameter.rule}: {parameter.why}")
        if parameter.value is None:
            lines.append(f"# {parameter.name}: read it")
        else:
            lines.append(f"{parameter.name},{parameter.value:g}")
    return "\n".join(lines) + "\n"
