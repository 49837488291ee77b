"""Clients of pads: the pad service over TCP, or people."""

from __future__ import annotations

import math
import socket
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.wire.address import parse_address
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import percent
from skyway.models.queues.pad_service import (
    MAX_LINE_BYTES,
    AskedPads,
    DroneOnPad,
    PadAnswer,
    PadServiceError,
    StationStatus,
    decode_answer,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

ANSWER_S = 3.0
"""For one answer, from the connection to its last byte."""
SNAPSHOT_S = 10.0
"""For the answers of all stations."""
_MAX_ANSWER_BYTES = 64 * MAX_LINE_BYTES


class TcpPads(AskedPads):
    """A pad service at ``tcp:HOST:PORT``, one JSON line a request; opened when first needed, and again after a failure.

    An `InputError` refuses another kind of address.
    """

    def __init__(self, address: str) -> None:
        self.address = parse_address(address, option="--pads")
        if self.address.kind != "tcp":
            raise InputError(Fault("not an address of pads", field="--pads", value=address, remedy="tcp:HOST:PORT"))
        self._socket: socket.socket | None = None
        self._received = b""

    def _exchange(self, line: bytes) -> PadAnswer:
        try:
            return self._answered(line)
        except OSError as error:
            self.close()
            raise PadServiceError(f"the pad service at {self.address} failed: {error.strerror or error}") from error

    def _answered(self, line: bytes) -> PadAnswer:
        end_s = time.monotonic() + ANSWER_S
        if self._socket is None:
            self._socket = socket.create_connection((self.address.host, self.address.port), ANSWER_S)
            self._received = b""
        self._socket.sendall(line)
        while b"\n" not in self._received:
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                raise TimeoutError(None, "timed out")
            self._socket.settimeout(left_s)
            data = self._socket.recv(65536)
            if not data:
                raise ConnectionResetError(None, "it closed the connection")
            self._received += data
            if len(self._received) > _MAX_ANSWER_BYTES:
                raise ConnectionResetError(None, "its answer does not end")
        answer, _, self._received = self._received.partition(b"\n")
        return decode_answer(answer)

    @property
    def closed(self) -> bool:
        """Whether no connection is open: before the first request, and after a failure."""
        return self._socket is None

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def snapshot(
    address: str, stations: Sequence[str], *, within_s: float = SNAPSHOT_S
) -> tuple[list[StationStatus], list[str]]:
    """Ask a pad service once for each of some stations; returns what it answered, and what a person should know of the others.

    Raises a `PadServiceError` if the service cannot be reached, or answers for none of them; an `InputError` refuses the address.
    """
    pads, end_s = TcpPads(address), time.monotonic() + within_s
    found: list[StationStatus] = []
    unknown: list[str] = []
    failure: PadServiceError | None = None
    for number, station in enumerate(stations):
        if time.monotonic() > end_s or (failure is not None and pads.closed):
            unknown += stations[number:]
            break
        try:
            found.append(pads.status(station))
        except PadServiceError as error:
            failure = failure or error
            unknown.append(station)
    pads.close()
    if not found and failure is not None:
        raise failure
    if not unknown:
        return found, []
    why = f": {failure}" if failure is not None else f" within {within_s:g} s"
    return found, [f"the pad service at {pads.address} reported {len(found)} of {len(stations)} stations{why}"]


@dataclass(slots=True)
class ManualPads:
    """Pads operated by people: they are asked to charge, and confirm when it is done."""

    ask: Callable[[str], None]
    """Puts a sentence to the operator."""
    pads: Mapping[str, int]
    """How many pads each station has."""
    posix_s: Callable[[], float]
    _asked: dict[tuple[str, str], float] = field(default_factory=dict)
    _done: dict[str, float] = field(default_factory=dict)

    def status(self, station: str) -> StationStatus:
        """Return what a plan assumes: free pads, since they are not counted."""
        pads = self.pads.get(station, 0)
        return StationStatus(
            station=station, posix_s=self.posix_s(), pads=pads, busy=0, remaining_s=(), waiting=0,
            holding_spots=pads, holding_free=pads,
        )  # fmt: skip

    def charge(self, station: str, drone: str, to_soc: float) -> DroneOnPad:
        """Ask the operator to charge; asks once for each state of charge."""
        if self._asked.get((station, drone)) != to_soc:
            self._asked[station, drone] = to_soc
            self._done.pop(drone, None)
            self.ask(f"charge drone {drone} at {station} to {percent(to_soc)} (or swap its battery), then type charged")
        if drone in self._done:
            soc = self._done[drone]
            return DroneOnPad(drone=drone, state="done", soc=None if math.isnan(soc) else soc, to_soc=to_soc)
        return DroneOnPad(drone=drone, state="charging", to_soc=to_soc)

    def charged(self, drone: str, soc: float = math.nan) -> None:
        """Take the operator's confirmation; NaN where the vehicle itself reports the state of charge."""
        self._done[drone] = soc

    def release(self, station: str, drone: str) -> DroneOnPad:
        """Forget it."""
        self._asked.pop((station, drone), None)
        self._done.pop(drone, None)
        return DroneOnPad(drone=drone, state="absent")
