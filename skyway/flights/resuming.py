"""Resuming a delivery from its journal: when it was begun, and whether it is the one that is to be flown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.units import parse_instant
from skyway.models.composition.file import to_json

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime
    from pathlib import Path

    from skyway.models.composition.composition import Composition

FIELD = "--resume"


@dataclass(frozen=True, eq=False, slots=True)
class Begun:
    """A delivery, or the flights of a cut mission, that has been begun and has not ended well."""

    journal: Path
    at: datetime
    """When it was begun."""
    composition: Mapping[str, object]
    """What it was begun with, as stored."""

    def refuse_other_delivery(self, given: Composition) -> None:
        """Raise an `InputError` if it is another delivery than that of a plan."""
        ours, theirs = _delivery(to_json(given)), _delivery(self.composition)
        if ours == theirs:
            return
        begun_with, asked = (" to ".join(str(one) for one in told[:2]) for told in (theirs, ours))
        problem = f"is of another delivery: {begun_with}, not {asked}"
        if begun_with == asked:
            problem = f"is of another plan of {asked}: its departure, drone or package differ"
        raise InputError(problem, str(self.journal), field=FIELD, remedy="give the plan that it was begun with")

    def refuse_other_set(self, identity: str) -> None:
        """Raise an `InputError` if these are not the flights of a cut mission, see `skyway.recharge.output.identity_of`."""
        if self.composition.get("id") != identity:
            remedy = "give the folder of its flight, or another journal"
            raise InputError("is not a journal of this set", str(self.journal), field=FIELD, remedy=remedy)


def begun_in(journal: Path) -> Begun:
    """Read what a journal was begun with. An `InputError` refuses one that has ended well: nothing is left to do."""
    from skyway.link.supervisor import State, read_journal
    from skyway.link.supervisor.journal.entries import Start, StateEntered

    records = read_journal(journal).records
    entered = [(record, entry) for record in records if (entry := record.entry(StateEntered))]
    last, state = entered[-1] if entered else (records[0], None)
    if state is not None and state.after in (State.DELIVERED, State.DONE):
        remedy = (
            f"nothing is left to fly; skyway params restore {journal} sets back what may still be changed on the drone"
        )
        raise InputError(f"ended at {last.time}: {last.reason}", str(journal), field=FIELD, remedy=remedy)
    start = records[0].entry(Start)
    return Begun(journal, parse_instant(records[0].time), {} if start is None else start.composition)


def _delivery(composition: Mapping[str, object]) -> tuple[object, ...]:
    """Return what makes a delivery this one, of a composition as stored."""
    return tuple(composition.get(name) for name in ("from", "to", "depart", "drone", "payload_kg"))
