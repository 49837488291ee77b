"""Lockstep shared by several processes: time passes only while all participants wait.

Each participant has a connection. It is running from an answer on until it asks to wait, for bytes of its vehicle or for an instant; once
all wait, the world goes on to the next beat, or to the first instant that is waited for. So many programs drive many vehicles as fast as
their machine can, on as many cores, and none is ever late. A participant whose connection breaks without a good-bye was killed: the world
goes on for its grace without it, and then waits, for a time of the wall's, until somebody takes its place.

A frame is its length (4 bytes), a letter and what belongs to it; every answer begins with the time, in seconds since the start.
"""

from __future__ import annotations

import json
import math
import select
import socket
import struct
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.models.queues.pad_service import encode
from skyway.sim_stub.transports.channel import Impairment, Lane
from skyway.sim_stub.transports.pad_server import answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.world import World

JOIN, WRITE, READ, SLEEP, PADS, ORDER, LEAVE = b"J", b"W", b"R", b"S", b"P", b"O", b"L"
"""Join; bytes to the vehicle; wait for bytes; wait for an instant; a line to the pads; something done to the world; good-bye."""
LENGTH, TIME = struct.Struct("<I"), struct.Struct("<d")
BEAT_S, HEARD_S = 0.2, 1.0
"""Bytes reach a participant at multiples of the first where it has sent some, and else of the second: so many vehicles are heard at once, and
their programs run side by side."""
UNANSWERED = frozenset((0, 252))
"""Messages that no vehicle answers: HEARTBEAT, NAMED_VALUE_INT."""
ABSENT_WALL_S = 90.0
"""So long, of the wall's time, the world waits for somebody in the place of one that was killed."""
HELD_WALL_S = 0.05
"""How often, of the wall's time, participants with the name of one that is waited for are answered: they try to take its place."""
IDLE_WALL_S, LOOK_WALL_S = 600.0, 2.0
"""A world ends after so long without participants; how often it looks meanwhile whether it is over."""
AWAITED_WALL_S = 300.0
"""So long it stands still until somebody comes who was announced."""
MAX_FRAME = 1 << 20
_BACKLOG = 512


@dataclass(eq=False)
class Participant:
    """One connection to the world."""

    connection: socket.socket
    name: str = ""
    grace_s: float = math.inf
    """Simulated time for which the world goes on without it once it was killed; infinite: it is not waited for."""
    lane: Lane | None = None
    until_s: float | None = None
    """The instant that it waits for; None while it runs."""
    reads: bool = False
    """It waits for bytes, too."""
    wrote: bool = False
    """It has sent bytes that are answered since it was last answered: what the vehicle says to them is not kept waiting."""
    received: bytearray = field(default_factory=bytearray)


@dataclass(frozen=True, slots=True)
class Absent:
    """A participant that was killed, or is yet to come."""

    name: str
    until_s: float
    given_up_wall_s: float


class SharedLockstep:
    """A world with participants; `serve` runs it until it is ended, or has been without participants for long.

    Parameters
    ----------
    world : World
        The world.
    host, port : str, int
        Where it listens.
    over : callable
        Whether no participant can come any more; asked while there is none.
    """

    def __init__(
        self, world: World, host: str = "127.0.0.1", port: int = 0, *, over: Callable[[], bool] = lambda: False
    ) -> None:
        self.world, self._over = world, over
        self.now_s = world.sim_s
        self._listener = socket.create_server((host, port), backlog=_BACKLOG)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._all: dict[socket.socket, Participant] = {}
        self._absent: list[Absent] = []
        self.ended = False

    def serve(self) -> None:
        """Let time pass until a client ends it (order ``end``), or it has no participants and is over, or has had none for long."""
        while not self.ended:
            running = [one for one in self._all.values() if one.until_s is None]
            if running:
                self._hear(None)
            elif not self._all:
                self._wait_for_somebody()
            elif not self._advance():
                self._wake_stand_ins()
                self._hear(HELD_WALL_S)  # held for somebody in the place of one that was killed
            else:
                self._hear(0.0)
        for one in list(self._all.values()):
            one.connection.close()
        self._listener.close()

    def _wait_for_somebody(self) -> None:
        until_wall_s = time.monotonic() + IDLE_WALL_S
        while not self._all and not self.ended:
            self._hear(LOOK_WALL_S)
            self.ended = not self._all and (time.monotonic() >= until_wall_s or self._over())

    # Time

    def _advance(self) -> bool:
        """Let time pass to the next beat, or to what is waited for; false where it may not."""
        waits = [one for one in self._all.values() if one.until_s is not None]
        limit = min(one.until_s for one in waits if one.until_s is not None)
        wall_s = time.monotonic()
        self._absent = [one for one in self._absent if wall_s < one.given_up_wall_s]
        held = min((one.until_s for one in self._absent), default=math.inf)
        if self.now_s >= held:
            return False
        world = self.world
        beat = (math.floor(self.now_s / BEAT_S + 1e-9) + 1) * BEAT_S
        due = min(world.next_due_s(), world.next_wall_s())
        if due > beat:
            beat = math.ceil(due / BEAT_S - 1e-9) * BEAT_S if math.isfinite(due) else math.inf
        now = self.now_s = max(self.now_s, min(beat, limit, held))
        world.advance(now, now)
        if world.next_wall_s() <= now:
            world.advance(now, now)
        on_beat = now >= beat - 1e-9
        heard = on_beat and _is_multiple(now, HEARD_S)
        for one in waits:
            if one.lane is not None and one.reads and (heard or (on_beat and one.wrote)) and one.lane.inbox:
                self._answer(one, self._bytes_of(one.lane))
            elif one.until_s is not None and one.until_s <= now + 1e-9:
                self._answer(one, self._bytes_of(one.lane) if one.reads and one.lane is not None else b"")
        return True

    def _wake_stand_ins(self) -> None:
        """Answer those who wait for an instant under the name of one that was killed: time stands still until they take its place."""
        names = {one.name for one in self._absent if self.now_s >= one.until_s}
        for one in [one for one in self._all.values() if one.name in names and one.until_s is not None]:
            self._answer(one, self._bytes_of(one.lane) if one.reads and one.lane is not None else b"")

    @staticmethod
    def _bytes_of(lane: Lane) -> bytes:
        data = b"".join(lane.inbox)
        lane.inbox.clear()
        return data

    # Talking

    def _hear(self, timeout_s: float | None) -> None:
        ready, _, _ = select.select([self._listener, *self._all], [], [], timeout_s)
        for one in ready:
            if one is self._listener:
                connection, _ = self._listener.accept()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._all[connection] = Participant(connection)
            else:
                self._receive(self._all[one])

    def _receive(self, one: Participant) -> None:
        try:
            data = one.connection.recv(1 << 16)
        except OSError:
            data = b""
        if not data:
            self._drop(one, killed=True)
            return
        one.received += data
        while len(one.received) >= LENGTH.size:
            (length,) = LENGTH.unpack_from(one.received)
            if not 1 <= length <= MAX_FRAME:
                self._drop(one, killed=False)
                return
            if len(one.received) < LENGTH.size + length:
                return
            frame = bytes(one.received[LENGTH.size : LENGTH.size + length])
            del one.received[: LENGTH.size + length]
            try:
                self._take(one, frame[:1], frame[1:])
            except (ValueError, KeyError, TypeError, struct.error, SkywayError) as error:
                self._answer(one, json.dumps({"error": str(error)}).encode())

    def _take(self, one: Participant, letter: bytes, body: bytes) -> None:
        if letter == WRITE and one.lane is not None:
            one.lane.arrived(body, self.now_s)
            one.wrote = one.wrote or _message_id(body) not in UNANSWERED
        elif letter == READ and one.lane is not None:
            (timeout_s,) = TIME.unpack(body)
            if one.lane.inbox or not timeout_s > 0.0:
                self._answer(one, self._bytes_of(one.lane))
            else:
                one.reads, one.until_s = True, self.now_s + timeout_s
        elif letter == SLEEP:
            (instant_s,) = TIME.unpack(body)
            one.reads, one.until_s = False, max(instant_s, self.now_s)
        elif letter == PADS and self.world.pads is not None:
            self._answer(one, encode(answer(self.world.pads, body)))
        elif letter == ORDER:
            self._answer(one, json.dumps(self._order(json.loads(body))).encode())
        elif letter == JOIN:
            self._join(one, json.loads(body))
        elif letter == LEAVE:
            self._drop(one, killed=False)
        else:
            raise ValueError(f"cannot be asked: {letter!r}")

    def _join(self, one: Participant, asked: dict[str, Any]) -> None:
        one.name, one.grace_s = str(asked.get("name", "")), float(asked.get("grace_s", math.inf))
        system = asked.get("system")
        if system is not None:
            one.lane = Lane(self.world.vehicles[int(system)], Impairment(), one.name, datagrams=True)
        self._absent = [other for other in self._absent if other.name != one.name]
        self._answer(one, json.dumps({"epoch_s": self.world.epoch_s}).encode())

    def _order(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Do something to the world that is done by hand in a real one."""
        what, vehicle = asked["do"], self.world.vehicles.get(int(asked.get("system", 0)))
        if what == "inject":
            self.world.inject(str(asked["fault"]))
        elif what == "load" and vehicle is not None:
            vehicle.body.payload_kg = float(asked["kg"])
            vehicle.event(f"is loaded with {float(asked['kg']):g} kg {vehicle.place()}")
        elif what == "await":
            self._absent.append(Absent(str(asked["name"]), self.now_s, time.monotonic() + AWAITED_WALL_S))
        elif what == "end":
            self.ended = True
        elif what == "look":
            return {
                str(number): {
                    "lat": one.body.lat, "lon": one.body.lon, "soc": one.battery.soc, "active": one.active, "at": one.station(),
                    "payload_kg": one.body.payload_kg,
                }
                for number, one in self.world.vehicles.items()
            }  # fmt: skip
        else:
            raise ValueError(f"cannot be done: {what}")
        return {}

    def _answer(self, one: Participant, body: bytes) -> None:
        one.until_s, one.wrote = None, False
        try:
            one.connection.sendall(LENGTH.pack(TIME.size + len(body)) + TIME.pack(self.now_s) + body)
        except OSError:
            self._drop(one, killed=True)

    def _drop(self, one: Participant, *, killed: bool) -> None:
        if self._all.pop(one.connection, None) is None:
            return
        one.connection.close()
        if one.lane is not None:
            one.lane.close()
        if killed and math.isfinite(one.grace_s):
            self._absent.append(Absent(one.name, self.now_s + one.grace_s, time.monotonic() + ABSENT_WALL_S))


def _is_multiple(instant_s: float, of_s: float) -> bool:
    return abs(instant_s / of_s - round(instant_s / of_s)) < 1e-6


def _message_id(frame: bytes) -> int:
    """Message of a MAVLink frame; -1 where it is none."""
    if len(frame) < 10:
        return -1
    return int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
