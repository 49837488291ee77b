"""Registry of autopilot families, by name and by MAV_AUTOPILOT."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from skyway.missions import autopilots
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from skyway.missions.autopilots.family import Family

FAMILIES: dict[str, Family] = {name: import_module(f"{autopilots.__name__}.{name}").FAMILY for name in autopilots.NAMES}
"""Every family by name."""


def default_family() -> Family:
    """Return the default family."""
    return FAMILIES[autopilots.NAMES[0]]


def family_named(name: str) -> Family:
    """Return a family by its name; an `InputError` for another name."""
    try:
        return FAMILIES[name]
    except KeyError:
        known = " or ".join(FAMILIES)
        raise InputError("is not a known autopilot", None, None, "autopilot", name, known) from None


def family_of(firmware: int | None) -> Family | None:
    """Return the family of a MAV_AUTOPILOT number; None for one that skyway does not know."""
    return next((family for family in FAMILIES.values() if family.firmware == firmware), None)
