"""Opening a log: the format is recognised by its first bytes, not by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.link.logs.common.log import Log
    from skyway.link.logs.csv_log import LogColumns

SUFFIX = {"tlog": "tlog", "dataflash": "bin", "ulog": "ulg", "csv": "csv"}
"""Usual name ending of each format."""
_LOOK = 65_536


def format_of(path: Path) -> str:
    """Return the format of a log, found from its first bytes.

    Returns
    -------
    str
        ``tlog``, ``dataflash``, ``ulog`` or ``csv``.

    Raises
    ------
    InputError
        The file cannot be read, is empty, or is none of these.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_LOOK)
    except OSError as error:
        raise InputError(Fault(f"cannot be read: {error.strerror or error}", str(path))) from None
    if not head:
        raise InputError(Fault("is empty", str(path)))
    if head.startswith(b"ULog"):
        return "ulog"
    if head.startswith(b"\xa3\x95"):
        return "dataflash"
    if head.startswith(b"\x1f\x8b") and ".csv" in path.suffixes:
        return "csv"
    if len(head) >= 10 and head[8] in (0xFD, 0xFE) and head[0] == 0:
        return "tlog"
    if _is_text(head):
        return "csv"
    ending = path.suffix.lower()
    found = {".tlog": "tlog", ".bin": "dataflash", ".ulg": "ulog"}.get(ending) or _inside(head)
    if found is None:
        remedy = "a MAVLink .tlog, an ArduPilot .bin, a PX4 .ulg or a .csv"
        raise InputError(Fault("is not a known flight log format", str(path), remedy=remedy))
    return found


def open_log(path: Path, columns: LogColumns | None = None) -> Log:
    """Open and index a log of any format.

    Parameters
    ----------
    path : Path
        The log.
    columns : LogColumns, optional
        For a CSV: which column is what.

    Raises
    ------
    InputError
        The file cannot be read, or is no log.
    """
    kind = format_of(path)
    if kind == "tlog":
        from skyway.link.logs.tlog.track import Tlog

        return Tlog(path)
    if kind == "dataflash":
        from skyway.link.logs.dataflash.dataflash import DataFlash

        return DataFlash(path)
    if kind == "ulog":
        from skyway.link.logs.ulog.ulog import ULogFile

        return ULogFile(path)
    from skyway.link.logs.csv_log import CsvLog

    return CsvLog(path, columns)


def _inside(head: bytes) -> str | None:
    """Tell a log whose beginning is cut or damaged by what follows: a whole frame behind a stamp, a message that is a format."""
    from skyway.link.logs.tlog import tlog_kernels as kernels
    from skyway.link.logs.tlog.dialect import crc_extras

    extras, data = crc_extras(), np.frombuffer(head, dtype=np.uint8)
    for at in np.flatnonzero((data == kernels.V1) | (data == kernels.V2)).tolist():
        if at < 8 or at + kernels.LONGEST > len(data):
            continue
        total = kernels.announced(data, at)
        number = data[at + 5] if data[at] == kernels.V1 else data[at + 7] | data[at + 8].astype(int) << 8
        if (
            data[at - 8] == 0
            and extras[number] >= 0
            and kernels.frame_is_good(data, at, total, extras, kernels.CRC_TABLE)
        ):
            return "tlog"
    return "dataflash" if b"\xa3\x95\x80" in head else None


def _is_text(head: bytes) -> bool:
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 4:
            return False
    return b"\0" not in head
