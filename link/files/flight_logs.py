"""The logs of one delivery: those on the vehicle before it, and its new ones, downloaded when the vehicle stands disarmed again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.files.aboard import LogStore
from skyway.link.files.catalog import remember
from skyway.link.files.fetching import fetch
from skyway.models.base.errors import CommandRefusedError, InputError, LinkError, one_line
from skyway.models.base.formatting import bytes_text, duration, percent, spent

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from skyway.link.files.aboard import LogAboard, Way
    from skyway.link.files.fetching import Fetched
    from skyway.link.vehicle.vehicle import Vehicle

TOLD_S = 20.0
"""Interval between progress reports of a transfer."""
_QUIET_HZ = 0.5
"""Telemetry rate during transfers of logs."""
_LONG_S = 60.0


@dataclass(frozen=True, slots=True)
class LogsBefore:
    """The logs on the vehicle before a delivery: their sizes by name, and the protocol that listed them."""

    way: Way
    sizes: Mapping[str, int]


def logs_before(vehicle: Vehicle) -> LogsBefore:
    """List the logs of a disarmed vehicle. Raises a `LinkError` if they cannot be listed."""
    if vehicle.armed:
        raise CommandRefusedError("list its logs", "it is armed")
    store = LogStore(vehicle)
    try:
        sizes = {log.name: log.size_bytes for log in store.logs()}
        return LogsBefore(store.way, sizes)
    finally:
        store.end()


def fetch_added(
    vehicle: Vehicle, before: LogsBefore | None, folder: Path, flight: Sequence[Path], tell: Callable[[str], None]
) -> list[Fetched]:
    """Fetch the logs that a delivery has added on the vehicle: new ones, and those that have grown; without `before` the latest.

    Failures are not raised: `tell` is called with a line about each log, and about missing ones. The list beside the logs records
    their recordings and their journal (`flight`).
    """
    if vehicle.armed:
        tell("log not fetched: the vehicle is armed; run skyway logs fetch when it is disarmed")
        return []
    found: list[Fetched] = []
    try:
        vehicle.request_telemetry(dict.fromkeys(vehicle.rates.wanted_hz, _QUIET_HZ))
        store = LogStore(vehicle, "auto" if before is None else before.way)
        added = _added(store.logs(), before)
        store.end()
        if not added:
            tell("log not fetched: the vehicle has no new log since the flight; check whether logging is on")
        for log in added:
            try:
                one = fetch(store, log, folder, progress=_Progress(log, tell, vehicle.connection.clock.now_s))
                remember(one, vehicle.system, flight)
            except InputError as error:  # of this file: the others may succeed
                tell(f"log not fetched: {one_line(str(error))}")
                continue
            found.append(one)
            took = duration(one.took_s) if one.took_s >= _LONG_S else spent(one.took_s)
            tell(f"log fetched: {one.path}, {bytes_text(one.size_bytes)} in {took}; verified by {one.verified_by}")
    except LinkError as error:
        tell(f"log not fetched: {one_line(str(error))}; skyway logs fetch tries again")
    except KeyboardInterrupt:
        tell("log not fetched: interrupted; continue with skyway logs fetch")
    return found


def _added(now: Sequence[LogAboard], before: LogsBefore | None) -> list[LogAboard]:
    if before is None:
        return list(now[-1:])
    return [log for log in now if log.size_bytes > before.sizes.get(log.name, 0)]


class _Progress:
    """Reports the progress of a log at intervals."""

    def __init__(self, log: LogAboard, tell: Callable[[str], None], now_s: Callable[[], float]) -> None:
        self._log, self._tell, self._now_s = log, tell, now_s
        self._begun_s = self._told_s = now_s()
        self._first = -1

    def __call__(self, came_bytes: int, size_bytes: int) -> None:
        now = self._now_s()
        self._first = came_bytes if self._first < 0 else self._first
        if now < self._told_s + TOLD_S:
            return
        self._told_s = now
        rate = max(came_bytes - self._first, 1) / (now - self._begun_s)
        left = duration((size_bytes - came_bytes) / rate)
        self._tell(f"{self._log.name}: {percent(came_bytes / size_bytes)}, {bytes_text(rate)}/s, {left} left")
