"""The pad service over TCP: one JSON line per request and per reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.queues.pad_service import (
    MAX_LINE_BYTES,
    DroneOnPad,
    PadAnswer,
    PadServiceError,
    decode_request,
    encode,
)
from skyway.sim_stub.transports.tcp import TcpListener, TcpPeer

if TYPE_CHECKING:
    import selectors
    import socket

    from skyway.models.base.address import Address
    from skyway.sim_stub.pads import Pads

MAX_CLIENTS = 32


def answer(pads: Pads, line: bytes) -> PadAnswer:
    """Do what a line asks for; every refusal is an answer."""
    try:
        request = decode_request(line)
        drone: DroneOnPad | None = None
        if request.op == "charge":
            drone = pads.charge(request.station, request.drone, request.to_soc)
        elif request.op == "release":
            drone = pads.release(request.station, request.drone)
        return PadAnswer(ok=True, station=pads.status(request.station), drone=drone)
    except PadServiceError as error:
        return PadAnswer(ok=False, error=str(error))


class PadPeer(TcpPeer):
    """One client of the pads; charging continues without it."""

    def __init__(self, connection: socket.socket, selector: selectors.BaseSelector, pads: Pads) -> None:
        super().__init__(connection, selector)
        self.pads = pads
        self.begun = b""
        self.answers = b""

    def received(self, data: bytes) -> None:
        """Answer the lines that are complete; a line too long ends the connection."""
        *lines, self.begun = (self.begun + data).split(b"\n")
        for line in lines:
            if line.strip():
                self.answers += encode(answer(self.pads, line[: MAX_LINE_BYTES + 1]))
        if len(self.begun) > MAX_LINE_BYTES:
            self.answers += encode(PadAnswer(ok=False, error="the line is too long"))
            self.flush(0.0)
            self.close()

    def outgoing(self, now_s: float) -> bytes:  # noqa: ARG002
        """The answers."""
        waiting, self.answers = self.answers, b""
        return waiting


def serve_pads(address: Address, pads: Pads, selector: selectors.BaseSelector) -> TcpListener:
    """Let clients ask about the pads."""
    return TcpListener(address, selector, MAX_CLIENTS, lambda connection, _: PadPeer(connection, selector, pads))
