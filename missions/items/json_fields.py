"""Validated fields of third-party JSON; faults name the field."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.missions.items.coordinates import Point, to_e7
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_FLOAT32 = 3.4028235e38
MAX_PARAM = float(2**31 - 1)
"""Largest parameter 5 or 6 that is not a place: an integer of 32 bits on the wire."""


class JsonField:
    """A value of a JSON file with its path; reading it validates it.

    Errors name the file and the field, as in ``mission.items[3].command``, empty for the whole file.
    """

    __slots__ = ("file", "name", "value")

    def __init__(self, value: Any, file: str, name: str = "") -> None:
        self.value, self.file, self.name = value, file, name

    def __getitem__(self, key: str | int) -> JsonField:
        """Return a field of an object, or an element of a list that is long enough."""
        if isinstance(key, int):
            return JsonField(self.value[key], self.file, f"{self.name}[{key}]")
        return JsonField(self.mapping().get(key), self.file, f"{self.name}.{key}" if self.name else key)

    def __contains__(self, key: str) -> bool:
        return key in self.mapping()

    def get(self, key: str, missing: object) -> JsonField:
        """Return a field of an object; another value if it is absent."""
        return self[key] if key in self else JsonField(missing, self.file, f"{self.name}.{key}")

    def of(self, value: object) -> JsonField:
        """Return another value in its place."""
        return JsonField(value, self.file, self.name)

    def fault(self, problem: str, value: object = None, remedy: str | None = None) -> InputError:
        """Make the error for this field."""
        return InputError(problem, self.file, None, self.name or "the file", value, remedy)

    def mapping(self) -> Mapping[str, Any]:
        """Take a JSON object."""
        if not isinstance(self.value, dict):
            raise self.fault("is not an object", self.value)
        return self.value

    def sequence(self) -> list[Any]:
        """Take a JSON array."""
        if not isinstance(self.value, list):
            raise self.fault("is not a list", self.value)
        return self.value

    def elements(self) -> list[JsonField]:
        """Take the elements of a JSON array."""
        return [JsonField(one, self.file, f"{self.name}[{index}]") for index, one in enumerate(self.sequence())]

    def number(self) -> float:
        """Take a number that a float on the wire can hold; null is NaN."""
        value = self.value
        if value is None:
            return math.nan
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.fault("is not a number", value)
        if abs(value) > MAX_FLOAT32:
            raise self.fault("is too large for a mission", value)
        return float(value)

    def number_or_none(self) -> float | None:
        """Take a number; null is None."""
        return None if self.value is None else self.number()

    def whole(self, *, most: int) -> int:
        """Take a whole number from 0 to `most`; 3.0 counts as 3."""
        value = self.value
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise self.fault(f"is not a whole number from 0 to {most}", value)
        return value

    def quantity(self, *, least: float = -math.inf, positive: bool = False) -> float:
        """Read a required setting, a finite number not below `least`."""
        value = self.number()
        if math.isnan(value):
            raise self.fault("is missing: a number is needed")
        if value < least or (positive and value <= 0.0):
            raise self.fault("is not above 0" if positive else f"is below {least:g}", self.value)
        return value

    def flag(self) -> bool:
        """Take a setting that is true or false."""
        if not isinstance(self.value, bool):
            raise self.fault("is neither true nor false", self.value)
        return self.value

    def place(self) -> Point:
        """Take [latitude, longitude, …] in degrees."""
        pair = self.elements()
        if len(pair) < 2:
            raise self.fault("is not [latitude, longitude]", self.value)
        lat, lon = pair[0].number(), pair[1].number()
        if not (-90.0 <= lat <= 90.0):
            raise self.fault("latitude is not between -90 and 90", pair[0].value)
        if not (-180.0 <= lon <= 180.0):
            raise self.fault("longitude is not between -180 and 180", pair[1].value)
        return Point(to_e7(lat), to_e7(lon))

    def without(self, *known: str) -> dict[str, Any]:
        """Return the rest of an object besides the known keys."""
        left = self.mapping().keys() - known
        return {key: value for key, value in self.value.items() if key in left} if left else {}
