"""PX4's mission manager: uploads take effect as a whole or not at all (mavlink_mission.cpp)."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import ALL, FENCE, MISSION, RALLY, Answer, Item
from skyway.sim_stub.autopilot.mission_server import PARTS, MissionServer, identity
from skyway.sim_stub.autopilot.px4.missions import MAX_ITEMS, accept, present

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Partner

RETRY_S = 0.25
GIVE_UP_S = 5.0


class _State(Enum):
    IDLE = 0
    RECEIVING = 1
    SENDING = 2


class Px4MissionServer(MissionServer):
    """Mission protocol of PX4; it does not know uploads of some items, and says nothing."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.state = _State.IDLE
        self.as_int = True
        self.total = 0
        self.received: list[Item] = []
        self.raw: list[Item] = []
        self.marked: int | None = None

    def forget(self) -> None:
        """Drop any transfer."""
        super().forget()
        self.state = _State.IDLE

    def next_wall_s(self) -> float:
        """Next retry or give-up."""
        if self.state == _State.IDLE:
            return math.inf
        give_up = self.heard_s + GIVE_UP_S
        return min(give_up, self.asked_s + RETRY_S) if self.state == _State.RECEIVING else give_up

    def tick(self) -> None:
        """Ask again every 250 ms, in the other variant each time; give up after 5 s without a word."""
        now = self.vehicle.wall_s
        if self.state == _State.IDLE or self.partner is None:
            return
        if now >= self.heard_s + GIVE_UP_S:
            self.vehicle.radio.say(2, "Operation timeout")
            self.state = _State.IDLE
        elif self.state == _State.RECEIVING and now >= self.asked_s + RETRY_S:
            self.as_int = not self.as_int
            self.send_request(self.partner, as_int=self.as_int)

    def count(self, who: Partner, kind: int, message: Any) -> None:
        """Begin an upload."""
        if self.state == _State.SENDING:
            self.vehicle.radio.say(2, "WPM: IGN MISSION_COUNT: Busy")
            self.acknowledge(who, kind, Answer.ERROR)
            return
        if self.state == _State.RECEIVING:
            if who != self.partner or self.expected > 0:
                self.acknowledge(who, kind, Answer.ERROR)
                return
        elif not self._open(who, kind, message.count):
            return
        self.heard_s = self.vehicle.wall_s
        self.send_request(who, as_int=self.as_int)

    def _open(self, who: Partner, kind: int, total: int) -> bool:
        """Prepare for an upload; False where it ends here."""
        if kind not in PARTS:
            self.acknowledge(who, kind, Answer.INVALID)
            return False
        if total > MAX_ITEMS[kind]:
            self.acknowledge(who, kind, Answer.NO_SPACE)
            return False
        if total == 0:
            self._store(kind, [], 0, None)
            self.acknowledge(who, kind, Answer.ACCEPTED)
            return False
        self.state = _State.RECEIVING
        self.partner, self.kind, self.total = who, kind, total
        self.expected = 0
        self.received, self.raw, self.marked = [], [], None
        self.as_int = True
        return True

    def item(self, who: Partner, kind: int, message: Any) -> None:
        """Take the item expected; any other is ignored, the last one again is acknowledged again."""
        if self.partner is not None and who != self.partner:
            self.vehicle.radio.say(2, "REJ. MIS ITEM: partner id mismatch")
            return
        if self.state != _State.RECEIVING:
            again = self.state == _State.IDLE and self.expected == message.seq + 1 and self.partner is not None
            ids = self.vehicle.mission_ids
            answer = Answer.ACCEPTED if again else Answer.ERROR
            if not again:
                self.vehicle.radio.say(2, "IGN MISSION_ITEM: No transfer")
            self.acknowledge(who, kind, answer, ids[kind] if again and kind in PARTS else 0)
            return
        if kind != self.kind:
            self.acknowledge(who, kind, Answer.ERROR)
            return
        self.heard_s = self.vehicle.wall_s
        if message.seq != self.expected:
            return
        self.as_int = message.get_type() == "MISSION_ITEM_INT"
        raw = self.read_item(message)
        taken = accept(raw, kind)
        if isinstance(taken, Answer):
            self.vehicle.radio.say(2, "IGN MISSION_ITEM: Invalid item")
            self.state = _State.IDLE
            self.expected = -1
            self.acknowledge(who, kind, taken)
            return
        if message.current:
            self.marked = self.expected
        self.received.append(taken)
        self.raw.append(raw)
        self.expected += 1
        if self.expected < self.total:
            self.send_request(who, as_int=self.as_int)
            return
        self.state = _State.IDLE
        opaque = identity(self.raw)
        self._store(kind, self.received, opaque, self.marked)
        self.acknowledge(who, kind, Answer.ACCEPTED, opaque)

    def _store(self, kind: int, items: list[Item], opaque: int, marked: int | None) -> None:
        pilot = self.vehicle.autopilot
        changed = opaque != self.vehicle.mission_ids[kind] or not opaque
        self.vehicle.mission_ids[kind] = opaque
        if not changed:
            return
        pilot.stores[kind][:] = items
        self.vehicle.event(f"{('mission', 'fence', 'rally')[kind]} of {len(items)} items stored")
        if kind == MISSION:
            self.vehicle.radio.forget_reached()
            pilot.missions_stored(replaced=True, current=marked)
            self.vehicle.radio.tell_mission_current()
        elif kind == FENCE:
            pilot.fence_stored()

    def request_list(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Start a download; a second one by another station is ignored."""
        done = self.state == _State.SENDING and self.expected == self.total
        mine = self.state == _State.SENDING and who == self.partner and kind == self.kind
        if not (self.state == _State.IDLE or done or mine):
            self.vehicle.radio.say(6, "Mission download request ignored, already active")
            return
        if kind not in PARTS:
            return
        self.state = _State.SENDING
        self.partner, self.kind = who, kind
        self.expected, self.total = 0, len(self.vehicle.autopilot.stores[kind])
        self.heard_s = self.vehicle.wall_s
        self.send_count(who, kind, self.total, self.vehicle.mission_ids[kind])
        if self.total == 0:
            self.state = _State.IDLE

    def request(self, who: Partner, kind: int, message: Any) -> None:
        """Send the item expected, or the one before again; anything else ends the download."""
        if who != self.partner:
            self.vehicle.radio.say(2, "WPM: REJ. CMD: partner id mismatch")
            return
        if self.state == _State.IDLE:
            return
        if self.state != _State.SENDING:
            self.vehicle.radio.say(2, "WPM: REJ. CMD: Busy")
            return
        if kind != self.kind:
            return
        self.heard_s = self.vehicle.wall_s
        seq = message.seq
        items = self.vehicle.autopilot.stores[self.kind]
        if seq not in (self.expected, self.expected - 1) or seq >= len(items):
            self.state = _State.IDLE
            self.acknowledge(who, self.kind, Answer.ERROR)
            self.vehicle.radio.say(2, "WPM: REJ. CMD: Req. WP was unexpected")
            return
        self.expected = max(self.expected, seq + 1)
        as_int = message.get_type() == "MISSION_REQUEST_INT"
        current = self.kind == MISSION and seq == self.vehicle.autopilot.run.current
        self.send_item(who, self.kind, seq, present(items[seq], as_int=as_int), as_int=as_int, current=current)

    def acknowledged(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """End a download, or an upload that the other side cancels."""
        if who != self.partner:
            return
        cancelled = message.type == Answer.CANCELLED
        if self.state == _State.SENDING or (self.state == _State.RECEIVING and cancelled):
            self.state = _State.IDLE
        elif self.state == _State.RECEIVING and message.type == Answer.UNSUPPORTED and self.partner:
            self.as_int = not self.as_int
            self.send_request(self.partner, as_int=self.as_int)

    def clear(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Clear one kind of items, or all."""
        if self.state != _State.IDLE:
            self.vehicle.radio.say(2, "WPM: IGN CLEAR CMD: Busy")
            return
        for part in (MISSION, FENCE, RALLY) if kind == ALL else (kind,):
            if part in PARTS:
                self._store(part, [], 0, None)
        self.acknowledge(who, kind, Answer.ACCEPTED)

    def set_current(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Make an item the current one."""
        pilot = self.vehicle.autopilot
        if self.state != _State.IDLE:
            self.vehicle.radio.say(2, "WPM: IGN WP CURR CMD: Busy")
        elif message.seq >= len(pilot.run.items):
            self.vehicle.radio.say(2, "WPM: WP CURR CMD: Not in list")
        else:
            pilot.run.jump(message.seq)
            self.vehicle.radio.tell_mission_current()
