"""Setting the current mission item, repeated until the vehicle confirms it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.protocol.exchange import Exchange

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import RoundTrip, Target
    from skyway.link.wire.messages import Message

GIVE_UP_S = 5.0


class SetCurrent(Exchange):
    """Makes an item the current one (MISSION_SET_CURRENT), confirmed by MISSION_CURRENT.

    Parameters
    ----------
    number : int
        In the autopilot's numbering; ArduPilot's 0 is the beginning.

    Attributes
    ----------
    confirmed : bool
        Whether the vehicle says so.
    """

    def __init__(self, target: Target, number: int, *, round_trip: RoundTrip | None = None) -> None:
        super().__init__(target, round_trip)
        self.number = number
        self.confirmed = False
        self._tries = 0
        self._end_s = 0.0

    def begin(self, now_s: float) -> None:
        """Ask."""
        self._end_s = now_s + GIVE_UP_S
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        self.send("MISSION_SET_CURRENT", seq=self.number)
        self._tries += 1
        self.next_s = now_s + max(self.round_trip.retry_s(self._tries), 0.1)

    def hear(self, message: Message, now_s: float) -> None:  # noqa: ARG002
        """End when it is so."""
        if message.name == "MISSION_CURRENT" and message["seq"] == self.number:
            self.confirmed = True
            self.finish()

    def tick(self, now_s: float) -> None:
        """Ask again."""
        if now_s >= self._end_s:
            self.finish()
        else:
            self._ask(now_s)
