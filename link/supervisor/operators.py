"""The operator: receives messages and questions, and never blocks the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Said:
    """An input of a person."""

    word: str
    id: str = ""
    """Id of a request, which is journaled and counts once; empty for console input."""
    who: str = ""
    name: str = ""
    """Browser session, and name of the person."""
    about: int | None = None
    """Number of the record with the question that it answers."""
    age_s: float = 0.0
    """Age, s."""


class Operator(Protocol):
    """The person who takes the decisions that a program must not."""

    interrupts: int
    """Number of times that Ctrl-C was pressed."""

    @property
    def present(self) -> bool:
        """Whether anybody can answer."""
        ...

    def tell(self, line: str) -> None:
        """Print a line."""
        ...

    def ask(self, question: str) -> None:
        """Show a question; `next_input` returns the answer later."""
        ...

    def next_input(self) -> Said | None:
        """Return the next input; None if there is none. Never waits."""
        ...


@dataclass(slots=True)
class NobodyThere:
    """Operator of dry runs: lines are shown, nobody answers."""

    show: Callable[[str], None] = lambda _: None
    """Displays a line."""
    interrupts: int = 0
    present: bool = False

    def tell(self, line: str) -> None:
        """Show a line."""
        self.show(line)

    def ask(self, question: str) -> None:
        """Show a question."""
        self.show(question)

    def next_input(self) -> Said | None:
        """Return None: there is no input."""
        return None
