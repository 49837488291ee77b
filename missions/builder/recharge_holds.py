"""Recharge holds: stays on a pad as mission items, and as notes for a pilot who flies one mission per leg."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import MissionItem
from skyway.models.base.formatting import duration, percent

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import Stop


def _stop_before(composition: Composition, number: int) -> Stop | None:
    """Return the stop before a leg, or None if the plan has none."""
    service = composition.services[number]
    landed = composition.services[number - 1].arrive if number else None
    for stop in composition.stops:
        in_time = stop.arrive <= service.depart and (landed is None or stop.arrive >= landed)
        if stop.station == service.origin and in_time:
            return stop
    return None


def _hold_s(composition: Composition, number: int) -> float:
    """Seconds on the pad before a leg: wait, recharge and hold."""
    stop = _stop_before(composition, number)
    if stop is not None:
        return stop.wait_s + stop.recharge_s + stop.hold_s
    before = composition.services[number - 1].arrive
    return max(0.0, (composition.services[number].depart - before).total_seconds())


def recharge_hold(composition: Composition, number: int) -> MissionItem:
    """Return the item that stays on the pad before a leg of a whole mission."""
    # never 0: ArduPilot takes that as a time of day and waits until midnight UTC
    seconds = max(1, math.ceil(_hold_s(composition, number)))
    return MissionItem(Command.NAV_DELAY, Frame.MISSION, float(seconds))


def hold_notes(composition: Composition, numbers: Iterable[int]) -> tuple[str, ...]:
    """Return the planned actions on the ground before these legs: a mission that disarms does not contain them."""
    notes = []
    for number in numbers:
        stop = _stop_before(composition, number)
        if stop is None:
            continue
        parts = [f"wait {duration(stop.wait_s)} for a pad"] if stop.wait_s else []
        if stop.recharge_s:
            parts.append(f"charge {duration(stop.recharge_s)} to {percent(stop.soc_to)}")
        if stop.hold_s:
            parts.append(f"stay {duration(stop.hold_s)}")
        parts.append(f"then arm for leg {number + 1} with at least {percent(stop.soc_to)}")
        notes.append(f"at {stop.station}: {', '.join(parts)}")
    return tuple(notes)
