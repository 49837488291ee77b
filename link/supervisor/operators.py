"""The operator: receives messages and questions, and never blocks the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Said:
    """Something that a person said."""

    word: str
    id: str = ""
    """Of a request, which is answered in the journal and counts once; empty for what is typed at a console."""
    who: str = ""
    name: str = ""
    """Browser session, and what the person is called."""
    about: int | None = None
    """Number of the record with the question that it answers."""
    age_s: float = 0.0
    """How long ago it was said."""


class Operator(Protocol):
    """The person who decides what a program must not."""

    interrupts: int
    """How often Ctrl-C was pressed."""

    @property
    def present(self) -> bool:
        """Whether anybody can answer."""
        ...

    def tell(self, line: str) -> None:
        """Print a line."""
        ...

    def ask(self, question: str) -> None:
        """Put a question; the answer is heard later."""
        ...

    def heard(self) -> Said | None:
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

    def heard(self) -> Said | None:
        """Nothing."""
        return None
