"""A tlog as telemetry."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.common.assembly import Assembler, Stretch
from skyway.link.logs.common.log import LogSummary
from skyway.link.logs.common.messages import SPOKEN
from skyway.link.logs.common.pieces import PIECE_BYTES, WARM_UP_S
from skyway.link.logs.tlog.events import TlogEvents
from skyway.link.logs.tlog.stamps import StampCheck
from skyway.link.logs.tlog.tlog import read_frames, scan
from skyway.models.base.formatting import duration
from skyway.models.base.views import counted, how_often
from skyway.models.drones.telemetry import TimeBase

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.link.logs.tlog.tlog import Frames, TlogIndex
    from skyway.models.drones.telemetry import TelemetryTrack

CLOCK_S, CLOCK_SHARE = 5.0, 0.02
"""A vehicle's clock that differs from the recorder's by more than this is reported."""
RETURN_S, RETURNS = 2.0, 20
"""A vehicle's clock that goes back by more than this, more often than it could have restarted, is that of two vehicles."""
LOST_S = 60.0
"""Steps longer than this are pauses of the recording, not of a clock."""


class _Clock:
    """Accumulated times of a vehicle's clock and the recorder's."""

    def __init__(self) -> None:
        self.own_s = self.recorder_s = 0.0
        self.returns = 0
        self._last = (math.nan, math.nan)

    def add(self, boot_s: NDArray[np.float64], time_s: NDArray[np.float64]) -> None:
        own, recorder = (
            np.diff(values, prepend=last) for values, last in zip((boot_s, time_s), self._last, strict=True)
        )
        steady = (own >= 0.0) & (own < LOST_S) & (recorder < LOST_S)  # false for NaN, the first
        self.own_s += float(own[steady].sum())
        self.recorder_s += float(recorder[steady].sum())
        self.returns += int((own < -RETURN_S).sum())
        self._last = float(boot_s[-1]), float(time_s[-1])


class Tlog:
    """A MAVLink telemetry log: read once to index it, and again for each use.

    Raises an `InputError` if the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._told: set[int] = set()
        self._events = TlogEvents()
        self._climbs: dict[int, float] = defaultdict(float)
        self._clocks: dict[int, _Clock] = defaultdict(_Clock)
        self.index = scan(path, chunk_bytes=PIECE_BYTES, watch=self._watch)
        self.summary = self._summary(self.index)

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry of every vehicle piece by piece."""
        begin, shift_s = self.index.offset_at(from_s - WARM_UP_S) if math.isfinite(from_s) else (0, 0.0)
        check = StampCheck(shift_s)
        assemblers: dict[int, Assembler] = {}
        memory = self.index.beginning.copy() if begin == 0 else None
        for frames in read_frames(self.path, begin=begin, chunk_bytes=PIECE_BYTES, memory=memory):
            times = check.clean(self.index.forward.undone(frames))
            for system, stretch in _stretches(frames, times, self._climbs).items():
                if system not in assemblers:
                    assemblers[system] = Assembler(system)
                track = assemblers[system].feed(stretch).between(from_s, to_s)
                if len(track):
                    yield track
            if len(times) and times[-1] >= to_s:
                return

    def _watch(self, frames: Frames, times: NDArray[np.float64]) -> None:
        """Process a chunk while the log is indexed."""
        for name in ("ATTITUDE", "GLOBAL_POSITION_INT"):
            self._told |= {int(system) for system in np.unique(frames.system[frames.rows_of(name)])}
        self._watch_climbs(frames, times)
        self._watch_clocks(frames, times)
        self._events.see(frames, times)

    def _summary(self, index: TlogIndex) -> LogSummary:
        return LogSummary(
            format="tlog",
            messages=index.messages,
            by_type=index.by_type,
            skipped_bytes=index.skipped_bytes,
            systems=tuple(sorted(self._told)),
            others=tuple(sorted(set(index.by_system) - self._told)),
            time_base=TimeBase("clock of the recorder (ground station)", doubts=self._doubts(index.stamps)),
            start_s=index.first_s,
            end_s=index.last_s,
            events=self._events.events(),
            vehicles=self._events.vehicles(),
            doubted=self._events.doubted(),
        )

    def _doubts(self, check: StampCheck) -> tuple[str, ...]:
        found = list(_doubts(check, self.index, self._climbs))
        for system, clock in sorted(self._clocks.items()):
            if clock.returns > RETURNS:
                found.append(
                    f"the clock of vehicle {system} goes back {how_often(clock.returns)}: several vehicles have this system id, and all "
                    "figures mix them; give each its own (SYSID_THISMAV or MAV_SYS_ID) before they are recorded together"
                )
            elif abs(clock.own_s - clock.recorder_s) > max(CLOCK_S, CLOCK_SHARE * clock.recorder_s):
                went = f"went {duration(clock.own_s)} while the recorder's went {duration(clock.recorder_s)}"
                found.append(f"the clock of vehicle {system} {went}: parts were not recorded as they happened")
        return tuple(found)

    def _watch_clocks(self, frames: Frames, times: NDArray[np.float64]) -> None:
        """Add up the time of each vehicle's clock, and the recorder's meanwhile; a restart adds nothing."""
        rows = frames.rows_of("ATTITUDE")
        boot = frames.decoded("ATTITUDE", rows)["time_boot_ms"].astype(np.float64) / 1000.0
        for system in np.unique(frames.system[rows]):
            mine = frames.system[rows] == system
            self._clocks[int(system)].add(boot[mine], times[rows[mine]])

    def _watch_climbs(self, frames: Frames, times: NDArray[np.float64]) -> None:
        """Add up climb times vertical speed of each vehicle: negative if the speed is positive down, as specified."""
        rows = frames.rows_of("GLOBAL_POSITION_INT")
        fields = frames.decoded("GLOBAL_POSITION_INT", rows)
        for system in np.unique(frames.system[rows]):
            chosen = frames.system[rows] == system
            height = fields["relative_alt"][chosen].astype(np.float64) / 1000.0
            speed = fields["vz"][chosen].astype(np.float64) / 100.0
            step = np.diff(times[rows[chosen]])
            steady = (step > 0.0) & (step < 2.0) & (np.abs(speed[1:]) > 0.5)
            self._climbs[int(system)] += float((np.diff(height) * speed[1:])[steady].sum())


def _doubts(check: StampCheck, index: TlogIndex, climbs: Mapping[int, float]) -> tuple[str, ...]:
    doubts = [
        f"vehicle {system} reports its vertical speed upwards, as ArduPilot did until 2018; its sign is changed"
        for system, agreement in sorted(climbs.items())
        if agreement > 0.0
    ]
    if check.held:
        doubts.append(
            f"{counted(check.held, 'time stamp')} up to {check.JITTER_S:g} s too early: the time before is used instead"
        )
    if check.set_back:
        most = max(check.set_back)
        doubts.append(
            f"the clock was set back {how_often(len(check.set_back))}, by {'up to ' * (len(check.set_back) > 1)}{duration(most)}; later times are shifted"
        )
    if index.forward.steps:
        steps_s = [by_s for _, by_s in index.forward.steps]
        often = how_often(len(steps_s))
        doubts.append(
            f"the recorder's clock was set forward {often} while the vehicle's ran on, by {_span(max(steps_s))}"
            f"{' at most' if len(steps_s) > 1 else ''}; later times are shifted back, so the date is that of the clock before"
        )
    if check.disbelieved:
        doubts.append(
            f"{counted(check.disbelieved, 'time stamp')} far from {'its' if check.disbelieved == 1 else 'their'} neighbours; the time before is used instead"
        )
    if index.first_s < 946_684_800.0:
        doubts.append("the clock is before the year 2000, so it was probably never set")
    return tuple(doubts)


def _span(seconds: float) -> str:
    """Return how far a clock was set, in days where it was days."""
    days = seconds / 86_400.0
    return duration(seconds) if days < 2.0 else f"{days:,.0f} days"


def _stretches(frames: Frames, times: NDArray[np.float64], climbs: Mapping[int, float]) -> dict[int, Stretch]:
    """Reports of each system about itself in a chunk; vertical speed is inverted if it has the sign of the climb."""
    stretches: dict[int, Stretch] = defaultdict(Stretch)
    for name, speak in SPOKEN.items():
        rows = frames.rows_of(name)
        if not len(rows):
            continue
        fields = frames.decoded(name, rows)
        senders = frames.system[rows]
        for system in np.unique(senders):
            chosen = senders == system
            if name == "HEARTBEAT":
                chosen &= frames.component[rows] == 1
            columns = speak(fields[chosen]) if chosen.any() else {}
            if "vel_down_mps" in columns and climbs.get(int(system), 0.0) > 0.0:
                columns["vel_down_mps"] = -columns["vel_down_mps"]
            if columns:
                stretches[int(system)].add(times[rows[chosen]], columns)
    return stretches
