"""Connection strings, such as ``udpout:host:port`` or ``tcp:host:port``."""

from __future__ import annotations

import re

from skyway.models.base.address import LOOPBACK, Address
from skyway.models.base.errors import Fault, InputError

KINDS = ("udpout", "udpin", "tcp", "tcpin")
_FORM = re.compile(r"([a-z]+):(?://)?(\[[0-9a-fA-F:]+\]|[^:\[\]]*):(\d{1,5})")


def parse_address(text: str, *, option: str, kinds: tuple[str, ...] = KINDS) -> Address:
    """Read a connection string; an `InputError` refuses another form, an unknown kind, and a port out of range."""
    remedy = f"KIND:HOST:PORT with KIND one of {', '.join(kinds)}, for example {kinds[0]}:127.0.0.1:14540"
    found = _FORM.fullmatch(text.strip())
    if found is None or found[1] not in kinds:
        raise InputError(Fault("not a connection", field=option, value=text, remedy=remedy))
    port = int(found[3])
    if port > 65535:
        raise InputError(Fault("port out of range", field=option, value=text, remedy="0 to 65535"))
    return Address(found[1], found[2].strip("[]") or LOOPBACK, port)
