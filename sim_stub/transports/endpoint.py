"""Socket endpoints of the loop, and address resolution."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any, Protocol

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from skyway.sim_stub.transports.urls import Address


class Endpoint(Protocol):
    """Something with a socket in the loop; never blocking, closed on any error.

    Attributes
    ----------
    where : str
        How it can be reached.
    """

    where: str

    def readable(self) -> None:
        """Read what is there."""
        ...

    def flush(self, now_s: float) -> None:
        """Send what is waiting."""
        ...

    def next_s(self) -> float:
        """Wall instant at which a delayed packet is due."""
        ...

    def close(self) -> None:
        """Close for good."""
        ...


def resolve(address: Address, kind: int) -> tuple[int, tuple[Any, ...]]:
    """Family and address of a host.

    Raises
    ------
    InputError
        There is no such host.
    """
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except OSError as error:
        problem = f"unknown host: {error.strerror or error}"
        raise InputError(Fault(problem, field="--connect", value=address.host)) from None
    return found[0][0], found[0][4]


def bind(listener: socket.socket, target: tuple[Any, ...], address: Address) -> None:
    """Bind a socket.

    Raises
    ------
    InputError
        The address is taken, or not ours.
    """
    try:
        listener.bind(target)
    except OSError as error:
        listener.close()
        where = f"{address.host}:{address.port}"
        problem = f"cannot listen: {error.strerror or error}"
        remedy = "another program listens there; choose another port"
        raise InputError(Fault(problem, field="--connect", value=where, remedy=remedy)) from None
