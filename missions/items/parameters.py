"""Vehicle parameters that a mission relies on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Rule = Literal["equal", "at-least", "at-most", "bits", "read"]
UNITS = {"": 1.0, "m": 1.0, "cm": 100.0, "m/s": 1.0, "cm/s": 100.0, "deg": 1.0, "cdeg": 100.0}
"""Factor from our unit to a unit of the wire."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter and its required value."""

    name: str
    """The autopilot's name."""
    rule: Rule
    """``equal``, ``at-least``, ``at-most``; ``bits``: these bits set, others as they are; ``read``: any value, but read
    it before flying and report its meaning to the operator."""
    value: float | None
    """In the autopilot's unit; None for ``read``."""
    why: str
    """The consequence of another value."""
    key: str = ""
    words: str = ""
    """Its setting, by key and in words (`missions.autopilots.settings`); empty for a parameter of no known
    meaning."""
    unit: str = ""
    """The autopilot's."""
    paired: str = ""
    """It counts only if the vehicle also has this parameter; empty for none."""
    plausible: tuple[float, float] = (-3.5e38, 3.5e38)
    """In the autopilot's unit: a value beyond it has another meaning than ours."""
    others: tuple[Parameter, ...] = ()
    """The same need if the firmware has no parameter of that name, the best first."""

    @property
    def ways(self) -> tuple[Parameter, ...]:
        """The parameter and its alternatives."""
        return (replace(self, others=()), *self.others)

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters needed to decide which method applies."""
        return tuple(dict.fromkeys(name for way in self.ways for name in (way.name, way.paired) if name))

    @property
    def meaning(self) -> str:
        """Its meaning in words."""
        return self.words or self.name

    def or_else(self, *others: Parameter) -> Parameter:
        """Return the same with other alternatives after its own."""
        return replace(self, others=(*self.others, *(way for other in others for way in other.ways)))

    def called(self, name: str, unit: str) -> Parameter:
        """Return the same need of a parameter of another name and unit, without alternatives."""
        known = [known for known in UNITS if known.removeprefix("c") == self.unit.removeprefix("c")]
        if unit not in known:
            remedy = " or ".join(known) or "no unit"
            raise InputError(f"is not a unit of {self.meaning}", field="--parameter-name", value=unit, remedy=remedy)
        scale = UNITS[unit] / UNITS[self.unit]
        value = None if self.value is None else self.value * scale
        low, high = self.plausible
        return replace(
            self, name=name, unit=unit, value=value, plausible=(low * scale, high * scale), paired="", others=()
        )

    def accepts(self, actual: float) -> bool:
        """Whether a value read from the vehicle is acceptable."""
        if not self.believes(actual):
            return False
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

    def believes(self, actual: float) -> bool:
        """Whether a value read from the vehicle is plausible."""
        return self.plausible[0] <= actual <= self.plausible[1]  # False for NaN


@dataclass(frozen=True, slots=True)
class FlightNeeds:
    """Settings that a mission needs."""

    ground_speed_mps: float
    climb_rate_mps: float
    descent_rate_mps: float
    """Greatest planned."""
    return_height_m: float
    """Height above home at which a return clears the ground everywhere on the route."""
    fenced: bool = False
    has_rally_points: bool = False
    continues_after_landing: bool = False
    stays_armed: bool = False
    uses_gripper: bool = False
    uses_winch: bool = False
    """The properties of a mission that determine its parameters."""


def dumps(
    parameters: Sequence[Parameter], *, firmware: str = "", way: Callable[[Parameter], Parameter | None] | None = None
) -> str:
    """Return the text of a Mission Planner parameter file, which QGroundControl's users can read too.

    Parameters that must only be read first are comments, and so are the names in other firmware. `firmware`
    names the firmware in words, `way` is the alternative of a need in that firmware, None for none; by default the
    first.
    """
    lines = ["# Parameters that this mission needs: NAME,VALUE"]
    if firmware:
        lines.append(f"# for {firmware}")
    for parameter in parameters:
        chosen = parameter if way is None else way(parameter)
        if chosen is None:
            lines.append(f"# this version has no parameter for: {parameter.meaning} ({', '.join(parameter.names)})")
            continue
        lines.append(f"# {chosen.rule}: {chosen.why}")
        if chosen.value is None:
            lines.append(f"# {chosen.name}: read it")
        else:
            lines.append(f"{chosen.name},{chosen.value:.9g}")
        lines += [f"#   elsewhere {_assignment(other)}" for other in parameter.ways if other.name != chosen.name]
    return "\n".join(lines) + "\n"


def _assignment(parameter: Parameter) -> str:
    """The parameter and its value with unit, for a comment."""
    if parameter.value is None:
        return parameter.name
    relation = {"at-least": "at least ", "at-most": "at most ", "bits": "with bits "}.get(parameter.rule, "")
    return f"{parameter.name} {relation}{parameter.value:g} {parameter.unit}".rstrip()
