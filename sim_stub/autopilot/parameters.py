"""Parameters of a simulated autopilot, under their real names."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
"""MAV_PARAM_TYPE of the kinds in use."""
_RANGE = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}


@dataclass(slots=True)
class Parameter:
    """One parameter."""

    name: str
    """At most 16 characters."""
    kind: int
    """MAV_PARAM_TYPE."""
    value: float
    """Integers are kept whole; 32-bit floats as their nearest 32-bit value."""


def as_float32(value: float) -> float:
    """Nearest 32-bit float; what does not fit becomes infinite."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


class ParameterStore:
    """All parameters of one vehicle, in a fixed order.

    `spelled` is what this version of the firmware calls a parameter that the simulator knows by an older name, and how
    many of the old unit are one of the new: the simulator asks for the old one; on the wire there is only the new one.
    """

    def __init__(
        self, table: Iterable[tuple[str, int, float]], spelled: Mapping[str, tuple[str, float]] | None = None
    ) -> None:
        self.changes = 0
        """How often one was set: what is worked out from them holds until it grows."""
        self._by_name: dict[str, Parameter] = {}
        self._spelled = dict(spelled or {})
        for name, kind, value in sorted(table):
            self._by_name[name] = Parameter(name, kind, as_float32(value) if kind == REAL32 else value)
        self._order = list(self._by_name.values())
        self._index = {parameter.name: number for number, parameter in enumerate(self._order)}

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, name: str) -> float:
        new, scale = self._spelled.get(name, (name, 1.0))
        return self._by_name[new].value * scale

    def __contains__(self, name: str) -> bool:
        return name in self._by_name or name in self._spelled

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._order)

    def find(self, name: str) -> Parameter | None:
        """Return the parameter of that name, or None."""
        return self._by_name.get(name)

    def at(self, index: int) -> Parameter | None:
        """Parameter at a place of the list, or None."""
        return self._order[index] if 0 <= index < len(self._order) else None

    def index(self, name: str) -> int:
        """Place of a parameter in the list."""
        return self._index[name]

    def clamped(self, name: str, low: float, high: float) -> float:
        """Value brought into the range the autopilot acts on: an absurd value is kept, but not obeyed."""
        return min(max(self[name], low), high)

    def bit(self, name: str, number: int) -> bool:
        """Whether a bit of a bit mask is set."""
        return bool(int(self[name]) >> number & 1)

    def set(self, name: str, value: float) -> bool:
        """Set a value of its type; False for an unknown name or a value that is not a finite number."""
        parameter = self._by_name.get(name)
        if parameter is None or not math.isfinite(value):
            return False
        self.changes += 1
        if parameter.kind == REAL32:
            parameter.value = as_float32(value)
            return math.isfinite(parameter.value)
        low, high = _RANGE[parameter.kind]
        parameter.value = float(max(low, min(high, math.floor(value + 0.5))))
        return True
