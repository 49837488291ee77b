"""The record of downloaded logs: a list beside them that links a recording or a journal to the full log of its flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.files.fetching import Fetched

NAME = "logs-fetched.jsonl"
"""The list in a folder of logs."""
_MAX_BYTES = 20_000_000


class FetchedLog(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the list."""

    schema: str = "skyway.fetched-log/1"
    log: str
    """Name of its file, beside the list."""
    system: int
    size_bytes: int
    crc32: str
    recordings: tuple[str, ...] = ()
    """Names of the recordings (.tlog) and the journal of its flight, as far as known."""


def remember(found: Fetched, system: int, flight: Sequence[Path] = ()) -> None:
    """Add a log to the list beside it, with the recordings and the journal of its flight."""
    entry = FetchedLog(
        log=found.path.name,
        system=system,
        size_bytes=found.size_bytes,
        crc32=f"{found.crc32:08x}",
        recordings=tuple(path.name for path in flight),
    )
    path = found.path.with_name(NAME)
    if any(known == entry for known in known_logs(found.path.parent)):
        return
    try:
        with path.open("ab") as stream:
            stream.write(msgspec.json.encode(entry) + b"\n")
    except OSError as error:
        raise file_error("written", path, error) from error


def known_logs(folder: Path) -> list[FetchedLog]:
    """Entries of the list in a folder; invalid lines are omitted."""
    path = folder / NAME
    try:
        with path.open("rb") as stream:
            lines = stream.read(_MAX_BYTES).splitlines()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise file_error("read", path, error) from error
    found = []
    for line in lines:
        try:
            found.append(msgspec.json.decode(line, type=FetchedLog))
        except msgspec.DecodeError:
            continue
    return found


def logs_of(flight: Path, system: int | None = None) -> list[Path]:
    """Return the full logs of the flight of a recording or a journal, the earliest first, as far as they are in the folder: of one vehicle, or of all."""
    return [
        path
        for known in known_logs(flight.parent)
        if flight.name in known.recordings and system in (None, known.system) and Path(known.log).name == known.log
        if (path := flight.with_name(known.log)).is_file()
    ]
