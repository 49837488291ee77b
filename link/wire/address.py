"""Connection strings."""

from __future__ import annotations

import re

from skyway.models.base.address import LISTENING, LOOPBACK, Address
from skyway.models.base.errors import Fault, InputError

DEFAULT_BAUD = 57600
_NET = re.compile(r"(udpin|udpout|udp|tcp|tcpin|tcpout):(?://)?(\[[0-9a-fA-F:.]+\]|[^:\[\]/]*):(\d{1,5})")
_SERIAL = re.compile(r"(?:serial:(?://)?)?((?:/dev/|COM).+?)(?:[,:](\d{3,8}))?", re.IGNORECASE)
_SAME = {"udp": "udpin", "tcpout": "tcp"}
_REMEDY = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or /dev/ttyUSB0,57600"


def parse_address(text: str, *, option: str = "--connect") -> Address:
    """Read a connection string; a listener without a host listens on this machine only.

    An `InputError` refuses any other form, and a port out of range.
    """
    given = text.strip()
    device = _SERIAL.fullmatch(given)
    if device is not None:
        return Address("serial", device[1], int(device[2] or DEFAULT_BAUD))
    found = _NET.fullmatch(given)
    if found is None:
        raise InputError(Fault("not a connection", field=option, value=text, remedy=_REMEDY))
    kind, port = _SAME.get(found[1], found[1]), int(found[3])
    if port > 65535 or (port == 0 and kind not in LISTENING):
        raise InputError(Fault("port out of range", field=option, value=text, remedy="1 to 65535"))
    return Address(kind, found[2].strip("[]") or LOOPBACK, port)
