"""From the time since a vehicle's boot to UTC, at any speed that a simulation runs at.

Three sources, the best first: the vehicle's own clock (SYSTEM_TIME, set by satellites); ours, tied to its boot by
questions and answers (TIMESYNC), whose error is at most half a round trip; ours when its messages arrive.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from models.telemetry import TimeBase

if TYPE_CHECKING:
    from link.frames import Message

_PLAUSIBLE_S = (946_684_800.0, 4_102_444_800.0)
"""Years 2000 to 2100: a clock without satellites starts in 1970."""
_REBOOT_S = 1.0
ASK_S, FIRST_ASK_S = 10.0, 1.0
"""How often the vehicle is asked for its time, and until it has answered."""
_KEPT_ANSWERS = 8
_OTHER_CLOCK_S = 60.0
"""An answer so far from the vehicle's other messages counts from another zero than they do (some bridges do)."""
_REAL_TIME = 0.05
"""A clock that runs by less than this share too fast or slow is a real one; others are simulations."""
_LEAST_SPAN_S = 2.0
_FAR_S = 2.0


@dataclass(frozen=True, slots=True)
class _Answer:
    """One answer to TIMESYNC: our time and the vehicle's at one instant, and how far they may be apart, s."""

    posix_s: float
    boot_s: float
    doubt_s: float

    @property
    def offset_s(self) -> float:
        return self.posix_s - self.boot_s


class VehicleClock:
    """The clock of one vehicle.

    Attributes
    ----------
    offset_s : float or None
        POSIX seconds at its boot, by SYSTEM_TIME; None while it does not know the time.
    reboots : int
        How often its time has begun anew.
    """

    def __init__(self) -> None:
        self.offset_s: float | None = None
        self.reboots = 0
        self._arrival_s: float | None = None
        self._newest_boot_s = 0.0
        self._asked: deque[int] = deque(maxlen=4)
        self._ask_s = -math.inf
        self._first: _Answer | None = None
        self._answers: deque[_Answer] = deque(maxlen=_KEPT_ANSWERS)

    @property
    def boot_s(self) -> float:
        """Newest time since boot that it has told, s."""
        return self._newest_boot_s

    @property
    def speed(self) -> float:
        """Seconds of the vehicle in one of ours, by TIMESYNC: 1 for real ones; NaN while it is not known."""
        if self._first is None or self._answers[-1].posix_s - self._first.posix_s < _LEAST_SPAN_S:
            return math.nan
        last = self._answers[-1]
        return (last.boot_s - self._first.boot_s) / (last.posix_s - self._first.posix_s)

    @property
    def base(self) -> TimeBase:
        """Where times come from."""
        if self.offset_s is not None:
            return TimeBase("the vehicle's clock (SYSTEM_TIME)", doubts=self._far())
        if self._first is not None:
            best = min(answer.doubt_s for answer in self._answers)
            doubt = f"the vehicle does not know the time: it is ours, to {1e3 * best:.0f} ms"
            return TimeBase("this computer's clock, tied to the vehicle's (TIMESYNC)", doubts=(doubt, *self._fast()))
        doubt = "the vehicle does not know the time: times are those of arrival here, late by the delay of the link"
        return TimeBase("this computer's clock", doubts=(doubt,))

    def _fast(self) -> tuple[str, ...]:
        if self._first is None or math.isnan(self.speed):
            return ()
        last = self._answers[-1]
        gained_s = abs(last.offset_s - self._first.offset_s)
        if gained_s <= last.doubt_s + self._first.doubt_s + _REAL_TIME * (last.posix_s - self._first.posix_s):
            return ()
        return (f"its clock runs {self.speed:.1f} times as fast as ours (a simulation): times are its own",)

    def _far(self) -> tuple[str, ...]:
        if not self._answers or self.offset_s is None or self._fast():
            return ()
        apart = self.offset_s - self._answers[-1].offset_s
        return (f"the vehicle's clock is {apart:+.0f} s from this computer's",) if abs(apart) > _FAR_S else ()

    def question(self, posix_s: float) -> int | None:
        """Our time for a TIMESYNC question to be sent now, ns; None where it is too early for the next one."""
        if posix_s < self._ask_s:
            return None
        self._ask_s = posix_s + (ASK_S if len(self._answers) == _KEPT_ANSWERS else FIRST_ASK_S)
        asked = int(posix_s * 1e9)
        self._asked.append(asked)
        return asked

    def hear(self, message: Message, posix_s: float) -> float:
        """Learn from a message, and return the instant it speaks of, POSIX seconds."""
        fields = message.fields
        if message.name == "TIMESYNC":
            self._answered(fields["tc1"], fields["ts1"], posix_s)
        boot_ms = fields.get("time_boot_ms")
        if boot_ms is None:
            offset_s = self._offset_s()
            return posix_s if offset_s is None else self._newest_boot_s + offset_s
        boot_s = float(boot_ms) * 1e-3
        self._advance(boot_s)
        if message.name == "SYSTEM_TIME":
            utc_s = fields["time_unix_usec"] * 1e-6
            if _PLAUSIBLE_S[0] < utc_s < _PLAUSIBLE_S[1]:
                self.offset_s = utc_s - boot_s
        offset_s = self._offset_s()
        if offset_s is not None:
            return boot_s + offset_s
        late = posix_s - boot_s
        self._arrival_s = late if self._arrival_s is None else min(self._arrival_s, late)
        return boot_s + self._arrival_s

    def _advance(self, boot_s: float) -> None:
        """Take a time since boot; one that goes back is of a new start."""
        if boot_s < self._newest_boot_s - _REBOOT_S:
            self.offset_s = self._arrival_s = self._first = None
            self._answers.clear()
            self._newest_boot_s, self._ask_s = boot_s, -math.inf
            self.reboots += 1
        self._newest_boot_s = max(self._newest_boot_s, boot_s)

    def _offset_s(self) -> float | None:
        if self.offset_s is not None or self._first is None:
            return self.offset_s
        if self._fast():
            return self._first.offset_s
        return min(self._answers, key=lambda answer: answer.doubt_s).offset_s

    def _answered(self, theirs_ns: int, ours_ns: int, posix_s: float) -> None:
        """Take an answer to a question of ours; others' are none of our business."""
        if not theirs_ns or ours_ns not in self._asked:
            return
        self._asked.remove(ours_ns)
        boot_s, took_s = theirs_ns * 1e-9, posix_s - ours_ns * 1e-9
        if self._newest_boot_s and abs(boot_s - self._newest_boot_s) > _OTHER_CLOCK_S:
            return
        self._advance(boot_s)
        answer = _Answer(posix_s - took_s / 2.0, boot_s, took_s / 2.0)
        self._answers.append(answer)
        self._first = self._first or answer
