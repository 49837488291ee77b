"""Reports of parameters: what ``skyway params --json`` prints."""

from __future__ import annotations

import msgspec


class ParameterValues(msgspec.Struct, frozen=True, kw_only=True):
    """Values by name."""

    schema: str = "skyway.parameters/1"
    parameters: dict[str, float]


class ParameterSet(msgspec.Struct, frozen=True, kw_only=True):
    """A value that was set, or would be."""

    schema: str = "skyway.parameter/1"
    name: str
    was: float
    value: float
    set: bool


class ParameterDifference(msgspec.Struct, frozen=True, kw_only=True):
    """A value of a file that the vehicle has otherwise, or not at all."""

    name: str
    file: float
    vehicle: float | None


class ParametersDiff(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle compared with a file."""

    schema: str = "skyway.parameters-diff/1"
    ok: bool
    compared: int
    differences: list[ParameterDifference]


class ParameterRestored(msgspec.Struct, frozen=True, kw_only=True):
    """A value that a flight changed, and what was done about it."""

    name: str
    now: float
    before: float
    done: str


class ParametersRestore(msgspec.Struct, frozen=True, kw_only=True):
    """What was restored; `problem` where not all could be."""

    schema: str = "skyway.parameters-restore/1"
    ok: bool
    parameters: list[ParameterRestored]
    problem: str | None
