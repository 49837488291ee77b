"""A lossy relay between two other programs: forwards datagrams in real time and drops some."""

from __future__ import annotations

import random
import selectors
import socket
import threading
import time
from typing import TYPE_CHECKING, Self

from skyway.sim_stub.transports.channel import Channel

if TYPE_CHECKING:
    from types import TracebackType

    from skyway.sim_stub.transports.channel import Impairment

_READ_BYTES = 65536
_LOOPBACK = "127.0.0.1"
_LONGEST_WAIT_S = 0.1


class Relay:
    """Datagrams between a ground station and a vehicle, each of which speaks first (``udpout``) to a port of ours.

    Parameters
    ----------
    impairment : Impairment
        What the radio does, in each direction; may be changed at any time.
    seed : int
        Its luck.

    Attributes
    ----------
    ground_port, vehicle_port : int
        Where each side is to speak to, on loopback.
    """

    def __init__(self, impairment: Impairment, seed: int = 1) -> None:
        self._sockets = []
        for _ in range(2):
            opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            opened.bind((_LOOPBACK, 0))
            opened.settimeout(0.0)
            self._sockets.append(opened)
        self.ground_port, self.vehicle_port = (opened.getsockname()[1] for opened in self._sockets)
        luck = (random.Random(f"{way}/{seed}") for way in ("up", "down"))
        self._channels = [Channel(impairment, generator) for generator in luck]
        self._peers: list[tuple[str, int] | None] = [None, None]
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="relay")

    def set_impairment(self, impairment: Impairment) -> None:
        """Make the radio better or worse."""
        for channel in self._channels:
            channel.impairment = impairment

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopping.set()
        self._thread.join()
        for opened in self._sockets:
            opened.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            for side, opened in enumerate(self._sockets):
                selector.register(opened, selectors.EVENT_READ, side)
            while not self._stopping.is_set():
                due = min(channel.next_s() for channel in self._channels) - time.monotonic()
                for key, _ in selector.select(min(max(due, 0.0), _LONGEST_WAIT_S)):
                    self._read(key.data)
                now = time.monotonic()
                for side, channel in enumerate(self._channels):
                    for packet in channel.take(now):
                        self._send(1 - side, packet)

    def _read(self, side: int) -> None:
        while True:
            try:
                packet, self._peers[side] = self._sockets[side].recvfrom(_READ_BYTES)
            except OSError:  # nothing more, or nobody at the other end
                return
            self._channels[side].put(time.monotonic(), packet)

    def _send(self, side: int, packet: bytes) -> None:
        peer = self._peers[side]
        if peer is None:
            return  # nobody has spoken yet
        try:
            self._sockets[side].sendto(packet, peer)
        except OSError:
            return  # it has gone: lost, as on a radio
