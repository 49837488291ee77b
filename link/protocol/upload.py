"""Upload by the MAVLink mission protocol: the ground side, as a state machine.

The vehicle requests items and repeats its requests by itself (PX4 after 250 ms, ArduPilot after 1 s). We wait no
longer than a round trip for its next request: then either our item or its request was lost, and it is unknown
which. So we send that item and the one after it: a vehicle that lacks the first takes both, one that has it
takes the second, and an item that is not expected is ignored. The transfer is never restarted on silence.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

from skyway.link.protocol.exchange import SPREADS, Exchange
from skyway.link.protocol.mission_words import ACCEPTED, CANCELLED, INVALID_SEQUENCE, ITEM_FIELDS, PASSING, MissionKind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message
    from skyway.missions.autopilots.wire import WireItem

GIVE_UP_S = 10.0
"""Silence after which the transfer is over: both autopilots give up earlier (5 s and 8 s)."""
BUSY_S = 12.0
"""Longest time for which a vehicle may be busy with another station."""
_DOUBT_S = 1.5
_STUCK_S = 15.0
"""Limit for repeated requests of one item."""
_LAST_TRIES = 12
"""If only the acknowledgement is missing, reading back is faster than waiting for it."""
_BUSY_AGAIN_S = 0.5
_AHEAD = 4
"""Greatest number of items sent beyond the requested one."""
_HEARD = frozenset(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_COUNT"))


class UploadEnd(Enum):
    """End of a transfer, as far as known without reading back."""

    RUNNING = "running"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    BROKEN = "broken off"
    SILENT = "no answer"


class Upload(Exchange):
    """Sends items, in the autopilot's numbering from 0, to a vehicle.

    `progress` is called with the number requested so far, and the total.
    """

    transfers = "MISSION_"

    def __init__(
        self,
        target: Target,
        items: Sequence[WireItem],
        kind: MissionKind,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        super().__init__(target)
        self.items = tuple(items)
        self.kind = kind
        self.end = UploadEnd.RUNNING
        """Result of the transfer."""
        self.answer = ACCEPTED
        """MAV_MISSION_RESULT of the last acknowledgement."""
        self.asked = self.sent = self._furthest = -1
        """`sent`: greatest number sent; -1 before the first."""
        """`asked`: number of the latest requested item; -1 before the first."""
        self.guessed = False
        self._progress = progress
        self._tries = 0
        self._times = [0] * len(self.items)
        self.heard_s = self._begun_s = self._sent_s = self._moved_s = 0.0
        """`heard_s`: time of the vehicle's latest packet in this transfer."""
        self._doubt_s = math.inf
        self._busy = self._listed = False

    def begin(self, now_s: float) -> None:
        """Send the number of items."""
        self._begun_s = self.heard_s = self._moved_s = now_s
        self._count(now_s)

    def _count(self, now_s: float) -> None:
        self.send("MISSION_COUNT", count=len(self.items), mission_type=int(self.kind))
        self._wait(now_s)

    def _wait(self, now_s: float) -> None:
        self._sent_s = now_s
        self._tries += 1
        self.next_s = min(now_s + self.round_trip.retry_s(self._tries, spreads=SPREADS), self._doubt_s)

    def _item(self, number: int) -> None:
        self.sent = max(self.sent, number)
        self._times[number] += 1
        item = self.items[number]
        self.send("MISSION_ITEM_INT", **{name: getattr(item, name) for name in ITEM_FIELDS})

    def hear(self, message: Message, now_s: float) -> None:
        """Answer requests, end at an acknowledgement."""
        if message.name not in _HEARD or message["mission_type"] != self.kind:
            return
        if message.name == "MISSION_COUNT":
            if self._listed and message["count"] == len(self.items):
                self.heard_s = now_s
                self._end(UploadEnd.ACCEPTED, ACCEPTED)
        elif message.name == "MISSION_ACK":
            self._acknowledged(message["type"], now_s)
        elif message["seq"] < len(self.items):
            self._asked(message["seq"], now_s)

    def _asked(self, number: int, now_s: float) -> None:
        if number > self.sent + 1:
            return  # of an older transfer: only the next item is ever requested
        fresh = number > self.asked
        if number > self._furthest:
            self._furthest, self._moved_s = number, now_s
        elif now_s >= self._moved_s + _STUCK_S:
            self.send("MISSION_ACK", type=CANCELLED, mission_type=int(self.kind))
            self._end(UploadEnd.BROKEN, CANCELLED)
            return
        if not fresh and now_s < self._sent_s + self.round_trip.retry_s(1, spreads=SPREADS):
            return  # a duplicate packet, or requested before our item can have arrived
        if number == self.asked + 1:
            self._learn(now_s)
        self.heard_s, self._doubt_s, self._busy = now_s, math.inf, False
        if fresh and self._progress is not None:
            self._progress(number, len(self.items))
        self.asked, self._tries = number, 0
        self.guessed = self.guessed and number < self.sent
        self._item(number)
        self._wait(now_s)

    def _learn(self, now_s: float) -> None:
        """Learn the round trip of the next request, if the item that it follows was sent once and nothing ahead of it."""
        if self._tries > 1:
            self.round_trip.unclear()
        elif self.asked < 0 or (self._times[self.asked] == 1 and self.sent == self.asked):
            self.round_trip.learn(now_s - self._sent_s)

    def _acknowledged(self, answer: int, now_s: float) -> None:
        complete = self.sent == len(self.items) - 1
        if answer == ACCEPTED:
            if complete:
                self.heard_s = now_s
                self._end(UploadEnd.ACCEPTED, answer)
            return  # otherwise of another transfer
        if answer == INVALID_SEQUENCE:
            return  # to an item that came twice; the vehicle will request the right one
        if self._listed and answer in PASSING:  # it still waits for our last item, and so does not send the list
            self._tries = min(self._tries, 1)
            return
        if answer not in PASSING:
            self._end(UploadEnd.REFUSED, answer)
            return
        self.answer = answer
        if self.asked < 0 and len(self.items):
            self._busy = True
            self.next_s = now_s + _BUSY_AGAIN_S
        elif math.isinf(self._doubt_s):
            self._doubt_s = now_s + _DOUBT_S
            self.next_s = min(self.next_s, self._doubt_s)

    def tick(self, now_s: float) -> None:
        """Repeat items that may have been lost."""
        if now_s >= self._doubt_s:
            self._end(UploadEnd.BROKEN, self.answer)
            return
        if self._busy:
            if now_s >= self._begun_s + BUSY_S:
                self._end(UploadEnd.BROKEN, self.answer)
                return
            # It may still be waiting for the acknowledgement of a download of ours.
            self.send("MISSION_ACK", type=ACCEPTED, mission_type=int(self.kind))
            self.heard_s = now_s
            self._count(now_s)
            return
        complete = self.sent == len(self.items) - 1 and self._tries >= _LAST_TRIES
        if complete or now_s >= min(self.heard_s + GIVE_UP_S, self._moved_s + _STUCK_S):
            self._end(UploadEnd.SILENT, self.answer)
        elif self.asked < 0:
            self._count(now_s)
        else:
            self._again()
            self._wait(now_s)

    def _again(self) -> None:
        """Repeat items that may have been lost, and send one new item; after the last one request the list.

        In any state of the vehicle between its last received request and the last item sent, the transfer continues. One
        that sends the list has received all items, and its acknowledgement was lost.
        """
        last = len(self.items) - 1
        following = min(self.sent + 1, self.asked + _AHEAD, last)
        self.guessed = self.guessed or following > self.asked
        for number in range(self.asked, following + 1):
            self._item(number)
        if self.sent == last:
            self._listed = True
            self.send("MISSION_REQUEST_LIST", mission_type=int(self.kind))

    def _end(self, end: UploadEnd, answer: int) -> None:
        self.end, self.answer = end, answer
        if self._progress is not None and end is UploadEnd.ACCEPTED:
            self._progress(len(self.items), len(self.items))
        self.finish()

    @property
    def concerned(self) -> tuple[int, ...]:
        """Numbers of the items that a refusal may concern."""
        if self.asked < 0:
            return ()
        last = self.sent if self.guessed else self.asked
        return tuple(range(self.asked, last + 1))
