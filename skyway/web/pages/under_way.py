"""The calculation in progress on a page: one at a time, with a status text and a cancel button."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from nicegui import Client, app, ui

from skyway.web.controls import Button, Status

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine


class UnderWay:
    """A line of the page: the calculation in progress, and *Cancel*.

    Parameters
    ----------
    client : Client
        The browser's page; the calculation ends with it.
    again : callable
        Starts the cancelled calculation again.
    words : str
        Text of its button.
    cancelled : callable
        Returns the text shown after a cancellation.
    """

    def __init__(
        self, client: Client, again: Callable[[], object], words: str, cancelled: Callable[[], str] = lambda: ""
    ) -> None:
        self._again, self._words, self._cancelled = again, words, cancelled
        self._task: asyncio.Task[None] | None = None
        with ui.element("div").classes("under-way"):
            self.status = Status()
            self._place = ui.element("span")
        client.on_delete(self.end)

    def begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a calculation; the previous one ends, and can show nothing any more."""
        self.end()
        self._task = task = asyncio.create_task(work)
        task.add_done_callback(self._ended)
        return task

    def tell(self, words: str) -> None:
        """Show the current computation, which can be cancelled from now on."""
        self.status.tell(words)
        self._offer("Cancel", self.cancel, data_keys="escape", title="Esc")

    def cancel(self) -> None:
        """End it at the person's request; it can be started again."""
        if self._task is not None:
            self.end()
            self.status.tell(f"Cancelled. {self._cancelled()}".strip())
            self._offer(self._words, self._again)

    def end(self) -> None:
        """End it, and its workers."""
        task, self._task = self._task, None
        self._place.clear()
        if task is not None:
            task.cancel()

    def _offer(self, words: str, act: Callable[[], object], **attributes: str) -> None:
        self._place.clear()
        with self._place:
            Button(words, act, **attributes)

    def _ended(self, task: asyncio.Task[None]) -> None:
        if task is self._task:
            self._task = None
            self._place.clear()
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception):
            self.status.tell(f"An error of skyway itself: {error!r}", wrong=True)
            app.handle_exception(error)
