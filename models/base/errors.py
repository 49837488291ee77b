"""The hierarchy of errors, and the faults of an input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Sequence


class SkywayError(Exception):
    """Any result of skyway that is not an answer.

    Attributes
    ----------
    exit_code : int
        Exit code of a command: 1 no solution, 2 wrong usage or input, 3 the vehicle or link failed.
    """

    exit_code = 2


def one_line(text: str) -> str:
    """Replace characters that must not be sent to a terminal (line ends, escape codes, lone surrogates) by spaces."""
    return text if text.isprintable() else "".join(char if char.isprintable() else " " for char in text)


MAX_FIELD, MAX_VALUE = 120, 60
"""Characters of a field's name and of its value in an error."""


def shortened(text: str, longest: int) -> str:
    """Return the beginning of a text that is longer."""
    return text[:longest] + "…" if len(text) > longest else text


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of an input, with the data to correct it."""

    problem: str
    """The problem, in a few words."""
    file: str | None = None
    line: int | None = None
    field: str | None = None
    value: object = None
    """Its location, and the value there; None if not applicable. Lines count from 1."""
    remedy: str | None = None
    """The correct form."""

    def __str__(self) -> str:
        where = self.file or ""
        if self.line is not None:
            where += f":{self.line}" if where else f"line {self.line}"
        parts = [where] if where else []
        if self.field is not None:
            parts.append(shortened(self.field, MAX_FIELD))
        text = ": ".join([*parts, self.problem])
        if self.value is not None:
            text += f" (got {shortened(str(self.value), MAX_VALUE)!r})"
        if self.remedy:
            text += f"; {self.remedy}"
        return one_line(text)


class InputError(SkywayError, ValueError):
    """A file, option or argument is wrong; contains every fault found, not only the first.

    The problem is described by faults, or in words, with the other arguments of a `Fault`.
    """

    def __init__(
        self,
        faults: str | Fault | Sequence[Fault],
        file: str | None = None,
        line: int | None = None,
        field: str | None = None,
        value: object = None,
        remedy: str | None = None,
    ) -> None:
        if isinstance(faults, str):
            faults = Fault(faults, file, line, field, value, remedy)
        if isinstance(faults, Fault):
            faults = (faults,)
        self.faults: tuple[Fault, ...] = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


def refuse(faults: Sequence[Fault]) -> None:
    """Raise an `InputError` if there are faults."""
    if faults:
        raise InputError(faults)


class InfeasibleError(SkywayError):
    """The request is well formed but has no solution: the reason, with the figures that bind.

    The binding constraint is ``payload``, ``energy``, ``wind``, ``airspace``, ``disconnected``, ``room``,
    ``no-drone`` or ``time-limit``.
    """

    exit_code = 1

    def __init__(self, message: str, *, constraint: str) -> None:
        super().__init__(message)
        self.constraint = constraint


class NoRouteError(InfeasibleError):
    """No composition reaches the destination."""


class AuditError(SkywayError):
    """A planner's answer differs from its simulated flight; it is not returned.

    The leg counts from 1, None is the whole plan; claimed and flown are figures, or words.
    """

    exit_code = 1

    def __init__(self, planner: str, leg: int | None, what: str, claimed: object, flown: object) -> None:
        where = "the delivery" if leg is None else f"leg {leg}"
        said, found = (f"{one:.12g}" if isinstance(one, float) else str(one) for one in (claimed, flown))
        super().__init__(
            one_line(
                f"the plan of {planner} failed its audit and is withheld: {where}: {what}: claimed {said}, flown {found}; "
                "another planner may have a plan (--planner); please report this request"
            )
        )
        self.planner, self.leg, self.what, self.claimed, self.flown = planner, leg, what, claimed, flown


class PayloadError(InfeasibleError):
    """No drone lifts the package."""

    def __init__(self, message: str) -> None:
        super().__init__(message, constraint="payload")


class LinkError(SkywayError):
    """The vehicle or the link to it failed."""

    exit_code = 3


class LinkLostError(LinkError):
    """The connection cannot be opened, or its other end is gone."""


class VehicleTimeoutError(LinkError):
    """The vehicle did not answer."""

    def __init__(self, what: str, waited_s: float) -> None:
        super().__init__(f"the vehicle did not answer within {duration(waited_s)}: {what}")
        self.what, self.waited_s = what, waited_s


class ListUnreadError(VehicleTimeoutError):
    """A list of the vehicle, such as its mission, did not arrive whole: no answer, or the vehicle aborted the transfer."""

    def __init__(self, what: str, problem: str, waited_s: float) -> None:
        super().__init__(f"download of its {what}: {problem}", waited_s)
        self.args = (f"the vehicle's {what} could not be read: {problem}",)


class CommandRefusedError(LinkError):
    """The vehicle refused a command."""

    def __init__(self, what: str, result: str, reasons: Sequence[str] = ()) -> None:
        said = f" ({'; '.join(reasons)})" if reasons else ""
        super().__init__(one_line(f"the vehicle refused to {what}: {result}{said}"))
        self.what, self.result, self.reasons = what, result, tuple(reasons)


class ListUnsupportedError(CommandRefusedError):
    """The vehicle has no lists of this kind: a fence, or rally points."""


class UploadMismatchError(LinkError):
    """The vehicle's mission differs from the one sent; a start is blocked."""


class StationConflictError(LinkError):
    """Another ground station sends with our system id."""

    def __init__(self, system: int, component: int) -> None:
        super().__init__(
            f"another ground station uses our system id {system} (component {component}): the vehicle cannot distinguish "
            "the two, and its failsafe counts both; choose another id with --gcs-system"
        )
        self.system, self.component = system, component


class ParameterAbsentError(LinkError):
    """The vehicle answers, but has no such parameter."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(f"the vehicle has no parameter {' or '.join(names)}: it answers for other parameters")
        self.names = tuple(names)
