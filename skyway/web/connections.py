"""Connections of browsers: slow clients are disconnected so that they do not block the others."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

if TYPE_CHECKING:
    Protocol = Any
else:
    Protocol = AutoHTTPProtocol

REQUEST_S = 15.0
"""Time limit of the head of a request: from its first byte, or from the connection, to its last."""
MAX_HEAD = 64 * 1024
"""Limit of the bytes of an incomplete head; one that arrives at once may be as long as a system passes on at once."""
TAKEN_S = 30.0
"""An answer of which a browser has read nothing for this long is aborted."""
MOST_WAITED_FOR = 128
"""Idle or incomplete connections; if there are more, the oldest is closed."""


class Prompt(Protocol):  # type: ignore[misc]  # which of two classes is known when it runs
    """HTTP of uvicorn, with a limit on the time until a request arrives and its answer is read; its body is limited by the guard."""

    _late: asyncio.TimerHandle | None = None
    _stuck: asyncio.TimerHandle | None = None
    _head = 0
    opened_s = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Expect a request from now on; an idle connection may be closed to make room."""
        super().connection_made(transport)
        self.opened_s = time.monotonic()
        if len(self.connections) > MOST_WAITED_FOR:
            waited_for = [one for one in self.connections if isinstance(one, Prompt) and one.is_waited_for]
            if len(waited_for) > MOST_WAITED_FOR:
                min(waited_for, key=lambda one: one.opened_s).transport.abort()
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Process received data; an incomplete head has the rest of its time."""
        super().data_received(data)
        in_body = self.cycle is not None and self.cycle.more_body
        self._head = 0 if self._answering or in_body else self._head + len(data)
        if self._head > MAX_HEAD and self._is_ours:
            self.transport.abort()
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        """Expect no further request."""
        self._forget()
        self.resume_writing()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """Monitor from now on whether the answer is read."""
        super().pause_writing()
        self._look(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """Resume sending: enough was read."""
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None
        super().resume_writing()

    def _look(self, before: int) -> None:
        self._stuck = asyncio.get_running_loop().call_later(TAKEN_S, self._untaken, before)

    def _untaken(self, before: int) -> None:
        left = self.transport.get_write_buffer_size()
        if left < before:
            self._look(left)
        else:
            self.transport.abort()

    def _expect(self) -> None:
        if self._answering:
            self._forget()
        elif self._late is None:
            self._late = asyncio.get_running_loop().call_later(REQUEST_S, self._cut)

    @property
    def is_waited_for(self) -> bool:
        """Whether more data are expected: a request, or the rest of its body."""
        return not self.transport.is_closing() and (not self._answering or self.cycle.more_body)

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def _is_ours(self) -> bool:
        """Whether it has not become a WebSocket."""
        return self.transport.get_protocol() is self

    def _forget(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _cut(self) -> None:
        self._late = None
        if self._is_ours and not self._answering and not self.transport.is_closing():
            self.transport.close()
