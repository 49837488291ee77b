"""Opening a log: the format is recognised by its first bytes, not by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.logs.formats import FORMATS, titles
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import file_error
from skyway.models.base.lazy import load

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from skyway.link.logs.common.log import Log
    from skyway.link.logs.csv_log import LogColumns

_LOOK = 65_536


def format_of(path: Path) -> str:
    """Return the format of a log, found from its first bytes.

    Returns
    -------
    str
        A name in `FORMATS`.

    Raises
    ------
    InputError
        The file cannot be read, is empty, or is none of these.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_LOOK)
    except OSError as error:
        raise file_error("read", path, error) from error
    if not head:
        raise InputError(Fault("is empty", str(path)))
    whole = (name for name, one in FORMATS.items() if one.begins(head, path))
    named = (name for name, one in FORMATS.items() if path.suffix.lower() == f".{one.suffix}" and name != "csv")
    damaged = (name for name, one in FORMATS.items() if one.within is not None and one.within(head))
    found = next((name for names in (whole, named, damaged) for name in names), None)
    if found is None:
        raise InputError(Fault("is not a known flight log format", str(path), remedy=titles()))
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
    found = FORMATS[format_of(path)]
    reader: Callable[..., Log] = load(found.reader)
    return reader(path, columns) if found.takes_columns else reader(path)
