"""Lists stored on a vehicle, read repeatedly if the vehicle does not report changes.

Vehicles that report opaque ids in MISSION_CURRENT need none of this. From the others the number of items is requested every second,
and the items themselves in turn, so that a list of up to 48 is checked within a second and a half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

KINDS = ("mission", "fence", "rally points")
"""By MAV_MISSION_TYPE."""
_COUNTS_S, _LOOK_S, _ROUND_S, _AT_ONCE = 1.0, 0.25, 1.5, 8
_FIELDS = ("command", "frame", "param1", "param2", "param3", "param4", "x", "y", "z")
Asked = tuple[str, dict[str, Any]]
Found = tuple[str, str, str]
"""The list, and its earlier and present state."""


@dataclass(slots=True)
class _List:
    """State of one list."""

    count: int | None = None
    items: dict[int, tuple[Any, ...]] = field(default_factory=dict)


@dataclass(slots=True)
class StoredLists:
    """The lists of one vehicle; later reads are compared with the first."""

    home_items: int = 0
    """Items at the beginning of a mission that are not part of it, and change by themselves."""
    _lists: list[_List] = field(default_factory=lambda: [_List(), _List(), _List()])
    _counted_s: float = -math.inf
    _looked_s: float = -math.inf
    _next: int = 0

    def forget(self, kind: str) -> None:
        """Accept the next ids as the known ones: a command of ours changes the list."""
        if kind in KINDS:
            self._lists[KINDS.index(kind)] = _List()

    def ask(self, now_s: float) -> list[Asked]:
        """Return the messages that are due."""
        found: list[Asked] = []
        if now_s >= self._counted_s + _COUNTS_S:
            self._counted_s = now_s
            found += [("MISSION_REQUEST_LIST", {"mission_type": kind}) for kind in range(len(KINDS))]
        if now_s >= self._looked_s + _LOOK_S:
            self._looked_s = now_s
            places = self._places()
            each = min(math.ceil(len(places) * _LOOK_S / _ROUND_S), _AT_ONCE)
            for number in range(each):
                kind, seq = places[(self._next + number) % len(places)]
                found.append(("MISSION_REQUEST_INT", {"mission_type": kind, "seq": seq}))
            self._next = (self._next + each) % max(len(places), 1)
        return found

    def _places(self) -> list[tuple[int, int]]:
        """Kind and number of every item to be checked."""
        firsts = (self.home_items, 0, 0)
        return [
            (kind, seq)
            for kind, (known, first) in enumerate(zip(self._lists, firsts, strict=True))
            for seq in range(first, known.count or 0)
        ]

    def hear(self, message: Message) -> Found | None:
        """Process an answer; returns the changes since the first read."""
        kind = message.fields.get("mission_type", 0)
        if kind >= len(KINDS):
            return None
        known = self._lists[kind]
        if message.name == "MISSION_COUNT":
            return self._count(kind, known, message["count"])
        seq, item = message["seq"], tuple(_value(message[name]) for name in _FIELDS)
        before = known.items.setdefault(seq, item)
        if before == item or known.count is None:
            return None
        known.items[seq] = item
        number = seq - (self.home_items if kind == 0 else 0)
        changed = [(name, was, now) for name, was, now in zip(_FIELDS, before, item, strict=True) if was != now]
        told = [", ".join(f"{name} {values[which]}" for name, *values in changed) for which in (0, 1)]
        return KINDS[kind], f"item {number}: {told[0]}", f"item {number}: {told[1]}"

    def _count(self, kind: int, known: _List, count: int) -> Found | None:
        before, known.count = known.count, count
        if before is None or before == count:
            return None
        known.items.clear()
        home = self.home_items if kind == 0 else 0
        return KINDS[kind], _items(before - home), _items(count - home)


def _items(count: int) -> str:
    return f"{max(count, 0)} items"


def _value(value: Any) -> Any:
    """Return a value for comparison: NaN is equal to itself."""
    return round(value, 4) if isinstance(value, float) and math.isfinite(value) else str(value)
