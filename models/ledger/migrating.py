"""Migrations of ledgers: numbered SQL files, applied in order, each once."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from collections.abc import Iterator

FOLDER = Path(__file__).parent / "migrations"
_NAME = re.compile(r"(\w+)-(\d{4})\.sql")


def scripts(dialect: str, folder: Path = FOLDER) -> list[str]:
    """Return the SQL of each version of a dialect, from version 1 on."""
    found = {
        int(match[2]): path
        for path in folder.iterdir()
        if (match := _NAME.fullmatch(path.name)) and match[1] == dialect
    }
    return [read_text(found[number], max_bytes=1_000_000) for number in range(1, len(found) + 1)]


def refuse_none(version: int, name: str) -> None:
    """Refuse a database without tables of a ledger, with an `InputError`: who reads a ledger must not create one where it looked by mistake."""
    if version == 0:
        raise InputError("has no ledger", name, remedy="name the ledger of a running dispatcher")


def missing(version: int, known: list[str], name: str) -> Iterator[tuple[int, str]]:
    """Yield the versions that a ledger lacks with their SQL; an `InputError` refuses a ledger from a newer skyway."""
    if version > len(known):
        problem = f"the ledger has version {version}, this skyway knows {len(known)}"
        raise InputError(problem, name, remedy="update skyway, or name another ledger")
    yield from list(enumerate(known, 1))[version:]
