"""Records of a ledger: leases, holds and events; and its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError, one_line
from skyway.models.base.units import iso

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from skyway.models.ledger.window import (
        State,
        Window,
    )


class LedgerError(SkywayError):
    """The ledger's database refuses, or is unreachable; no booking is incomplete."""

    exit_code = 3


class TakenError(SkywayError):
    """A pad is taken; nothing was booked.

    `holds` has the conflicting bookings, as far as they are known: after a race that the database decided it is empty.
    """

    exit_code = 1

    def __init__(self, holds: Sequence[Hold] = ()) -> None:
        self.holds = tuple(holds)
        told = "; ".join(
            f"pad {one.window.pad} of {one.window.station} is held by {one.itinerary} from {iso(one.window.start)} to {iso(one.window.end)}"
            for one in self.holds[:3]
        )
        more = f"; and {len(self.holds) - 3} more" if len(self.holds) > 3 else ""
        super().__init__(one_line(f"nothing was booked: {told or 'somebody else booked first'}{more}"))


class FencedError(SkywayError):
    """The lease is no longer the holder's: it expired, or another process has taken over."""

    exit_code = 1


class VersionError(SkywayError):
    """The itinerary has changed since it was read, or cannot enter the requested state."""

    exit_code = 1


@dataclass(frozen=True, slots=True)
class Lease:
    """The right to book and change in the name of a holder, until it expires."""

    holder: str
    """Name under which bookings are made: a dispatcher or one of its workers."""
    owner: str
    """The process that has it now."""
    token: int
    """Fencing token: each lease taken gets a higher one, and only the highest is valid."""
    expires: datetime
    """By the clock of the database."""


@dataclass(frozen=True, slots=True)
class Hold:
    """A booked window."""

    itinerary: str
    version: int
    number: int
    """Of the window in its itinerary, from 1."""
    window: Window
    state: State
    holder: str
    token: int

    @property
    def name(self) -> str:
        """The holder's name for the itinerary; see `itinerary_of`."""
        return self.itinerary.removeprefix(f"{self.holder}: ")


def itinerary_of(holder: str, name: str) -> str:
    """Return the id of a holder's name, such as an order: two holders may have an order of the same name."""
    return f"{holder}: {name}"


@dataclass(frozen=True, slots=True)
class Event:
    """One row of the history: the state of a window from a time on."""

    seq: int
    at: datetime
    hold: Hold
