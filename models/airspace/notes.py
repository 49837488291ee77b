"""Notes on parts of an airspace file that were not understood, and how they count."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from skyway.models.base.errors import Fault, one_line

CLOSES_NOTHING = "closes nothing"
"""Begin of notes on items that are not zones."""


@dataclass(slots=True)
class Notes:
    """Notes of a reader on parts that it does not understand, each with its place in the file.

    Attributes
    ----------
    place : Fault
        File, line and feature that is read now.
    taken : list of Fault
        Items that were interpreted in the stricter way, which closes more, with a note.
    faults : list of Fault
        Items without a place or a meaning: a file with one of these is not used.
    """

    place: Fault
    taken: list[Fault] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def at(self, feature: str, line: int | None = None) -> None:
        """Continue with another feature."""
        self.place = replace(self.place, field=one_line(feature), line=line)

    def closed(self, what: str, problem: str, value: object, counted: str) -> None:
        """Note an item that is not understood, and how it counts."""
        self.taken.append(self._fault(what, problem, value, counted))

    def wrong(self, what: str, problem: str, value: object = None, remedy: str | None = None) -> None:
        """Note a fault."""
        self.faults.append(self._fault(what, problem, value, remedy))

    def _fault(self, what: str, problem: str, value: object, remedy: str | None) -> Fault:
        parts = [part for part in (self.place.field, what) if part]
        return replace(self.place, problem=problem, field=": ".join(parts) or None, value=value, remedy=remedy)
