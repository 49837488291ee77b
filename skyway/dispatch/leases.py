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
"""A database that is away is tried again so often, of the wall's time."""
SHARE = 3.0
"""A lease is renewed so often within its time."""


class KeptLeases:
    """Leases of one process, renewed until they are lost or given back; for several threads.

    Parameters
    ----------
    ledger : str
        Name of the ledger.
    owner : str
        This process.
    ttl_s : float
        How long a lease holds on without being renewed.
    """

    def __init__(self, ledger: str, owner: str, ttl_s: float) -> None:
        self.owner, self.ttl_s = owner, ttl_s
        self._name = ledger
        self._ledger = open_ledger(ledger)
        self._lock = threading.RLock()
        self._kept: dict[str, Lease] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._renew, daemon=True, name="leases")
        self._thread.start()

    def take(self, holder: str) -> Lease:
        """Take the lease of a holder, and keep it; a `FencedError` says that another process has it, a `LedgerError` that the database is away: try again."""
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
        """Time of the wall after which another process that had a lease knows that it is lost: it has tried to renew it since."""
        return self.ttl_s / SHARE + AGAIN_S

    def kept(self, holder: str) -> Lease | None:
        """Return the lease of a holder; None where it is not, or no longer, ours."""
        with self._lock:
            return self._kept.get(holder)

    @property
    def holders(self) -> tuple[str, ...]:
        """Whose leases are kept."""
        with self._lock:
            return tuple(self._kept)

    def confirm(self, holder: str) -> None:
        """Refuse, with a `FencedError`, what is about to be commanded where the lease is no longer ours, as the ledger has it now."""
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
                except LedgerError as error:  # a database that is back within the time of the lease interrupts nothing
                    if time.monotonic() >= end_s:
                        self._kept.pop(holder, None)
                        raise FencedError(f"the lease of {holder} cannot be confirmed: {error}") from error
                    time.sleep(AGAIN_S)
                    self._reopen()
                else:
                    return

    def give_back(self, holders: Iterable[str]) -> None:
        """Give some leases back, so that others may take them at once."""
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
                    except (
                        SkywayError
                    ):  # the database is away: the lease holds on for its time, and is renewed or lost later
                        self._reopen()

    def _reopen(self) -> None:
        try:
            fresh = open_ledger(self._name)
        except SkywayError:
            return
        self._ledger.close()
        self._ledger = fresh

    def close(self) -> None:
        """Give all leases back, and end."""
        self._end.set()
        self._thread.join()
        with self._lock:
            self.give_back(self.holders)
            self._ledger.close()
