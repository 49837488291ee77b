"""Parameters: the tuned numbers of a part, each with default, unit, range, meaning and the measurement behind it.

A part is a frozen dataclass derived from `Parameters`; its fields are made by `parameter`, or are parts themselves. This
suffices to check, list, change (``planner.robust.members=50``) and compare a tree of parts with its defaults.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar, cast

from skyway.models.base.errors import Fault, InputError, refuse

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Value = bool | int | float | tuple[float, ...]
"""Types of a parameter's value."""
P = TypeVar("P", bound="Parameters")


def parameter(
    default: Any, meaning: str, low: float = 0.0, high: float = math.inf, *, unit: str = "", measured: str = ""
) -> Any:
    """Return a field of a part.

    Parameters
    ----------
    default : bool, int, float or tuple of float
        Its type is the parameter's; a tuple holds one number or more.
    meaning : str
        Its effect, in one sentence.
    low, high : float
        The range, both ends included; of each number of a tuple.
    unit : str
        ``s``, ``m/s``; empty for counts and shares.
    measured : str
        The measurement that it was set by; empty if it was not measured.
    """
    return field(
        default=default, metadata={"meaning": meaning, "range": (low, high), "unit": unit, "measured": measured}
    )


@dataclass(frozen=True)
class Parameters:
    """Base of all parts: checks the range and type of every value."""

    def __post_init__(self) -> None:
        """Refuse values that are out of range."""
        faults = [fault for one in entries(self) if (fault := one.fault(one.value)) is not None]
        refuse(faults)


@dataclass(frozen=True, slots=True)
class Entry:
    """One parameter of a tree: its dotted name, its value, and its arguments of `parameter`."""

    name: str
    value: Value
    default: Value
    meaning: str
    low: float
    high: float
    unit: str
    measured: str

    @property
    def range_text(self) -> str:
        """The range for people: ``0 to 1``, ``1 or more``."""
        return f"{self.low:g} or more" if math.isinf(self.high) else f"{self.low:g} to {self.high:g}"

    def fault(self, value: object) -> Fault | None:
        """The problem with a value, or None."""
        if isinstance(self.default, bool):
            return None if isinstance(value, bool) else Fault("is not true or false", field=self.name, value=value)
        numbers = value if isinstance(self.default, tuple) and isinstance(value, tuple) else (value,)
        kind = int if isinstance(self.default, int) else (int, float)
        real = all(isinstance(one, kind) and not isinstance(one, bool) for one in numbers) and len(numbers) > 0
        if not real or isinstance(value, tuple) != isinstance(self.default, tuple):
            what = {int: "a whole number", float: "a number", tuple: "numbers with commas between them"}
            return Fault("has another type", field=self.name, value=value, remedy=what[type(self.default)])
        if not all(self.low <= cast("float", one) <= self.high for one in numbers):
            return Fault("out of range", field=self.name, value=value, remedy=f"{self.range_text} {self.unit}".rstrip())
        return None

    def parsed(self, text: str) -> Value:
        """Return the value of a text. Raises an `InputError` if it is not one, or out of range."""
        value: Any = text
        try:
            if isinstance(self.default, bool):
                value = {"true": True, "false": False}.get(text.strip().lower(), text)
            elif isinstance(self.default, tuple):
                value = tuple(float(part) for part in text.split(","))
            else:
                value = type(self.default)(text)
        except ValueError:
            pass
        fault = self.fault(value)
        if fault is not None:
            raise InputError(fault)
        return cast("Value", value)


def entries(part: Parameters, name: str = "") -> list[Entry]:
    """Return all parameters of a tree in order; `name` is that of the tree itself."""
    found: list[Entry] = []
    for one in fields(part):
        value, whole = getattr(part, one.name), f"{name}.{one.name}" if name else one.name
        if isinstance(value, Parameters):
            found += entries(value, whole)
        else:
            told = one.metadata
            low, high = told["range"]
            default = cast("Value", one.default)
            found.append(Entry(whole, value, default, told["meaning"], low, high, told["unit"], told["measured"]))
    return found


def text_of(value: Value) -> str:
    """Return a value as typed: ``0.12,0.25``."""
    if isinstance(value, tuple):
        return ",".join(map(text_of, value))
    if isinstance(value, int):
        return str(value).lower()
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def changed(part: Parameters, name: str = "") -> dict[str, str]:
    """Return the parameters of a tree that are not at their defaults, by name, as typed (`with_settings`)."""
    return {one.name: text_of(one.value) for one in entries(part, name) if one.value != one.default}


def with_values(part: P, values: Mapping[str, Value]) -> P:
    """Return a tree with some parameters changed, by their names; an `InputError` for a wrong name or value."""
    known = {one.name: one for one in entries(part)}
    for name in values:
        _find(known, name)
    own: dict[str, Any] = {}
    for one in fields(part):
        inner = {name.partition(".")[2]: value for name, value in values.items() if name.startswith(f"{one.name}.")}
        if inner:
            own[one.name] = with_values(getattr(part, one.name), inner)
        elif one.name in values:
            own[one.name] = values[one.name]
    return replace(part, **own)


def with_settings(part: P, settings: Iterable[str]) -> P:
    """Return a tree with parameters changed by typed settings: ``planner.robust.members=50``.

    Raises an `InputError` if one is not ``name=value``, has no such parameter, or a value out of range.
    """
    known = {one.name: one for one in entries(part)}
    values: dict[str, Value] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise InputError("is not name=value", field="--set", value=setting, remedy="planner.robust.members=50")
        values[name.strip()] = _find(known, name.strip()).parsed(text)
    return with_values(part, values)


def _find(known: Mapping[str, Entry], name: str) -> Entry:
    """Return a parameter by its name, or raise an `InputError` that lists similar names."""
    if name in known:
        return known[name]
    last = name.rpartition(".")[2]
    close = get_close_matches(name, known, 3, 0.5)
    close = close or sorted(known, key=lambda one: one.rpartition(".")[2] != last)[:3]
    raise InputError("no such parameter", field=name, remedy="near it: " + ", ".join(close))
