"""Indexes of GRIB files on servers: the bytes of each field.

NCEP's ``.idx`` has a line for each field, ``number:first byte:d=time:name:level:step:…``; fields of one message share their first byte (ncep.noaa.gov, wgrib2 -s).
ECMWF's ``.index`` has a JSON object a line, with ``_offset`` and ``_length`` (ECMWF open data, "Index files").
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import msgspec

from skyway.models.base.errors import LinkError

if TYPE_CHECKING:
    import re
    from collections.abc import Collection, Sequence


class Span(NamedTuple):
    """Bytes of a file, the last one included; None: to its end."""

    begin: int
    end: int | None


class _Field(msgspec.Struct, rename={"offset": "_offset", "length": "_length"}):
    offset: int
    length: int
    param: str = ""
    levtype: str = ""


def ncep_spans(text: str, wanted: re.Pattern[str], url: str) -> list[Span]:
    """Spans of the fields whose ``name:level`` matches, adjacent ones joined. Raises a `LinkError` without an index, or a match."""
    rows: list[tuple[int, bool]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        parts = line.split(":")
        if not line.strip():
            continue
        if len(parts) < 5 or not parts[1].isdigit():
            raise LinkError(f"{url}: line {number} is not of an index: {line[:60]}")
        rows.append((int(parts[1]), wanted.fullmatch(f"{parts[3]}:{parts[4]}") is not None))
    begins = sorted({begin for begin, _ in rows})
    after = dict(zip(begins, [*begins[1:], None], strict=True))
    chosen = sorted({begin for begin, fits in rows if fits})
    spans = [Span(begin, None if (end := after[begin]) is None else end - 1) for begin in chosen]
    return _joined(spans, url)


def ecmwf_spans(text: str, names: Collection[str], url: str) -> list[Span]:
    """The same of an index of ECMWF, for fields of such names."""
    spans = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            one = msgspec.json.decode(line, type=_Field)
        except (msgspec.ValidationError, msgspec.DecodeError) as error:
            raise LinkError(f"{url}: line {number} is not of an index: {error}") from error
        if one.param in names and one.levtype == "sfc" and one.offset >= 0 and one.length > 0:
            spans.append(Span(one.offset, one.offset + one.length - 1))
    return _joined(sorted(spans), url)


def _joined(spans: Sequence[Span], url: str) -> list[Span]:
    if not spans:
        raise LinkError(f"{url}: has none of the fields that are wanted")
    found = [spans[0]]
    for one in spans[1:]:
        last = found[-1]
        if last.end is not None and one.begin <= last.end + 1:
            found[-1] = Span(last.begin, None if one.end is None else max(one.end, last.end))
        else:
            found.append(one)
    return found
