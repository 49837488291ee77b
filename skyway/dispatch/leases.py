"""Leases that a separate thread renews, and that are confirmed before each command."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError
from skyway.models.ledger.ledger import FencedError, LedgerError
from skyway.models.ledger.opening import open_ledger

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.models.ledger.ledger import Lease

AGAIN_S = 0.1
"""Interval of attempts to reach an unavailable database, s of wall time."""
SHARE = 3.0
"""Number of renewals within the lifetime of a lease."""
LEAST_WAIT_S = 1.0
"""Least time that a renewal waits for a locked ledger, s of wall time: longer than a busy one takes for those before it."""


class KeptLeases:
    """Leases of one process, renewed until they are lost or returned; thread-safe.

    Parameters
    ----------
    ledger : str
        Name of the ledger.
    owner : str
        This process.
    ttl_s : float
        Lifetime of a lease without renewal.
    """

    def __init__(self, ledger: str, owner: str, ttl_s: float) -> None:
        self.owner, self.ttl_s = owner, ttl_s
        self._name, self._wait_s = ledger, max(ttl_s / SHARE, LEAST_WAIT_S)
        self._ledger = open_ledger(ledger, wait_s=self._wait_s)
        self._lock = threading.RLock()
        self._kept: dict[str, Lease] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._renew, daemon=True, name="leases")
        self._thread.start()

    def take(self, holder: str) -> Lease:
        """Take the lease of a holder, and keep it; a `FencedError`: another process has it; a `LedgerError`: the database is unavailable, try again."""
        with self._lock:
            try:
                lease = self._ledger.acquire(holder, self.owner, self.ttl_s)
            except LedgerError:
                self._reopen()
                raise
            self._kept[holder] = lease
            return lease

    @property
    def noticed_s(self) -> float:
        """Wall time after which another process that had a lease knows that it is lost: it has tried to renew it since."""
        return self.ttl_s / SHARE + AGAIN_S

    def kept(self, holder: str) -> Lease | None:
        """Return the lease of a holder; None if this process does not have it, or has lost it."""
        with self._lock:
            return self._kept.get(holder)

    @property
    def holders(self) -> tuple[str, ...]:
        """Return the holders whose leases are kept."""
        with self._lock:
            return tuple(self._kept)

    def confirm(self, holder: str) -> None:
        """Refuse a command, with a `FencedError`, if the ledger shows that the lease now belongs to another process."""
        with self._lock:
            lease = self._kept.get(holder)
            if lease is None:
                raise FencedError(f"the lease of {holder} is lost: sending no more commands")
            end_s = time.monotonic() + self.ttl_s
            while True:
                try:
                    self._ledger.confirm(lease)
                except FencedError:
                    self._kept.pop(holder, None)
                    raise
                except LedgerError as error:  # an outage shorter than the lease interrupts nothing
                    if time.monotonic() >= end_s:
                        self._kept.pop(holder, None)
                        raise FencedError(f"the lease of {holder} cannot be confirmed: {error}") from error
                    time.sleep(AGAIN_S)
                    self._reopen()
                else:
                    return

    def give_back(self, holders: Iterable[str]) -> None:
        """Return some leases, so that others can take them at once."""
        with self._lock:
            for holder in holders:
                lease = self._kept.pop(holder, None)
                if lease is not None:
                    with suppress(SkywayError):
                        self._ledger.give_back(lease)

    def _renew(self) -> None:
        while not self._end.wait(self.ttl_s / SHARE):
            with self._lock:
                for holder, lease in list(self._kept.items()):
                    try:
                        self._kept[holder] = self._ledger.renew(lease, self.ttl_s)
                    except FencedError:
                        self._kept.pop(holder, None)
                    except SkywayError:  # database unavailable: the lease is renewed or lost later
                        self._reopen()

    def _reopen(self) -> None:
        try:
            fresh = open_ledger(self._name, create=False, wait_s=self._wait_s)
        except SkywayError:
            return
        self._ledger.close()
        self._ledger = fresh

    def close(self) -> None:
        """Return all leases, and end."""
        self._end.set()
        self._thread.join()
        with self._lock:
            self.give_back(self.holders)
            self._ledger.close()
