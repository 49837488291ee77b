"""The bookings of a dispatcher in its ledger, updated to its plan: each itinerary whole or not at all."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.windows import apart
from skyway.models.base.units import from_posix
from skyway.models.ledger.ledger import TakenError, itinerary_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from skyway.models.ledger.ledger import Hold, Lease, Ledger
    from skyway.models.ledger.window import Window

SAME_S = 1.0
"""Windows whose ends differ by no more than this are the same, s."""


class Bookings:
    """Bookings of a dispatcher in a ledger.

    Parameters
    ----------
    ledger : Ledger
        Ledger of the bookings.
    holder : str
        The dispatcher.
    lease : callable
        Returns its valid lease.
    pads : mapping
        Number of pads of each station.
    """

    def __init__(self, ledger: Ledger, holder: str, lease: Callable[[], Lease], pads: Mapping[str, int]) -> None:
        self._ledger, self._holder, self._lease, self._pads = ledger, holder, lease, pads

    def of_others(self, now_s: float) -> list[Hold]:
        """Return the windows held by others from an instant on."""
        return [one for one in self._ledger.holds(begin=from_posix(now_s)) if one.holder != self._holder]

    def bring_up_to_date(self, wanted: Mapping[str, Sequence[Window]], now_s: float) -> None:
        """Book the wanted windows in place of the held ones; past windows are released.

        A `TakenError`: another holder has booked a pad meanwhile, and the itinerary there is not booked.
        """
        lease = self._lease()
        held: dict[str, list[Hold]] = {}
        others: list[Window] = []  # also what is over and not released: a window of ours that has begun may touch it
        for one in self._ledger.holds():
            if one.holder == self._holder:
                held.setdefault(one.itinerary, []).append(one)
            else:
                others.append(one.window)
        wanted = {itinerary_of(self._holder, name): one for name, one in wanted.items()}
        windows = apart(wanted, self._pads, others)
        moved = [
            name for name, holds in held.items() if not _same([one.window for one in holds], windows.get(name, []))
        ]
        for name in moved:
            self._ledger.mark(lease, name, "released")
        problem: TakenError | None = None
        for name in windows:
            if windows[name] and (name in moved or name not in held):
                try:
                    self._ledger.book(lease, name, windows[name])
                except TakenError as error:
                    problem = error
        self._mark_begun(lease, now_s)
        if problem is not None:
            raise problem

    def _mark_begun(self, lease: Lease, now_s: float) -> None:
        """Mark windows that have begun as used. One pad has one at a time: while another holder still uses it beyond its window, ours stays firm."""
        now = from_posix(now_s)
        for one in self._ledger.holds(begin=now, end=now):
            if one.holder == self._holder and one.state == "firm" and one.window.start <= now < one.window.end:
                with suppress(TakenError):
                    self._ledger.mark(lease, one.itinerary, "in use", number=one.number)


def _same(held: Sequence[Window], wanted: Sequence[Window]) -> bool:
    if len(held) != len(wanted):
        return False

    def key(one: Window) -> tuple[str, int, float]:
        return one.station, one.pad, one.start.timestamp()

    return all(
        (a.station, a.pad) == (b.station, b.pad)
        and abs((a.start - b.start).total_seconds()) <= SAME_S
        and abs((a.end - b.end).total_seconds()) <= SAME_S
        for a, b in zip(sorted(held, key=key), sorted(wanted, key=key), strict=True)
    )
