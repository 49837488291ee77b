"""What is asked, what a drone knows, and what a policy answers: the door between the world and those who are judged."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


@dataclass(frozen=True)
class Order:
    """A delivery asked for: from where to where, when (POSIX seconds), with what."""

    origin: str
    destination: str
    depart_s: float
    payload_kg: float
    seed: int = 0
    any_drone: bool = False
    """The plan chooses who flies, of the region's fleet; else it is the usual drone."""


@dataclass(frozen=True)
class Flown:
    """A flight as the drone that made it knows it.

    Attributes
    ----------
    origin, end : int
        Nodes where it took off and landed.
    segments : tuple of int
        Those of its way that it flew to their end.
    off_s, down_s : float
        Take-off, and landing on the station.
    told_off, told_down : float
        Charge that the gauge told then.
    hovered_s : float
        For a place, within the flight.
    wind : (float, float)
        Mean wind that it measured at flight height, north and east, m/s.
    """

    origin: int
    end: int
    segments: tuple[int, ...]
    off_s: float
    down_s: float
    told_off: float
    told_down: float
    hovered_s: float
    wind: tuple[float, float]


@dataclass(frozen=True)
class Seen:
    """What a drone on the ground, or over a station on its way, knows.

    Attributes
    ----------
    run : int
        Which run of the order: to keep notes, not to know more.
    node, station
        Where.
    landed_s, time_s : float
        When it came, and now, by the calendar of the order.
    told : float
        Charge that the gauge tells.
    reports : mapping of str to (float, float, float)
        Of each told site the latest that is out: time of the observation by the same calendar, north and east, m/s at 10 m.
    line : callable
        Strangers on the pads and in line at a node now, pads out of order included, as its pad service tells; where it stands those
        before it.
    behind : int
        Strangers that came after it to where it stands.
    flights : tuple of Flown
        Its own so far.
    """

    run: int
    node: int
    station: str
    landed_s: float
    time_s: float
    told: float
    reports: Mapping[str, tuple[float, float, float]]
    line: Callable[[int], int]
    behind: int
    flights: tuple[Flown, ...]


@dataclass(frozen=True)
class Leave:
    """How to leave: over which segments, with at least which charge, with what the flight needs at a time, and when to be asked again."""

    segments: tuple[int, ...]
    charge: float = 0.0
    needs: Callable[[float], float] = field(default=lambda _: 0.0)
    look_s: float = math.inf


@dataclass(frozen=True)
class Piece:
    """A piece of a flight, between two looks.

    Attributes
    ----------
    time_s, place : float, (float, float)
        Its middle: when, and where (latitude and longitude, degrees).
    wind : (float, float)
        Mean wind that the drone measured, at flight height, north and east, m/s.
    """

    time_s: float
    place: tuple[float, float]
    wind: tuple[float, float]


@dataclass(frozen=True)
class Aloft:
    """What a drone on its way knows.

    Attributes
    ----------
    run, time_s, told, reports, line, flights
        As of `Seen`.
    origin, off_s, told_off : int, float, float
        Where and when it took off, and the charge that the gauge told then.
    segments : tuple of int
        Its whole way.
    segment, share : int, float
        Which of them it flies on, and which share of that lies behind; or lay when it was turned.
    turned : int or None
        The station that it was turned to, and flies straight to now.
    place : (float, float)
        Where it is (latitude and longitude, degrees).
    pieces : tuple of Piece
        Of this flight so far.
    """

    run: int
    time_s: float
    told: float
    reports: Mapping[str, tuple[float, float, float]]
    line: Callable[[int], int]
    flights: tuple[Flown, ...]
    origin: int
    off_s: float
    told_off: float
    segments: tuple[int, ...]
    segment: int
    share: float
    turned: int | None
    place: tuple[float, float]
    pieces: tuple[Piece, ...]


LEVELS = (0.5, 0.8, 0.95)
"""Of the promised times of arrival that are compared with what happens."""
HERE = -1
"""Instead of a node: to land where it is, outside any station."""


class Policy(Protocol):
    """Decides for the drone; asked at every landing, at each `Leave.look_s`, when a new report is out, and right before a take-off.

    Who derives from it goes on over stations and in the air, and keeps no notes.
    """

    watches: ClassVar[bool] = False
    """Whether it decides in the air; `aloft` is asked of those who do."""

    def leave(self, seen: Seen) -> Leave | None:
        """How to leave, or None to give up."""

    def over(self, seen: Seen, rest: tuple[int, ...]) -> tuple[int, ...]:
        """Segments to go on with over a station with pads; none: land there."""
        del seen
        return rest

    def aloft(self, seen: Aloft) -> int | None:
        """A station to turn to at once, straight, or `HERE`; None to fly on. Asked every `flight.LOOK_M`, on the way out and on the way to where it was turned to."""
        del seen
        return None

    def forget(self) -> None:
        """Drop what was noted of deliveries before."""
        return
