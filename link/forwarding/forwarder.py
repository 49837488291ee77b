"""Forwarding between the vehicles of a connection and other ground stations: routed by target, without loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.link.forwarding.clients import open_endpoint
from skyway.link.forwarding.notes import Note, Notes
from skyway.link.forwarding.permission import (
    Effect,
    Permission,
    effect,
    order,
    passes,
)
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.layout import MAGIC_1, SENDER_AT_1, SENDER_AT_2
from skyway.link.wire.seen import SeenFrames

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from skyway.link.forwarding.clients import Client, Endpoint
    from skyway.link.wire.messages import Message
    from skyway.link.wire.signing import Signing

POLL_S = 0.02
"""Longest interval between reads of the clients."""
SILENT_S = 5.0
"""A sender that has been silent for this long may move to another client."""
_MUTED_S = 10.0
_GARBAGE_BYTES = 4096
_MAX_SENDERS = 64
_DENIED, _MISSION_DENIED = 2, 14
_INVALID_AUTOPILOT = 8
_LOGS, _ASKS_FOR_LOGS = frozenset(("LOG_ENTRY", "LOG_DATA")), frozenset(("LOG_REQUEST_LIST", "LOG_REQUEST_DATA"))
_UPLOADS = frozenset(("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST"))


class Forwarder:
    """Passes packets of the vehicles to clients, and those of clients to the vehicles, as far as permitted.

    Nothing here waits: packets that a client does not read are lost to it. `own` is our system and component, `signing` makes the
    state of a link that must be signed. `open_endpoint` documents the errors of addresses.
    """

    def __init__(
        self,
        addresses: Sequence[str],
        permission: Permission = Permission.PILOT,
        *,
        own: tuple[int, int],
        signing: Callable[[], Signing | None] = lambda: None,
    ) -> None:
        self.permission, self.own = permission, own
        self.endpoints: list[Endpoint] = []
        self.rates_kept: Collection[int] = ()
        """Ids of the messages whose rates we set ourselves."""
        self._noted = Notes()
        self._vehicles: dict[int, float] = {}
        self._to_clients, self._to_vehicles = SeenFrames(), SeenFrames()
        self._muted: dict[Client, float] = {}
        self._wants_logs: Client | None = None
        self._signs = signing() is not None
        try:
            for text in addresses:
                self.endpoints.append(open_endpoint(text, signing))
        except Exception:
            self.close()
            raise

    def clients(self) -> Iterator[Client]:
        """Yield all clients."""
        for endpoint in self.endpoints:
            yield from endpoint.clients

    @property
    def tell(self) -> Callable[[Note], None] | None:
        """Called with each note at once; without it notes are kept for `notes`."""
        return self._noted.tell

    @tell.setter
    def tell(self, told: Callable[[Note], None] | None) -> None:
        self._noted.tell = told

    def notes(self) -> list[Note]:
        """Return the notes since the last call, the oldest first."""
        return self._noted.all()

    # From the vehicles

    def hand_out(self, frame: bytes, message: Message | None, now_s: float) -> None:
        """Pass a frame from the vehicles' side to its target clients."""
        sender = _sender(frame) if message is None else (message.system, message.component)
        if self._lives_with_client(sender[0], now_s):
            return  # it came from a client, and has been sent back
        self._vehicles[sender[0]] = now_s
        if len(self._vehicles) > 255:
            self._vehicles.clear()
        if not self._to_clients.fresh(frame, now_s):
            return
        fields: dict[str, Any] = {} if message is None else message.fields
        system, component = fields.get("target_system", 0), fields.get("target_component", 0)
        if (system, component) == self.own:
            return
        for_one = message is not None and message.name in _LOGS
        for client in self.clients():
            if for_one and client is not self._wants_logs:
                continue  # pieces of a log have no target: they are for the latest requester
            if system == 0 or _hears(client, system, component):
                client.put(frame)

    def announce(self, frame: bytes, now_s: float) -> None:
        """Pass a broadcast of our own to all clients."""
        self._to_clients.fresh(frame, now_s)
        for client in self.clients():
            client.put(frame)

    def came_back(self, frame: bytes, now_s: float) -> bool:
        """Whether a frame from the vehicles' side is an echo of a frame passed on from a client."""
        return self._to_vehicles.holds(frame, now_s)

    def _lives_with_client(self, system: int, now_s: float) -> bool:
        if system in self._vehicles and now_s <= self._vehicles[system] + SILENT_S:
            return False
        return any(
            known == system and now_s <= heard + SILENT_S
            for client in self.clients()
            for (known, _), heard in client.speakers.items()
        )

    def flush(self) -> None:
        """Send the queued data of the clients."""
        for client in self.clients():
            client.flush()

    # From the clients

    def collect(self, now_s: float, busy: str = "") -> Iterator[tuple[int, bytes, Message]]:
        """Yield the permitted packets from clients to the vehicles: target system (0: all), frame and message.

        Messages that begin with `busy` are held back: a transfer of our own of that kind is in progress.
        """
        if busy and any(name.startswith(busy) for name in _LOGS):
            self._wants_logs = None
        for endpoint in self.endpoints:
            for client, data in endpoint.poll(now_s):
                if not self._within(client, len(data), now_s):
                    continue
                found = False
                for frame, message in client.reader.feed(data):
                    found = True
                    target = self._taken(client, frame, message, now_s, busy)
                    if target is not None and message is not None:
                        yield target, frame, message
                self._weigh_garbage(client, 0 if found else len(data), now_s)

    def _within(self, client: Client, size: int, now_s: float) -> bool:
        """Whether a client is within its rate limit."""
        if now_s < self._muted.get(client, now_s):
            return False
        if client.allowance.takes(size, now_s):
            return True
        client.flooded += 1
        said = f"client {client.name} floods the link: what exceeds 25 kB or 200 packets a second is dropped"
        self._noted.take(client, None, "flood", None, said, now_s, fold_s=60.0)
        return False

    def _weigh_garbage(self, client: Client, size: int, now_s: float) -> None:
        client.garbage_bytes = client.garbage_bytes + size if size else 0
        if client.garbage_bytes < _GARBAGE_BYTES:
            return
        client.garbage_bytes = 0
        self._muted = {one: until for one, until in self._muted.items() if now_s < until}
        self._muted[client] = now_s + _MUTED_S
        what = "does not send MAVLink" + (" signed with our key" if self._signs else "")
        self._noted.take(
            client, None, "garbage", None, f"client {client.name} {what}: it is ignored", now_s, fold_s=60.0
        )

    def _taken(self, client: Client, frame: bytes, message: Message | None, now_s: float, busy: str) -> int | None:
        """Target of a permitted frame; None for any other."""
        sender = _sender(frame) if message is None else (message.system, message.component)
        if self._refused_sender(client, frame, message, sender, now_s) or self._to_vehicles.holds(frame, now_s):
            return None
        if message is None or (busy and message.name.startswith(busy)):
            return None  # its target is unknown; or a vehicle does one such transfer at a time
        self._meet(client, sender, now_s)
        does = effect(message, self.rates_kept)
        if does is Effect.CHANGE and "target_system" not in message.fields:
            return None  # telemetry of another vehicle: vehicles do not use it
        target: int = message.fields.get("target_system", 0)
        if passes(does, self.permission):
            self._to_vehicles.fresh(frame, now_s)
            if message.name in _ASKS_FOR_LOGS:
                self._wants_logs = client
            if does is not Effect.READ:
                said = f"client {client.name} (system {sender[0]}) sends {order(message)}{_to(target)}: passed on"
                self._noted.take(client, sender, "passed", order(message), said, now_s)
            return target
        self._refuse(client, message, sender, does, now_s)
        return None

    def _refused_sender(
        self, client: Client, frame: bytes, message: Message | None, sender: tuple[int, int], now_s: float
    ) -> bool:
        """Whether a packet is our own, an echo, or in the name of a vehicle."""
        if self._to_clients.holds(frame, now_s):
            said = f"client {client.name} echoes packets (a loop of routers): its echoes are dropped"
        elif self._is_vehicle(sender[0], message, now_s):
            said = f"client {client.name} speaks as vehicle {sender[0]}: those packets are dropped"
        elif sender == self.own:
            said = f"client {client.name} uses our system and component id, {sender[0]} and {sender[1]}: change its id"
        else:
            return False
        self._noted.take(client, None, "impersonates", None, said, now_s, fold_s=60.0)
        return True

    def _is_vehicle(self, system: int, message: Message | None, now_s: float) -> bool:
        """Whether a system is known as a vehicle, or claims to be one."""
        if message is not None and message.name == "HEARTBEAT" and message["autopilot"] != _INVALID_AUTOPILOT:
            return True
        return system in self._vehicles and now_s <= self._vehicles[system] + SILENT_S

    def _meet(self, client: Client, sender: tuple[int, int], now_s: float) -> None:
        if sender not in client.speakers:
            if len(client.speakers) >= _MAX_SENDERS:
                return
            said = f"client {client.name} joined (system {sender[0]}, component {sender[1]})"
            self._noted.take(client, sender, "joined", None, said, now_s, fold_s=60.0)
        client.speakers[sender] = now_s

    def _refuse(self, client: Client, message: Message, sender: tuple[int, int], does: Effect, now_s: float) -> None:
        """Report that a message is not passed on, also to the sender that waits for an answer."""
        target = message.fields.get("target_system", 0)
        if does is Effect.RATE:
            self._answer(client, message, sender)
            return
        needs = Permission.PILOT if does is Effect.PILOT else Permission.ALL
        said = f"client {client.name} (system {sender[0]}) sends {order(message)}{_to(target)}: refused"
        self._noted.take(
            client, sender, "refused", order(message), f"{said}; --forward-commands {needs} passes it on", now_s
        )
        self._answer(client, message, sender)

    def _answer(self, client: Client, message: Message, sender: tuple[int, int]) -> None:
        """Answer in the vehicle's place a message that is not passed on."""
        target = message.fields.get("target_system", 0)
        to = {"target_system": sender[0], "target_component": sender[1]}
        writer = FrameWriter(target, message.fields.get("target_component", 0) or 1)
        if not target or self._signs:  # it targets no vehicle's id, or the answer would need the vehicle's signature
            return
        if message.name.startswith("COMMAND_"):
            fields = {"command": message["command"], "result": _DENIED, **to}
            client.put(writer.frame("COMMAND_ACK", fields))
        elif message.name in _UPLOADS:
            fields = {"type": _MISSION_DENIED, "mission_type": message.fields.get("mission_type", 0), **to}
            client.put(writer.frame("MISSION_ACK", fields))

    def close(self) -> None:
        """Close all endpoints; queued data are sent first."""
        self.flush()
        for endpoint in self.endpoints:
            endpoint.close()


def _hears(client: Client, system: int, component: int) -> bool:
    """Whether a client has a station of that system and component (0: any)."""
    if component:
        return (system, component) in client.speakers
    return any(known == system for known, _ in client.speakers)


def _sender(frame: bytes) -> tuple[int, int]:
    at = SENDER_AT_1 if frame[0] == MAGIC_1 else SENDER_AT_2
    return frame[at], frame[at + 1]


def _to(system: int) -> str:
    return f" to vehicle {system}" if system else ""
