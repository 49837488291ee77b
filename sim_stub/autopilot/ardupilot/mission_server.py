"""ArduPilot's mission protocol: items take effect as they arrive (MissionItemProtocol.cpp)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.ardupilot.missions import MAX_ITEMS, accept
from skyway.sim_stub.autopilot.fence import Fence
from skyway.sim_stub.autopilot.items import FENCE, MISSION, RALLY, Answer, Command, Frame, Item
from skyway.sim_stub.autopilot.mission_server import PARTS, MissionServer, identity
from skyway.sim_stub.autopilot.modes import Mode

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Partner

RETRY_S = 1.0
GIVE_UP_S = 8.0


class ArduPilotMissionServer(MissionServer):
    """Mission protocol of ArduPilot; it keeps no state of a download, so an acknowledgement means nothing to it."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.fence_items: list[Item] = []

    def next_wall_s(self) -> float:
        """Next retry or give-up."""
        if self.partner is None:
            return math.inf
        return min(self.heard_s + GIVE_UP_S, self.asked_s + RETRY_S)

    def tick(self) -> None:
        """Ask again every second; after 8 s without an item, cancel and leave what has arrived."""
        now = self.vehicle.wall_s
        if self.partner is None:
            return
        if now >= self.heard_s + GIVE_UP_S:
            partner, self.partner = self.partner, None
            self.vehicle.radio.say(4, "Mission upload timeout")
            self.acknowledge(partner, self.kind, Answer.CANCELLED)
        elif now >= self.asked_s + RETRY_S:
            self.send_request(self.partner, as_int=False)

    def _refused(self, who: Partner, kind: int) -> bool:
        """Answer what cannot be served at all."""
        if kind not in PARTS:
            self.acknowledge(who, kind, Answer.UNSUPPORTED)
            return True
        if kind != MISSION and who.port.version == 1:
            self.vehicle.radio.say(4, "Need mavlink2 for item transfer")
            self.acknowledge(who, kind, Answer.UNSUPPORTED)
            return True
        return False

    def _items(self, kind: int) -> list[Item]:
        return self.vehicle.autopilot.stores[kind]

    def count(self, who: Partner, kind: int, message: Any) -> None:
        """Begin an upload: what is stored is cut to the new length at once."""
        total = message.count
        if self._refused(who, kind):
            return
        if self.partner is not None and (who != self.partner or kind != self.kind):
            self.acknowledge(who, kind, Answer.DENIED)
            return
        if total > MAX_ITEMS[kind]:
            self.vehicle.radio.say(4, f"Only {MAX_ITEMS[kind]} items are supported")
            self.acknowledge(who, kind, Answer.NO_SPACE)
            return
        self.kind, self.fence_items = kind, []
        if kind != FENCE:
            del self._items(kind)[total:]
        if total == 0:
            self.partner = who
            self._complete(who)
            return
        self._begin(who, 0, total - 1)

    def _begin(self, who: Partner, first: int, last: int) -> None:
        self.partner, self.expected, self.last = who, first, last
        self.heard_s = self.vehicle.wall_s
        self.send_request(who, as_int=False)

    def write_partial(self, who: Partner, kind: int, message: Any) -> None:
        """Begin an upload of some items."""
        if self._refused(who, kind):
            return
        first, last, have = message.start_index, message.end_index, len(self._items(kind))
        if not 0 <= first <= last <= have or kind == FENCE or self.partner is not None:
            self.vehicle.radio.say(4, "Flight plan update rejected")
            self.acknowledge(who, kind, Answer.ERROR)
            return
        self.kind = kind
        self._begin(who, first, last)

    def item(self, who: Partner, kind: int, message: Any) -> None:
        """Store an item; a refusal ends the upload and leaves what has been stored."""
        if self.partner is None:
            return
        if message.seq != self.expected:
            self.acknowledge(who, kind, Answer.INVALID_SEQUENCE)
            return
        if who != self.partner:
            self.acknowledge(who, kind, Answer.DENIED)
            return
        answer = self._take(self.read_item(message))
        if answer != Answer.ACCEPTED:
            self.partner = None
            self.acknowledge(who, kind, answer)
            return
        self.heard_s = self.vehicle.wall_s
        self.expected += 1
        if self.expected > self.last:
            self._complete(who)
        else:
            self.send_request(who, as_int=False)

    def _take(self, raw: Item) -> Answer:
        taken = accept(raw, self.kind)
        if isinstance(taken, Answer):
            return taken
        index = self.expected
        items = self.fence_items if self.kind == FENCE else self._items(self.kind)
        if taken.command == Command.DO_JUMP and self.kind == MISSION:
            target = int(taken.p1)
            if target == 0 or (target >= len(items) and target > self.last):
                return Answer.ERROR
        if index > len(items):
            return Answer.ERROR
        replaced = index < len(items)
        if replaced:
            items[index] = taken
        else:
            items.append(taken)
        if self.kind == MISSION:
            self.vehicle.autopilot.missions_stored(replaced=replaced, current=index)
        return Answer.ACCEPTED

    def _complete(self, who: Partner) -> None:
        pilot = self.vehicle.autopilot
        answer = Answer.ACCEPTED
        if self.kind == FENCE:
            if Fence.from_items(self.fence_items).consistent:
                pilot.stores[FENCE][:] = self.fence_items
                pilot.fence_stored()
            else:
                answer = Answer.ERROR
        elif self.kind == MISSION:
            self.vehicle.radio.say(6, "Flight plan received")
            pilot.missions_stored(replaced=False, current=None)
        else:
            pilot.parameters.set("RALLY_TOTAL", float(len(pilot.stores[RALLY])))
        self.vehicle.mission_ids[self.kind] = identity(self._items(self.kind))
        self.vehicle.event(f"{('mission', 'fence', 'rally')[self.kind]} of {len(self._items(self.kind))} items stored")
        self.partner = None
        self.acknowledge(who, self.kind, answer)

    def request_list(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Send the number of items; home counts as the first."""
        if self._refused(who, kind):
            return
        if self.partner is not None:
            self.acknowledge(who, kind, Answer.DENIED)
            return
        self.send_count(who, kind, len(self._items(kind)))

    def request(self, who: Partner, kind: int, message: Any) -> None:
        """Send an item; home can always be requested."""
        seq = message.seq
        if self._refused(who, kind):
            return
        if self.partner is not None:
            self.acknowledge(who, kind, Answer.DENIED)
            return
        items = self._items(kind)
        home = kind == MISSION and seq == 0
        if seq >= len(items) and not home:
            if kind == MISSION:
                self.send_count(who, kind, len(items))
            self.acknowledge(who, kind, Answer.ERROR)
            return
        item = self._home_item() if home else items[seq]
        current = kind == MISSION and seq == self.vehicle.autopilot.run.current
        as_int = message.get_type() == "MISSION_REQUEST_INT"
        self.send_item(who, kind, seq, item, as_int=as_int, current=current)

    def _home_item(self) -> Item:
        home = self.vehicle.autopilot.home
        if home is None:
            return Item(Command.WAYPOINT, Frame.GLOBAL)
        height = int(home.alt_m * 100.0) / 100.0
        return Item(Command.WAYPOINT, Frame.GLOBAL, x=round(home.lat * 1e7), y=round(home.lon * 1e7), z=height)

    def clear(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Clear one kind of items; not all kinds at once, and not a mission that is being flown."""
        if self._refused(who, kind):
            return
        pilot = self.vehicle.autopilot
        flying = kind == MISSION and pilot.mode == Mode.MISSION and pilot.armed
        if self.partner is not None or flying:
            self.acknowledge(who, kind, Answer.ERROR)
            return
        self._items(kind).clear()
        self.vehicle.mission_ids[kind] = 0
        if kind == MISSION:
            pilot.run.reset()
            pilot.missions_stored(replaced=False, current=None)
        elif kind == FENCE:
            pilot.fence_stored()
        self.acknowledge(who, kind, Answer.ACCEPTED)

    def set_current(self, who: Partner, kind: int, message: Any) -> None:  # noqa: ARG002
        """Make an item the current one."""
        if self.vehicle.set_mission_current(message.seq):
            self.vehicle.radio.tell_mission_current()
