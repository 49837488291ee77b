"""The desk of a dispatcher, stored with its ledger: orders, drones, flights and pads out of order, each with its state and a document.

It stores everything that a dispatcher or a worker needs after a restart. Entries are changed
only under a lease: by the dispatcher, or by the keeper to which the dispatcher has assigned the entry, and only from the newest version.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from skyway.models.base.errors import InputError, one_line
from skyway.models.ledger.ledger import FencedError, TakenError, VersionError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from skyway.models.ledger.ledger import Lease, Ledger

Kind = Literal["service", "order", "drone", "flight", "pad", "change", "cancel", "reopening"]
FIELDS = "kind, id, version, state, keeper, document"
MAX_DOCUMENT = 4_000_000
"""Characters."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of the desk."""

    kind: Kind
    id: str
    version: int
    state: str
    keeper: str
    """Holder under whose lease it is changed, besides the dispatcher's."""
    document: str
    """JSON."""


class Desk:
    """The desk of one dispatcher."""

    def __init__(self, ledger: Ledger, dispatcher: str) -> None:
        self.ledger, self.dispatcher = ledger, dispatcher

    def get(self, kind: Kind, id: str) -> Entry | None:  # noqa: A002  the field's word
        """Return one entry; None if there is none."""
        found = self._found("kind = ? AND id = ?", (kind, id))
        return found[0] if found else None

    def entries(self, kind: Kind, states: Sequence[str] = (), *, keeper: str | None = None) -> list[Entry]:
        """Return the entries of a kind, those in some states alone where states are named, by their ids."""
        condition = "kind = ?"
        values: list[Any] = [kind]
        if states:
            condition += f" AND state IN ({', '.join('?' * len(states))})"
            values += states
        if keeper is not None:
            condition, values = f"{condition} AND keeper = ?", [*values, keeper]
        return self._found(condition, values)

    def keepers(self, kind: Kind, states: Sequence[str]) -> dict[str, str]:
        """Return the keepers of the entries of a kind in some states, by their ids; without the documents."""
        sql = f"SELECT id, keeper FROM desk WHERE dispatcher = ? AND kind = ? AND state IN ({', '.join('?' * len(states))}) ORDER BY id"
        with self.ledger.reading():
            return {str(id_): str(keeper) for id_, keeper in self.ledger.rows(sql, (self.dispatcher, kind, *states))}

    def count(self, kind: Kind, states: Sequence[str] = ()) -> int:
        """Number of entries of a kind, in some states where they are named."""
        condition = f" AND state IN ({', '.join('?' * len(states))})" if states else ""
        sql = f"SELECT COUNT(*) FROM desk WHERE dispatcher = ? AND kind = ?{condition}"
        with self.ledger.reading():
            return int(self.ledger.rows(sql, (self.dispatcher, kind, *states))[0][0])

    def _found(self, condition: str, values: Sequence[Any]) -> list[Entry]:
        sql = f"SELECT {FIELDS} FROM desk WHERE dispatcher = ? AND {condition} ORDER BY id"
        with self.ledger.reading():
            return [Entry(*row) for row in self.ledger.rows(sql, (self.dispatcher, *values))]

    def put_down(self, kind: Kind, id: str, state: str, document: str) -> Entry:  # noqa: A002
        """Add a new entry to the desk: any process may, under an unused id. Raises an `InputError` otherwise."""
        return self.put_down_all(kind, state, {id: document})[0]

    def put_down_all(self, kind: Kind, state: str, documents: Mapping[str, str]) -> list[Entry]:
        """Add new entries to the desk by their ids, all or none, as `put_down` does."""
        entries = [Entry(kind, id_, 1, state, self.dispatcher, document) for id_, document in documents.items()]
        for one in entries:
            _check(kind, one.id, one.document)
        known = f"SELECT version FROM desk WHERE dispatcher = ? AND kind = ? AND id = ? {self.ledger.LOCK}"
        try:
            with self.ledger.transaction():
                for one in entries:
                    if self.ledger.rows(known, (self.dispatcher, kind, one.id)):
                        raise InputError(
                            f"there is {_article(kind)} of this id already",
                            field="id",
                            value=one.id,
                            remedy="give it another id",
                        )
                    self._insert(one, 0)
        except TakenError:
            taken = ", ".join(list(documents)[:5])
            raise InputError(f"there is {_article(kind)} of this id already", field="id", value=taken) from None
        return entries

    def put(self, lease: Lease, entries: Sequence[Entry]) -> list[Entry]:
        """Write entries, all or none; of version 0 they are new, else their version must be the newest.

        Raises a `FencedError` if the lease is lost, or if another keeps one of them; a `VersionError` if one has changed meanwhile.
        """
        written = []
        with self.ledger.transaction():
            self.ledger.check(lease)
            for one in entries:
                _check(one.kind, one.id, one.document)
                written.append(self._write(lease, one))
        return written

    def _write(self, lease: Lease, one: Entry) -> Entry:
        key = (self.dispatcher, one.kind, one.id)
        sql = f"SELECT version, keeper FROM desk WHERE dispatcher = ? AND kind = ? AND id = ? {self.ledger.LOCK}"
        found = self.ledger.rows(sql, key)
        version, keeper = found[0] if found else (0, self.dispatcher)
        if version != one.version:
            raise VersionError(one_line(f"{one.kind} {one.id} has version {version}, not {one.version}"))
        if lease.holder not in (keeper, self.dispatcher):
            raise FencedError(one_line(f"{one.kind} {one.id} is kept by {keeper}, not by {lease.holder}"))
        after = replace(one, version=one.version + 1)
        if not found:
            self._insert(after, lease.token)
        else:
            values = (after.version, after.state, after.keeper, after.document, lease.token, *key)
            sql = (
                "UPDATE desk SET version = ?, state = ?, keeper = ?, document = ?, token = ? "
                "WHERE dispatcher = ? AND kind = ? AND id = ?"
            )
            self.ledger.rows(sql, values)
        return after

    def _insert(self, one: Entry, token: int) -> None:
        sql = "INSERT INTO desk (dispatcher, kind, id, version, state, keeper, document, token) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        self.ledger.rows(
            sql, (self.dispatcher, one.kind, one.id, one.version, one.state, one.keeper, one.document, token)
        )

    def history(self, kind: Kind, id: str | None = None, *, after: int = 0, limit: int = 100_000) -> list[tuple[int, datetime, Entry]]:  # noqa: A002  # fmt: skip
        """Return the history of one entry or of all of a kind, in order: number, time by the clock of the database, and entry."""
        condition = "kind = ? AND seq > ?"
        values: list[Any] = [kind, after]
        if id is not None:
            condition, values = f"{condition} AND id = ?", [*values, id]
        sql = f"SELECT seq, at, {FIELDS} FROM desk_history WHERE dispatcher = ? AND {condition} ORDER BY seq LIMIT ?"
        with self.ledger.reading():
            rows = self.ledger.rows(sql, (self.dispatcher, *values, limit))
        return [(int(row[0]), self.ledger.from_db(row[1]), Entry(*row[2:])) for row in rows]


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def _check(kind: str, id: str, document: str) -> None:  # noqa: A002
    if not id or one_line(id) != id or len(id) > 200:
        raise InputError(
            "must be a name", field=f"{kind}.id", value=id[:80], remedy="one line of plain text of up to 200 characters"
        )
    if len(document) > MAX_DOCUMENT:
        raise InputError(
            "is too large", field=f"{kind}.{id}", value=len(document), remedy=f"up to {MAX_DOCUMENT} characters"
        )
