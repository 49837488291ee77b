"""Audit of a ledger: its whole history is checked by code that is independent of the booking code."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from skyway.models.ledger.window import FOLLOWING, Window, p_both

if TYPE_CHECKING:
    from skyway.models.ledger.ledger import Event, Hold, Ledger

    Key = tuple[str, int, int]

PAGE = 50_000
SLACK = 1e-9
PART_S = 6 * 3600.0
"""Windows of a pad are indexed by the parts of time that they touch."""


class _Pad:
    """Windows of one pad that are held."""

    def __init__(self) -> None:
        self._parts: defaultdict[int, dict[Key, Window]] = defaultdict(dict)

    @staticmethod
    def _of(window: Window) -> range:
        return range(int(window.opens.timestamp() // PART_S), int(window.closes.timestamp() // PART_S) + 1)

    def put(self, key: Key, window: Window) -> None:
        for part in self._of(window):
            self._parts[part][key] = window

    def take(self, key: Key, window: Window) -> None:
        for part in self._of(window):
            self._parts[part].pop(key, None)

    def touching(self, window: Window) -> list[Window]:
        near = {key: other for part in self._of(window) for key, other in self._parts.get(part, {}).items()}
        return [other for other in near.values() if window.touches(other)]


def audit(ledger: Ledger) -> list[str]:
    """Return the violations in the history of a ledger; empty if every promise was kept.

    Violations are windows that were held against the rule, impossible steps between states, versions that were incomplete or
    went back, tokens that came after newer ones, and bookings that differ from the history.
    """
    found: list[str] = []
    state: dict[Key, Hold] = {}
    pads: defaultdict[tuple[str, int], _Pad] = defaultdict(_Pad)
    seen = 0
    while True:
        events = ledger.history(after=seen, limit=PAGE)
        for event in events:
            found += _event(event, state, pads[event.hold.window.station, event.hold.window.pad])
        if len(events) < PAGE:
            break
        seen = events[-1].seq
    now = {_key(hold): hold for hold in ledger.holds()}
    told = {key: hold for key, hold in state.items() if hold.state != "released"}
    for key in sorted(now.keys() ^ told.keys()):
        found.append(f"{key[0]} version {key[1]} window {key[2]}: {'not in the history' if key in now else 'lost'}")
    found += [f"{key[0]}: {told[key].state} in the history, {now[key].state} now" for key in sorted(now.keys() & told.keys()) if now[key].state != told[key].state]  # fmt: skip
    numbers: dict[tuple[str, int], set[int]] = {}
    for itinerary, version, number in state:
        numbers.setdefault((itinerary, version), set()).add(number)
    found += [f"{key[0]} version {key[1]} is not whole" for key, has in numbers.items() if has != set(range(1, len(has) + 1))]  # fmt: skip
    return found


def _key(hold: Hold) -> Key:
    return hold.itinerary, hold.version, hold.number


def _event(event: Event, state: dict[Key, Hold], pad: _Pad) -> list[str]:
    """Process one event of a pad; returns its violations."""
    hold, key = event.hold, _key(event.hold)
    before = state.get(key)
    state[key] = hold
    where = f"event {event.seq}: {hold.itinerary} version {hold.version} window {hold.number}"
    if before is not None:
        found = [] if hold.state in FOLLOWING[before.state] else [f"{where}: from {before.state} to {hold.state}"]
        if before.holder == hold.holder and hold.token < before.token:
            found.append(f"{where}: token {hold.token} after {before.token}")
        if hold.state == "released":
            pad.take(key, before.window)
        return found
    found = _met(where, hold.window, pad)
    pad.put(key, hold.window)
    return found


def _met(where: str, window: Window, pad: _Pad) -> list[str]:
    """Violations of a window with respect to those that were held when it was booked."""
    touching = pad.touching(window)
    if any(window.epsilon == 0.0 or other.epsilon == 0.0 for other in touching):
        return [f"{where}: overlaps another"]
    if sum(p_both(window, other) for other in touching) > window.epsilon + SLACK:
        return [f"{where}: the pad is taken more often than it allows"]
    broken = [
        other
        for other in touching
        if p_both(other, window) + sum(p_both(other, third) for third in pad.touching(other) if third is not other)
        > other.epsilon + SLACK
    ]
    return [f"{where}: takes the pad of another more often than that one allows"] if broken else []
