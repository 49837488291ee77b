"""Network addresses, for both sides of a link."""

from __future__ import annotations

import errno
import socket
from dataclasses import dataclass
from typing import Any

from skyway.models.base.errors import InputError

LOOPBACK = "127.0.0.1"
LISTENING = ("udpin", "tcpin")
"""Kinds at which others connect."""


@dataclass(frozen=True, slots=True)
class Address:
    """Address of one end of a link."""

    kind: str
    """``udpin`` and ``tcpin`` listen, ``udpout`` and ``tcp`` send first, ``serial`` opens a device."""
    host: str
    """Host, or the device."""
    port: int
    """Port, or the baud rate of a device; port 0 lets the system choose when listening."""

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"{self.host},{self.port}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"

    @property
    def listens(self) -> bool:
        """Whether others connect to us."""
        return self.kind in LISTENING


def resolve(address: Address, kind: int) -> tuple[int, Any]:
    """Return family and socket address of a host, for a kind of socket. Raises an `InputError` for an unknown host."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except OSError as error:
        raise InputError(f"unknown host: {error.strerror or error}", field="--connect", value=address.host) from error
    return found[0][0], found[0][4]


def bind(listener: socket.socket, target: Any, address: Address) -> None:
    """Bind a socket; if the address is taken, or not of this machine, it is closed: an `InputError`."""
    try:
        listener.bind(target)
    except OSError as error:
        listener.close()
        problem = f"cannot listen: {error.strerror or error}"
        remedy = {
            errno.EADDRNOTAVAIL: "this computer has no such address: udpin and tcpin take one of its own, or 0.0.0.0",
            errno.EACCES: "you may not use this port: choose one above 1023",
        }.get(error.errno or 0, "another program listens there; choose another port")
        raise InputError(problem, field="--connect", value=str(address), remedy=remedy) from error
