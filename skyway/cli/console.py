"""The operator at a terminal or a pipe: lines read beside the flight, never waited for; Ctrl-C counted."""

from __future__ import annotations

import contextlib
import queue
import signal
import sys
import threading
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class Console:
    """Whoever types.

    Parameters
    ----------
    listens : bool
        Whether anybody is to be asked; otherwise nobody is there.
    show : callable
        Takes a line for the person.
    """

    def __init__(self, *, listens: bool, show: Callable[[str], None] = typer.echo) -> None:
        self.interrupts = 0
        self._show = show
        self._words: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._ended = not listens
        if listens:
            threading.Thread(target=self._read, name="operator", daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in sys.stdin:
                if line.strip():
                    self._words.put(line.strip())
        self._ended = True

    @property
    def present(self) -> bool:
        """Whether anybody can answer: as long as what is typed has not ended."""
        return not self._ended or not self._words.empty()

    def tell(self, line: str) -> None:
        """Say something."""
        self._show(line)

    def ask(self, question: str) -> None:
        """Put a question."""
        self._show(f"? {question}")

    def heard(self) -> str | None:
        """Return the next line typed, or None."""
        with contextlib.suppress(queue.Empty):
            return self._words.get_nowait()
        return None

    @contextlib.contextmanager
    def counting_interrupts(self) -> Iterator[None]:
        """Count Ctrl-C instead of stopping the program; the supervisor decides what it means."""

        def count(*_: object) -> None:
            self.interrupts += 1

        before = {number: signal.signal(number, count) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
