"""Opening a ledger by its name: a file, or ``postgresql://…``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from skyway.models.ledger.ledger import Ledger

SCHEMES = ("postgresql://", "postgres://")


def open_ledger(name: str, *, create: bool = True) -> Ledger:
    """Open a ledger, created if there is none; an older one is migrated.

    An `InputError` refuses a file that is not a ledger, one from a newer skyway, a database whose clock is off and, without `create`,
    a file that does not exist; a `LedgerError` means that the database cannot be reached.
    """
    if name.startswith(SCHEMES):
        from skyway.models.ledger.postgresql import PostgresqlLedger

        return PostgresqlLedger(name)
    if "://" in name:
        remedy = "a file, or postgresql://USER@HOST/DATABASE"
        raise InputError("is not a ledger", field="--ledger", value=name, remedy=remedy)
    from skyway.models.ledger.sqlite import SqliteLedger

    if not create and not Path(name).exists():
        raise InputError("no such file", name, remedy="name the ledger of a running dispatcher")
    return SqliteLedger(Path(name))
