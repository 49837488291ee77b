"""The pad service: its messages, and the state of pads.

There is no MAVLink message for pads, so this is skyway's own: a protocol in Python, and the same as JSON lines over
TCP. One line is one request or one answer:

    {"op": "status", "station": "bellevue"}
    {"op": "charge", "station": "bellevue", "drone": "1", "to_soc": 0.8}
    {"op": "release", "station": "bellevue", "drone": "1"}

Each answer is ``{"ok": true, "station": {...}, "drone": {...} or null}`` or ``{"ok": false, "error": "..."}``.
A drone is named by its MAVLink system id in decimal. States of charge are fractions, instants POSIX seconds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal, Protocol, TypeVar

import msgspec

from skyway.models.base.errors import LinkError

MAX_LINE_BYTES = 4096
"""A longer line is not a request."""

T = TypeVar("T")
DroneState = Literal["absent", "waiting", "charging", "done"]


class PadServiceError(LinkError):
    """The pad service refused a request or failed; the message gives the remedy."""


class DroneOnPad(msgspec.Struct, frozen=True, kw_only=True):
    """Our drone at a station."""

    drone: str
    state: DroneState
    """``absent``; ``waiting`` for a pad on a holding spot; ``charging``; ``done``: charged, still on the pad."""
    soc: float | None = None
    """State of charge as the pad measures it; None if it is not on a pad."""
    to_soc: float | None = None
    """Where charging ends."""
    place_in_line: int = 0
    """Drones ahead of this one in the line."""
    pad_free_s: float | None = None
    """Expected time at which it gets a pad: POSIX seconds."""
    done_s: float | None = None
    """Expected end of charging: POSIX seconds."""


class StationStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The pads of one station at an instant."""

    station: str
    posix_s: float
    pads: int
    busy: int
    """Number of pads, and of those that are occupied."""
    remaining_s: tuple[float, ...]
    """Seconds until busy pads become free, ascending, where that is known."""
    waiting: int
    holding_spots: int
    holding_free: int
    """Spots beside the pads, and how many of them are free."""
    drones: tuple[DroneOnPad, ...] = ()
    """Drones that requested charging here."""

    @property
    def present(self) -> int:
        """Number of drones there: on the pads and in line."""
        return self.busy + self.waiting

    def others(self, drone: str) -> tuple[int, int]:
        """Others on the pads and in line: those that are ahead of a drone, and those that came after it.

        For a drone that did not request charging here, all are ahead of it.
        """
        ours = next((one for one in self.drones if one.drone == drone and one.state != "absent"), None)
        if ours is None:
            return self.present, 0
        before = self.busy + ours.place_in_line if ours.state == "waiting" else max(self.busy - 1, 0)
        return before, max(self.present - 1 - before, 0)


class PadService(Protocol):
    """What a station offers; every method may raise `PadServiceError`."""

    def status(self, station: str) -> StationStatus:
        """Return the pads of a station now."""
        ...

    def charge(self, station: str, drone: str, to_soc: float) -> DroneOnPad:
        """Request a pad and charging to a state of charge; another call changes the state of charge."""
        ...

    def release(self, station: str, drone: str) -> DroneOnPad:
        """Release the pad, or the place in the line."""
        ...


class PadRequest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One request on the wire."""

    op: Literal["status", "charge", "release"]
    """``status``, ``charge`` or ``release``."""
    station: str
    drone: str = ""
    to_soc: float = 1.0
    """For ``charge``, 0-1."""


class PadAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """One answer on the wire."""

    ok: bool
    error: str | None = None
    station: StationStatus | None = None
    """After the request."""
    drone: DroneOnPad | None = None
    """The drone of a ``charge`` or ``release``."""


class AskedPads(ABC):
    """A `PadService` over requests and answers, on any transport."""

    def status(self, station: str) -> StationStatus:
        """Return the pads of a station now."""
        found = self._ask(PadRequest(op="status", station=station)).station
        if found is None:
            raise PadServiceError(f"the pad service did not report {station}")
        return found

    def charge(self, station: str, drone: str, to_soc: float) -> DroneOnPad:
        """Request a pad and charging to a state of charge."""
        return self._drone(PadRequest(op="charge", station=station, drone=drone, to_soc=to_soc))

    def release(self, station: str, drone: str) -> DroneOnPad:
        """Release the pad, or the place in the line."""
        return self._drone(PadRequest(op="release", station=station, drone=drone))

    def _drone(self, request: PadRequest) -> DroneOnPad:
        found = self._ask(request).drone
        if found is None:
            raise PadServiceError(f"the pad service did not report drone {request.drone}")
        return found

    def _ask(self, request: PadRequest) -> PadAnswer:
        answer = self._exchange(encode(request))
        if not answer.ok:
            raise PadServiceError(answer.error or "the pad service refuses, without a reason")
        return answer

    @abstractmethod
    def _exchange(self, line: bytes) -> PadAnswer:
        """Send the line of a request, and return the answer to it."""


_REQUEST = msgspec.json.Decoder(PadRequest)
_ANSWER = msgspec.json.Decoder(PadAnswer)


def encode(message: PadRequest | PadAnswer) -> bytes:
    """Return the line of a request or answer, with its end."""
    return msgspec.json.encode(message) + b"\n"


def decode_request(line: bytes) -> PadRequest:
    """Read a request; a `PadServiceError` for any other line."""
    return _decoded(_REQUEST, line, "a request")


def decode_answer(line: bytes) -> PadAnswer:
    """Read an answer; a `PadServiceError` for any other line."""
    return _decoded(_ANSWER, line, "an answer")


def _decoded(decoder: msgspec.json.Decoder[T], line: bytes, what: str) -> T:
    try:
        return decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PadServiceError(f"not {what} of the pad service: {error}") from error
