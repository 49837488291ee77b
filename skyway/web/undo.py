"""Undoing a request, and repeating it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from skyway.web.controls import Button

if TYPE_CHECKING:
    from collections.abc import Callable

MOST = 100
"""Number of steps that can be undone."""
Asked = TypeVar("Asked")


class Undo(Generic[Asked]):
    """Previous and undone requests, with buttons and the usual keys.

    Parameters
    ----------
    turn_to : callable
        Makes a given request.
    """

    def __init__(self, turn_to: Callable[[Asked], object]) -> None:
        self._turn_to = turn_to
        self._now: Asked | None = None
        self._before: list[Asked] = []
        self._undone: list[Asked] = []

    def lay_out(self) -> None:
        """Lay out the buttons."""
        self._back = Button("Undo", self.undo, data_keys="ctrl+z", title="Ctrl+Z")
        self._again = Button("Redo", self.redo, data_keys="ctrl+shift+z", title="Ctrl+Shift+Z")

    def show(self, now: Asked) -> None:
        """Show what can be undone from the current request."""
        self._now = now
        self._back.enable(bool(self._before))
        self._again.enable(bool(self._undone))

    def leave(self, now: Asked) -> None:
        """Store the previous request, after a new one was made."""
        self._before = [*self._before[-MOST:], now]
        self._undone = []

    def undo(self) -> None:
        """Return to the previous request."""
        if self._before and self._now is not None:
            self._undone.append(self._now)
            self._turn_to(self._before.pop())

    def redo(self) -> None:
        """Undo an undo."""
        if self._undone and self._now is not None:
            self._before.append(self._now)
            self._turn_to(self._undone.pop())
