"""Serial lines, such as telemetry radios, with the system's own calls."""

from __future__ import annotations

import contextlib
import os
import termios
import time
import tty
from typing import TYPE_CHECKING

from link.transport import read_fd
from models.errors import Fault, InputError

if TYPE_CHECKING:
    from link.address import Address

_AGAIN_S = 1.0


class SerialLine:
    """A device at a baud rate, 8N1 without flow control; opened again every second after it was unplugged.

    Raises
    ------
    InputError
        The device cannot be opened, or does not know the rate.
    """

    def __init__(self, address: Address) -> None:
        self.address = address
        self._descriptor: int | None = None
        self._tried_s = 0.0
        problem = self._open()
        if problem is not None:
            remedy = "is it plugged in, and may you read it?"
            raise InputError(Fault(problem, field="--connect", value=str(address), remedy=remedy))

    def _open(self) -> str | None:
        self._tried_s = time.monotonic()
        rate = getattr(termios, f"B{self.address.port}", None)
        if rate is None:
            return "no such baud rate"
        try:
            descriptor = os.open(self.address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            return f"cannot be opened: {error.strerror or error}"
        try:
            tty.setraw(descriptor, termios.TCSANOW)
            settings = termios.tcgetattr(descriptor)
            settings[2] |= termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = rate
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(descriptor)
            return f"is no serial line: {error.args[-1]}"
        self._descriptor = descriptor
        return None

    def read(self, timeout_s: float = 0.0) -> bytes:
        """What has come."""
        early = time.monotonic() < self._tried_s + _AGAIN_S
        if self._descriptor is None and (early or self._open() is not None):
            time.sleep(min(timeout_s, 0.05))
            return b""
        if self._descriptor is None:
            return b""
        try:
            return read_fd(self._descriptor, timeout_s)
        except OSError:
            self.close()
            return b""

    def write(self, data: bytes) -> None:
        """Send; what the line does not take is lost, as radios lose it."""
        if self._descriptor is None:
            return
        try:
            os.write(self._descriptor, data)
        except BlockingIOError:
            return
        except OSError:
            self.close()

    def close(self) -> None:
        """Close."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = None
        self._tried_s = time.monotonic()
