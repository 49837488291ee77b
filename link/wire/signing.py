"""MAVLink 2 message signing: signs frames, and checks signatures before a frame is used.

This is our own implementation, because pymavlink's check adopts the time of a packet before it has checked the signature, so that one
forged packet from the future would shut out the genuine sender.
Source: MAVLink message signing, https://mavlink.io/en/guide/message_signing.html.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass, field

from skyway.models.base.errors import Fault, InputError

_SIGNING_EPOCH_S = 1_420_070_400.0
"""1 January 2015 UTC: signing time counts from here, in units of 10 microseconds."""
_NEW_SENDER_WINDOW = 6_000_000
_MAX_SENDERS = 64


@dataclass(slots=True)
class Signing:
    """The signing state of one connection."""

    key: bytes = field(repr=False)
    """32 bytes; never shown."""
    timestamp: int = 0
    """Newest signing time seen or used."""
    link_id: int = 0
    last: dict[tuple[int, int, int], int] = field(default_factory=dict, repr=False)
    """Newest time by (system, component, link): a packet that is not newer is a replay."""

    def __post_init__(self) -> None:
        if len(self.key) != 32:
            raise InputError(Fault("a signing key is not 32 bytes", remedy="64 hexadecimal digits, or 32 bytes"))

    def advance_to(self, posix_s: float) -> None:
        """Advance the signing time to an instant."""
        self.timestamp = max(self.timestamp, int((posix_s - _SIGNING_EPOCH_S) * 1e5))

    def sign(self, frame: bytes) -> bytes:
        """Signature block of a frame that ends with its checksum."""
        self.timestamp += 1
        tail = struct.pack("<BQ", self.link_id, self.timestamp)[:7]
        return tail + hashlib.sha256(self.key + frame + tail).digest()[:6]

    def accepts(self, frame: bytes, signature: bytes) -> str | None:
        """Return None for a valid signature, otherwise ``forged`` or ``replayed``; only a valid one advances the time."""
        wanted = hashlib.sha256(self.key + frame + signature[:7]).digest()[:6]
        if not hmac.compare_digest(wanted, signature[7:]):
            return "forged"
        stamp = int.from_bytes(signature[1:7], "little")
        sender = (frame[5], frame[6], signature[0])
        last = self.last.get(sender)
        if (stamp <= last) if last is not None else (stamp + _NEW_SENDER_WINDOW < self.timestamp):
            return "replayed"
        if last is None and len(self.last) >= _MAX_SENDERS:
            return "forged"
        self.last[sender] = stamp
        self.timestamp = max(self.timestamp, stamp)
        return None
