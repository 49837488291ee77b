"""Parameter names and units of an autopilot, by firmware version.

A setting has one meaning and one unit of ours; firmware versions name it differently. The version of a vehicle determines the
likely name; the actual one is requested from the vehicle, since builds between two versions have some of the new names and
not others. Each family has its table in ``settings`` of its folder.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.missions.items.parameters import UNITS, Parameter
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from skyway.missions.items.parameters import Rule

Version = tuple[int, int]
"""Major and minor version of a firmware."""
OLDEST: Version = (0, 0)
MAIN: Version = (999, 0)
"""The development branch."""
_NEVER: Version = (1000, 0)
_VERSION = re.compile(r"v?(\d{1,3})\.(\d{1,3})(?:[.-].*)?")


def version_of(text: str) -> Version:
    """Version of a text such as ``4.6``, ``v1.16.1`` or ``main``; an `InputError` for any other text."""
    if text.strip().lower() == "main":
        return MAIN
    found = _VERSION.fullmatch(text.strip())
    if found is None:
        remedy = "major and minor number such as 4.6 or 1.16, or main"
        raise InputError("is not a firmware version", field="--firmware", value=text, remedy=remedy)
    return int(found[1]), int(found[2])


@dataclass(frozen=True, slots=True)
class Name:
    """One name of a setting."""

    name: str
    """In the firmware."""
    unit: str = ""
    """One of `missions.items.parameters.UNITS`: that of the value on the wire."""
    since: Version = OLDEST
    until: Version = _NEVER
    """Versions that have it; `until` has it no more."""

    def held_by(self, version: Version) -> bool:
        """Whether a version of the firmware has it."""
        return self.since <= version < self.until


@dataclass(frozen=True, slots=True)
class Setting:
    """One meaning."""

    key: str
    """Its name in skyway, such as ``mission-speed``."""
    words: str
    """Its meaning."""
    names: tuple[Name, ...]
    """Those of the newest firmware first."""
    plausible: tuple[float, float] = (-1e9, 1e9)
    """Plausible range in our unit: a value beyond it has another unit or meaning than ours."""

    def need(self, rule: Rule, value: float | None, why: str, *otherwise: Parameter, paired: str = "") -> Parameter:
        """Return what a mission needs of it, under each of its names; the value in our unit.

        `otherwise` suffices if the firmware has no such setting at all. It counts only if the vehicle also has the
        parameter `paired` too, which came into the firmware with it.
        """
        low, high = self.plausible
        ways = [
            Parameter(
                name.name, rule, None if value is None else value * UNITS[name.unit], why,
                key=self.key, words=self.words, unit=name.unit, paired=paired,
                plausible=(low * UNITS[name.unit], high * UNITS[name.unit]),
            )
            for name in self.names
        ]  # fmt: skip
        return ways[0].or_else(*ways[1:], *otherwise)


class Settings:
    """The settings of one autopilot."""

    def __init__(self, settings: Iterable[Setting]) -> None:
        self._by_key = {setting.key: setting for setting in settings}
        self._by_name = {name.name: (setting, name) for setting in self._by_key.values() for name in setting.names}

    def __getitem__(self, key: str) -> Setting:
        return self._by_key[key]

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys."""
        return tuple(self._by_key)

    def find(self, name: str) -> tuple[Setting, Name] | None:
        """Return the setting of a parameter, and its name; None for a parameter that is not in the table."""
        return self._by_name.get(name)

    def range_left(self, name: str, value: float) -> str:
        """Return the plausible range of a parameter in words, if a value is outside it; otherwise, or if it is not known, nothing."""
        found = self.find(name)
        if found is None:
            return ""
        setting, spelled = found
        low, high = (bound * UNITS[spelled.unit] for bound in setting.plausible)
        return "" if low <= value <= high else f"{low:g} to {high:g} {spelled.unit}".rstrip()

    def in_our_units(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return parameters, by name and in the autopilot's units, as settings by key and in ours; others are omitted."""
        known = ((self.find(name), value) for name, value in values.items())
        return {found[0].key: value / UNITS[found[1].unit] for found, value in known if found is not None}

    def in_version(self, wanted: Parameter, version: Version) -> Parameter | None:
        """Return the variant of a need for a version of the firmware; None if that has none of its names."""
        for way in wanted.ways:
            found = self.find(way.name)
            paired = self.find(way.paired)
            if (found is None or found[1].held_by(version)) and (paired is None or paired[1].held_by(version)):
                return way
        return None
