"""Serial lines, such as telemetry radios, through the system's own calls."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time
import tty
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from skyway.models.base.address import Address

_AGAIN_S = 1.0
_READ_BYTES = 4096
_MIN_BAUD = 1200


class SerialLine:
    """A device at a baud rate, 8N1 without flow control; opened again every second after it was unplugged.

    Raises an `InputError` if the device cannot be opened, or does not support the rate.
    """

    def __init__(self, address: Address) -> None:
        self.address = address
        self._descriptor: int | None = None
        self._tried_s = 0.0
        if address.port not in _rates():
            remedy = f"one of {', '.join(map(str, sorted(_rates())))}"
            raise InputError(Fault("no such baud rate", field="--connect", value=address.port, remedy=remedy))
        problem = self._open()
        if problem is not None:
            remedy = "is it plugged in, and may you read it?"
            raise InputError(Fault(problem, field="--connect", value=str(address), remedy=remedy))

    def _open(self) -> str | None:
        self._tried_s = time.monotonic()
        try:
            descriptor = os.open(self.address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            return f"cannot be opened: {error.strerror or error}"
        try:
            tty.setraw(descriptor, termios.TCSANOW)
            settings = termios.tcgetattr(descriptor)
            settings[2] |= termios.CLOCAL | termios.CREAD
            settings[2] &= ~(termios.CSTOPB | termios.CRTSCTS)
            settings[4] = settings[5] = _rates()[self.address.port]
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            os.close(descriptor)
            return f"is not a serial line: {error.args[-1]}"
        self._descriptor = descriptor
        return None

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Bytes received."""
        early = time.monotonic() < self._tried_s + _AGAIN_S
        if self._descriptor is None and (early or self._open() is not None):
            time.sleep(min(timeout_s, _AGAIN_S))
            return b""
        if self._descriptor is None:
            return b""
        ready, _, _ = select.select([self._descriptor], [], [], timeout_s)
        if not ready:
            return b""
        try:
            data = os.read(self._descriptor, _READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:  # readable, but no data: it was unplugged
            self.close()
        return data

    def write(self, data: bytes) -> None:
        """Send; data that the line does not accept are lost, as on radios."""
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


def _rates() -> dict[int, int]:
    """The system's number of each baud rate that telemetry radios and flight controllers use."""
    found = {int(name[1:]): value for name, value in vars(termios).items() if name[0] == "B" and name[1:].isdigit()}
    return {rate: value for rate, value in found.items() if rate >= _MIN_BAUD}
