"""Dialogue between the supervisor and the operator: questions, answers, commands, Ctrl-C."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.command.commander import WORDS, Commander, Person
from skyway.link.supervisor.command.orders import DEFERRED, matching, offered
from skyway.link.supervisor.departure.failsafes import left_words
from skyway.link.supervisor.journal.entries import OperatorNote, Ordered
from skyway.link.supervisor.states import IN_AIR, ON_GROUND, State, Turn
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.operators import Operator, Said

STALE_S = 30.0
"""Maximum age of a request, s: since an older one the situation may have changed."""


@dataclass(slots=True)
class Conversation:
    """Dialogue with one operator, or with several of whom one has command."""

    operator: Operator
    question: str | None = None
    """The open question; None if there is none."""
    answers: tuple[str, ...] = ()
    """Answers allowed to it."""
    question_n: int = 0
    """Number of the journal record with it."""
    stays: bool = False
    """The operator wants the vehicle to stay at the next landing."""
    take_off_confirmed: bool = False
    """A take-off of this delivery was confirmed."""
    paused: bool = False
    """The vehicle was ordered to hold its position, and not yet to continue."""
    commander: Commander = field(default_factory=Commander)
    _words: list[str] = field(default_factory=list)
    _orders: deque[Said] = field(default_factory=deque)
    _known: set[str] = field(default_factory=set)
    _interrupts: int = 0

    @property
    def attended(self) -> bool:
        """Whether an answer is possible: an operator is present, or unread input exists."""
        return self.operator.present or bool(self._words)

    def next_word(self) -> str | None:
        """Take the next input, in lower case; None if there is none."""
        return self._words.pop(0) if self._words else None

    def next_order(self) -> Said | None:
        """Take the next command for a vehicle in the air; None if there is none."""
        return self._orders.popleft() if self._orders else None

    def forget(self) -> None:
        """Discard all input so far: it does not answer the present question."""
        self._words.clear()
        self._orders.clear()

    def end_flight(self) -> None:
        """Discard the commands for a flight that has ended."""
        self._orders.clear()
        self.paused = False

    def pause(self, *, on: bool) -> None:
        """Record that the drone holds its position, or continues."""
        self.paused = on

    def allow(self, *, once: bool = True) -> None:
        """Record that a take-off was confirmed."""
        self.take_off_confirmed = once

    def ask_again(self, *, stays: bool) -> None:
        """Record that a person ended the flight: the next take-off needs a confirmation, or, if the drone stays, the command `go`."""
        self.take_off_confirmed = False
        self.stays = self.stays or stays

    def restore(self, entry: Ordered) -> None:
        """Restore from an ``order`` record of a journal: a request that was processed once is never processed again."""
        self._known.add(entry.id or "")
        if entry.holder is not None:
            self.commander.restore(Person(entry.holder, entry.holder_name or "somebody"))

    def listen(self, ctx: Context) -> None:
        """Read the operator's input at any time; Ctrl-C on the ground, or twice in the air, raises a `Turn`."""
        if (said := self.operator.next_input()) is not None:
            self._take(ctx, replace(said, word=" ".join(said.word.split()).lower()))
        if over := self.commander.overdue(ctx.vehicle.connection.clock.now_s()):
            self._note_command(ctx, "take", "taken", over)
        if self.operator.interrupts > self._interrupts:
            self._interrupts = self.operator.interrupts
            self._stay(ctx, "Ctrl-C")

    def _take(self, ctx: Context, said: Said) -> None:
        if said.id:
            if said.id in self._known:
                return
            self._known.add(said.id)
            if said.word in WORDS:
                taken, why = self.commander.hear(said, ctx.vehicle.connection.clock.now_s())
                self._note_command(ctx, said.word, "taken" if taken else "refused", why, said)
                return
        meant = matching(said.word, offered(ctx))
        if said.id:
            refused = self._refused(ctx, said, meant)
            note = Ordered(
                word=said.word, done="refused" if refused else "taken", id=said.id, who=said.who, name=said.name
            )
            reason = f"refused: {refused}" if refused else "taken"
            ctx.note(note, f"{said.name or 'somebody'} ordered {said.word}: {reason}")
            if refused:
                return
        if meant is None:
            self._words.append(said.word)  # typed ahead: the next question may be answered by it
        else:
            self._do(ctx, replace(said, word=meant))

    def _note_command(self, ctx: Context, word: str, done: str, why: str, said: Said | None = None) -> None:
        """Journal the effect of a command."""
        holder = self.commander.holder
        entry = Ordered(
            word=word, done=done, id=None if said is None else said.id, who=None if said is None else said.who,
            name=None if said is None else said.name, holder=None if holder is None else holder.id,
            holder_name=None if holder is None else holder.name,
        )  # fmt: skip
        ctx.say(entry, why)

    def _refused(self, ctx: Context, said: Said, meant: str | None) -> str:
        """Return why a request is rejected; empty if it is accepted."""
        if why := self.commander.refuse(said):
            return why
        if said.age_s > STALE_S:
            return f"it was asked {duration(said.age_s)} ago"
        if meant is None:
            now = ", ".join(offered(ctx)) or "nothing"
            return f"in the state {ctx.state} there is: {now}"
        if self.question is not None and said.about != self.question_n:
            return "it does not answer the open question"
        return ""

    def _do(self, ctx: Context, said: Said) -> None:
        """Execute an input at once, or keep it as an answer to its question."""
        word = said.word.partition(" ")[0]
        if self.question is not None or ctx.state is State.HOLDING or word == "charged":
            self._words.append(said.word)
        elif word == "go" and self.stays and not ctx.stands_in_air:
            self.stays = False
            ctx.note(OperatorNote(), "go: the delivery continues")
        elif word == "stay":
            self._stay(ctx, said.name or "the operator")
        elif word == "leave":
            raise Turn(State.LEFT, f"the program ends, as ordered, and leaves the drone to itself; {left_words(ctx)}")
        elif word in DEFERRED and ctx.state in IN_AIR:
            if not said.id:
                ctx.note(Ordered(word=said.word, done="taken"), f"the operator ordered {said.word}")
            self._orders.append(said)

    def _stay(self, ctx: Context, by: str) -> None:
        """Keep the vehicle where it stands or lands next; a second Ctrl-C ends the program."""
        typed = by == "Ctrl-C"
        if self.stays and typed:
            raise Turn(State.LEFT, f"Ctrl-C twice: the program ends and leaves the drone to itself; {left_words(ctx)}")
        if ctx.on_ground and ctx.state in (State.CONNECTING, *ON_GROUND):
            ctx.note(OperatorNote(), f"{by} on the ground" if typed else f"{by}: the drone stays")
            raise Turn(
                State.STOPPED,
                f"{by}: the drone stays at {_heading_for(ctx)}, disarmed; --resume continues the delivery",
            )
        self.stays = True
        ctx.note(OperatorNote(), f"{by}: the drone stays at the next landing")
        again = f"Ctrl-C again ends the program now; then {left_words(ctx)}"
        self.operator.ask(
            f"{by}: the drone lands at {_heading_for(ctx)} and stays there. Type go to continue the delivery after all. {again}"
        )

    def answer(self, ctx: Context, question: str, words: tuple[str, ...]) -> str:
        """Let time pass until the operator types one of the allowed words; a `Turn` if no operator is present any more."""
        record = ctx.note(OperatorNote(question=question, answers=words), f"asked: {question}")
        self.operator.ask(question)
        self.question, self.answers, self.question_n = question, words, record.n
        try:
            while True:
                while (word := self.next_word()) is not None:
                    if word in words:
                        return word
                    self.operator.ask(f"not understood. Please answer: {', '.join(words)}")
                if not self.attended:
                    raise Turn(State.STOPPED, f"nobody can answer the question any more: {question}")
                ctx.tick()
        finally:
            self.question, self.answers = None, ()


def _heading_for(ctx: Context) -> str:
    """Name the place of the next landing for the operator."""
    if ctx.delivery.leg is not None and ctx.in_air:
        return ctx.delivery.leg.destination
    return ctx.delivery.station or "this place"
