"""Download and clearing by the MAVLink mission protocol: the ground side, as state machines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.protocol.exchange import SPREADS, Exchange, Question
from skyway.link.protocol.mission_words import ACCEPTED, ERROR, ITEM_FIELDS, UNSUPPORTED, MissionKind, in_words
from skyway.missions.autopilots.wire import WireItem
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

GIVE_UP_S = 10.0
_AGAIN_S = 0.4
_MAX_RESTARTS = 12
_FORGOTTEN_TRIES, _FORGOTTEN_COSTS, _DOUBTED_TRIES = 12, 2, 2
_HEARD = frozenset(("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ACK"))
_LACKS_COSTS = 4
"""One such answer may be a late one to an upload."""
_WITHOUT_KINDS = 5
"""Requests for another list that were answered with the mission; a late answer to an earlier request for it comes once or twice."""


def wire_item(message: Message) -> WireItem:
    """Item of a MISSION_ITEM_INT message."""
    return WireItem(**{name: message[name] for name in ITEM_FIELDS})


class Download(Exchange):
    """Downloads a list of a vehicle, item by item in order: PX4 ends the transfer on any other order."""

    transfers = "MISSION_"

    def __init__(
        self,
        target: Target,
        kind: MissionKind,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        super().__init__(target)
        self.kind = kind
        self.items: tuple[WireItem, ...] | None = None
        """The list; None if it could not be read."""
        self.problem = ""
        """Reason for a failure."""
        self.lacks = False
        """The vehicle answers that it has no lists of this kind."""
        self._got: list[WireItem] = []
        self._count: int | None = None
        self._tries = 0
        self._restarts = 0
        self._heard_s = 0.0
        self._sent_s = 0.0
        self._progress = progress
        self._pause = False
        self._answered_by_mission: set[int] = set()

    def begin(self, now_s: float) -> None:
        """Request the number of items."""
        self._heard_s = now_s
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        if self._count is None:
            self.send("MISSION_REQUEST_LIST", mission_type=int(self.kind))
        else:
            self.send("MISSION_REQUEST_INT", seq=len(self._got), mission_type=int(self.kind))
        self._sent_s = now_s
        self._tries += 1
        self.next_s = now_s + self.round_trip.retry_s(self._tries, spreads=SPREADS)

    def hear(self, message: Message, now_s: float) -> None:
        """Process the count, and item after item."""
        if message.name not in _HEARD or self._pause:
            return
        if message["mission_type"] != self.kind:
            self._hear_other(message)
            return
        if message.name == "MISSION_COUNT":
            if self._count is None:
                self._count = message["count"]
                self._next(now_s)
        elif message.name == "MISSION_ITEM_INT":
            if self._count is not None and message["seq"] == len(self._got):
                self._got.append(wire_item(message))
                self._next(now_s)
        elif message.name == "MISSION_ITEM":
            if self._count is not None:  # coordinates as floats are off by a metre, and are not what it flies
                self.problem = "it sends items as MISSION_ITEM, without full coordinates: update its firmware"
                self.finish()
        elif message["type"] == ERROR and self._count is not None:
            # Either it has ended the transfer, and is silent from now on, or this answers a packet that came late.
            self._tries = max(self._tries, _FORGOTTEN_TRIES - _DOUBTED_TRIES)
            self.next_s = min(self.next_s, now_s + self.round_trip.retry_s(1))
        elif message["type"] != ACCEPTED:
            self._refused(message["type"], now_s)

    def _hear_other(self, message: Message) -> None:
        """Recognize a vehicle that knows missions only: it ignores the kind, and answers each request with its mission."""
        if message.name != "MISSION_COUNT" or message["mission_type"] != MissionKind.MISSION or self._count is not None:
            return
        self._answered_by_mission.add(self._tries)
        if len(self._answered_by_mission) >= _WITHOUT_KINDS:
            self.lacks = True
            self.problem = f"it answers with its mission, and does not know lists of this kind ({self.kind.word})"
            self.finish()

    def _refused(self, answer: int, now_s: float) -> None:
        lacks = answer == UNSUPPORTED and self._count is None
        why = (
            f"it does not support lists of this kind ({self.kind.word})"
            if lacks
            else f"it aborted the transfer: {in_words(answer)}"
        )
        self._pause = self._may_begin_again(_LACKS_COSTS if lacks else 1, why)
        if self._pause:
            self.next_s = now_s + _AGAIN_S
        else:
            self.lacks = lacks

    def _next(self, now_s: float) -> None:
        if self._tries == 1:
            self.round_trip.learn(now_s - self._sent_s)
        else:
            self.round_trip.unclear()
        self._heard_s, self._tries = now_s, 0
        if self._progress is not None and self._count is not None:
            self._progress(len(self._got), self._count)
        if len(self._got) == self._count:
            self.items = tuple(self._got)
            self.send("MISSION_ACK", type=ACCEPTED, mission_type=int(self.kind))
            self.finish()
        else:
            self._ask(now_s)

    def _may_begin_again(self, costs: int, problem: str) -> bool:
        """Whether it may begin again: the vehicle was busy, has forgotten the transfer, or has changed the list."""
        self._restarts += costs
        if self._restarts > _MAX_RESTARTS:
            self.problem = problem
            self.finish()
        return not self.done

    def tick(self, now_s: float) -> None:
        """Repeat the request."""
        if self._pause:
            self._pause, self._count, self._got, self._tries = False, None, [], 0
        elif now_s >= self._heard_s + GIVE_UP_S:
            self.problem = f"no answer for {duration(GIVE_UP_S)}"
            self.finish()
            return
        elif self._count is not None and self._tries >= _FORGOTTEN_TRIES:  # a reboot, or it has forgotten the transfer
            if not self._may_begin_again(_FORGOTTEN_COSTS, f"item {len(self._got)} never came"):
                return
            self._count, self._got, self._tries = None, [], 0
        self._ask(now_s)


class Clear(Question):
    """Clears a vehicle's list of one kind; repeating it does no harm."""

    give_up_s, soonest_s = GIVE_UP_S, 0.0
    transfers = "MISSION_"

    def __init__(self, target: Target, kind: MissionKind) -> None:
        super().__init__(target, "MISSION_CLEAR_ALL", mission_type=int(kind))
        self.kind = kind
        self.answer: int | None = None
        """MAV_MISSION_RESULT; None: no answer."""

    def hear(self, message: Message, now_s: float) -> None:  # noqa: ARG002
        """End at the acknowledgement."""
        if message.name == "MISSION_ACK" and message["mission_type"] == self.kind:
            self.answer = message["type"]
            self.finish()
