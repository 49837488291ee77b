"""Mission validity as reported by the vehicle: some accept missions that they will not fly.

Such a vehicle (`Family.judges_missions`) judges a mission after accepting it, reports in texts (STATUSTEXT), and in newer
versions in MISSION_CURRENT.mission_state.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.protocol.command import ACCEPTED, IN_PROGRESS
from skyway.link.protocol.exchange import Exchange

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

GIVE_UP_S = 2.0
SETTLE_S = 0.2
"""It judges within this time of the last item; earlier texts may concern the previous mission."""
AGAIN_S = 0.3
"""A refusal counts if it is repeated after this time."""
WORDS_S = 1.0
"""Texts come no later than this."""
_MISSION_CURRENT, _REQUEST_MESSAGE = 42, 512
_UNKNOWN, _NO_MISSION = 0, 1
_YES = (ACCEPTED, IN_PROGRESS)


class AskVerdict(Exchange):
    """Requests whether the mission that was accepted at `since_s`, by the connection's clock, can be flown."""

    def __init__(self, target: Target, since_s: float) -> None:
        super().__init__(target)
        self.refused: bool | None = None
        """Its reported state; None if it does not report one."""
        self._since_s, self._end_s = since_s, 0.0
        self._tries = 0
        self._told = False
        self._refused_s = math.inf

    def begin(self, now_s: float) -> None:
        """Send the request, as soon as it can have judged."""
        self._end_s = now_s + GIVE_UP_S
        self.next_s = max(now_s, self._since_s + SETTLE_S)

    def hear(self, message: Message, now_s: float) -> None:
        """Process its state."""
        if message.name == "MISSION_CURRENT" and now_s >= self._since_s + SETTLE_S:
            state = message["mission_state"]
            if state == _NO_MISSION and now_s < self._refused_s + AGAIN_S:
                self._refused_s = min(self._refused_s, now_s)
                self.next_s = self._refused_s + AGAIN_S
            elif state != _UNKNOWN:
                self.refused = state == _NO_MISSION
                self.finish()
            else:  # older versions report only by texts
                self._wait_for_words(now_s)
        elif message.name == "COMMAND_ACK" and message["command"] == _REQUEST_MESSAGE and message["result"] not in _YES:
            self._wait_for_words(now_s)

    def _wait_for_words(self, now_s: float) -> None:
        self._told = True
        self._end_s = min(self._end_s, max(now_s, self._since_s + WORDS_S))
        self.next_s = self._end_s

    def tick(self, now_s: float) -> None:
        """Repeat the request, or give up."""
        if now_s >= self._end_s:
            if math.isfinite(self._refused_s):
                self.refused = True
            self.finish()
        elif not self._told:
            self._tries += 1
            self.send("COMMAND_LONG", command=_REQUEST_MESSAGE, param1=float(_MISSION_CURRENT))
            self.next_s = min(now_s + max(self.round_trip.retry_s(self._tries), 0.1), self._end_s)
