"""Single requests of MAVLink FTP: folders, opening and closing, checksums."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.files.ftp_words import ERRORS, FtpMessage, Nak, Op, payload, read_payload
from skyway.link.protocol.exchange import Question
from skyway.models.base.errors import CommandRefusedError, VehicleTimeoutError

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import Target
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.link.wire.messages import Message

ANSWER_S = 6.0
"""An answer is not expected after this time."""
CRC_S, CRC_BYTEPS = 10.0, 500_000.0
"""Time limit of a checksum, and bytes per second that extend it: a card is slow."""
_MAX_ENTRIES = 20_000
_MESSAGE = "FILE_TRANSFER_PROTOCOL"


class Numbers:
    """Sequence numbers of requests to one vehicle: a repeated number would be taken for a repetition of the request just answered."""

    def __init__(self, first: int) -> None:
        self._next = first

    def take(self) -> int:
        """Return the next number."""
        self._next = (self._next + 1) & 0xFFFF
        return self._next


class FtpQuestion(Question):
    """One request, repeated under the same number until it is answered."""

    transfers = "FILE_TRANSFER"

    def __init__(
        self, target: Target, sequence: int, op: Op, *, session: int = 0, offset: int = 0, size: int = 0, data: bytes = b"",
        give_up_s: float = ANSWER_S,
    ) -> None:  # fmt: skip
        asked = payload(sequence, op, session=session, offset=offset, size=size, data=data)
        super().__init__(target, _MESSAGE, payload=asked)
        self.give_up_s = give_up_s
        self._op, self._sequence = op, sequence
        self.answer: FtpMessage | None = None
        """None: no answer."""

    def hear(self, message: Message, now_s: float) -> None:
        """Accept the answer to it, and no other."""
        if message.name != _MESSAGE:
            return
        told = read_payload(bytes(message["payload"]))
        if told is None or told.asked != self._op or told.sequence != (self._sequence + 1) & 0xFFFF:
            return
        self._learn(now_s)
        self.answer = told
        self.finish()


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of a folder."""

    name: str
    size_bytes: int | None
    """None for a folder."""


class FtpClient:
    """Files of one vehicle. Raises a `VehicleTimeoutError` if it does not answer, a `CommandRefusedError` if it refuses."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.numbers = Numbers(int(vehicle.connection.clock.posix_s() * 16.0) & 0xFFFF)
        self.answered = False
        """Whether it has answered at all."""

    def ask(self, what: str, op: Op, *, give_up_s: float = ANSWER_S, session: int = 0, offset: int = 0, size: int = 0, text: str = "") -> FtpMessage:  # fmt: skip
        """Send a request, and return the answer, including errors."""
        asked = FtpQuestion(
            self.vehicle.peer.target, self.numbers.take(), op, session=session, offset=offset, size=size,
            data=text.encode(), give_up_s=give_up_s,
        )  # fmt: skip
        answer = self.vehicle.carry_out(asked).answer
        if answer is None:
            raise VehicleTimeoutError(what, self.vehicle.waited_s)
        self.answered = True
        return answer

    def reset(self) -> None:
        """Close all sessions that we, or an earlier client, left open."""
        self.ask("close files that are open", Op.RESET)

    def entries(self, folder: str) -> list[Entry] | None:
        """Entries of a folder; None if the folder does not exist."""
        found: list[Entry] = []
        offset = 0
        while offset < _MAX_ENTRIES:
            answer = self.ask(f"list {folder}", Op.LIST, offset=offset, text=folder)
            if answer.error == Nak.EOF or (answer.error is None and not answer.data):
                break
            if answer.error is not None:
                if offset == 0 and answer.error in (Nak.NOT_FOUND, Nak.FAIL, Nak.FAIL_ERRNO):
                    return None
                raise CommandRefusedError(f"list {folder}", _words(answer.error))
            lines = answer.data.rstrip(b"\0").split(b"\0")
            offset += len(lines)
            found.extend(entry for line in lines if (entry := _entry(line)) is not None)
        return found

    def open(self, path: str) -> tuple[int, int]:
        """Open a file to be read; returns its session and its size."""
        answer = self.ask(f"open {path}", Op.OPEN, text=path)
        if answer.error in (Nak.NO_SESSIONS, Nak.FAIL, Nak.BAD_SESSION):
            self.reset()
            answer = self.ask(f"open {path}", Op.OPEN, text=path)
        if answer.error is not None:
            raise CommandRefusedError(f"open {path}", _words(answer.error))
        return answer.session, int.from_bytes(answer.data[:4], "little")

    def close(self, session: int) -> None:
        """Close a file; the answer is ignored."""
        self.ask("close a file", Op.TERMINATE, session=session)

    def crc32(self, path: str, size_bytes: int) -> int | None:
        """Checksum of a file as the vehicle reads it from its card; None if it offers none."""
        answer = self.ask(
            f"checksum of {path}", Op.CRC32, text=path, give_up_s=CRC_S + size_bytes / CRC_BYTEPS
        )  # fmt: skip
        if answer.error == Nak.UNKNOWN:
            return None
        if answer.error is not None:
            raise CommandRefusedError(f"tell the checksum of {path}", _words(answer.error))
        return int.from_bytes(answer.data[:4], "little")


def _words(error: int) -> str:
    return ERRORS.get(error, f"error {error}")


def _entry(line: bytes) -> Entry | None:
    """Entry of a folder from its line; None for one that is skipped or invalid."""
    text = line[1:].decode("utf-8", "replace")
    if line[:1] == b"D":
        return Entry(text, None)
    name, tab, size = text.rpartition("\t")
    if line[:1] != b"F" or not tab or not size.isascii() or not size.isdigit():
        return None
    return Entry(name, int(size))
