"""The ledger: itineraries booked completely or not at all, by holders of a lease.

The same statements serve both stores; a store adds a connection, a transaction and a few words of its dialect. Forbidden
states are refused three times: by the rule of `models.ledger.window` under a lock of the pads, by the database's own constraints, and
by the audit of the history.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from skyway.models.base.errors import InputError, one_line
from skyway.models.base.units import iso
from skyway.models.ledger.records import (
    Event,
    FencedError,
    Hold,
    Lease,
    LedgerError,
    TakenError,
    VersionError,
    itinerary_of,
)
from skyway.models.ledger.window import (
    FOLLOWING,
    MAX_TEXT,
    State,
    Window,
    check_windows,
    in_the_way,
    p_both,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager
    from datetime import datetime
    from types import TracebackType

__all__ = [
    "Event",
    "FencedError",
    "Hold",
    "Lease",
    "Ledger",
    "LedgerError",
    "TakenError",
    "VersionError",
    "itinerary_of",
]

WINDOW = "station, pad, starts, ends, start_sd_s, end_sd_s, epsilon"
HELD = f"itinerary, version, number, {WINDOW}, state, holder, token"
MAX_LEASE_S = 86_400.0
WAIT_S = 60.0
"""How long a transaction waits for those of others, in a file."""


class Ledger(ABC):
    """A ledger; for one thread at a time. It is a context manager that closes its connection."""

    NOW: str
    """Time of the database, in its SQL."""
    LOCK: str
    SHARE: str
    """Words that lock the rows of a query until the transaction ends, exclusively or against changes by others."""

    def __init__(self) -> None:
        self._pads: dict[tuple[str, int], int] = {}

    @abstractmethod
    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Run one statement, with ``?`` for each value, and return its rows."""

    @abstractmethod
    def transaction(self) -> AbstractContextManager[None]:
        """Run a block as one transaction; a conflict found by the database becomes a `TakenError`."""

    @abstractmethod
    def reading(self) -> AbstractContextManager[None]:
        """Run a block of reads as one transaction."""

    @abstractmethod
    def _to_db(self, instant: datetime) -> Any:
        """Instant in the form of the database."""

    @abstractmethod
    def from_db(self, value: Any) -> datetime:
        """Instant from the form of the database."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def now(self) -> datetime:
        """Time by the clock of the database."""
        with self.reading():
            return self.from_db(self.rows(f"SELECT {self.NOW}")[0][0])

    def acquire(self, holder: str, owner: str, ttl_s: float = 60.0) -> Lease:
        """Take the lease of a holder for a time. Raises a `FencedError` if another process has it.

        An expired lease is taken over with all its bookings: further attempts of its former owner are refused.
        """
        _check_text("holder", holder)
        _check_text("owner", owner)
        _check_ttl(ttl_s)
        sql = (
            f"INSERT INTO lease (holder, token, owner, expires) VALUES (?, 1, ?, {self._later()}) ON CONFLICT (holder) "
            "DO UPDATE SET token = lease.token + 1, owner = excluded.owner, expires = excluded.expires "
            f"WHERE lease.owner = excluded.owner OR lease.expires <= {self.NOW} RETURNING token, expires"
        )
        with self.transaction():
            taken = self.rows(sql, (holder, owner, ttl_s))
            if not taken:
                _, other, expires, _ = self._lease(holder)
                when = iso(self.from_db(expires))
                raise FencedError(one_line(f"the lease of {holder} is with {other} until {when}"))
        return Lease(holder, owner, int(taken[0][0]), self.from_db(taken[0][1]))

    def renew(self, lease: Lease, ttl_s: float = 60.0) -> Lease:
        """Extend a lease from now. Raises a `FencedError` if it is lost."""
        _check_ttl(ttl_s)
        sql = (
            f"UPDATE lease SET expires = {self._later()} WHERE holder = ? AND token = ? AND expires > {self.NOW} "
            "RETURNING expires"
        )
        with self.transaction():
            kept = self.rows(sql, (ttl_s, lease.holder, lease.token))
            if not kept:
                self.check(lease)
        return replace(lease, expires=self.from_db(kept[0][0]))

    def led(self, holder: str) -> bool:
        """Whether a process has the lease of a holder now."""
        with self.reading():
            found = self.rows(f"SELECT expires > {self.NOW} FROM lease WHERE holder = ?", (holder,))
        return bool(found and found[0][0])

    def confirm(self, lease: Lease) -> None:
        """Refuse, with a `FencedError`, actions under a lost lease: called before each command to a vehicle."""
        with self.reading():
            self.check(lease)

    def give_back(self, lease: Lease) -> None:
        """End a lease at once, so that another process need not wait for its expiry; firm bookings stay."""
        with self.transaction():
            self.rows(
                f"UPDATE lease SET expires = {self.NOW} WHERE holder = ? AND token = ?", (lease.holder, lease.token)
            )

    @abstractmethod
    def _later(self) -> str:
        """Time of the database after ``?`` seconds, in its SQL."""

    def _lease(self, holder: str) -> tuple[Any, ...]:
        """Token, owner and expiry of a lease, and whether it is still valid."""
        sql = f"SELECT token, owner, expires, expires > {self.NOW} FROM lease WHERE holder = ? {self.SHARE}"
        found = self.rows(sql, (holder,))
        if not found:
            raise FencedError(one_line(f"nobody holds the lease of {holder}"))
        return found[0]

    def check(self, lease: Lease) -> None:
        """Refuse actions under a lease that is no longer the newest, or has expired."""
        token, owner, expires, alive = self._lease(lease.holder)
        if token != lease.token:
            raise FencedError(one_line(f"the lease of {lease.holder} (token {lease.token}) went to {owner}"))
        if not alive:
            when = iso(self.from_db(expires))
            raise FencedError(one_line(f"the lease of {lease.holder} ran out at {when}; take it again"))

    def book(
        self,
        lease: Lease,
        itinerary: str,
        windows: Sequence[Window],
        *,
        state: State = "firm",
        version: int | None = None,
    ) -> int:
        """Book the windows of an itinerary, all or none, replacing its existing ones; returns its new version.

        Parameters
        ----------
        lease : Lease
            Of the holder.
        itinerary : str
            Id; no other holder may have booked it.
        windows : sequence of Window
            In their order.
        state : State
            ``tentative`` (released when the lease expires) or ``firm``.
        version : int, optional
            The version that it replaces, 0 for none; a `VersionError` if the current version differs.

        Raises
        ------
        TakenError
            A pad is taken; existing bookings are unchanged.
        FencedError
            The lease is lost.
        """
        _check_text("itinerary", itinerary, 2 * MAX_TEXT + 2)
        check_windows(windows)
        if state not in ("tentative", "firm"):
            raise InputError("out of range", field="state", value=state, remedy="tentative or firm")
        with self.transaction():
            self.check(lease)
            current = self._own_version(lease, itinerary)
            if version is not None and version != current:
                raise VersionError(one_line(f"{itinerary} has version {current}, not {version}"))
            keys = self._locked(windows)
            if current:
                self._set_state("released", lease, "itinerary = ? AND state <> 'released'", (itinerary,))
            self._refuse_taken(windows, keys, lease)
            rows = []
            for number, one in enumerate(windows, 1):
                begin, end = one.core
                times = (self._to_db(time) for time in (one.start, one.end, one.opens, one.closes, begin, end))
                key = keys[one.station, one.pad]
                how = (one.start_sd_s, one.end_sd_s, one.epsilon)
                rows.append(
                    (itinerary, current + 1, number, one.station, one.pad, key, *times, *how, state, lease.holder, lease.token)
                )  # fmt: skip
            self._insert(rows)
            sql = (
                "INSERT INTO itinerary (id, version, holder) VALUES (?, ?, ?) "
                "ON CONFLICT (id) DO UPDATE SET version = excluded.version"
            )
            self.rows(sql, (itinerary, current + 1, lease.holder))
        return current + 1

    def _insert(self, rows: Sequence[tuple[Any, ...]]) -> None:
        marks = "(" + ", ".join("?" * len(rows[0])) + ")"
        columns = (
            "itinerary, version, number, station, pad, pad_key, starts, ends, opens, closes, core_from, core_until, "
            "start_sd_s, end_sd_s, epsilon, state, holder, token"
        )
        values = [value for row in rows for value in row]
        self.rows(f"INSERT INTO booking ({columns}) VALUES {', '.join([marks] * len(rows))}", values)

    def _own_version(self, lease: Lease, itinerary: str) -> int:
        """Version of an itinerary, 0 if it is new; refuse that of another holder."""
        found = self.rows(f"SELECT version, holder FROM itinerary WHERE id = ? {self.LOCK}", (itinerary,))
        if found and found[0][1] != lease.holder:
            raise FencedError(one_line(f"{itinerary} is booked by {found[0][1]}, not by {lease.holder}"))
        return int(found[0][0]) if found else 0

    def _locked(self, windows: Sequence[Window]) -> dict[tuple[str, int], int]:
        """Lock the pads of some windows, in one order for all, and return their keys."""
        pads = sorted({(one.station, one.pad) for one in windows})
        for pad in pads:
            if pad not in self._pads:
                self.rows("INSERT INTO pad (station, number) VALUES (?, ?) ON CONFLICT DO NOTHING", pad)
                self._pads[pad] = self.rows("SELECT key FROM pad WHERE station = ? AND number = ?", pad)[0][0]
        keys = {pad: self._pads[pad] for pad in pads}
        if self.LOCK:
            marks = ", ".join("?" * len(keys))
            self.rows(f"SELECT key FROM pad WHERE key IN ({marks}) ORDER BY key {self.LOCK}", list(keys.values()))
        return keys

    def _refuse_taken(self, windows: Sequence[Window], keys: dict[tuple[str, int], int], lease: Lease) -> None:
        """Raise conflicting bookings; tentative bookings whose lease has expired are released instead."""
        held, left = self._near(windows, keys)
        if left:
            marks = ", ".join("?" * len(left))
            self._set_state("released", lease, f"id IN ({marks})", left)
        others = [one.window for one in held]
        met = [0.0] * len(others)
        if any(one.epsilon for one in windows):
            met = [sum(p_both(one, other) for other in others if other is not one) for one in others]
        hits: set[int] = set()
        for one in windows:
            hits.update(in_the_way(one, others, met))
            met = [spent + p_both(one, other) for spent, other in zip(met, others, strict=True)]
        if hits:
            raise TakenError([held[number] for number in sorted(hits)])

    def _near(self, windows: Sequence[Window], keys: dict[tuple[str, int], int]) -> tuple[list[Hold], list[int]]:
        """Bookings of the pads of some windows about their time, and the ids of those whose lease has expired."""
        times = [(keys[one.station, one.pad], self._to_db(one.opens), self._to_db(one.closes)) for one in windows]
        if any(one.epsilon for one in windows):  # epsilon already spent on other bookings counts, too
            begin, end = min(opens for _, opens, _ in times), max(closes for _, _, closes in times)
            where, values = self._touching([(key, begin, end) for key in keys.values()])
            sql = f"SELECT MIN(opens), MAX(closes) FROM booking WHERE {where}"
            (first, last), = self.rows(sql, values)  # fmt: skip
            if first is not None:
                begin, end = min(begin, first), max(end, last)
            times = [(key, begin, end) for key in keys.values()]
        where, values = self._touching(times)
        sql = (
            f"SELECT {HELD}, id, state = 'tentative' AND NOT EXISTS (SELECT 1 FROM lease WHERE lease.holder = booking.holder "
            f"AND lease.expires > {self.NOW}) FROM booking WHERE {where}"
        )
        rows = self.rows(sql, values)
        return [self._hold(row) for row in rows if not row[-1]], [int(row[-2]) for row in rows if row[-1]]

    @staticmethod
    def _touching(times: Sequence[tuple[int, Any, Any]]) -> tuple[str, list[Any]]:
        """Condition, and its values, of bookings of pads (by key) that are active at any time between two.

        They are found by their closing time: after the first, and within the longest window of the pad from the second.
        """
        one = "(pad_key = ? AND state <> 'released' AND closes > ? AND closes < ? + (SELECT longest FROM pad WHERE key = ?) AND opens < ?)"
        values = [value for key, begin, end in times for value in (key, begin, end, key, end)]
        return " OR ".join([one] * len(times)), values

    def mark(self, lease: Lease, itinerary: str, state: State, *, number: int | None = None) -> int:
        """Move the windows of an itinerary that are not released, or one of them, to another state; returns how many.

        ``in use`` settles chance windows: the first drone to arrive has the pad, and the other one gets a `TakenError`. A
        `VersionError` refuses an impossible step, such as back from ``in use`` to ``firm``.
        """
        if state not in FOLLOWING:
            raise InputError("is not a state", field="state", value=state, remedy="one of " + ", ".join(FOLLOWING))
        with self.transaction():
            self.check(lease)
            version = self._own_version(lease, itinerary)
            condition = "itinerary = ? AND version = ? AND state <> 'released'"
            values: list[Any] = [itinerary, version]
            if number is not None:
                condition, values = f"{condition} AND number = ?", [*values, number]
            before = self.rows(f"SELECT state FROM booking WHERE {condition}", values)
            for (one,) in before:
                if state not in FOLLOWING[one]:
                    raise VersionError(one_line(f"{itinerary} is {one}: it cannot become {state}"))
            if not before:
                raise VersionError(one_line(f"{itinerary} has no such window that is not released"))
            self._set_state(state, lease, condition, values)
        return len(before)

    def _set_state(self, state: State, lease: Lease, condition: str, values: Sequence[Any]) -> None:
        sql = f"UPDATE booking SET state = ?, changed_by = ?, token = ? WHERE {condition}"
        self.rows(sql, (state, lease.holder, lease.token, *values))

    def holds(
        self, *, station: str | None = None, begin: datetime | None = None, end: datetime | None = None
    ) -> list[Hold]:
        """Return the windows that are not released, of a station or all, that touch a time, by their start."""
        condition = "state <> 'released'"
        values: list[Any] = []
        for text, value in (
            ("station = ?", station),
            ("closes > ?", None if begin is None else self._to_db(begin)),
            ("opens < ?", None if end is None else self._to_db(end)),
        ):
            if value is not None:
                condition, values = f"{condition} AND {text}", [*values, value]
        with self.reading():
            rows = self.rows(f"SELECT {HELD} FROM booking WHERE {condition} ORDER BY starts, station, pad", values)
        return [self._hold(row) for row in rows]

    def itinerary(self, itinerary: str) -> list[Hold]:
        """Return the windows of the newest version of an itinerary, released ones as well; empty if there is none."""
        sql = (
            f"SELECT {HELD} FROM booking WHERE itinerary = ? AND version = "
            "(SELECT version FROM itinerary WHERE id = ?) ORDER BY number"
        )
        with self.reading():
            return [self._hold(row) for row in self.rows(sql, (itinerary, itinerary))]

    def history(self, itinerary: str | None = None, *, after: int = 0, limit: int = 100_000) -> list[Event]:
        """Return the events of one itinerary or all, in order, after a number that was seen before."""
        condition = "seq > ?"
        values: list[Any] = [after]
        if itinerary is not None:
            condition, values = f"{condition} AND itinerary = ?", [after, itinerary]
        sql = f"SELECT seq, at, {HELD} FROM history WHERE {condition} ORDER BY seq LIMIT ?"
        with self.reading():
            rows = self.rows(sql, (*values, limit))
        return [Event(int(row[0]), self.from_db(row[1]), self._hold(row[2:])) for row in rows]

    def _hold(self, row: Sequence[Any]) -> Hold:
        itinerary, version, number, station, pad, start, end, start_sd, end_sd, epsilon, state, holder, token = row[:13]
        window = Window(
            station=station,
            pad=int(pad),
            start=self.from_db(start),
            end=self.from_db(end),
            start_sd_s=float(start_sd),
            end_sd_s=float(end_sd),
            epsilon=float(epsilon),
        )
        return Hold(itinerary, int(version), int(number), window, state, holder, int(token))


def _check_ttl(ttl_s: float) -> None:
    if not 0.0 < ttl_s <= MAX_LEASE_S:
        raise InputError("out of range", field="ttl_s", value=ttl_s, remedy=f"up to {MAX_LEASE_S:g} s")


def _check_text(field: str, value: str, longest: int = MAX_TEXT) -> None:
    if not value or one_line(value) != value or len(value) > longest:
        remedy = f"one line of plain text of up to {longest} characters"
        raise InputError("must be a name", field=field, value=value, remedy=remedy)
