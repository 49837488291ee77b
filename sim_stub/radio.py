"""The radio of a vehicle: ports, MAVLink versions, signing, streams and status texts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault, InputError
from skyway.sim_stub.protocols.remote_id import COMPONENT
from skyway.sim_stub.protocols.telemetry import (
    BUILDERS,
    HOME,
    STREAM_GROUPS,
    STREAMED,
    mission_current,
)
from skyway.sim_stub.wire.messages import Mavlink, is_version_2, message, message_id, message_name
from skyway.sim_stub.wire.ports import Port

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.sim_stub.vehicle import Vehicle

_MIN_INTERVAL_S = 0.02
_ORDERS = frozenset(("SET_MODE", "MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST", "PARAM_SET"))
"""Orders besides commands: not obeyed where another station is in control."""
_MAX_PORTS = 16
_REMOTE_ID = message_id("OPEN_DRONE_ID_ARM_STATUS")


class Radio:
    """The ports of one vehicle, and its unsolicited messages."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.ports: list[Port] = []
        self.handlers: dict[str, Callable[[Port, Any], None]] = {}
        self._reached: tuple[int, int, float] | None = None
        self._texts = 0
        self._signing_key = vehicle.config.signing_key

    def serve(self, handlers: Mapping[str, object]) -> None:
        """Have messages of these names handled."""
        self.handlers.update(handlers)  # type: ignore[arg-type]

    # Time

    def next_due_s(self) -> float:
        """Simulated instant of the next scheduled message."""
        due = math.inf if self._reached is None else self._reached[2]
        for port in self.ports:
            due = min(due, port.next_due_s)
        return due

    @property
    def shortest_s(self) -> float:
        """Interval of the message that goes out most often."""
        return min((port.shortest_s for port in self.ports), default=math.inf)

    def send_due(self, now: float) -> None:
        """Send what is due."""
        if self._reached is not None and self._reached[2] <= now:
            self._repeat_reached(now)
        for port in self.ports:
            if port.next_due_s <= now + 1e-9:
                self._stream(port, now)

    def mute(self, *, muted: bool) -> None:
        """Let nothing out, or let it out again."""
        for port in self.ports:
            port.muted = muted

    def restart(self) -> None:
        """Forget what a restart of the autopilot forgets."""
        self.forget_reached()
        for port in self.ports:
            port.mavlink.seq = 0
            port.beside.clear()
            self._default_streams(port)

    # Ports

    def connect(self, send: Callable[[bytes], None], *, datagrams: bool = True) -> Port:
        """Open a port; the vehicle's messages go to `send`. Raises an `InputError` after too many ports."""
        self.ports = [port for port in self.ports if not port.closed]
        if len(self.ports) >= _MAX_PORTS:
            raise InputError(Fault("too many connections to one vehicle", value=len(self.ports)))
        port = Port(send, Mavlink(self.vehicle.config.system), datagrams)
        port.muted = "link-loss" in self.vehicle.faults.active
        self._choose_version(port)
        self.ports.append(port)
        self.vehicle.wake()
        if self._signing_key is not None:
            self._sign(port, self._signing_key, 0)
        self._default_streams(port)
        return port

    def disconnect(self, port: Port) -> None:
        """Close a port."""
        port.closed = True
        if port in self.ports:
            self.ports.remove(port)

    def choose_versions(self) -> None:
        """Follow a parameter that selects the MAVLink version."""
        for port in self.ports:
            self._choose_version(port)

    def _choose_version(self, port: Port) -> None:
        """Speak MAVLink 1 where the parameters say so, until (in automatic) MAVLink 2 is heard."""
        port.version = self.vehicle.autopilot.mavlink_version(heard_2=port.heard_version_2)

    def set_signing(self, key: bytes | None, timestamp: int) -> None:
        """Sign, and ask for signatures, on every port from now on; None stops it."""
        self._signing_key = key
        self.vehicle.event("signing on" if key else "signing off")
        for port in self.ports:
            self._sign(port, key, timestamp)

    def _sign(self, port: Port, key: bytes | None, timestamp: int) -> None:
        port.mavlink.sign(key, timestamp, self.vehicle.posix_s)

    # Hearing

    def receive(self, port: Port, data: bytes) -> None:
        """Handle the messages for this vehicle that the bytes of a port complete."""
        own = self.vehicle.config.system
        for heard in port.hear(data):
            self._hand_on(port, heard)
            handler = self.handlers.get(heard.get_type())
            if is_version_2(heard) and not port.heard_version_2:
                port.heard_version_2 = True
                self._choose_version(port)
            if handler is None or (heard.get_srcSystem(), heard.get_srcComponent()) == (own, 1):
                continue
            if getattr(heard, "target_system", 0) not in (0, own) or getattr(heard, "target_component", 0) not in (
                0,
                1,
            ):
                continue
            if heard.get_type() in _ORDERS and self.vehicle.commands.control.denies(heard.get_srcSystem()):
                continue
            self.vehicle.tend()
            handler(port, heard)

    def _hand_on(self, port: Port, heard: Any) -> None:
        """Hand what is for others, or for all, to the other ports, as both autopilots do."""
        target = getattr(heard, "target_system", 0)
        if len(self.ports) < 2 or target == self.vehicle.config.system or heard.get_type() == "BAD_DATA":
            return
        if heard.get_srcSystem() == self.vehicle.config.system:
            return
        frame = bytes(heard.get_msgbuf())
        for other in self.ports:
            if other is not port and not other.muted:
                other.send(frame)

    # Speaking

    def say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT to every ground station, in numbered chunks where it is longer than one."""
        if self.vehicle.flight_log is not None:
            self.vehicle.flight_log.text(severity, text)
        self._texts = self._texts % 65535 + 1
        chunks = [text[i : i + 50] for i in range(0, len(text), 50)]
        if len(chunks) > 1 and len(chunks[-1]) == 50:
            chunks.append("")  # a full last chunk does not end the text
        for port in self.ports:
            for index, chunk in enumerate(chunks or [""]):
                numbered = {"id": self._texts, "chunk_seq": index} if len(chunks) > 1 else {}
                port.reply("STATUSTEXT", severity=severity, text=chunk, **numbered)

    def broadcast(self, sent: Any) -> None:
        """Send a message on every port."""
        for port in self.ports:
            port.write(sent)

    # Streams

    def _default_streams(self, port: Port) -> None:
        port.streams.clear()
        for name, rate in self.vehicle.autopilot.DEFAULT_HZ.items():
            port.set_interval(name, 1.0 / rate, self.vehicle.sim_s)
        if any(fault.kind == "aircraft" for fault in self.vehicle.faults.faults):
            port.set_interval("ADSB_VEHICLE", 1.0, self.vehicle.sim_s)
        if self.vehicle.config.remote_id:
            port.set_interval("OPEN_DRONE_ID_ARM_STATUS", 1.0, self.vehicle.sim_s)
        if self.vehicle.config.operator_control:
            port.set_interval("CONTROL_STATUS", 1.0, self.vehicle.sim_s)

    def set_interval(self, port: Port, number: int, interval_us: float) -> None:
        """Do SET_MESSAGE_INTERVAL: 0 is the default rate, -1 stops."""
        name = message_name(number) or ""
        if interval_us == 0.0:
            rate = self.vehicle.autopilot.DEFAULT_HZ.get(name)
            interval_s = 1.0 / rate if rate else None
        else:
            interval_s = None if interval_us < 0.0 else max(interval_us * 1e-6, _MIN_INTERVAL_S)
        port.set_interval(name, interval_s, self.vehicle.sim_s)

    def stream_group(self, port: Port, group: int, rate_hz: int) -> None:
        """Do REQUEST_DATA_STREAM; group 0 is every one."""
        names = [n for g, members in STREAM_GROUPS.items() if group in (0, g) for n in members]
        for name in names:
            if name not in self.vehicle.autopilot.LACKS:
                interval_s = max(1.0 / rate_hz, _MIN_INTERVAL_S) if rate_hz > 0 else None
                port.set_interval(name, interval_s, self.vehicle.sim_s)

    def _stream(self, port: Port, now: float) -> None:
        following = math.inf
        for number, stream in list(port.streams.items()):
            if stream.due_s <= now + 1e-9:
                stream.due_s += stream.interval_s
                if stream.due_s <= now:  # fell behind, as in the first step after standing
                    stream.due_s = now + stream.interval_s
                for one in self.vehicle.remote_id.says() if number == _REMOTE_ID else ():
                    port.write(one, COMPONENT)
                sent = STREAMED[number](self.vehicle)
                if sent is not None:
                    port.write(sent)
            following = min(following, stream.due_s)
        port.next_due_s = following

    # Reports of the autopilot

    def home_changed(self) -> None:
        """Tell all ground stations the position of home."""
        sent = BUILDERS[HOME](self.vehicle)
        if sent is not None:
            self.broadcast(sent)

    def tell_mission_current(self) -> None:
        """Tell all ground stations the current item."""
        self.broadcast(mission_current(self.vehicle))

    def item_reached(self, index: int) -> None:
        """Report an item as reached, and again as often as the family does."""
        self.broadcast(message("MISSION_ITEM_REACHED", seq=index))
        repeats = self.vehicle.autopilot.REACHED_REPEATS
        if repeats:
            self._reached = (index, repeats, self.vehicle.sim_s + 1.0)

    def _repeat_reached(self, now: float) -> None:
        if self._reached is None:
            return
        index, left, _ = self._reached
        self.broadcast(message("MISSION_ITEM_REACHED", seq=index))
        self._reached = (index, left - 1, now + 1.0) if left > 1 else None

    def forget_reached(self) -> None:
        """Stop repeating."""
        self._reached = None
