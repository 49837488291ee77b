"""Command authority over a delivery: held by one of the persons who watch it; others request it, and the holder grants or refuses it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from skyway.link.supervisor.operators import Said

SILENT_S = 20.0
"""Time after which a holder who has not answered a request loses command to the requester, s."""
WORDS = ("take", "give", "keep")
"""Commands about command authority itself: request it; grant it to the requester; or keep it."""


@dataclass(frozen=True, slots=True)
class Person:
    """A person who watches with a browser."""

    id: str
    name: str


@dataclass(slots=True)
class Commander:
    """Command authority over one delivery. Commands at the program's own console do not need it."""

    holder: Person | None = None
    """The person who has command."""
    requester: Person | None = None
    """The person who requests command."""
    requested_s: float = 0.0
    """Time of the request by this computer's clock, POSIX seconds."""

    def restore(self, holder: Person | None) -> None:
        """Restore command from a journal."""
        self.holder, self.requester = holder, None

    def refuse(self, said: Said) -> str:
        """Return why a person may not give orders; empty if the person may."""
        if self.holder is None:
            return "nobody has command: press Take command first"
        if self.holder.id != said.who:
            return f"{self.holder.name} has command: ask for it first"
        return ""

    def hear(self, said: Said, now_s: float) -> tuple[bool, str]:
        """Process one of `WORDS`; return whether it is accepted, and its effect in words."""
        person = Person(said.who, said.name or "somebody")
        if said.word == "take":
            return self._request(person, now_s)
        if self.holder is None or self.holder.id != person.id:
            return False, f"{person.name} does not have command"
        if self.requester is None:
            return False, "nobody asks for command"
        requester, self.requester = self.requester, None
        if said.word == "keep":
            return True, f"{person.name} keeps command; {requester.name} had asked for it"
        self.holder = requester
        return True, f"{person.name} gave command to {requester.name}"

    def _request(self, person: Person, now_s: float) -> tuple[bool, str]:
        if self.holder is None:
            self.holder = person
            return True, f"{person.name} has command"
        if self.holder.id == person.id:
            return False, f"{person.name} has command already"
        if self.requester is not None:
            return False, f"{self.requester.name} asks for command already"
        self.requester, self.requested_s = person, now_s
        return True, f"{person.name} asks {self.holder.name} for command, who has {duration(SILENT_S)} to keep it"

    def overdue(self, now_s: float) -> str:
        """Give command to the requester if the holder has not answered in time; return what happened, or an empty string."""
        if self.requester is None or self.holder is None or now_s < self.requested_s + SILENT_S:
            return ""
        before, self.holder, self.requester = self.holder, self.requester, None
        return f"{self.holder.name} took command: {before.name} had not answered for {duration(SILENT_S)}"
