"""The person who watches: told, asked, and heard without ever keeping the vehicle waiting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable


class Operator(Protocol):
    """Whoever decides what a program must not."""

    @property
    def present(self) -> bool:
        """Whether anybody can answer."""
        ...

    @property
    def interrupts(self) -> int:
        """How often Ctrl-C was pressed."""
        ...

    def tell(self, line: str) -> None:
        """Print a line."""
        ...

    def ask(self, question: str) -> None:
        """Put a question; the answer is heard later."""
        ...

    def heard(self) -> str | None:
        """Return what was said, a word at a time; None for nothing as yet. Never waits."""
        ...


@dataclass(slots=True)
class NobodyThere:
    """For dry runs: lines are shown, nobody answers."""

    show: Callable[[str], None] = lambda _: None
    """Takes a line."""
    interrupts: int = 0
    present: bool = False

    def tell(self, line: str) -> None:
        """Show it."""
        self.show(line)

    def ask(self, question: str) -> None:
        """Show it too."""
        self.show(question)

    def heard(self) -> str | None:
        """Nothing."""
        return None
