"""The codes of MAVLink FTP: requests and answers in the payload of FILE_TRANSFER_PROTOCOL, error codes, and the checksum of files."""

from __future__ import annotations

import struct
import zlib
from enum import IntEnum
from typing import NamedTuple

DATA_BYTES = 239
"""Greatest size of the data of one message."""
_HEAD = struct.Struct("<HBBBBBxI")
_PAYLOAD_BYTES = 251
_INVERTED = 0xFFFFFFFF
FTP_CAPABILITY = 32
"""MAV_PROTOCOL_CAPABILITY_FTP."""


class Op(IntEnum):
    """Opcodes: those of requests, and the two of answers."""

    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CRC32 = 14
    BURST = 15
    ACK = 128
    NAK = 129


class Nak(IntEnum):
    """Error codes with a reaction."""

    FAIL = 1
    FAIL_ERRNO = 2
    BAD_SESSION = 4
    NO_SESSIONS = 5
    EOF = 6
    UNKNOWN = 7
    NOT_FOUND = 10


ERRORS = {
    1: "it failed", 2: "its file system failed", 3: "a size that it does not accept", 4: "the file is not open", 5: "too many files are open",
    6: "the end of the file", 7: "it does not support this request", 8: "the file exists", 9: "the file is protected", 10: "no such file",
}  # fmt: skip
"""Error codes in words."""


class FtpMessage(NamedTuple):
    """A request or an answer."""

    sequence: int
    session: int
    op: int
    asked: int
    """The opcode of the answered request."""
    complete: bool
    """Whether a burst ends here."""
    offset: int
    data: bytes

    @property
    def error(self) -> int | None:
        """Error code of a refusal; None for anything else."""
        if self.op != Op.NAK:
            return None
        return self.data[0] if self.data else Nak.FAIL


def payload(sequence: int, op: Op, *, session: int = 0, offset: int = 0, size: int = 0, data: bytes = b"") -> bytes:
    """Payload of a request; `size` is the number of bytes requested, or that of the data."""
    head = _HEAD.pack(sequence & 0xFFFF, session, op, len(data) if data else size, 0, 0, offset)
    return (head + data).ljust(_PAYLOAD_BYTES, b"\0")


def read_payload(given: bytes) -> FtpMessage | None:
    """Read the payload of a message; None if it claims more data than fit."""
    sequence, session, op, size, asked, complete, offset = _HEAD.unpack_from(given)
    if size > DATA_BYTES:
        return None
    data = bytes(given[_HEAD.size : _HEAD.size + size])
    return FtpMessage(sequence, session, op, asked, bool(complete), offset, data)


def crc32(data: bytes, before: int = 0) -> int:
    """Checksum of files on autopilots: CRC-32 (IEEE) from 0 on, not inverted at the end."""
    return zlib.crc32(data, before ^ _INVERTED) ^ _INVERTED
