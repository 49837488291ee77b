"""Observations of other ground stations, for the operator and the journal: each once, in a limited number of lines."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.forwarding.clients import Client

_FOLD_S = 5.0
"""Within this time, a repeated event of a client is not noted again."""
_MAX_NOTES, _MAX_TOLD = 200, 256
_MANY, _MANY_S = 8, 10.0
"""Largest number of notes about one client within a time; then one note reports that there are more, until the client has been quiet for as long."""


@dataclass(frozen=True, slots=True)
class Note:
    """An event of a client, for the operator and the journal."""

    client: str
    """Its address."""
    system: int | None
    component: int | None
    """`system`, `component`: the sender; None if irrelevant."""
    what: str
    """``joined``, ``passed``, ``refused``, ``impersonates`` (also by a loop of routers), ``flood`` or ``garbage``."""
    order: str | None
    """The command, by its MAVLink name."""
    said: str
    """A sentence."""


@dataclass(slots=True)
class Notes:
    """All notes, without repetitions."""

    tell: Callable[[Note], None] | None = None
    """Called with each note at once; without it they are kept for `all`."""
    _kept: deque[Note] = field(default_factory=lambda: deque(maxlen=_MAX_NOTES))
    _told: dict[tuple[Any, ...], float] = field(default_factory=dict)

    def all(self) -> list[Note]:
        """Return the notes since the last call, the oldest first."""
        found = list(self._kept)
        self._kept.clear()
        return found

    def take(
        self,
        client: Client,
        sender: tuple[int, int] | None,
        what: str,
        ordered: str | None,
        said: str,
        now_s: float,
        *,
        fold_s: float = _FOLD_S,
    ) -> None:
        """Keep a note; a lasting or repeated event is noted once, and of frequent refusals only the first."""
        key = (client.name, sender, what, ordered)
        last = self._told.get(key)
        if len(self._told) > _MAX_TOLD:
            self._told = {one: then for one, then in self._told.items() if one[2] == "flood"}
        self._told[key] = now_s
        if last is not None and now_s <= last + fold_s:
            return
        if what in ("refused", "joined") and _is_one_of_many(client.noted_s, now_s):
            said = f"client {client.name}: many messages refused, or many ids; further ones are not listed"
            self.take(client, None, "flood", None, said, now_s, fold_s=60.0)
            return
        system, component = sender or (None, None)
        note = Note(client.name, system, component, what, ordered, said)
        if self.tell is None:
            self._kept.append(note)
        else:
            self.tell(note)


def _is_one_of_many(noted_s: deque[float], now_s: float) -> bool:
    """Whether a note is suppressed because there were many about a client lately."""
    while noted_s and now_s > noted_s[0] + _MANY_S:
        noted_s.popleft()
    many = len(noted_s) >= _MANY
    if many:
        noted_s.popleft()
    noted_s.append(now_s)  # suppressed notes count, too: so the suppression continues while the events do
    return many
