"""Pads divided among drones in advance: time windows on each numbered pad, so that two drones never meet on one, regardless of delays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.planner.fixed_route.pad_windows import ALWAYS
from skyway.planner.fixed_route.sharing import APART_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.planner.fixed_route.pad_windows import Window
    from skyway.planner.fixed_route.sharing import Stay


def shares_of(
    counts: Sequence[int], stays: Sequence[Sequence[Stay]], within: Sequence[Sequence[Window]] = ()
) -> list[list[list[tuple[Window, int]]]]:
    """Return for each drone its own windows of each pad, with the number of the pad.

    `stays` are those of each drone. Between the stays of two drones the time is cut in the middle, `APART_S` apart; an unused
    pad is assigned to one drone, in turn.
    """
    found: list[list[list[tuple[Window, int]]]] = [[[] for _ in counts] for _ in stays]
    unused = 0
    for pad, count in enumerate(counts):
        open_when = within[pad] if within else (ALWAYS,)
        for number in range(count):
            here = sorted(
                (stay.from_s, stay.until_s, drone)
                for drone, own in enumerate(stays)
                for stay in own
                if (stay.pad, stay.number) == (pad, number)
            )
            if not here:
                found[unused % len(stays)][pad] += [(window, number) for window in open_when]
                unused += 1
            for (first, last), drone in _divided(here):
                for begin, end in open_when:
                    window = max(first, begin), min(last, end)
                    if window[1] > window[0]:
                        found[drone][pad].append((window, number))
    return [[sorted(windows) for windows in own] for own in found]


def _divided(here: Sequence[tuple[float, float, int]]) -> list[tuple[Window, int]]:
    """Divide all time among the drones of some stays on one pad, in order of time."""
    found: list[tuple[Window, int]] = []
    begin, until, whose = ALWAYS[0], here[0][1] if here else 0.0, here[0][2] if here else 0
    for first, last, drone in here:
        if drone != whose:
            middle = (until + first) / 2.0
            found.append(((begin, middle - APART_S / 2.0), whose))
            begin, whose = middle + APART_S / 2.0, drone
        until = last
    return [*found, ((begin, ALWAYS[1]), whose)] if here else []
