"""The logs on a vehicle: listed and read, by whichever protocol it supports."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skyway.link.files.ftp import FtpClient
from skyway.link.files.ftp_read import ReadFtp
from skyway.link.files.ftp_words import FTP_CAPABILITY
from skyway.link.files.log_data import EndLogs, ListLogs, ReadLog
from skyway.models.base.errors import CommandRefusedError, LinkError, VehicleTimeoutError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.link.files.part_file import Pieces
    from skyway.link.vehicle.vehicle import Vehicle

Way = Literal["auto", "ftp", "requests"]
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._ -]{0,63}")
_FOLDERS = 3
"""Greatest depth of folders."""


@dataclass(frozen=True, slots=True)
class LogAboard:
    """One log on a vehicle."""

    name: str
    """Its path below the folder of logs, such as ``2026-11-22/14_03_22.ulg``, or a name made from its number."""
    size_bytes: int
    time_utc: int = 0
    """POSIX seconds; 0 if the vehicle does not report it."""
    path: str = ""
    """Its path on the vehicle, if it is read by FTP."""
    number: int = -1
    """Its number, if it is read by log requests."""


class LogStore:
    """The logs of one vehicle. Raises a `VehicleTimeoutError` if it does not answer, a `CommandRefusedError` if it refuses."""

    def __init__(self, vehicle: Vehicle, way: Way = "auto") -> None:
        self.vehicle, self.way = vehicle, way
        self.ftp = FtpClient(vehicle)
        self.skipped: list[str] = []
        """Entries of its folders with invalid file names: they are not used."""
        self._listed = False

    def logs(self) -> list[LogAboard]:
        """All logs on the vehicle, in the order of the list: oldest first as far as reported."""
        if self.way == "auto":
            self.way = self._choose()
        return self._by_ftp() if self.way == "ftp" else self._by_requests()

    def _choose(self) -> Way:
        """FTP if the vehicle reports the capability, and answers."""
        known = self.vehicle.identify().capabilities
        if known and not known & FTP_CAPABILITY:
            return "requests"
        try:
            self.ftp.reset()
        except VehicleTimeoutError:
            return "requests"
        return "ftp"

    def _by_ftp(self) -> list[LogAboard]:
        for root in self.vehicle.family.log_folders:
            entries = self.ftp.entries(root)
            if entries is not None:
                found = list(self._below(root, "", _FOLDERS))
                return sorted(found, key=lambda log: (not log.name[0].isdigit(), log.name))
        folders = " or ".join(self.vehicle.family.log_folders)
        raise CommandRefusedError("list its logs", f"there is no folder {folders}: is its card in?")

    def _below(self, root: str, folder: str, depth: int) -> Iterator[LogAboard]:
        where = f"{root}/{folder}".rstrip("/")
        for entry in self.ftp.entries(where) or ():
            if not _NAME.fullmatch(entry.name):
                self.skipped.append(one_line(entry.name))
            elif entry.size_bytes is not None and entry.name.lower().endswith(self.vehicle.family.log_endings):
                yield LogAboard(f"{folder}{entry.name}", entry.size_bytes, path=f"{where}/{entry.name}")
            elif entry.size_bytes is None and depth > 1:
                yield from self._below(root, f"{folder}{entry.name}/", depth - 1)

    def _by_requests(self) -> list[LogAboard]:
        listed = self.vehicle.carry_out(ListLogs(self.vehicle.peer.target))
        self._listed = True
        if not listed.complete:
            reasons = self.vehicle.texts()[-1:] if self.vehicle.armed else []
            raise VehicleTimeoutError(
                " ".join([f"list of its logs ({len(listed.found)} came)", *reasons]), self.vehicle.waited_s
            )
        ending = self.vehicle.family.log_endings[0]
        return [
            LogAboard(f"{one.number:08}{ending}", one.size_bytes, one.time_utc, number=one.number)
            for _, one in sorted(listed.found.items())
        ]

    def size_bytes(self, log: LogAboard) -> int:
        """Request the present size of a log, which grows while it is written. -1 where it no longer exists."""
        if self.way != "ftp":
            listed = self.vehicle.carry_out(ListLogs(self.vehicle.peer.target, log.number)).found.get(log.number)
            self._listed = True
            return -1 if listed is None else listed.size_bytes
        session, size = self.ftp.open(log.path)
        self.ftp.close(session)
        return size

    def crc32(self, log: LogAboard, size_bytes: int) -> int | None:
        """Checksum of a log computed by the vehicle; None if it offers none."""
        return self.ftp.crc32(log.path, size_bytes) if self.way == "ftp" else None

    def read(
        self, log: LogAboard, pieces: Pieces, size_bytes: int, progress: Callable[[int], None] | None = None
    ) -> ReadFtp | ReadLog:
        """Read a log from the end of the local part on; returns the reason for the end."""
        target = self.vehicle.peer.target
        if self.way != "ftp":
            if not self._listed:  # PX4 reads no log unless it has listed them since the last end
                self.size_bytes(log)
            return self.vehicle.carry_out(ReadLog(target, log.number, pieces, size_bytes, progress))
        session, _ = self.ftp.open(log.path)
        read = self.vehicle.carry_out(ReadFtp(target, self.ftp.numbers, session, pieces, size_bytes, progress))
        if not read.session_lost and not read.problem.startswith("nothing"):
            with contextlib.suppress(VehicleTimeoutError):  # the session closes by itself
                self.ftp.close(session)
        return read

    def end(self) -> None:
        """Let the vehicle resume logging; no error if the link to the vehicle is lost."""
        self._listed = False
        if self.way == "requests":
            with contextlib.suppress(LinkError):
                self.vehicle.carry_out(EndLogs(self.vehicle.peer.target))
