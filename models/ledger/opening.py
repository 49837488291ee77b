"""Opening a ledger by its name: a file, or ``postgresql://…``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.ledger.address import refuse_unescaped, without_password
from skyway.models.ledger.ledger import WAIT_S

if TYPE_CHECKING:
    from skyway.models.ledger.ledger import Ledger

SCHEMES = ("postgresql://", "postgres://")


def open_ledger(name: str, *, create: bool = True, wait_s: float = WAIT_S) -> Ledger:
    """Open a ledger, created if there is none; an older one is migrated.

    An `InputError` refuses a file that is not a ledger, one from a newer skyway, a database whose clock is off and, without `create`,
    a file or database without a ledger; a `LedgerError` means that the database cannot be reached.

    Parameters
    ----------
    name : str
        A file, or ``postgresql://USER@HOST/DATABASE``.
    create : bool
        Create it if there is none.
    wait_s : float
        How long a transaction waits for those of others, s; in a file.
    """
    if name.startswith(SCHEMES):
        from skyway.models.ledger.postgresql import PostgresqlLedger

        refuse_unescaped(name)
        return PostgresqlLedger(name, create=create)
    if "://" in name:
        remedy = "a file, or postgresql://USER@HOST/DATABASE"
        raise InputError("is not a ledger", field="--ledger", value=without_password(name), remedy=remedy)
    from skyway.models.ledger.sqlite import SqliteLedger

    if not create and not Path(name).exists():
        raise InputError("no such file", name, remedy="name the ledger of a running dispatcher")
    return SqliteLedger(Path(name), create=create, wait_s=wait_s)
