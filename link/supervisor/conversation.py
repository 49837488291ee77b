"""What is said between the supervisor and the operator: questions, answers, Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.departure.failsafes import left_words
from skyway.link.supervisor.journal.entries import OperatorNote
from skyway.link.supervisor.states import ON_GROUND, State, Turn

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.operators import Operator


@dataclass(slots=True)
class Conversation:
    """The conversation with one operator."""

    operator: Operator
    question: str | None = None
    """What was asked and is not answered."""
    stays: bool = False
    """The operator wants the vehicle to stay at the next landing."""
    asked_once: bool = False
    """A take-off of this delivery was allowed."""
    _words: list[str] = field(default_factory=list)
    _interrupts: int = 0

    @property
    def attended(self) -> bool:
        """Whether an answer may come: somebody is there, or has said something that is not yet taken."""
        return self.operator.present or bool(self._words)

    def next_word(self) -> str | None:
        """Take the next thing said, in small letters; None where there is none."""
        return self._words.pop(0) if self._words else None

    def forget(self) -> None:
        """Forget what was said so far: it was no answer to what is asked now."""
        self._words.clear()

    def allow(self, *, once: bool = True) -> None:
        """Note that a take-off was allowed."""
        self.asked_once = once

    def listen(self, ctx: Context) -> None:
        """Take what the operator says at any time; Ctrl-C on the ground, or twice in the air, is raised as a `Turn`."""
        word = self.operator.heard()
        if word:
            self._words.append(word.strip().lower())
        if self.operator.interrupts > self._interrupts:
            self._interrupts = self.operator.interrupts
            self._interrupted(ctx)
        if self.stays and self._words and self._words[-1] == "go":
            self._words.pop()
            self.stays = False
            ctx.note(OperatorNote(), "go: the delivery continues")

    def _interrupted(self, ctx: Context) -> None:
        if self.stays:
            raise Turn(State.LEFT, f"Ctrl-C twice: the program ends and leaves the drone to itself; {left_words(ctx)}")
        if ctx.on_ground and ctx.state in (State.CONNECTING, *ON_GROUND):
            ctx.note(OperatorNote(), "Ctrl-C on the ground")
            raise Turn(
                State.STOPPED,
                f"Ctrl-C: the drone stays at {_heading_for(ctx)}, disarmed; --resume continues the delivery",
            )
        self.stays = True
        ctx.note(OperatorNote(), "Ctrl-C: the drone stays at the next landing")
        self.operator.ask(
            f"Ctrl-C: the drone lands at {_heading_for(ctx)} and stays there. Type go to continue the delivery after all. "
            f"Ctrl-C again ends the program now; then {left_words(ctx)}"
        )

    def answer(self, ctx: Context, question: str, words: tuple[str, ...]) -> str:
        """Let time pass until the operator says one of some words; it stops (a `Turn`) where nobody is there any more."""
        ctx.note(OperatorNote(question=question, answers=words), f"asked: {question}")
        self.operator.ask(question)
        self.question = question
        try:
            while True:
                while (word := self.next_word()) is not None:
                    if word in words:
                        return word
                    self.operator.ask(f"not understood. Please answer: {', '.join(words)}")
                if not self.attended:
                    raise Turn(State.STOPPED, f"nobody is there any more to answer the question: {question}")
                ctx.tick()
        finally:
            self.question = None


def _heading_for(ctx: Context) -> str:
    """Where it will stand next, for a person."""
    if ctx.delivery.leg is not None and ctx.in_air:
        return ctx.delivery.leg.destination
    return ctx.delivery.station or "this place"
