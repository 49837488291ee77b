"""The person who watches: told, asked, and heard without ever keeping the vehicle waiting."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
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
    """Rehearsals: lines are shown, nobody answers.

    Attributes
    ----------
    show : callable
        Takes a line.
    """

    show: Callable[[str], None] = lambda _: None
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


@dataclass(slots=True)
class Scripted:
    """An operator of tests: answers by a function of the question and of how often it was asked.

    Attributes
    ----------
    answers : callable
        (question, time asked) to (delay in seconds, answer), or None for silence.
    now_s : callable
        The time.
    """

    answers: Callable[[str, int], tuple[float, str] | None]
    now_s: Callable[[], float]
    lines: list[str] = field(default_factory=list)
    interrupts: int = 0
    present: bool = True
    _asked: dict[str, int] = field(default_factory=dict)
    _due: deque[tuple[float, str]] = field(default_factory=deque)

    def tell(self, line: str) -> None:
        """Keep it."""
        self.lines.append(line)

    def ask(self, question: str) -> None:
        """Work out an answer."""
        self.lines.append(question)
        number = self._asked[question] = self._asked.get(question, 0) + 1
        answer = self.answers(question, number)
        if answer is not None:
            self._due.append((self.now_s() + answer[0], answer[1]))

    def heard(self) -> str | None:
        """Say what is due."""
        if self._due and self._due[0][0] <= self.now_s():
            return self._due.popleft()[1]
        return None
