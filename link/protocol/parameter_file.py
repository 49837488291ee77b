"""Parameter files of ground stations: ``NAME,VALUE`` lines, and QGroundControl's tab-separated ones."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from skyway.missions.autopilots.registry import FAMILIES
from skyway.missions.items.parameters import UNITS, Parameter
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.fields import finite
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.missions.autopilots.settings import Name, Setting
    from skyway.missions.items.parameters import Rule

IMPLAUSIBLE = "is outside the plausible range"
_MAX_BYTES = 2_000_000
_QGC_FIELDS = 5
_FEW = 5
"""So many wrong lines are listed one by one in any case."""
_RULE = re.compile(r"# (equal|at-least|at-most|bits|read): (.*)")
_READ = re.compile(r"# ([A-Z0-9_]{1,16}): read it")
_ELSEWHERE = re.compile(
    r"# {1,3}elsewhere ([A-Z0-9_]{1,16})(?: (at least|at most|with bits))?(?: ([-+0-9.e]+)[ a-z/]*)?"
)


@dataclass(frozen=True, slots=True)
class ParameterLine:
    """One parameter of a file."""

    number: int
    """Number of its line, from 1."""
    component: int | None
    """Of the vehicle; None if the file does not state it."""
    name: str
    value: float


def parameter_lines(path: Path) -> list[ParameterLine]:
    """Read a parameter file line by line.

    Raises an `InputError` that lists every line that is not a parameter, or only the first if most of many are not.
    """
    found = []
    faults = []
    for number, line in enumerate(read_text(path, max_bytes=_MAX_BYTES).splitlines(), start=1):
        text = line.partition("#")[0].strip()
        name, value = _pair(text)
        if text and (math.isnan(value) or not re.fullmatch(r"[A-Za-z0-9_]{1,16}", name)):
            faults.append(Fault("is not a parameter", str(path), number, value=text, remedy="NAME,VALUE"))
        elif text:
            words = text.split("\t")
            component = int(words[1]) if len(words) == _QGC_FIELDS and words[1].isdecimal() else None
            found.append(ParameterLine(number, component, name, value))
    if len(faults) > max(len(found), _FEW):
        problem = f"is no parameter file: {len(faults)} of its {len(faults) + len(found)} lines are not parameters"
        first = faults[0]
        remedy = "a file of lines NAME,VALUE, as skyway mission and ground stations write them"
        raise InputError(problem, str(path), first.line, value=first.value, remedy=remedy)
    refuse(faults)
    return found


def read_required(path: Path) -> tuple[Parameter, ...]:
    """Read the parameters that a mission needs, with their rules, as ``skyway mission`` writes them.

    A line without a rule before it is ``equal``. A parameter that has other names in other firmware is accepted under any of
    its names. Raises an `InputError` for lines that are not parameters, and for values outside the plausible range.
    """
    lines = parameter_lines(path)
    values = {line.name: line.value for line in lines}
    refuse([fault for line in lines if (fault := _implausible(path, line)) is not None])
    wanted: list[Parameter] = []
    rule: Rule = "equal"
    why = ""
    for line in map(str.strip, read_text(path, max_bytes=_MAX_BYTES).splitlines()):
        told, only, other = _RULE.fullmatch(line), _READ.fullmatch(line), _ELSEWHERE.fullmatch(line)
        if told is not None:
            rule, why = cast("Rule", told[1]), told[2]
        elif other is not None and wanted:
            wanted[-1] = wanted[-1].or_else(_elsewhere(other, wanted[-1]))
        elif only is not None:
            wanted.append(_known(only[1], "read", None, why))
        elif line and not line.startswith("#"):
            name, _ = _pair(line.partition("#")[0].strip())
            wanted.append(_known(name, rule, values[name], why))
            rule, why = "equal", ""
    once: dict[str, Parameter] = {}
    for parameter in wanted:
        if parameter.name not in once or once[parameter.name].value is None:
            once[parameter.name] = _every_name(parameter)
    return tuple(once.values())


def _implausible(path: Path, line: ParameterLine) -> Fault | None:
    """The fault of a value that no vehicle has."""
    for family in FAMILIES.values():
        expected = family.settings.range_left(line.name, line.value)
        if expected:
            return Fault(IMPLAUSIBLE, str(path), line.number, line.name, f"{line.value:.9g}", expected)
    return None


def _known(name: str, rule: Rule, value: float | None, why: str) -> Parameter:
    """A parameter of the file, with its meaning if known; the file is for one version, so only under its name."""
    found = _setting(name)
    if found is None:
        return Parameter(name, rule, value, why)
    setting, spelled = found
    ours = None if value is None else value / UNITS[spelled.unit]
    return next(way for way in setting.need(rule, ours, why).ways if way.name == name)


def _elsewhere(line: re.Match[str], first: Parameter) -> Parameter:
    """Parameter of other firmware in a comment."""
    rule: Rule = (
        "read" if line[3] is None else cast("Rule", (line[2] or "equal").replace("at ", "at-").replace("with ", ""))
    )
    return _known(line[1], rule, None if line[3] is None else float(line[3]), first.why)


def _every_name(parameter: Parameter) -> Parameter:
    """Add the names of other versions; those in comments of the file stay unchanged."""
    found = _setting(parameter.name)
    if found is None:
        return parameter
    value = None if parameter.value is None else parameter.value / UNITS[parameter.unit]
    given = set(parameter.names)
    more = [w for w in found[0].need(parameter.rule, value, parameter.why).ways if w.name not in given]
    return parameter.or_else(*more)


def _setting(name: str) -> tuple[Setting, Name] | None:
    """The setting of a parameter of either autopilot."""
    return next((found for known in FAMILIES.values() if (found := known.settings.find(name)) is not None), None)


def _pair(text: str) -> tuple[str, float]:
    """Name and value of a line; NaN if it has no finite one."""
    words = text.split("\t")
    words = words[2:4] if len(words) == _QGC_FIELDS else re.split(r"[,\s]+", text.strip(", "))
    value = finite(words[1]) if len(words) == 2 else None
    return words[0], math.nan if value is None else value
