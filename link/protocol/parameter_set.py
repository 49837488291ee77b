"""Sets of parameters: saved in the files of Mission Planner and QGroundControl, and compared with a vehicle."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.protocol.parameter_file import IMPLAUSIBLE, parameter_lines
from skyway.link.protocol.parameters import CHANGE_BY_THEMSELVES, is_whole, misfit, same_value
from skyway.missions.items.parameters import UNITS
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from skyway.link.protocol.parameters import ParameterValue
    from skyway.missions.autopilots.family import Family

MISSION_PLANNER, QGROUNDCONTROL = (".param", ".parm"), (".params",)
"""Suffixes of the files."""
_AUTOPILOT = 1
"""MAVLink component of the autopilot itself."""
_STACK = re.compile(r"#\s*Stack:\s*(\w+)", re.IGNORECASE)
_MAX_BYTES = 2_000_000
_HEAD_CHARACTERS = 2000


@dataclass(frozen=True, slots=True)
class SavedSet:
    """The parameters of a file."""

    path: Path
    values: dict[str, float]
    stack: str = ""
    """The autopilot named in the file, in lower case; empty if it names none."""
    of_others: int = 0
    """Lines for other components of the vehicle (camera, gimbal), which are omitted."""


@dataclass(frozen=True, slots=True)
class SetChange:
    """A parameter that a set changes."""

    name: str
    """Its name on the vehicle."""
    now: float
    then: float
    file_name: str
    """Its name in the file: differs if the firmware has renamed it."""


@dataclass(frozen=True, slots=True)
class SetDifference:
    """A set compared with a vehicle."""

    changes: tuple[SetChange, ...]
    renamed: tuple[tuple[str, str], ...]
    """Name in the file, and name on the vehicle, also of unchanged ones."""
    absent: tuple[str, ...]
    """Those that the vehicle has under no known name."""
    left: tuple[tuple[str, str], ...]
    """Those that differ and are not changed, with the reason."""
    same: int


def check_ending(path: Path) -> None:
    """Refuse to write a file that no ground station would read."""
    if path.suffix.lower() not in (*MISSION_PLANNER, *QGROUNDCONTROL):
        remedy = "FILE.param (Mission Planner) or FILE.params (QGroundControl)"
        raise InputError("unknown form of a parameter file", str(path), value=path.suffix, remedy=remedy)


def set_text(path: Path, values: Iterable[ParameterValue], head: Sequence[str], stack: str, system: int) -> str:
    """Return the text of the file of a set, in the format of its suffix; values that are not numbers as comments."""
    check_ending(path)
    tabbed = path.suffix.lower() in QGROUNDCONTROL
    lines = [*(f"# {line}" for line in head), f"# Stack: {stack}", "#"]
    if tabbed:
        lines.append("# Vehicle-Id Component-Id Name Value Type")
    for one in sorted(values, key=lambda value: value.name):
        shown = value_text(one.value, one.kind)
        if not math.isfinite(one.value):
            lines.append(f"# {one.name} is {shown}, which is not a number")
        elif tabbed:
            lines.append(f"{system}\t{_AUTOPILOT}\t{one.name}\t{shown}\t{one.kind}")
        else:
            lines.append(f"{one.name},{shown}")
    return "\n".join([*lines, ""])


def value_text(value: float, kind: int) -> str:
    """A value with all digits: whole numbers have up to ten, 32-bit floats need nine."""
    return str(int(value)) if is_whole(kind) and math.isfinite(value) and value == int(value) else f"{value:.9g}"


def read_set(path: Path) -> SavedSet:
    """Read a set. Raises an `InputError` that lists lines that are not parameters, or contradict each other."""
    first: dict[str, tuple[int, float]] = {}
    faults = []
    of_others = 0
    for line in parameter_lines(path):
        if line.component not in (None, _AUTOPILOT):
            of_others += 1
            continue
        number, value = first.setdefault(line.name, (line.number, line.value))
        if value != line.value:
            problem = f"stands there twice, with {value:.9g} in line {number}"
            faults.append(Fault(problem, str(path), line.number, line.name, f"{line.value:.9g}", "leave one of them"))
    refuse(faults)
    if not first:
        raise InputError("has no parameters of an autopilot", str(path), remedy="lines NAME,VALUE")
    named = _STACK.search(read_text(path, max_bytes=_MAX_BYTES)[:_HEAD_CHARACTERS])
    values = {name: value for name, (_, value) in first.items()}
    return SavedSet(path, values, "" if named is None else named[1].lower(), of_others)


def compare_set(saved: SavedSet, actual: Mapping[str, ParameterValue], family: Family) -> SetDifference:
    """Compare a set with what a vehicle has.

    Raises an `InputError` if the set is for another autopilot, or with the values that do not fit the type of its parameters,
    or that it would change to what is outside the plausible range.
    """
    if saved.stack and not saved.stack.startswith(family.name):
        remedy = f"a set that was saved from {family.name}"
        raise InputError(
            f"is of another autopilot than the vehicle, {family.name}",
            str(saved.path),
            value=saved.stack,
            remedy=remedy,
        )
    changes, renamed, absent, left, faults = [], [], [], [], []
    same = 0
    for file_name, value in saved.values.items():
        name, then = _on_vehicle(file_name, value, saved.values, actual, family)
        has = actual.get(name)
        if has is None:
            absent.append(file_name)
            continue
        if name != file_name:
            renamed.append((file_name, name))
        problem = misfit(then, has.kind)
        reason = _left(name, family)
        if problem:
            faults.append(Fault(problem, str(saved.path), field=file_name, value=f"{value:.9g}"))
        elif same_value(then, has.value, has.kind):
            same += 1
        elif reason:
            left.append((name, reason))
        elif expected := family.settings.range_left(name, then):
            remedy = f"{expected}; correct it, or remove its line"
            faults.append(Fault(IMPLAUSIBLE, str(saved.path), field=file_name, value=f"{value:.9g}", remedy=remedy))
        else:
            changes.append(SetChange(name, has.value, then, file_name))
    if len(absent) == len(saved.values):
        problem = f"the vehicle ({family.name}) has none of its {len(absent)} parameters"
        raise InputError(problem, str(saved.path), remedy="is it of another autopilot?")
    refuse(faults)
    return SetDifference(tuple(changes), tuple(renamed), tuple(absent), tuple(left), same)


def _left(name: str, family: Family) -> str:
    """Reason why a parameter is never restored; empty if it is."""
    if name in family.system_id_names:
        return "the system id is the vehicle's own, and the link would be lost"
    return "the autopilot writes it itself" if name.startswith(CHANGE_BY_THEMSELVES) else ""


def _on_vehicle(
    name: str, value: float, values: Mapping[str, float], actual: Mapping[str, ParameterValue], family: Family
) -> tuple[str, float]:
    """Name and value on the vehicle, which may have another name and unit for it."""
    known = family.settings.find(name)
    if name in actual or known is None:
        return name, value
    setting, spelled = known
    for way in setting.need("equal", value / UNITS[spelled.unit], "").ways:
        if way.name in actual and way.name not in values and way.value is not None and way.believes(way.value):
            return way.name, way.value
    return name, value
