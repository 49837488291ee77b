"""Connection strings, such as ``udpout:host:port`` or ``tcp:host:port``."""

from __future__ import annotations

import re
from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError

KINDS = ("udpout", "udpin", "tcp", "tcpin")
_FORM = re.compile(r"([a-z]+):(?://)?(\[[0-9a-fA-F:]+\]|[^:\[\]]*):(\d{1,5})")


@dataclass(frozen=True, slots=True)
class Address:
    """Where to speak.

    Attributes
    ----------
    kind : str
        ``udpout`` sends there, ``udpin`` and ``tcpin`` listen there, ``tcp`` connects there.
    host, port : str, int
        Port 0 lets the system choose when listening.
    """

    kind: str
    host: str
    port: int


def parse_address(text: str, *, option: str, kinds: tuple[str, ...] = KINDS) -> Address:
    """Read a connection string.

    Raises
    ------
    InputError
        Not of that form, an unknown kind, or a port out of range.
    """
    remedy = f"KIND:HOST:PORT with KIND one of {', '.join(kinds)}, for example {kinds[0]}:127.0.0.1:14540"
    found = _FORM.fullmatch(text.strip())
    if found is None or found[1] not in kinds:
        raise InputError(Fault("not a connection", field=option, value=text, remedy=remedy))
    port = int(found[3])
    if port > 65535:
        raise InputError(Fault("port out of range", field=option, value=text, remedy="0 to 65535"))
    return Address(found[1], found[2].strip("[]") or "127.0.0.1", port)
