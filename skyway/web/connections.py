"""Connections of browsers: one that is slow to say what it wants is cut off, so that none keeps the others out."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

if TYPE_CHECKING:
    Protocol = Any
else:
    Protocol = AutoHTTPProtocol

REQUEST_S = 15.0
"""Head of a request: from its first byte, or from the connection on, to its last."""


class Prompt(Protocol):  # type: ignore[misc]  # which of two classes is known when it runs
    """HTTP as uvicorn speaks it, with a limit on the time in which a request is begun; its body is limited by the guard."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Expect a request from now on."""
        super().connection_made(transport)
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Take what has come; what is not a whole head yet has the rest of its time."""
        super().data_received(data)
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        """Expect nothing more."""
        self._forget()
        super().connection_lost(exc)

    def _expect(self) -> None:
        if self._answering:
            self._forget()
        elif self._late is None:
            self._late = asyncio.get_running_loop().call_later(REQUEST_S, self._cut)

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _forget(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _cut(self) -> None:
        self._late = None
        is_ours = self.transport.get_protocol() is self  # else it has become a WebSocket
        if is_ours and not self._answering and not self.transport.is_closing():
            self.transport.close()
