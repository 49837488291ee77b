"""A participant in a shared lockstep: the clock, the link to a vehicle and the pads of a world in another process."""

from __future__ import annotations

import json
import math
import socket
import threading
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import LinkLostError
from skyway.models.queues.pad_service import AskedPads, decode_answer
from skyway.sim_stub.transports.shared_lockstep import JOIN, LEAVE, LENGTH, ORDER, PADS, READ, SLEEP, TIME, WRITE

if TYPE_CHECKING:
    from skyway.models.queues.pad_service import PadAnswer


class LockstepClient:
    """One participant: satisfies `models.base.clock.Clock`, and `Transport` where it is linked to a vehicle.

    The world stands still from each answer on until this participant waits again. For one thread at a time.

    Parameters
    ----------
    address : str
        ``HOST:PORT`` of the world.
    name : str
        Who takes part; one of the same name takes the place of one that was killed.
    system : int, optional
        System id of the vehicle that it is linked to.
    grace_s : float
        Simulated time for which the world goes on without it once it was killed; infinite: it is not waited for.
    """

    def __init__(self, address: str, name: str, *, system: int | None = None, grace_s: float = math.inf) -> None:
        host, _, port = address.rpartition(":")
        try:
            self._socket = socket.create_connection((host, int(port)))
        except (OSError, ValueError) as error:
            raise LinkLostError(f"the simulated world at {address} cannot be reached: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unsent, self._received = bytearray(), bytearray()
        self._lock = threading.Lock()
        self._now_s = 0.0
        asked = {"name": name, "system": system} | ({"grace_s": grace_s} if math.isfinite(grace_s) else {})
        self.epoch_s = float(json.loads(self._ask(JOIN, json.dumps(asked).encode()))["epoch_s"])

    def _ask(self, letter: bytes, body: bytes) -> bytes:
        with self._lock:
            self._send(letter, body)
            return self._heard()

    def _send(self, letter: bytes, body: bytes) -> None:
        self._unsent += LENGTH.pack(1 + len(body)) + letter + body
        try:
            self._socket.sendall(self._unsent)
            self._unsent.clear()
        except OSError as error:
            raise LinkLostError(f"the simulated world is gone: {error}") from error

    def _heard(self) -> bytes:
        received = self._received
        while True:
            if len(received) >= LENGTH.size:
                (length,) = LENGTH.unpack_from(received)
                if len(received) >= LENGTH.size + length:
                    frame = bytes(received[LENGTH.size : LENGTH.size + length])
                    del received[: LENGTH.size + length]
                    (self._now_s,) = TIME.unpack_from(frame)
                    return frame[TIME.size :]
            try:
                data = self._socket.recv(1 << 16)
            except OSError as error:
                raise LinkLostError(f"the simulated world is gone: {error}") from error
            if not data:
                raise LinkLostError("the simulated world has ended")
            received += data

    # Clock

    def now_s(self) -> float:
        """Seconds since the start of the world."""
        return self._now_s

    def posix_s(self) -> float:
        """POSIX seconds of the simulated instant."""
        return self.epoch_s + self._now_s

    def sleep_until(self, instant_s: float) -> None:
        """Let time pass until an instant."""
        self._ask(SLEEP, TIME.pack(instant_s))

    # Transport

    def write(self, data: bytes) -> None:
        """Send bytes to the vehicle: they leave with what is asked next, before which no time passes."""
        with self._lock:
            self._unsent += LENGTH.pack(1 + len(data)) + WRITE + data

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Bytes from the vehicle; lets time pass until there are some or the time-out is over (then empty)."""
        return self._ask(READ, TIME.pack(timeout_s))

    def close(self) -> None:
        """Take part no longer."""
        try:
            self._send(LEAVE, b"")
        except LinkLostError:
            pass
        finally:
            self._socket.close()

    # The world

    def order(self, do: str, **what: Any) -> dict[str, Any]:
        """Have something done to the world by hand: ``inject`` a fault, ``load`` a package, ``look``, ``await`` a participant, ``end``."""
        found: dict[str, Any] = json.loads(self._ask(ORDER, json.dumps({"do": do, **what}).encode()))
        if "error" in found:
            raise LinkLostError(f"the simulated world refuses: {found['error']}")
        return found

    def pads_line(self, line: bytes) -> PadAnswer:
        """Put a line to the pads."""
        return decode_answer(self._ask(PADS, line))


class LockstepPads(AskedPads):
    """The pads of a world in another process; satisfies `models.queues.pad_service.PadService`."""

    def __init__(self, client: LockstepClient) -> None:
        self._client = client

    def _exchange(self, line: bytes) -> PadAnswer:
        return self._client.pads_line(line)
