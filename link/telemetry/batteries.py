"""The batteries of one vehicle, each by its own reports: the vehicle's state of charge is that of one of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from skyway.link.wire.messages import Message

_OF_OTHERS = frozenset((3, 4))
"""MAV_BATTERY_FUNCTION of batteries that do not turn the propellers: avionics, payload."""
_FRESH_S = 30.0
_APART = 0.1
"""Packs that share a load differ by less."""


class Batteries:
    """Those that a vehicle flies on."""

    def __init__(self) -> None:
        self._told: dict[int, tuple[float, Message]] = {}

    def hear(self, message: Message, now_s: float) -> None:
        """Process a BATTERY_STATUS."""
        if message["battery_function"] not in _OF_OTHERS:
            self._told[message["id"]] = now_s, message

    def reports(self, now_s: float) -> dict[int, Mapping[str, Any]]:
        """Return the newest report of each, by its number; old ones are omitted."""
        return {
            number: message.fields for number, (at_s, message) in sorted(self._told.items()) if now_s <= at_s + _FRESH_S
        }

    def lowest(self, now_s: float) -> tuple[int, float] | None:
        """Return the number and the state of charge of the emptiest one; None where none reports it."""
        known = {
            number: told["battery_remaining"] / 100.0
            for number, told in self.reports(now_s).items()
            if 0 <= told["battery_remaining"] <= 100
        }
        return min(known.items(), key=lambda one: one[1]) if known else None

    def doubt(self, soc: float, now_s: float) -> str:
        """Return in words that one of them is much emptier than the vehicle's state of charge; empty if none is."""
        found = self.lowest(now_s)
        return (
            f"battery {found[0]} reports {percent(found[1])}" if found is not None and found[1] < soc - _APART else ""
        )
