"""Formats of flight logs: recognition by the first bytes, not by the name, and the class that reads each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import AS_UTF8, file_error, is_utf16
from skyway.models.base.lazy import load
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from skyway.link.logs.common.log import Log
    from skyway.link.logs.csv_log import LogColumns

_LOOK = 65_536
LAST_S = 4_102_444_800.0
"""Year 2100: no log was recorded later."""


@dataclass(frozen=True)
class LogFormat:
    """One format of flight logs."""

    title: str
    """For messages, such as ``a PX4 .ulg``."""
    suffix: str
    """Usual suffix of its files, without the dot."""
    reader: str
    """``module:class`` of a `skyway.link.logs.common.log.Log`, made from a path."""
    begins: Callable[[bytes, Path], bool]
    """Whether a file is of this format, from its first bytes and its path."""
    within: Callable[[bytes], bool] | None = None
    """The same for a file with a damaged beginning that no `begins` has recognised."""
    takes_columns: bool = False
    """The reader also takes a mapping of columns."""


def _is_text(head: bytes) -> bool:
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 4:
            return False
    return b"\0" not in head


def _tlog_within(head: bytes) -> bool:
    """Return whether a complete frame follows a time stamp anywhere."""
    from skyway.link.logs.tlog.beginning import frame_within

    return frame_within(head)


FORMATS: Mapping[str, LogFormat] = {
    "tlog": LogFormat(
        "a MAVLink .tlog",
        "tlog",
        "skyway.link.logs.tlog.track:Tlog",
        lambda head, _: len(head) >= 10 and head[8] in (0xFD, 0xFE) and head[0] == 0,
        within=_tlog_within,
    ),
    "dataflash": LogFormat(
        "an ArduPilot .bin",
        "bin",
        "skyway.link.logs.dataflash.dataflash:DataFlash",
        lambda head, _: head.startswith(b"\xa3\x95"),
        within=lambda head: b"\xa3\x95\x80" in head,
    ),
    "ulog": LogFormat(
        "a PX4 .ulg", "ulg", "skyway.link.logs.ulog.ulog:ULogFile", lambda head, _: head.startswith(b"ULog")
    ),
    "csv": LogFormat(
        "a .csv",
        "csv",
        "skyway.link.logs.csv_log:CsvLog",
        lambda head, path: _is_text(head) or (head.startswith(b"\x1f\x8b") and ".csv" in path.suffixes),
        takes_columns=True,
    ),
}
"""Formats by name, in the order in which they are tried; ``csv`` accepts any text, so it is the last."""


def titles() -> str:
    """Return all formats for a message: ``a MAVLink .tlog, an ArduPilot .bin, a PX4 .ulg or a .csv``."""
    *first, last = (one.title for one in FORMATS.values())
    return f"{', '.join(first)} or {last}"


PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"7z\xbc\xaf\x27\x1c", b"\xfd7zXZ\x00")
"""First bytes of gzip, zip, 7z and xz."""


def suffixes() -> str:
    """Return all suffixes for a message: ``.tlog, .bin, .ulg or .csv``."""
    *first, last = (f".{one.suffix}" for one in FORMATS.values())
    return f"{', '.join(first)} or {last}"


def format_of(path: Path) -> str:
    """Return the format of a log, a name in `FORMATS`, from its first bytes.

    Raises an `InputError` if the file cannot be read, is empty, or is none of these.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_LOOK)
    except OSError as error:
        raise file_error("read", path, error) from error
    if not head:
        raise InputError(Fault("is empty", str(path)))
    if is_utf16(head):
        raise InputError(Fault("is UTF-16 text", str(path), remedy=AS_UTF8))
    whole = (name for name, one in FORMATS.items() if one.begins(head, path))
    named = (name for name, one in FORMATS.items() if path.suffix.lower() == f".{one.suffix}" and name != "csv")
    damaged = (name for name, one in FORMATS.items() if one.within is not None and one.within(head))
    found = next((name for names in (whole, named, damaged) for name in names), None)
    if found is None:
        remedy = "decompress it first" if head.startswith(PACKED) else titles()
        raise InputError(Fault("is not a known flight log format", str(path), remedy=remedy))
    if FORMATS[found].takes_columns and head.lstrip()[:1] in (b"{", b"["):
        problem = "is JSON (a plan, mission or journal), not a flight log"
        raise InputError(Fault(problem, str(path), remedy=f"name {titles()}; skyway report reads journals"))
    return found


def open_log(path: Path, columns: LogColumns | None = None) -> Log:
    """Open and index a log of any format. Raises an `InputError` if the file cannot be read, or is not a log."""
    found = FORMATS[format_of(path)]
    reader: Callable[..., Log] = load(found.reader)
    log = reader(path, columns) if found.takes_columns else reader(path)
    summary = log.summary
    noise = summary.skipped_bytes > 0.5 * path.stat().st_size and not found.takes_columns
    if noise and summary.time_base.absolute and not summary.start_s < LAST_S:
        valid = counted(summary.messages, "valid message")
        problem = (
            f"is not a flight log: {valid}, at an implausible time, and {summary.skipped_bytes} bytes that are none"
        )
        raise InputError(Fault(problem, str(path), remedy=titles()))
    return log
