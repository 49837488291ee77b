"""A connection: frames in and out of one transport, separated by system id, recorded, with our own heartbeat."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from skyway.link.forwarding.forwarder import POLL_S
from skyway.link.protocol.exchange import Carrier, RoundTrip, Target
from skyway.link.protocol.stations import ANNOUNCEMENT, Stations, announcement
from skyway.link.wire.frames import FrameReader, FrameWriter, Rejected
from skyway.link.wire.radio_quality import STATUS, RadioQuality
from skyway.link.wire.redundant import RedundantTransport
from skyway.link.wire.transport import UdpSocket
from skyway.models.base.errors import StationConflictError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from skyway.link.forwarding.forwarder import Forwarder
    from skyway.link.protocol.exchange import Exchange
    from skyway.link.wire.messages import Message
    from skyway.link.wire.recorder import Recorder
    from skyway.link.wire.signing import Signing
    from skyway.link.wire.transport import Transport
    from skyway.models.base.clock import Clock

HEARTBEAT_S = 1.0
GROUND_SYSTEM, GROUND_COMPONENT = 255, 190
PLANNER_COMPONENT = 195
"""Our component id if other ground stations share the link: theirs is mostly 190, and their system id mostly equals ours."""
_GROUND_STATION, _INVALID_AUTOPILOT = 6, 8
_NO_VEHICLES = frozenset((_GROUND_STATION, 18, 26, 27, 30, 31, 32, 33, 34, 36, 37, 38, 39, 40, 41, 42, 44))
"""Types (MAV_TYPE) of other senders of heartbeats: onboard computers, gimbals, cameras, batteries, winches; some of them claim the
autopilot's firmware."""
_AUTOPILOT = 1
"""Component of an autopilot. Onboard computers beat before it, and some in its name: what first beats as another component gives way to it."""
_MAX_SYSTEMS = 255
_BESIDE = frozenset(("OPEN_DRONE_ID_ARM_STATUS", "WINCH_STATUS"))
"""Messages that parts of a vehicle send in their own name, or the autopilot in theirs."""
_FILES = frozenset(("FILE_TRANSFER_PROTOCOL", "LOG_DATA"))
"""Pieces of files, which are stored as files: recording them would store a log twice."""
_CHUNK, _CHUNK_S = 50, 1.0
"""Characters of a piece of a long text, and the longest wait for the next piece."""
_MAX_TEXTS = 200
_GUEST_S = 0.002
"""Longest delay of the other runner's messages while we wait for the vehicle's."""


@dataclass(slots=True)
class Peer:
    """One vehicle on a connection."""

    system: int
    component: int
    """`system`, `component`: of its autopilot."""
    autopilot: int = 0
    kind: int = 0
    """`autopilot`, `kind`: MAV_AUTOPILOT and MAV_TYPE of its heartbeat."""
    version: int = 2
    met_s: float = -math.inf
    heard_s: float = -math.inf
    """`met_s`, `heard_s`: times of its first and latest packet, by the connection's clock."""
    received: int = 0
    lost: int = 0
    """`received`, `lost`: packets, and gaps in their numbers."""
    sequence: int | None = None
    texts: list[tuple[int, str]] = field(default_factory=list)
    """Its texts, severity and text, the newest last; only the latest ones are kept."""
    said: int = 0
    """Total number of its texts."""
    latest: dict[str, Message] = field(default_factory=dict)
    """Newest message of each name."""
    beside: dict[str, tuple[float, Message]] = field(default_factory=dict)
    """Newest messages of its Remote ID module and its winch, with their times, by the connection's clock; heartbeats of other components as
    ``HEARTBEAT`` with their type."""
    round_trip: RoundTrip = field(default_factory=RoundTrip)
    text_s: float = -math.inf
    _text: tuple[int, int] = (0, 0)
    _text_open: bool = False

    @property
    def target(self) -> Target:
        """Target of messages to it."""
        return Target(self.system, self.component, self.round_trip)

    @property
    def loss(self) -> float:
        """Share of its packets that were lost, 0-1."""
        return self.lost / max(1, self.lost + self.received)

    def texts_since(self, said: int) -> list[str]:
        """Return its texts after the first `count`, as far as they are stored."""
        fresh = self.said - said
        return [text for _, text in self.texts[-fresh:]] if fresh > 0 else []

    def text_unfinished(self, now_s: float) -> bool:
        """Whether more pieces of the newest text may come."""
        return self._text_open and now_s < self.text_s + _CHUNK_S

    def take_text(self, message: Message, now_s: float) -> None:
        """Process a STATUSTEXT; chunks of one text (MAVLink 2) are joined."""
        severity, text = message["severity"], message["text"]
        number, chunk = message["id"], message["chunk_seq"]
        if number and chunk and self.texts and self._text == (number, chunk - 1):
            self.texts[-1] = (severity, self.texts[-1][1] + text)
        else:
            self.texts.append((severity, text))
            self.said += 1
            del self.texts[:-_MAX_TEXTS]
        self._text, self.text_s = (number, chunk), now_s
        self._text_open = bool(number) and len(text) >= _CHUNK

    def met_as(self, component: int) -> None:
        """Take another component for its autopilot, and forget what the first one said."""
        self.component, self.sequence = component, None
        self.latest.clear()


def _of_vehicle(beat: Message) -> bool:
    """Whether a heartbeat is that of an autopilot."""
    return beat["autopilot"] != _INVALID_AUTOPILOT and beat["type"] not in _NO_VEHICLES


class SharedClient(Protocol):
    """Another MAVLink library that sends on a connection in our name, with a heartbeat of its own."""

    def hear(self, frame: bytes) -> None:
        """Process an accepted frame."""
        ...

    def frames(self) -> Iterable[tuple[int, bytes]]:
        """Yield its outgoing frames, each with its target system; 0 is broadcast."""
        ...


class Connection(Carrier):
    """Frames in and out of one transport, all of them recorded; `system` is our id.

    With a signing key only correctly signed packets are accepted.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        recorder: Recorder | None = None,
        system: int = GROUND_SYSTEM,
        signing: Signing | None = None,
        forwarder: Forwarder | None = None,
    ) -> None:
        if signing is not None:
            signing.advance_to(clock.posix_s())
        self.transport, self.clock, self.recorder = transport, clock, recorder
        self.forwarder = forwarder
        """Passes packets to other ground stations, and theirs to the vehicles."""
        self.system, self.component = (system, GROUND_COMPONENT) if forwarder is None else forwarder.own
        self.peers: dict[int, Peer] = {}
        self.listeners: list[Callable[[Peer, Message], None]] = []
        self.conflict: StationConflictError | None = None
        """Set once another ground station with our id is received; nothing is sent to a vehicle then."""
        self.stations = Stations()
        """Other ground stations on the link, also those to which it is forwarded."""
        self.supervises: int | None = None
        """System of the vehicle that we supervise: announced to all other stations, every second."""
        self.commanded = False
        """Whether we have already commanded that vehicle; announced with it."""
        self.strangers: dict[tuple[int, int], tuple[int, int]] = {}
        """Senders of heartbeats that are neither vehicles nor ground stations, by system and component: MAV_TYPE and MAV_AUTOPILOT."""
        self.namesake = False
        """A vehicle has our id; its packets are indistinguishable from our own."""
        self.shared_client: SharedClient | None = None
        """Another sender on this connection; our own heartbeats pause meanwhile."""
        self.fence: Callable[[], None] | None = None
        """Called before each exchange: raises if we may no longer command the vehicle."""
        self._writer = FrameWriter(self.system, self.component, signing=signing)
        self._routed = transport if isinstance(transport, UdpSocket) else None
        self.radios = transport if isinstance(transport, RedundantTransport) else None
        """The radios, if there are several."""
        self._quality = RadioQuality("radio")
        self._reader = FrameReader(signing, datagrams=self._routed is not None or self.radios is not None)
        self._beat_s = self._second_s = -math.inf
        self.every_second: list[Callable[[], None]] = []
        """Called once a second, for messages that must be repeated."""
        self._own: deque[bytes] = deque(maxlen=16)
        self._exchange: Exchange | None = None

    @property
    def rejected(self) -> Rejected:
        """Packets that were rejected."""
        return self._reader.rejected

    @property
    def qualities(self) -> tuple[RadioQuality, ...]:
        """Quality of each radio, the active one first."""
        if self.radios is None:
            return (self._quality,)
        used = self.radios.used
        return (used.quality, *(radio.quality for radio in self.radios.radios if radio is not used))

    @property
    def signed(self) -> bool:
        """Whether it has a signing key."""
        return self._writer.signing is not None

    @property
    def wants_key(self) -> bool:
        """Whether a vehicle signs and we have no key: such vehicles rarely accept unsigned packets."""
        return self._reader.heard_signed and not self.signed

    def send(self, name: str, system: int = 0, **fields: Any) -> None:
        """Send a message; as MAVLink 1 to a vehicle that uses only that."""
        peer = self.peers.get(system)
        self._pass_on(self._writer.frame(name, fields, None if peer is None else peer.version), system)

    def _pass_on(self, frame: bytes, system: int) -> None:
        if self.recorder is not None:
            self.recorder.frame(frame)
        if system and self._routed is not None:
            self._routed.write_to(system, frame)
        else:
            self.transport.write(frame)

    def pump(self, timeout_s: float = 0.0) -> None:
        """Process received data, waiting for them at most a given time; send our heartbeat."""
        now = self.clock.now_s()
        if self.forwarder is not None:
            timeout_s = min(timeout_s, POLL_S)
            self._serve_clients(self.forwarder, now)
        if now >= self._second_s + HEARTBEAT_S:
            self._second_s = now
            for keep in tuple(self.every_second):
                keep()
        if self.shared_client is not None:
            due_s = now + _GUEST_S
            for system, frame in self.shared_client.frames():
                if not system:
                    self._own.append(frame)
                self._pass_on(frame, system)
        else:
            if now >= self._beat_s + HEARTBEAT_S:
                self._beat(now)
            due_s = self._beat_s + HEARTBEAT_S
        data = self.transport.read(max(0.0, min(timeout_s, due_s - now)))
        if data:
            self._take(data)

    def _serve_clients(self, forwarder: Forwarder, now: float) -> None:
        forwarder.flush()
        asked = self._exchange
        busy = "" if asked is None or asked.done else asked.transfers
        for system, frame, message in forwarder.collect(now, busy):
            self.stations.hear(message, now)
            self._pass_on(frame, system)

    def _beat(self, now: float) -> None:
        self._beat_s = now
        fields = {"type": _GROUND_STATION, "autopilot": _INVALID_AUTOPILOT, "system_status": 4, "mavlink_version": 3}
        old = any(peer.version == 1 for peer in self.peers.values())
        for version in (1, 2) if old else (2,):  # one that sends 1 may know 2, and waits for it (MAV_PROTO_VER 0)
            frame = self._writer.frame("HEARTBEAT", fields, version)
            self._own.append(frame)
            self._pass_on(frame, 0)
            if self.forwarder is not None:
                self.forwarder.announce(frame, now)
        if self.supervises is not None:
            frame = self._writer.frame(ANNOUNCEMENT, announcement(self.supervises, under_way=self.commanded))
            self._own.append(frame)
            self._pass_on(frame, 0)
            if self.forwarder is not None:
                self.forwarder.announce(frame, now)

    def _take(self, data: bytes) -> None:
        now = self.clock.now_s()
        for frame, message in self._reader.feed(data):
            if self.recorder is not None and (message is None or message.name not in _FILES):
                self.recorder.frame(frame)
            if self.radios is None and frame not in self._own and (message is None or message.name not in STATUS):
                self._quality.count(frame, now)
            if self.forwarder is not None:
                if self.forwarder.came_back(frame, now):
                    continue
                if frame not in self._own:
                    self.forwarder.hand_out(frame, message, now)
            if message is not None and frame not in self._own:  # routers send our own packets back
                self._hear(message, now)
            if self.shared_client is not None:
                self.shared_client.hear(frame)

    def _hear(self, message: Message, now: float) -> None:
        name = message.name
        if name in STATUS:
            if self.radios is None:  # each of several radios has its own
                self._quality.hear_status(message)
            return  # without a sender, and even unsigned
        if message.system == self.system:
            self._hear_namesake(message)
            return
        if self.stations.hear(message, now):
            return
        peer = self.peers.get(message.system)
        if peer is None:
            peer = self._meet(message, now)
            if peer is None:
                if name == "HEARTBEAT" and len(self.strangers) < _MAX_SYSTEMS:
                    self.strangers[message.system, message.component] = message["type"], message["autopilot"]
                return
        if name == "HEARTBEAT" and message.component == _AUTOPILOT != peer.component and _of_vehicle(message):
            peer.met_as(_AUTOPILOT)
        own = message.component == peer.component
        if name in _BESIDE or (name == "HEARTBEAT" and not own):
            peer.beside[name if name in _BESIDE else f"{name} {message['type']}"] = now, message
        if not own:
            return
        if self._routed is not None and not self._routed.learn(peer.system, proven=self.signed):
            self.rejected.elsewhere += 1
            return
        self._count(peer, message, now)
        if name == "STATUSTEXT":
            peer.take_text(message, now)
        peer.latest[name] = message
        for listener in self.listeners:
            listener(peer, message)
        asked = self._exchange
        if asked is not None and asked.target.system == message.system and not asked.done and self._for_us(message):
            asked.hear(message, now)

    def _hear_namesake(self, message: Message) -> None:
        if message.name != "HEARTBEAT":
            return
        if message["type"] == _GROUND_STATION:
            self.conflict = self.conflict or StationConflictError(message.system, message.component)
        elif message["autopilot"] != _INVALID_AUTOPILOT:
            self.namesake = True

    def forget_address(self, system: int) -> None:
        """Let the next packet in the name of a vehicle determine its address: the sender so far is another one."""
        if self._routed is not None:
            self._routed.forget(system)

    def keep_rates(self, numbers: Collection[int]) -> None:
        """Prevent other ground stations from changing the rates of these messages."""
        if self.forwarder is not None:
            self.forwarder.rates_kept = frozenset((*self.forwarder.rates_kept, *numbers))

    def supervise(self, system: int | None, *, commanded: bool = False) -> None:
        """Announce to all other stations, every second, that we supervise a vehicle, and whether we have already commanded it."""
        self.supervises, self.commanded = system, commanded

    @property
    def transferring(self) -> bool:
        """Whether a transfer of ours is in progress, during which no other of its kind may start."""
        return self._exchange is not None and not self._exchange.done and bool(self._exchange.transfers)

    def refuse_conflict(self) -> None:
        """Refuse to send to a vehicle that cannot distinguish us from another station.

        Raises a `StationConflictError` if another station uses our system id.
        """
        if self.conflict is not None:
            raise StationConflictError(self.conflict.system, self.conflict.component)

    def _meet(self, message: Message, now: float) -> Peer | None:
        """Register a vehicle at the first heartbeat of its autopilot."""
        if message.name != "HEARTBEAT" or message.system == 0 or not _of_vehicle(message):
            return None
        if len(self.peers) >= _MAX_SYSTEMS:
            return None
        peer = Peer(message.system, message.component, met_s=now)
        self.peers[message.system] = peer
        return peer

    def _count(self, peer: Peer, message: Message, now: float) -> None:
        if peer.sequence is not None and self.radios is None:  # each of several radios counts its own
            gap = (message.sequence - peer.sequence - 1) & 0xFF
            if gap < 128:
                peer.lost += gap
        peer.sequence = message.sequence
        peer.received += 1
        peer.heard_s = now
        if message.name == "HEARTBEAT":
            peer.autopilot, peer.kind, peer.version = message["autopilot"], message["type"], message.version

    def _for_us(self, message: Message) -> bool:
        system = message.fields.get("target_system", 0)
        component = message.fields.get("target_component", 0)
        return system in (0, self.system) and component in (0, self.component)

    def _carry_out(self, exchange: Exchange) -> None:
        if self.fence is not None:
            self.fence()
        self.refuse_conflict()
        self._exchange = exchange
        try:
            exchange.begin(self.clock.now_s())
            self._flush(exchange)
            while not exchange.done:
                self.pump(min(exchange.next_s - self.clock.now_s(), HEARTBEAT_S))
                self.refuse_conflict()
                now = self.clock.now_s()
                if not exchange.done and now >= exchange.next_s:
                    exchange.tick(now)
                self._flush(exchange)
        finally:
            self._exchange = None

    def _flush(self, exchange: Exchange) -> None:
        for name, fields in exchange.outbox:
            self.send(name, exchange.target.system, **fields)
        exchange.outbox.clear()

    def wait(self, condition: Callable[[], bool], longest_s: float) -> bool:
        """Process received data until a condition holds; False if it does not hold in time."""
        end = self.clock.now_s() + longest_s
        while not condition():
            left = end - self.clock.now_s()
            if left <= 0.0:
                return False
            self.pump(left)
        return True

    def run_for(self, duration_s: float) -> None:
        """Process received data for a while."""
        self.wait(lambda: False, duration_s)

    def close(self) -> None:
        """Close transport, clients and recording."""
        try:
            self.transport.close()
            if self.forwarder is not None:
                self.forwarder.close()
        finally:
            if self.recorder is not None:
                self.recorder.close()
