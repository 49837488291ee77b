"""A growing journal, followed: its new records, in the form of the page."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.link.supervisor.journal import fields as of
from skyway.link.supervisor.journal.entries import Decided, Ordered, PlanTaken, TextHeard, Tracked
from skyway.link.supervisor.journal.file import Record

if TYPE_CHECKING:
    from pathlib import Path

PIECE = 4 * 1024 * 1024
"""Bytes that are read at once: the rest is read next time."""
LONGEST = 1024 * 1024
"""Bytes of a line; longer ones are not records."""
MOST_POINTS, MOST_KEPT = 200_000, 50_000
"""Number of points of the track, and of rows, that are kept: two days at one point a second."""
COURSE = 600
"""Points of the track on the map of all flights."""
MOST_ROWS = 4000
SHOWN = frozenset({"state", "decision", "text", "order", "turn", "landed", "link", "reboot", "change", "upload", "gauge", "pad", "traffic", "give-way", "remote-id", "client", "proof", "operator", "limit", "waits", "energy", "parameter", "end"})  # fmt: skip
"""Events shown to a person."""
_DECODER = msgspec.json.Decoder(Record)


class JournalTail:
    """One journal, read from the position of the previous read. Invalid lines are skipped: the supervisor checks journals."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._at = 0
        self._rest = b""
        self.rows: deque[dict[str, Any]] = deque(maxlen=MOST_KEPT)
        self.track: deque[list[float | None]] = deque(maxlen=MOST_POINTS)
        self.plan: dict[str, Any] | None = None
        self.last = 0

    def read(self) -> None:
        """Process the data written since the last call."""
        try:
            if self._path.stat().st_size < self._at:  # another file of the same name
                self.__init__(self._path)  # type: ignore[misc]
            with self._path.open("rb") as file:
                file.seek(self._at)
                found = file.read(PIECE)
        except OSError:
            return
        self._at += len(found)
        *lines, rest = (self._rest + found).split(b"\n")
        self._rest = rest[:LONGEST]  # no more is needed: a longer line is not a record
        for line in lines:
            if len(line) > LONGEST:
                continue
            try:
                self._take(_DECODER.decode(line))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                continue

    def _take(self, record: Record) -> None:
        self.last = max(self.last, record.n)
        at_s = of.instant_s(record.time)
        if (point := record.entry(Tracked)) is not None:
            self.track.append([record.n, at_s, point.lat, point.lon, point.soc, point.height_m, point.ground_speed_mps])
            return
        if (taken := record.entry(PlanTaken)) is not None:
            self.plan = None if taken.plan is None else _steps(taken.plan)
        if record.event in SHOWN:
            self.rows.append(
                {"n": record.n, "t": at_s, "state": record.state, "event": record.event, "text": record.reason or ""}
                | _more(record)
            )

    def course(self) -> list[list[float]]:
        """Return the track as latitude and longitude, thinned."""
        known = [[lat, lon] for _, _, lat, lon, *_ in self.track if lat is not None and lon is not None]
        return known[:: max(1, len(known) // COURSE)] + known[-1:]

    def since(self, seen: int) -> dict[str, Any]:
        """Return the rows and points after a record."""
        rows = [row for row in self.rows if row["n"] > seen][-MOST_ROWS:]
        points = [point for point in self.track if (point[0] or 0) > seen][-MOST_ROWS:]
        return {"last": self.last, "rows": rows, "points": points, "plan": self.plan}


def _more(record: Record) -> dict[str, Any]:
    """Data shown of an event besides its sentence."""
    if (ordered := record.entry(Ordered)) is not None:
        return {"id": ordered.id, "done": ordered.done, "word": ordered.word, "name": ordered.name}
    if (heard := record.entry(TextHeard)) is not None:
        return {"severity": heard.severity, "count": heard.count, "text": heard.text or record.reason or ""}
    if (decided := record.entry(Decided)) is not None:
        return {"action": decided.action}
    return {}


def _steps(plan: dict[str, Any]) -> dict[str, Any]:
    """The rest of the delivery in a plan: flights and stops, each with its time and charge."""
    legs = [
        {
            "from": of.text(one, "from"), "to": of.text(one, "to"), "depart_s": of.instant_s(of.text(one, "depart")),
            "arrive_s": of.instant_s(of.text(one, "arrive")), "soc_depart": of.share(one, "soc_depart"), "soc_arrive": of.share(one, "soc_arrive"),
        }
        for one in of.tables(plan, "legs")
    ]  # fmt: skip
    stops = [{"station": of.text(one, "station"), "arrive_s": of.instant_s(of.text(one, "arrive")), "recharge_s": of.number(one, "recharge_s")} for one in of.tables(plan, "stops")]  # fmt: skip
    arrival = of.table(plan, "arrival")
    times = {name: of.instant_s(of.text(arrival, name)) for name in ("mean", "p50", "p95")}
    return {"legs": legs, "stops": stops, "arrival": times, "reserve": of.share(plan, "reserve_soc")}
