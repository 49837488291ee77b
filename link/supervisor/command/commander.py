"""Command of a delivery: one person among all who watch; another person asks for it, and is given it or refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from skyway.link.supervisor.operators import Said

SILENT_S = 20.0
"""Who has command and does not answer for so long has left: it goes to the one who asks."""
WORDS = ("take", "give", "keep")
"""What is said about command itself: ask for it; give it to the one who asks, or keep it."""


@dataclass(frozen=True, slots=True)
class Person:
    """A person who watches with a browser."""

    id: str
    name: str


@dataclass(slots=True)
class Commander:
    """Command of one delivery. Commands at the console of the program itself do not need it."""

    holder: Person | None = None
    """Who has it."""
    asker: Person | None = None
    """Who asks for it."""
    asked_s: float = 0.0
    """Since when, by the clock of this computer."""

    def restore(self, holder: Person | None) -> None:
        """Restore command from a journal."""
        self.holder, self.asker = holder, None

    def refuse(self, said: Said) -> str:
        """Return why somebody may not give orders; empty where they may."""
        if self.holder is None:
            return "nobody has command: press Take command first"
        if self.holder.id != said.who:
            return f"{self.holder.name} has command: ask for it first"
        return ""

    def hear(self, said: Said, now_s: float) -> tuple[bool, str]:
        """Hear one of `WORDS`; returns whether it is taken, and what becomes of command."""
        person = Person(said.who, said.name or "somebody")
        if said.word == "take":
            return self._asked(person, now_s)
        if self.holder is None or self.holder.id != person.id:
            return False, f"{person.name} does not have command"
        if self.asker is None:
            return False, "nobody asks for command"
        asker, self.asker = self.asker, None
        if said.word == "keep":
            return True, f"{person.name} keeps command; {asker.name} had asked for it"
        self.holder = asker
        return True, f"{person.name} gave command to {asker.name}"

    def _asked(self, person: Person, now_s: float) -> tuple[bool, str]:
        if self.holder is None:
            self.holder = person
            return True, f"{person.name} has command"
        if self.holder.id == person.id:
            return False, f"{person.name} has command already"
        if self.asker is not None:
            return False, f"{self.asker.name} asks for command already"
        self.asker, self.asked_s = person, now_s
        return True, f"{person.name} asks {self.holder.name} for command, who has {duration(SILENT_S)} to keep it"

    def overdue(self, now_s: float) -> str:
        """Give command to the asker where nobody has answered in time; returns what happened, or nothing."""
        if self.asker is None or self.holder is None or now_s < self.asked_s + SILENT_S:
            return ""
        before, self.holder, self.asker = self.holder, self.asker, None
        return f"{self.holder.name} took command: {before.name} had not answered for {duration(SILENT_S)}"
