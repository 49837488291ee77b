"""Exchanges: request-reply state machines with one vehicle, without any input or output of their own.

An exchange is told of messages and of time, and says what to send and when it wants to be told of time again. The same
one runs on sockets at wall time and against a simulated vehicle in virtual time. A procedure is a generator of
exchanges: it yields one, and goes on when that is done.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

T = TypeVar("T")
Steps = Generator["Exchange", None, T]
"""A procedure: yields exchanges one after the other and returns what came of them."""

FIRST_RETRY_S = 0.25
"""What MAVLink allows for an item, while the round trip is not known."""
_MIN_RETRY_S = 0.03
_FEW_TRIES = 6
_UNCLEAR, _SLOWEST = 4, 16.0
SPREADS = 2.0
"""For missions, `RoundTrip.retry_s` waits for no more than so many: what is sent too early there is ignored."""
_LONGEST_RETRY_S = 3.0


@dataclass(frozen=True, slots=True)
class Target:
    """System and component of an exchange; packets of others are ignored."""

    system: int
    component: int = 1


@dataclass(slots=True)
class RoundTrip:
    """How long an answer takes, learnt as TCP does it (RFC 6298).

    Attributes
    ----------
    mean_s, spread_s : float
        Smoothed; NaN before the first.
    """

    mean_s: float = math.nan
    spread_s: float = 0.0
    _unclear: int = 0
    _slower: float = 1.0

    def learn(self, took_s: float) -> None:
        """Add one measurement: an answer to a question asked once."""
        self._unclear, self._slower = 0, 1.0
        if math.isnan(self.mean_s):
            self.mean_s, self.spread_s = took_s, took_s / 2.0
        else:
            self.spread_s += 0.25 * (abs(took_s - self.mean_s) - self.spread_s)
            self.mean_s += 0.125 * (took_s - self.mean_s)

    def unclear(self) -> None:
        """Take an answer to a repeated request: it does not show which request, so no round trip is learnt.

        Several in a row mean that the link may have become slower than we wait: then we wait longer, until an answer
        is clear again. Without this a slow link is never learnt, and is asked ever more.
        """
        self._unclear += 1
        if self._unclear >= _UNCLEAR:
            self._unclear = 0
            self._slower = min(self._slower * 2.0, _SLOWEST)

    def retry_s(self, attempt: int, *, spreads: float = 4.0) -> float:
        """How long to wait for an answer before asking again; longer each time after the first few.

        Parameters
        ----------
        attempt : int
            How often it has been asked.
        spreads : float
            How much later than usual an answer may be; few where asking too early costs nothing but a packet.
        """
        first = FIRST_RETRY_S if math.isnan(self.mean_s) else self.mean_s + max(spreads * self.spread_s, 0.01)
        return min(max(first, _MIN_RETRY_S) * self._slower * 1.4 ** max(0, attempt - _FEW_TRIES), _LONGEST_RETRY_S)


class Exchange(ABC):
    """One question with its answers.

    Parameters
    ----------
    target : Target
        Who is asked.
    round_trip : RoundTrip
        Shared by all exchanges with this vehicle.
    """

    def __init__(self, target: Target, round_trip: RoundTrip | None = None) -> None:
        self.target = target
        self.round_trip = round_trip or RoundTrip()
        self.outbox: list[tuple[str, dict[str, Any]]] = []
        self.next_s = math.inf
        self.done = False

    def send(self, name: str, **fields: Any) -> None:
        """Put a message to the target into the outbox."""
        addressed = {"target_system": self.target.system, "target_component": self.target.component}
        self.outbox.append((name, addressed | fields))

    def finish(self) -> None:
        """Nothing more is expected."""
        self.done = True
        self.next_s = math.inf

    @abstractmethod
    def begin(self, now_s: float) -> None:
        """Ask."""

    @abstractmethod
    def hear(self, message: Message, now_s: float) -> None:
        """Take a message of the target, addressed to us or broadcast."""

    @abstractmethod
    def tick(self, now_s: float) -> None:
        """Time has come: ask again, or give up."""
