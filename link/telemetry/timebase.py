"""Conversion of a vehicle's time since boot to UTC, at any speed of a simulation.

Three sources, the best first: the vehicle's own clock (SYSTEM_TIME, set by satellites); ours, tied to its boot by
requests and answers (TIMESYNC), whose error is at most half a round trip; ours at the arrival of its messages.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.models.drones.telemetry import TimeBase

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

_PLAUSIBLE_S = (946_684_800.0, 4_102_444_800.0)
"""Years 2000 to 2100: a clock without satellites starts in 1970."""
_REBOOT_S = 1.0
ASK_S, FIRST_ASK_S = 10.0, 1.0
"""Interval of requests for the vehicle's time, and the interval until it has answered."""
_KEPT_ANSWERS = 8
_OTHER_CLOCK_S = 60.0
"""An answer this far from the vehicle's other messages has another zero than they do (as with some bridges)."""
_REAL_TIME = 0.05
"""A clock whose rate is off by less than this share is a real one; others are simulations."""
_MIN_SPAN_S = 2.0
_KEPT_READINGS, _MIN_READINGS, _ONE_STEP = 5, 4, 0.6
"""Number of readings for the detection of a drift; one step of it is at most this share of the total."""
_READ_S = 0.05
"""Greatest difference between two fields of one SYSTEM_TIME message."""
_FAR_S = 2.0
_BEFORE_S = 5.0
"""A clock this far behind an earlier reading of it is another one."""


@dataclass(frozen=True, slots=True)
class _Answer:
    """One answer to TIMESYNC: our time and the vehicle's at one instant, and the uncertainty between them, s."""

    posix_s: float
    boot_s: float
    doubt_s: float

    @property
    def offset_s(self) -> float:
        return self.posix_s - self.boot_s


class _Drift:
    """Whether another clock runs at the rate of the vehicle's time since boot, determined from pairs of readings.

    A real clock does, and may occasionally be set: by satellites, or by a person. In a simulation one of the two may
    be the computer's and the other the simulated one: PX4's takes the time of day from the computer, and its time since
    boot from the simulation.
    """

    def __init__(self) -> None:
        self._readings: deque[_Answer] = deque(maxlen=_KEPT_READINGS)
        self.seen = False
        self.speed = math.nan

    def add(self, reading: _Answer) -> None:
        """Record a reading of both clocks."""
        last = self._readings[-1] if self._readings else None
        if last is not None and reading.boot_s <= last.boot_s:
            return
        self._readings.append(reading)
        first = self._readings[0]
        span_s = min(reading.posix_s - first.posix_s, reading.boot_s - first.boot_s)
        if len(self._readings) < _MIN_READINGS or span_s <= 0.0:
            return
        if reading.posix_s - first.posix_s >= _MIN_SPAN_S:
            self.speed = (reading.boot_s - first.boot_s) / (reading.posix_s - first.posix_s)
        gains = [after.offset_s - before.offset_s for before, after in pairwise(self._readings)]
        gained = abs(sum(gains))
        spread = max(map(abs, gains)) <= _ONE_STEP * gained  # one that is set jumps once; this one always gains
        if spread and gained > reading.doubt_s + first.doubt_s + _REAL_TIME * (reading.boot_s - first.boot_s):
            self.seen = True

    @property
    def steady(self) -> bool:
        """Whether the newest two readings agree."""
        if len(self._readings) < 2:
            return True
        before, after = self._readings[-2], self._readings[-1]
        gained = abs(after.offset_s - before.offset_s)
        return gained <= after.doubt_s + before.doubt_s + _REAL_TIME * (after.boot_s - before.boot_s)


class VehicleClock:
    """The clock of one vehicle."""

    def __init__(self) -> None:
        self.offset_s: float | None = None
        """POSIX seconds at its boot, by SYSTEM_TIME; None while the vehicle does not know the time."""
        self.reboots = 0
        """Number of restarts of its time."""
        self._newest_boot_s = 0.0
        self._continued = False
        self._begin()

    def _begin(self) -> None:
        """Forget the offset to our time, and drifts."""
        self.offset_s = None
        self._continued = False
        self._arrival_s: float | None = None
        self._asked: deque[int] = deque(maxlen=4)
        self._ask_s = -math.inf
        self._kept_s: float | None = None
        self._answers: deque[_Answer] = deque(maxlen=_KEPT_ANSWERS)
        self._ours, self._theirs = _Drift(), _Drift()

    @property
    def boot_s(self) -> float:
        """Newest reported time since boot, s."""
        return self._newest_boot_s

    @property
    def booted_s(self) -> float | None:
        """When its time since boot began, POSIX seconds; None while unknown."""
        return self._offset_s()

    def go_on(self, booted_s: float, last_s: float) -> bool:
        """Continue an earlier connection's clock, by which it was `booted_s`, and `last_s` at the last look; return whether that was necessary.

        It is where the time since boot is of the same boot, and the vehicle's clock of day has gone another way: it is a simulation, or behind.
        """
        own_s, boot_s = self._offset_s(), self._newest_boot_s
        if boot_s + booted_s < last_s - _BEFORE_S:
            return False
        if own_s is not None and not self.simulated and boot_s + own_s >= last_s - _BEFORE_S:
            return False
        self.offset_s, self._continued = booted_s, True
        return True

    @property
    def speed(self) -> float:
        """Seconds of the vehicle in one of ours, by TIMESYNC: 1 for real ones; NaN while unknown."""
        return self._ours.speed

    @property
    def simulated(self) -> bool:
        """Whether its time since boot runs faster or slower than ours, or than its own clock of day."""
        return self._ours.seen or self._theirs.seen

    @property
    def base(self) -> TimeBase:
        """Source of the times."""
        if self._theirs.seen:
            doubt = "its clock and its time since boot differ in speed (a simulation): time since boot is used"
            return TimeBase("the vehicle's time since boot, started at its clock (SYSTEM_TIME)", doubts=(doubt,))
        if self.offset_s is not None:
            return TimeBase("the vehicle's clock (SYSTEM_TIME)", doubts=(*self._fast(), *self._far()))
        if self._answers:
            best = min(answer.doubt_s for answer in self._answers)
            doubt = f"the vehicle has no clock: this computer's is used, to within {1e3 * best:.0f} ms"
            return TimeBase("this computer's clock, tied to the vehicle's (TIMESYNC)", doubts=(doubt, *self._fast()))
        doubt = "the vehicle has no clock: times are those of arrival, late by the delay of the link"
        return TimeBase("this computer's clock", doubts=(doubt,))

    def _fast(self) -> tuple[str, ...]:
        if not self._ours.seen:
            return ()
        return (
            f"its clock runs {self.speed:.1f} times as fast as this computer's (a simulation): its own time is used",
        )

    def _far(self) -> tuple[str, ...]:
        if not self._answers or self.offset_s is None or self._ours.seen:
            return ()
        apart = self.offset_s - self._answers[-1].offset_s
        return (f"the vehicle's clock is {apart:+.0f} s from this computer's",) if abs(apart) > _FAR_S else ()

    def question(self, posix_s: float) -> int | None:
        """Our time for a TIMESYNC request to be sent now, ns; None if it is too early for the next one."""
        if posix_s < self._ask_s:
            return None
        self._ask_s = posix_s + (ASK_S if len(self._answers) == _KEPT_ANSWERS else FIRST_ASK_S)
        asked = int(posix_s * 1e9)
        self._asked.append(asked)
        return asked

    def hear(self, message: Message, posix_s: float) -> float:
        """Learn from a message, and return its instant, POSIX seconds."""
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
                self._told(utc_s, boot_s)
        offset_s = self._offset_s()
        if offset_s is not None:
            return boot_s + offset_s
        late = posix_s - boot_s
        self._arrival_s = late if self._arrival_s is None else min(self._arrival_s, late)
        return boot_s + self._arrival_s

    def _advance(self, boot_s: float) -> None:
        """Process a time since boot; one that goes back means a restart."""
        if boot_s < self._newest_boot_s - _REBOOT_S:
            self._begin()
            self._newest_boot_s = boot_s
            self.reboots += 1
        self._newest_boot_s = max(self._newest_boot_s, boot_s)

    def _told(self, utc_s: float, boot_s: float) -> None:
        """Process the vehicle's clock of day, as long as its rate equals that of its time since boot.

        If it differs, it is the computer's clock under a simulation: its last value while both agreed, or its first, is kept.
        """
        self._theirs.add(_Answer(utc_s, boot_s, _READ_S))
        if self._continued:
            return
        if self.offset_s is None or (self._theirs.steady and not self._theirs.seen):
            self.offset_s = utc_s - boot_s

    def _offset_s(self) -> float | None:
        return self._kept_s if self.offset_s is None else self.offset_s

    def _answered(self, theirs_ns: int, ours_ns: int, posix_s: float) -> None:
        """Process an answer to a request of ours; others' are ignored."""
        if not theirs_ns or ours_ns not in self._asked:
            return
        self._asked.remove(ours_ns)
        boot_s, took_s = theirs_ns * 1e-9, posix_s - ours_ns * 1e-9
        if self._newest_boot_s and abs(boot_s - self._newest_boot_s) > _OTHER_CLOCK_S:
            return
        self._advance(boot_s)
        answer = _Answer(posix_s - took_s / 2.0, boot_s, took_s / 2.0)
        self._answers.append(answer)
        self._ours.add(answer)
        if self._kept_s is None or (self._ours.steady and not self._ours.seen):
            self._kept_s = min(self._answers, key=lambda told: told.doubt_s).offset_s
