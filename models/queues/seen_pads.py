"""Observed pads at an instant: JSON lines, each in the form of the pad service's answer for a station."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import msgspec

from skyway.models.base.errors import InputError
from skyway.models.base.files import read_text
from skyway.models.base.table import FaultCollector

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path

MAX_BYTES = 16 * 1024 * 1024
MAX_BUSY = 1000
_Count = Annotated[int, msgspec.Meta(ge=0, le=MAX_BUSY)]


class SeenPads(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The pads of a station at an instant; fields as in `models.queues.pad_service.StationStatus`, most of them optional.

    What of them tells nothing here is accepted and not read; other fields are refused: a name that is misspelt would be overlooked.
    """

    station: str
    busy: _Count
    """Occupied pads."""
    pads: _Count | None = None
    """Number of pads; None: as in the scenario."""
    waiting: _Count = 0
    """Drones in line."""
    remaining_s: tuple[Annotated[float, msgspec.Meta(ge=0.0, le=7 * 86_400.0)], ...] = ()
    """Seconds until busy pads become free, where that is known."""
    posix_s: float | None = None
    """Time of the observation; None: the departure."""
    holding_spots: object = None
    holding_free: object = None
    drones: object = None
    """`holding_spots`, `holding_free`, `drones`: of the service's answer, not read."""

    @property
    def present(self) -> int:
        """Drones on the pads and in line."""
        return self.busy + self.waiting


class PadsSeen(NamedTuple):
    """The pads of a network at an instant, in the form that planners use."""

    busy: Mapping[str, int]
    """Others on the pads and in line, by station; a station that is not there was not seen."""
    free_s: Mapping[str, tuple[float, ...]]
    """When busy pads become free, by station, POSIX seconds, as far as that is known."""


NOTHING_SEEN = PadsSeen({}, {})


class _Answer(msgspec.Struct):
    """A line that holds the whole answer of a pad service."""

    station: SeenPads


_LINE = msgspec.json.Decoder(SeenPads)
_WHOLE = msgspec.json.Decoder(_Answer)


def read_seen_pads(path: Path, stations: Collection[str]) -> tuple[SeenPads, ...]:
    """Read a file of observed pads, one station a line; the last line of a station counts.

    An `InputError` has all its faults: lines that are not JSON, counts out of range, stations that are not in the network.
    """
    faults = FaultCollector(str(path))
    found: dict[str, SeenPads] = {}
    for number, line in enumerate(read_text(path, max_bytes=MAX_BYTES).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            seen = _decoded(line)
        except (msgspec.ValidationError, msgspec.DecodeError, RecursionError, UnicodeError) as error:
            remedy = 'write a line like {"station": "clinic", "busy": 2}'
            faults.add(f"is not a report of pads: {error}", remedy, line=number)
            continue
        for field, problem, remedy in _problems(seen, stations):
            faults.add(problem, remedy, line=number, field=field, value=getattr(seen, field))
        found[seen.station] = seen
    faults.raise_if_any()
    if not found:
        raise InputError(
            "reports no pads", str(path), remedy='a line for each station: {"station": "clinic", "busy": 2}'
        )
    return tuple(found.values())


def _decoded(line: str) -> SeenPads:
    try:
        return _LINE.decode(line)
    except msgspec.ValidationError:
        try:
            return _WHOLE.decode(line).station
        except msgspec.ValidationError:
            return _LINE.decode(line)


def _problems(seen: SeenPads, stations: Collection[str]) -> Iterator[tuple[str, str, str]]:
    """Yield the field of each problem, the problem, and the correct form."""
    if seen.station not in stations:
        yield "station", "no such station", "name stations by their id"
    if seen.pads is not None and seen.busy > seen.pads:
        yield "busy", f"more than the {seen.pads} pads", "count drones in line under waiting"
    if len(seen.remaining_s) > seen.busy:
        yield "remaining_s", f"{len(seen.remaining_s)} times for {seen.busy} busy pads", "one for each busy pad at most"
    if seen.posix_s is not None and not (math.isfinite(seen.posix_s) and 0.0 <= seen.posix_s < 7.3e9):
        yield "posix_s", "is not a time", "seconds since 1970"
