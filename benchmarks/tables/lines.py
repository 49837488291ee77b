"""Files of results of long measurements: one delivery of an instance a line, written as it comes, gone on with later."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Row = dict[str, Any]


def read(path: Path) -> list[Row]:
    """Lines of a file of results, each delivery once, in order; none where there is no file."""
    if not path.exists():
        return []
    rows = {row["number"]: row for row in map(json.loads, path.read_text(encoding="utf-8").splitlines())}
    return [rows[number] for number in sorted(rows)]


def missing(path: Path, count: int, part: tuple[int, int]) -> Iterator[int]:
    """Deliveries that a file does not hold yet, of every n-th from the k-th on; `part` is (k, n)."""
    known = {row["number"] for row in read(path)}
    return (number for number in range(count) if number % part[1] == part[0] and number not in known)


def append(path: Path, row: Row) -> None:
    """Write one more line."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
