"""PX4 logs (``.ulg``) as telemetry."""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.log import LogEvent, LogSummary
from skyway.link.logs.common.pieces import HOLD_S, WARM_UP_S, InOrder, read_pieces
from skyway.link.logs.common.stamps import SteadyTimes
from skyway.link.logs.ulog.events import ULogEvents
from skyway.link.logs.ulog.format import HEADER_BYTES, MAGIC, ULogContents, ULogScan, last_sync
from skyway.link.logs.ulog.messages import REPLACED, SPOKEN
from skyway.link.logs.ulog.px4_events import EventWords
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import file_error
from skyway.models.base.formatting import duration
from skyway.models.base.views import counted, how_often
from skyway.models.drones.telemetry import TimeBase

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.link.logs.common.pieces import Reports
    from skyway.link.logs.ulog.format import Messages
    from skyway.models.drones.telemetry import TelemetryTrack

RECEIVERS = ("vehicle_gps_position", "sensor_gps")
"""Topics with UTC."""
MAX_FIXES = 100_000
"""Number of receiver messages that set the clock."""
LASTING = frozenset(("armed", "mode", "landed", "fixed_wing"))
"""Quantities reported only when they change, and rarely otherwise."""


class ULogFile:
    """A PX4 log: read once piece by piece to index it, and again for each use.

    Raises an `InputError` if the file cannot be read, or has no header.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as stream:
                head = stream.read(HEADER_BYTES)
            self._scan = ULogScan(last_sync(path))
        except OSError as error:
            raise file_error("read", path, error) from error
        if len(head) < HEADER_BYTES or not head.startswith(MAGIC):
            raise InputError(Fault("is not a ULog: its header is damaged or truncated", str(path)))
        self._log = ULogContents()
        self._events = ULogEvents()
        self._id = 1
        self._spoken: set[str] = set()
        self._range_us = (math.inf, -math.inf)
        self._pieces: list[tuple[float, int, ULogScan, dict[str, float]]] = []
        self._zero_s, self._time_base = self._index()
        self.summary = self._summary()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry piece by piece."""
        steady = SteadyTimes()
        latest_us, place, scan, lasting = self._begin(from_s)
        topics = [topic for topic in SPOKEN if topic in self._spoken and REPLACED.get(topic) not in self._spoken]
        pieces = read_pieces(self.path, scan.copy(), begin=place)
        reports = (self._reports(data, found, topics, steady) for _, data, found in pieces)
        return InOrder(self._id, LASTING, latest_us * 1e-6 + self._zero_s, lasting).tracks(reports, from_s, to_s)

    def _reports(self, data: NDArray[np.uint8], found: Messages, topics: Iterable[str], steady: SteadyTimes) -> Reports:
        """Telemetry in the topics of a piece, with times of the log."""
        reports = {}
        for topic, (stamps_us, columns) in self._stamped(data, found, topics, steady).items():
            with contextlib.suppress(KeyError):  # another generation of the topic
                reports[topic] = stamps_us * 1e-6 + self._zero_s, SPOKEN[topic](columns)
        local, estimator = reports.get("vehicle_local_position"), reports.pop("estimator_status", None)
        if local is not None:
            trusted = local[1].pop("position_ok")
            if estimator is not None and len(estimator[0]):
                order = np.argsort(estimator[0], kind="stable")
                before = np.searchsorted(estimator[0][order], local[0], side="right") - 1
                trusted = np.minimum(trusted, estimator[1]["ekf_ok"][order][np.maximum(before, 0)])
            local[1]["ekf_ok"] = trusted
        return reports

    def _stamped(
        self, data: NDArray[np.uint8], found: Messages, topics: Iterable[str], steady: SteadyTimes
    ) -> dict[str, tuple[NDArray[np.float64], dict[str, NDArray[Any]]]]:
        """Times, microseconds since the start (NaN: implausible), and fields of topics in a piece."""
        tables = {topic: self._log.columns(topic, data, found) for topic in topics}
        tables = {topic: (rows, columns) for topic, (rows, columns) in tables.items() if "timestamp" in columns}
        places = [rows for rows, _ in tables.values()]
        stamps = [columns["timestamp"].astype(np.float64) for _, columns in tables.values()]
        good = steady.of_tables(places, [stamps_us * 1e-6 for stamps_us in stamps])
        believed = [np.where(fine, stamps_us, np.nan) for fine, stamps_us in zip(good, stamps, strict=True)]
        return {topic: (part, tables[topic][1]) for topic, part in zip(tables, believed, strict=True)}

    def _begin(self, from_s: float) -> tuple[float, int, ULogScan, dict[str, float]]:
        """Return a position from which everything from a time on can be read, and the values known there."""
        wanted_us = (from_s - WARM_UP_S - HOLD_S - self._zero_s) * 1e6
        before = [piece for piece in self._pieces if piece[0] <= wanted_us]
        return before[-1] if before else (-math.inf, HEADER_BYTES, self._scan, {})

    def _index(self) -> tuple[float, TimeBase]:
        """Read the log once; derive UTC from the receiver, if it ever had a fix."""
        wanted = dict.fromkeys((*SPOKEN, *RECEIVERS))
        zeros: dict[str, NDArray[np.float64]] = {topic: np.empty(0) for topic in RECEIVERS}
        steady = SteadyTimes()
        scan = self._scan.copy()
        begun = self._scan.copy()
        for base, data, found in read_pieces(self.path, scan, begin=HEADER_BYTES):
            self._pieces.append((self._range_us[1], base, begun, self._events.lasting()))
            begun = scan.copy()
            self._log.see(data, found)
            self._log.skipped += found.skipped
            stamped = self._stamped(data, found, wanted, steady)
            self._spoken |= stamped.keys()
            for topic, (stamps, columns) in stamped.items():
                if not np.isfinite(stamps).any():
                    continue
                low, high = self._range_us
                self._range_us = min(low, float(np.nanmin(stamps))), max(high, float(np.nanmax(stamps)))
                if topic in zeros and "time_utc_usec" in columns and len(zeros[topic]) < MAX_FIXES:
                    utc = columns["time_utc_usec"].astype(np.float64)
                    zeros[topic] = np.concatenate([zeros[topic], (utc - stamps)[(utc > 1e15) & np.isfinite(stamps)]])
            if "vehicle_status" in stamped:
                self._events.status(*stamped["vehicle_status"], self._log.evidence)
                number = stamped["vehicle_status"][1].get("system_id", np.zeros(1))[0]
                self._id = int(number) if 0 < number < 256 else self._id
            self._events.happened(self._log.columns("event", data, found)[1], self._range_us[1])
            if "vehicle_local_position" in stamped:
                self._events.resets(*stamped["vehicle_local_position"])
            if "vehicle_land_detected" in stamped:
                self._events.changes("landed", *stamped["vehicle_land_detected"])
        self._odd_stamps = steady.odd
        for topic in RECEIVERS:
            if len(zeros[topic]):
                return float(np.median(zeros[topic])) * 1e-6, TimeBase("the autopilot's clock, set by GPS")
        doubt = "no GPS time was logged: times count from the start of the autopilot"
        return 0.0, TimeBase("the autopilot's clock since its start", absolute=False, doubts=(doubt,))

    def _summary(self) -> LogSummary:
        by_type = self._log.counts()
        known = bool(self._spoken & {"vehicle_attitude", "vehicle_local_position"})
        doubts = self._time_base.doubts
        if self._log.dropouts:
            lost = self._log.dropouts_ms / 1000.0
            doubts += (f"the logger lost data {how_often(self._log.dropouts)}, {duration(lost)} in all",)
        if self._odd_stamps:
            doubts += (f"{counted(self._odd_stamps, 'message')} ignored: the time is far from the neighbours'",)
        first_us, last_us = self._range_us
        told, spans = self._events.texts(self._log.texts, EventWords(self._log.event_metadata))
        return LogSummary(
            format="ulog",
            messages=sum(by_type.values()),
            by_type=by_type,
            skipped_bytes=self._log.skipped,
            systems=(self._id,) if known else (),
            others=(),
            time_base=TimeBase(self._time_base.source, self._time_base.absolute, doubts),
            start_s=first_us * 1e-6 + self._zero_s if math.isfinite(first_us) else math.nan,
            end_s=last_us * 1e-6 + self._zero_s if math.isfinite(last_us) else math.nan,
            events=tuple(LogEvent(time_us * 1e-6 + self._zero_s, self._id, text) for time_us, text in told),
            vehicles={self._id: self._log.evidence.vehicle()},
            doubted={self._id: tuple((begin + self._zero_s, end + self._zero_s) for begin, end in spans)},
        )
