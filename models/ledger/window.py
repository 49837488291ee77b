"""Windows of pads: the time in which a drone holds one, with its uncertainty, and when two of them are compatible.

A hard window (epsilon 0) is held from start to end, and no other one may touch it. A chance window gives the times at which the drone arrives
and leaves as two normal distributions. Two chance windows may overlap if the probability that both drones need the pad at
once is small enough: with starts A1, A2 and ends E1, E2, all independent, that is 1 - P(E1 <= A2) - P(E2 <= A1), since the two
ways of missing each other exclude each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Literal, get_args

from skyway.models.base.errors import Fault, one_line, refuse

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

State = Literal["tentative", "firm", "in use", "late", "released"]
STATES: tuple[State, ...] = get_args(State)
FOLLOWING: dict[State, tuple[State, ...]] = {
    "tentative": ("firm", "released"),
    "firm": ("in use", "late", "released"),
    "in use": ("late", "released"),
    "late": ("in use", "released"),
    "released": (),
}
"""Allowed next states of each state."""
REACH_SD = 4.0
"""A chance window extends this many standard deviations beyond its expected times: 3 in 100,000 arrive earlier, or stay longer."""
CORE_SD = 1.0
"""In its core, whose ends are this many standard deviations inside its start and end, a drone needs its pad with a probability of 0.68 or more:
two that overlap there both need it with 0.47 or more, which no epsilon allows. Databases refuse that by themselves."""
MAX_EPSILON = 0.4
MAX_SD_S = 6 * 3600.0
LONGEST_S = 7 * 86_400.0
MAX_PAD = 10_000
MAX_TEXT = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """One pad, and the time in which it is held.

    Attributes
    ----------
    station : str
        Id.
    pad : int
        Number of the pad at the station, from 1.
    start, end : datetime
        When the drone arrives on it and leaves it; of a chance window, on average.
    start_sd_s, end_sd_s : float
        Standard deviations of both; 0 for a hard window.
    epsilon : float
        Largest probability at which the drone may find its pad taken by another booking; 0 makes the window a hard one.
    """

    station: str
    pad: int
    start: datetime
    end: datetime
    start_sd_s: float = 0.0
    end_sd_s: float = 0.0
    epsilon: float = 0.0

    @property
    def opens(self) -> datetime:
        """Beginning of the time in which it is active."""
        return self.start - timedelta(seconds=REACH_SD * self.start_sd_s)

    @property
    def closes(self) -> datetime:
        """End of the time in which it is active."""
        return self.end + timedelta(seconds=REACH_SD * self.end_sd_s)

    @property
    def core(self) -> tuple[datetime, datetime]:
        """The part that can overlap no other core; empty if its end is its beginning."""
        begin = self.start + timedelta(seconds=CORE_SD * self.start_sd_s)
        return begin, max(begin, self.end - timedelta(seconds=CORE_SD * self.end_sd_s))

    def touches(self, other: Window) -> bool:
        """Whether the two are active at one pad at one time."""
        same = (self.station, self.pad) == (other.station, other.pad)
        return same and self.opens < other.closes and other.opens < self.closes


def p_both(one: Window, other: Window) -> float:
    """Probability that both drones need the pad at once."""
    if not one.touches(other):
        return 0.0
    return max(0.0, 1.0 - _p_before(one, other) - _p_before(other, one))


def _p_before(first: Window, second: Window) -> float:
    """Probability that the first drone has left when the second one comes."""
    gap_s = (second.start - first.end).total_seconds()
    sd_s = math.hypot(first.end_sd_s, second.start_sd_s)
    if sd_s == 0.0:
        return 1.0 if gap_s >= 0.0 else 0.0
    return 0.5 * math.erfc(-gap_s / (sd_s * math.sqrt(2.0)))


def in_the_way(wanted: Window, others: Sequence[Window], met: Sequence[float]) -> list[int]:
    """Return the windows that prevent a booking; `met` has the part of each window's epsilon that is already spent.

    A hard window excludes every window that touches it. The probabilities of finding the pad taken add up (the sum is a bound of the
    probability that any of the others has it); each drone's sum stays within its own epsilon.
    """
    touching = [number for number, other in enumerate(others) if wanted.touches(other)]
    hard = [number for number in touching if wanted.epsilon == 0.0 or others[number].epsilon == 0.0]
    if hard:
        return hard
    chances = {number: p_both(wanted, others[number]) for number in touching}
    spent = [number for number, chance in chances.items() if met[number] + chance > others[number].epsilon]
    if spent:
        return spent
    return touching if sum(chances.values()) > wanted.epsilon else []


def check_windows(windows: Sequence[Window]) -> None:
    """Refuse windows that are invalid, alone or together, with an `InputError`."""
    faults = [] if windows else [Fault("an itinerary without windows", field="windows")]
    for number, one in enumerate(windows):
        faults += [
            Fault(problem, field=f"windows[{number}].{field}", value=value, remedy=remedy)
            for field, problem, value, remedy in _problems(one)
        ]
    refuse(faults)
    refuse(
        [
            Fault("books the same pad twice at one time", field=f"windows[{number}]", value=f"{one.station} {one.pad}")
            for number, one in enumerate(windows)
            if any(one.touches(other) for other in windows[:number])
        ]
    )


def _problems(one: Window) -> list[tuple[str, str, object, str | None]]:
    found: list[tuple[str, str, object, str | None]] = []
    if not one.station or one_line(one.station) != one.station or len(one.station) > MAX_TEXT:
        found.append(("station", "must be the id of a station", one.station, None))
    if not 1 <= one.pad <= MAX_PAD:
        found.append(("pad", "out of range", one.pad, f"from 1 to {MAX_PAD}"))
    if one.start.tzinfo is None or one.end.tzinfo is None:
        return [*found, ("start", "the time has no UTC offset", one.start.isoformat(), "give it a time zone")]
    if not 0.0 < (one.end - one.start).total_seconds() <= LONGEST_S:
        found.append(("end", "is not after start, or more than a week", one.end.isoformat(), None))
    for field, value in {"start_sd_s": one.start_sd_s, "end_sd_s": one.end_sd_s}.items():
        if not 0.0 <= value <= MAX_SD_S:
            found.append((field, "out of range", value, f"from 0 to {MAX_SD_S:g}"))
    if not 0.0 <= one.epsilon <= MAX_EPSILON:
        found.append(("epsilon", "out of range", one.epsilon, f"from 0 to {MAX_EPSILON:g}"))
    if one.epsilon == 0.0 and (one.start_sd_s or one.end_sd_s):
        found.append(("epsilon", "a hard window has no standard deviations", 0, "an epsilon above 0"))
    return found
