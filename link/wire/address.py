"""Connection strings."""

from __future__ import annotations

import re
from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError

LOOPBACK = "127.0.0.1"
DEFAULT_BAUD = 57600
_NET = re.compile(r"(udpin|udpout|udp|tcp|tcpin|tcpout):(?://)?(\[[0-9a-fA-F:.]+\]|[^:\[\]/]*):(\d{1,5})")
_SERIAL = re.compile(r"(?:serial:(?://)?)?((?:/dev/|COM).+?)(?:[,:](\d{3,8}))?", re.IGNORECASE)
_SAME = {"udp": "udpin", "tcpout": "tcp"}
_LISTENING = ("udpin", "tcpin")
_REMEDY = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or /dev/ttyUSB0,57600"


@dataclass(frozen=True, slots=True)
class Address:
    """Where to speak.

    Attributes
    ----------
    kind : str
        ``udpin`` and ``tcpin`` listen, ``udpout`` and ``tcp`` speak first, ``serial`` opens a device.
    host : str
        Host, or the device.
    port : int
        Port, or the baud rate of a device; port 0 lets the system choose when listening.
    """

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"{self.host},{self.port}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"

    @property
    def listens(self) -> bool:
        """Whether others connect to us."""
        return self.kind in _LISTENING


def parse_address(text: str, *, option: str = "--connect") -> Address:
    """Read a connection string; a listener without a host listens on this machine only.

    Raises
    ------
    InputError
        Not of that form, or a port out of range.
    """
    given = text.strip()
    device = _SERIAL.fullmatch(given)
    if device is not None:
        return Address("serial", device[1], int(device[2] or DEFAULT_BAUD))
    found = _NET.fullmatch(given)
    if found is None:
        raise InputError(Fault("not a connection", field=option, value=text, remedy=_REMEDY))
    kind, port = _SAME.get(found[1], found[1]), int(found[3])
    if port > 65535 or (port == 0 and kind not in _LISTENING):
        raise InputError(Fault("port out of range", field=option, value=text, remedy="1 to 65535"))
    return Address(kind, found[2].strip("[]") or LOOPBACK, port)
