"""Pictures of a mission that no item commands individually: at a distance or time interval.

Both autopilots take the next picture at a distance from the last one, in a straight line on the map
(``AP_Camera_Backend.cpp``, ``CameraTrigger.cpp``); both take the first picture of an interval at once. A vehicle that continues from the place
of the last picture with the same distance takes the next one at the original place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.missions.items.commands import Command
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.missions.items.mission import MissionItem

MS = 1000.0
MAX_PICTURES = 200_000
"""A mission that takes more is refused."""


@dataclass(frozen=True, slots=True)
class Taking:
    """How pictures are being taken: every so many metres, or seconds; 0: not."""

    every_m: float = 0.0
    every_s: float = 0.0
    paused: bool = False
    """DO_TRIGGER_CONTROL stopped it, and may resume it."""

    def __bool__(self) -> bool:
        return not self.paused and (self.every_m > 0.0 or self.every_s > 0.0)


NOT = Taking()


def ordered(item: MissionItem, before: Taking) -> Taking:
    """Return how pictures are taken after an item."""
    if item.command in (Command.DO_SET_CAM_TRIGG_DIST, Command.OBLIQUE_SURVEY):
        return Taking(every_m=item.param1) if item.param1 > 0.0 else NOT
    if item.command == Command.DO_SET_CAM_TRIGG_INTERVAL:
        return Taking(every_s=item.param1 / MS) if item.param1 > 0.0 else NOT
    if item.command == Command.IMAGE_START_CAPTURE and item.param3 == 0 and item.param2 > 0:
        return Taking(every_s=item.param2)
    if item.command == Command.DO_TRIGGER_CONTROL and before != NOT:
        return replace(before, paused=item.param1 == 0.0 or (before.paused and not restarts(item)))
    return NOT if item.command == Command.IMAGE_STOP_CAPTURE else before


def restarts(item: MissionItem) -> bool:
    """Whether an item resumes pictures that another one stopped."""
    return item.command == Command.DO_TRIGGER_CONTROL and item.param1 == 1.0


def takes_one(item: MissionItem) -> bool:
    """Whether an item takes a picture at its place."""
    if item.command == Command.DO_SET_CAM_TRIGG_DIST:
        return item.param1 > 0.0 and item.param3 == 1.0
    if item.command == Command.IMAGE_START_CAPTURE:
        return item.param3 >= 1.0 or ordered(item, NOT).every_s > 0.0
    return item.command == Command.DO_DIGICAM_CONTROL or ordered(item, NOT).every_s > 0.0


def within(since_s: float, every_s: float, duration_s: float) -> list[float]:
    """Return the times of pictures in an interval, given the time since the last one before it."""
    count = math.floor((since_s + duration_s) / every_s + 1e-9)
    if count > MAX_PICTURES:
        raise InputError(f"the mission takes more than {MAX_PICTURES} pictures", field="mission")
    return [number * every_s - since_s for number in range(1, count + 1)]


def along_leg(
    start: tuple[float, float], end: tuple[float, float], last: tuple[float, float], every_m: float
) -> Iterator[float]:
    """Yield the shares of a straight leg at which pictures are taken at a distance interval; places are metres on a plane."""
    (x0, y0), (x1, y1) = start, end
    dx, dy = x1 - x0, y1 - y0
    length_sq = dx * dx + dy * dy
    if length_sq <= 0.0:
        return
    share = 0.0
    for _ in range(MAX_PICTURES):
        # |start + share * d - last| = every_m, the greater root beyond the share before
        fx, fy = x0 - last[0], y0 - last[1]
        b, c = fx * dx + fy * dy, fx * fx + fy * fy - every_m * every_m
        inside = b * b - length_sq * c
        if c > 0.0 and share == 0.0:
            following = 0.0  # it is already farther away than that
        elif inside < 0.0:
            return
        else:
            following = (-b + math.sqrt(inside)) / length_sq
        if following > 1.0 + 1e-12 or following < share:
            return
        share = min(following, 1.0)
        yield share
        last = (x0 + share * dx, y0 + share * dy)
        if share >= 1.0:
            return
