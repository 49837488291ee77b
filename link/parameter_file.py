"""Parameter files of ground stations: ``NAME,VALUE`` lines, and QGroundControl's tab-separated ones."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, cast

from missions.parameters import Parameter, Rule
from models.errors import Fault, InputError
from models.files import read_text

if TYPE_CHECKING:
    from pathlib import Path

_MAX_BYTES = 2_000_000
_QGC_FIELDS = 5
_RULE = re.compile(r"# (equal|at-least|at-most|bits|read): (.*)")
_READ = re.compile(r"# ([A-Z0-9_]{1,16}): read it")


def read_parameters(path: Path) -> dict[str, float]:
    """Read a parameter file.

    Raises
    ------
    InputError
        With every line that is none.
    """
    found: dict[str, float] = {}
    faults = []
    for number, line in enumerate(read_text(path, max_bytes=_MAX_BYTES).splitlines(), start=1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        words = text.split("\t")
        name, value = (words[2], words[3]) if len(words) == _QGC_FIELDS else _pair(text)
        try:
            found[name] = float(value)
        except ValueError:
            faults.append(Fault("is no parameter", str(path), number, value=text, remedy="NAME,VALUE"))
            continue
        if not math.isfinite(found[name]) or not re.fullmatch(r"[A-Za-z0-9_]{1,16}", name):
            faults.append(Fault("is no parameter", str(path), number, value=text, remedy="NAME,VALUE"))
    if faults:
        raise InputError(faults)
    return found


def read_required(path: Path) -> tuple[Parameter, ...]:
    """Read the parameters that a mission needs, with their rules, as ``skyway mission`` writes them.

    A line without a rule before it is ``equal``.
    """
    values = read_parameters(path)
    rules: dict[str, tuple[Rule, str]] = {}
    read_only: list[Parameter] = []
    rule: Rule = "equal"
    why = ""
    for line in read_text(path, max_bytes=_MAX_BYTES).splitlines():
        found = _RULE.fullmatch(line.strip())
        only = _READ.fullmatch(line.strip())
        if found is not None:
            rule, why = cast("Rule", found[1]), found[2]
        elif only is not None:
            read_only.append(Parameter(only[1], "read", None, why))
        elif line.strip() and not line.startswith("#"):
            rules[_pair(line.strip())[0]] = (rule, why)
            rule, why = "equal", ""
    wanted = [Parameter(name, *_ruled(rules.get(name, ("equal", "")), value)) for name, value in values.items()]
    return (*wanted, *read_only)


def _ruled(rule: tuple[Rule, str], value: float) -> tuple[Rule, float, str]:
    return rule[0], value, rule[1]


def _pair(text: str) -> tuple[str, str]:
    words = [word for word in re.split(r"[,\s]+", text) if word]
    return (words[0], words[1]) if len(words) == 2 else (text, "")
