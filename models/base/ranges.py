"""Checks of arguments: their kinds, and their ranges with a hint if the number fits another unit: percent, kilometres, grams."""

from __future__ import annotations

from numbers import Real

from skyway.models.base.errors import Fault

MIN_PERCENT = 1.0
"""A state of charge between 0 and this is a typing error: percent for a fraction, or a fraction for percent."""


def kind_faults(field: str, value: object, kind: type | tuple[type, ...], remedy: str) -> list[Fault]:
    """Faults of an argument that must be of a kind; `remedy` says what to give."""
    if isinstance(value, kind):
        return []
    first = kind[0] if isinstance(kind, tuple) else kind
    return [Fault(f"is not a {first.__name__}", field=field, value=_shown(value), remedy=remedy)]


def divided(value: float, by: float, most: float) -> str | None:
    """Return the meaning of a number if it was given in a unit this many times smaller; None if that is not from 0 to `most`."""
    return f"; did you mean {value / by:g}?" if _is_number(value) and 0.0 < value / by <= most else None


def number_faults(field: str, value: object, remedy: str | None = None) -> list[Fault]:
    """Faults of an argument that must be a number."""
    if _is_number(value):
        return []
    problem = "is not a number but text" if isinstance(value, str) else "is not a number"
    return [Fault(problem, field=field, value=_shown(value), remedy=remedy)]


def range_faults(
    field: str, value: float, low: float, high: float, remedy: str, meant: str | None = None
) -> list[Fault]:
    """Faults of a number that must lie in a range; `meant` is its possible meaning in another unit."""
    faults = number_faults(field, value, remedy)
    if faults:
        return faults
    if low <= value <= high:
        return []
    return [Fault("out of range", field=field, value=value, remedy=f"{remedy}{meant or ''}")]


def fraction_faults(field: str, value: float, high: float, option: str, *, least: float = 0.0) -> list[Fault]:
    """Faults of a state of charge from 0 to 1; above 0 and below `least` it is probably a fraction of a percent."""
    meant = divided(value, 100.0, high) if _is_number(value) and value > 1.0 else None
    faults = range_faults(field, value, 0.0, high, f"a fraction from 0 to {high:g} ({option})", meant)
    if faults or not 0.0 < value < least:
        return faults
    return [_hardly(field, value, 100.0 * value, "a fraction", f"{min(100.0 * value, high):g}")]


def percent_faults(option: str, value: float, high: float) -> list[Fault]:
    """Faults of percent, as typed; above 0 and up to 1 it is a fraction, taken for percent."""
    faults = range_faults(option, value, 0.0, high, f"percent from 0 to {high:g}")
    if faults or not 0.0 < value <= MIN_PERCENT:
        return faults
    return [_hardly(option, value, value, "in percent", f"{option} {min(100.0 * value, high):g}")]


def _hardly(field: str, value: float, percent: float, unit: str, meant: str) -> Fault:
    problem = f"is {unit}, and {percent:g} % is hardly anything"
    return Fault(problem, field=field, value=value, remedy=f"did you mean {meant}?")


def _shown(value: object) -> object:
    """Return a value as an error shows it: None would be no value."""
    return "None" if value is None else value


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
