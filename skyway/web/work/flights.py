"""Deliveries under way, from their journals."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import SkywayError

LINES = 12
"""Number of entries of a journal that are shown, the newest."""


def standing(root: str, names: list[tuple[str, float, int]]) -> list[dict[str, Any]]:
    """Return the state of each delivery: journals with their time and size."""
    return [row for one in names if (row := _of(root, *one)) is not None]


@lru_cache(maxsize=200)
def _of(root: str, name: str, changed_s: float, size: int) -> dict[str, Any] | None:  # noqa: ARG001  they are the key
    from skyway.flying import line_of
    from skyway.link.supervisor import read_journal
    from skyway.link.supervisor.journal.entries import Tracked

    try:
        records = read_journal(Path(root) / name).records
    except SkywayError:
        return None
    if not records:
        return None
    lines = [line for record in records if (line := line_of(record)) is not None]
    track = [
        [entry.lat, entry.lon]
        for record in records
        if (entry := record.entry(Tracked)) is not None and entry.lat is not None and entry.lon is not None
    ]
    last = records[-1]
    return {
        "file": name,
        "state": last.state,
        "reason": last.reason or "",
        "lines": lines[-LINES:],
        "track": track[-2000:],
    }
