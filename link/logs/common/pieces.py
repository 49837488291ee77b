"""Reading a log of any size piece by piece, with reports in order of time.

An autopilot writes the reports of its parts as they arrive, so reports of one second are mixed with those of
the next. They are delayed for a while before samples are made of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from skyway.link.logs.common.assembly import Assembler, Stretch
from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.drones.telemetry import TelemetryTrack

    Reports = Mapping[str, tuple[NDArray[np.float64], Mapping[str, NDArray[np.float64]]]]
    """Times and quantities of each kind of message, by its name."""

Found_co = TypeVar("Found_co", covariant=True)
PIECE_BYTES = 1024 * 1024
HOLD_S = 2.0
"""Greatest delay of a report in the log after younger ones."""
WARM_UP_S = 15.0
"""A replay that begins in the middle reads from this much earlier, so that slow quantities are known."""


class Scan(Protocol[Found_co]):
    """Finds messages in a piece of a log."""

    def __call__(self, data: NDArray[np.uint8], *, final: bool) -> tuple[Found_co, int]:
        """Return the findings, and the number of bytes processed; `final` means that the log ends with them."""


def read_pieces(
    path: Path, scan: Scan[Found_co], *, begin: int = 0
) -> Iterator[tuple[int, NDArray[np.uint8], Found_co]]:
    """Read a file piece by piece from a position; the unprocessed rest of a piece begins the next one.

    Yields the position of each piece in the file, its bytes (valid until the next piece), and the findings in it. An
    `InputError` means that the file cannot be read.
    """
    buffer = np.empty(PIECE_BYTES, dtype=np.uint8)
    try:
        with path.open("rb") as stream:
            stream.seek(begin)
            base, held = begin, 0
            while True:
                got = stream.readinto(memoryview(buffer)[held:])  # type: ignore[arg-type]
                data = buffer[: held + got]
                found, used = scan(data, final=got == 0)
                yield base, data, found
                if got == 0:
                    return
                left = data[used:].copy()
                buffer[: len(left)] = left
                held, base = len(left), base + used
    except OSError as error:
        raise file_error("read", path, error) from error


class InOrder:
    """Makes samples of reports that are slightly out of order.

    `lasting` is as in `Assembler`; `known`, by quantity, is valid since `known_s`, before the first reports.
    """

    def __init__(self, system: int, lasting: frozenset[str], known_s: float, known: Mapping[str, float]) -> None:
        self._assembler = Assembler(system, lasting)
        since = np.array([known_s])
        self._known = {"before": (since, {name: np.array([value]) for name, value in known.items()})} if known else {}
        self._held: dict[str, tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]] = {}
        self._latest_s = self._done_s = -math.inf

    def tracks(self, pieces: Iterable[Reports], from_s: float, to_s: float) -> Iterator[TelemetryTrack]:
        """Take the reports of pieces one after the other; yield the samples of a time."""
        for reports in pieces:
            track = self._feed({**reports, **self._known})
            self._known = {}
            if len(track) and track.time_s[0] >= to_s:
                return
            part = track.between(from_s, to_s)
            if len(part):
                yield part
        part = self._until(math.inf).between(from_s, to_s)
        if len(part):
            yield part

    def _feed(self, reports: Reports) -> TelemetryTrack:
        """Take the reports of a piece; return the samples that no older report can change."""
        for name, (times, columns) in reports.items():
            fresh = np.isfinite(times) & (times > self._done_s)
            if not fresh.any():
                continue
            kept = {quantity: np.asarray(values, dtype=np.float64)[fresh] for quantity, values in columns.items()}
            before = self._held.get(name)
            stamps = times[fresh]
            if before is not None and before[1].keys() == kept.keys():
                stamps = np.concatenate([before[0], stamps])
                kept = {quantity: np.concatenate([before[1][quantity], kept[quantity]]) for quantity in kept}
            order = np.argsort(stamps, kind="stable")
            self._held[name] = stamps[order], {quantity: values[order] for quantity, values in kept.items()}
            self._latest_s = max(self._latest_s, float(stamps[order[-1]]))
        return self._until(self._latest_s - HOLD_S)

    def _until(self, time_s: float) -> TelemetryTrack:
        stretch = Stretch()
        for name, (times, columns) in self._held.items():
            count = int(np.searchsorted(times, time_s, side="right"))
            stretch.add(times[:count], {quantity: values[:count] for quantity, values in columns.items()})
            self._held[name] = times[count:], {quantity: values[count:] for quantity, values in columns.items()}
        self._done_s = max(self._done_s, time_s)
        return self._assembler.feed(stretch)
