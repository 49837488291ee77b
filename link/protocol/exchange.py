"""Exchanges: request-reply state machines with one vehicle, without any input or output of their own.

An exchange receives messages and the time, and returns the messages to send and the time of its next call. The same
one runs on sockets at wall time and against a simulated vehicle in virtual time. A procedure is a generator of
exchanges: it yields one, and continues when that is done.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

T = TypeVar("T")
Steps = Generator["Exchange", None, T]
"""A procedure: yields exchanges one after the other and returns their result."""

FIRST_RETRY_S = 0.25
"""MAVLink's time limit for an item, while the round trip is unknown."""
_MIN_RETRY_S = 0.03
_FEW_TRIES = 6
_UNCLEAR, _SLOWEST = 4, 16.0
SPREADS = 2.0
"""Spreads that `RoundTrip.retry_s` waits beyond the mean, for missions: packets sent too early are ignored there."""
_LONGEST_RETRY_S = 3.0


@dataclass(slots=True)
class RoundTrip:
    """Time until an answer, learnt as in TCP (RFC 6298)."""

    mean_s: float = math.nan
    spread_s: float = 0.0
    """`mean_s`, `spread_s`: smoothed; NaN before the first."""
    _unclear: int = 0
    _slower: float = 1.0

    def learn(self, took_s: float) -> None:
        """Add one measurement: an answer to a request sent once."""
        self._unclear, self._slower = 0, 1.0
        if math.isnan(self.mean_s):
            self.mean_s, self.spread_s = took_s, took_s / 2.0
        else:
            self.spread_s += 0.25 * (abs(took_s - self.mean_s) - self.spread_s)
            self.mean_s += 0.125 * (took_s - self.mean_s)

    def unclear(self) -> None:
        """Process an answer to a repeated request: it is unknown to which request it belongs, so no round trip is learnt.

        Several in a row mean that the link may have become slower than our wait: then the wait grows, until an answer
        is unambiguous again. Without this the round trip of a slow link is never learnt, and requests are repeated ever more often.
        """
        self._unclear += 1
        if self._unclear >= _UNCLEAR:
            self._unclear = 0
            self._slower = min(self._slower * 2.0, _SLOWEST)

    def retry_s(self, attempt: int, *, spreads: float = 4.0) -> float:
        """Time to wait for an answer before repeating the request; longer with each `attempt` after the first few.

        An answer may be `spreads` later than usual; use few if an early repetition costs only a packet.
        """
        first = FIRST_RETRY_S if math.isnan(self.mean_s) else self.mean_s + max(spreads * self.spread_s, 0.01)
        return min(max(first, _MIN_RETRY_S) * self._slower * 1.4 ** max(0, attempt - _FEW_TRIES), _LONGEST_RETRY_S)


@dataclass(frozen=True, slots=True)
class Target:
    """System and component of an exchange, with their round trip; packets of others are ignored."""

    system: int
    component: int = 1
    round_trip: RoundTrip = field(default_factory=RoundTrip, compare=False)


class Exchange(ABC):
    """One request with its answers."""

    transfers = ""
    """Prefix of the names of its messages, if a vehicle can do only one such transfer at a time."""

    def __init__(self, target: Target) -> None:
        self.target, self.round_trip = target, target.round_trip
        self.outbox: list[tuple[str, dict[str, Any]]] = []
        self.next_s = math.inf
        self.done = False

    def send(self, name: str, **fields: Any) -> None:
        """Queue a message to the target."""
        addressed = {"target_system": self.target.system, "target_component": self.target.component}
        self.outbox.append((name, addressed | fields))

    def finish(self) -> None:
        """End the exchange."""
        self.done = True
        self.next_s = math.inf

    @abstractmethod
    def begin(self, now_s: float) -> None:
        """Send the request."""

    @abstractmethod
    def hear(self, message: Message, now_s: float) -> None:
        """Process a message of the target, addressed to us or broadcast."""

    @abstractmethod
    def tick(self, now_s: float) -> None:
        """The time is up: repeat the request, or give up."""


class Question(Exchange):
    """An exchange whose request is repeated until it is answered or abandoned."""

    give_up_s = 5.0
    """Time without an answer after which it ends."""
    soonest_s = 0.1
    """Shortest interval between requests."""

    def __init__(self, target: Target, name: str, **fields: Any) -> None:
        super().__init__(target)
        self._question = name, fields
        self._tries = 0
        self._sent_s = self._end_s = 0.0

    def ask(self) -> None:
        """Send the request."""
        name, fields = self._question
        self.send(name, **fields)

    def begin(self, now_s: float) -> None:
        """Send the request for the first time."""
        self._end_s = now_s + self.give_up_s
        self._put(now_s)

    def tick(self, now_s: float) -> None:
        """Repeat the request, or give up."""
        if now_s >= self._end_s:
            self.finish()
        else:
            self._put(now_s)

    def _put(self, now_s: float) -> None:
        self.ask()
        self._sent_s = now_s
        self._tries += 1
        self.next_s = now_s + max(self.round_trip.retry_s(self._tries), self.soonest_s)

    def _learn(self, now_s: float) -> None:
        """Learn the round trip of an answer, if the request was sent once."""
        if self._tries == 1:
            self.round_trip.learn(now_s - self._sent_s)


class Carrier(ABC):
    """Runner of exchanges with a vehicle: the connection itself, or another library on it."""

    def perform(self, steps: Steps[T]) -> T:
        """Execute a procedure, and return its result.

        Raises a `StationConflictError` if another station uses our system id.
        """
        try:
            while True:
                try:
                    exchange = next(steps)
                except StopIteration as end:
                    result: T = end.value
                    return result
                self._carry_out(exchange)
        finally:
            steps.close()

    @abstractmethod
    def _carry_out(self, exchange: Exchange) -> None:
        """Execute one exchange."""
