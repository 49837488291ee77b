"""The operator's console: lines and keys read without blocking the flight, and Ctrl-C counted."""

from __future__ import annotations

import codecs
import contextlib
import os
import queue
import signal
import sys
import threading
from typing import TYPE_CHECKING

import typer

from skyway.link.supervisor.operators import Said

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.link.supervisor import Operator

_MAX_TYPED = 200


class Console:
    """The person at the terminal.

    Parameters
    ----------
    listens : bool
        Whether anybody is to be asked; otherwise nobody is there.
    show : callable
        Takes a line for the person.
    keys : bool
        Read key by key at a terminal, for a panel that shows what is typed; `reading_keys` must be entered then.

    Attributes
    ----------
    typed : str
        The line that is being typed.
    """

    def __init__(self, *, listens: bool, show: Callable[[str], None] = typer.echo, keys: bool = False) -> None:
        self.interrupts = 0
        self.typed = ""
        self._show = show
        self._keys = keys and listens and sys.stdin.isatty()
        self._words: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._ended = not listens
        if listens:
            threading.Thread(target=self._read, name="operator", daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            if self._keys:
                self._read_keys()
            else:
                for line in sys.stdin:
                    self._say(line)
        self._ended = True

    def _say(self, line: str) -> None:
        if line.strip():
            self._words.put(line.strip())

    def _read_keys(self) -> None:
        """Read key by key: what is typed stands in the panel, which the terminal's own echo would disturb."""
        decoder = codecs.getincrementaldecoder("utf-8")(errors="replace")
        while data := os.read(sys.stdin.fileno(), 1024):
            for key in decoder.decode(data):
                if key in "\r\n":
                    line, self.typed = self.typed, ""
                    self._say(line)
                elif key in "\x7f\b":
                    self.typed = self.typed[:-1]
                elif key == "\x15":  # Ctrl-U
                    self.typed = ""
                elif key == "\x04" and not self.typed:  # Ctrl-D
                    return
                elif key.isprintable() and len(self.typed) < _MAX_TYPED:
                    self.typed += key

    @contextlib.contextmanager
    def reading_keys(self) -> Iterator[None]:
        """Have the terminal give each key at once, without an echo, where keys are read; as it was, at the end."""
        if not self._keys:
            yield
            return
        import termios
        import tty

        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)  # Ctrl-C stays a signal
        try:
            yield
        finally:
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)

    @property
    def present(self) -> bool:
        """Whether anybody can answer: as long as what is typed has not ended."""
        return not self._ended or not self._words.empty()

    def tell(self, line: str) -> None:
        """Print a line."""
        self._show(line)

    def ask(self, question: str) -> None:
        """Put a question."""
        self._show(f"? {question}")

    def next_input(self) -> Said | None:
        """Return the next line typed, or None."""
        with contextlib.suppress(queue.Empty):
            return Said(self._words.get_nowait())
        return None


@contextlib.contextmanager
def counting_interrupts(operator: Operator) -> Iterator[None]:
    """Count Ctrl-C for an operator instead of stopping the program; the supervisor decides what it means."""

    def count(*_: object) -> None:
        operator.interrupts += 1

    before = {number: signal.signal(number, count) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
