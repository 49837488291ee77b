"""Parameters that a delivery changes on the vehicle: listed beforehand, journaled before they are set, restored at its end."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Literal

from msgspec.structs import replace

from skyway.link.supervisor.journal.entries import ParameterNote
from skyway.link.supervisor.observed.link_watch import ask
from skyway.models.base.errors import CommandRefusedError, LinkError, ParameterAbsentError, VehicleTimeoutError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.journal.file import Record
    from skyway.link.vehicle.vehicle import Vehicle

_TRIES = 6
"""Attempts at the end, where nothing else is waited for; an attempt without an answer takes some 5 s."""
_SAME = 1e-6


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A parameter that is to be changed."""

    name: str
    """The autopilot's name of it."""
    before: float
    after: float
    """`before`, `after`: value on the vehicle, and value to be set."""
    why: str
    """Consequence if it is not set."""

    def __str__(self) -> str:
        return f"{self.name} {self.before:g} > {self.after:g}: {self.why}"


@dataclass(slots=True)
class ParameterChanges:
    """Parameters that a delivery has changed, or will change."""

    proposed: tuple[ParameterChange, ...] = ()
    """For the next leg."""
    before: dict[str, float] = field(default_factory=dict)
    ours: dict[str, float] = field(default_factory=dict)
    """`before`, `ours`: by name: the value before the first change of the delivery, and the last value set."""

    @property
    def unconfirmed(self) -> tuple[ParameterChange, ...]:
        """Proposed changes that this delivery has not made before, and that the operator has not confirmed."""
        return tuple(setting for setting in self.proposed if setting.name not in self.ours)

    def propose(self, proposed: Iterable[ParameterChange]) -> None:
        """Propose the changes of the next leg."""
        self.proposed = tuple(proposed)

    def take_proposed(self) -> tuple[ParameterChange, ...]:
        """Return the proposed changes, which are about to be set, and clear them."""
        proposed, self.proposed = self.proposed, ()
        return proposed

    def follow(self, records: Iterable[Record]) -> None:
        """Restore from the ``parameter`` records of a journal."""
        for record in records:
            if note := record.entry(ParameterNote):
                self.take(note)

    def take(self, note: ParameterNote) -> None:
        """Restore from one ``parameter`` record of a journal."""
        if note.name is None:
            return  # a journal written before values were stored
        if note.done == "setting" and note.before is not None and note.after is not None:
            self.before.setdefault(note.name, note.before)
            self.ours[note.name] = note.after
        elif note.done in ("restored", "released"):
            self.before.pop(note.name, None)
            self.ours.pop(note.name, None)

    def words(self) -> str:
        """Describe the remaining changes."""
        return ", ".join(f"{name} {self.ours[name]:g} (before: {value:g})" for name, value in self.before.items())


def changes_of(records: Iterable[Record]) -> ParameterChanges:
    """Return the parameters that are still changed on the vehicle, according to a journal."""
    found = ParameterChanges()
    found.follow(records)
    return found


def _note(ctx: Context, entry: ParameterNote, reason: str) -> None:
    ctx.note(entry, reason)
    ctx.parameters.take(entry)


def apply(ctx: Context) -> None:
    """Set what was proposed, each with its old value on the disk before, and read back.

    Raises a `LinkError` if the vehicle refuses one, or does not answer.
    """
    proposed = ctx.parameters.take_proposed()
    for one in proposed:
        setting = ParameterNote(name=one.name, done="setting", before=one.before, after=one.after)
        reason = f"{one.name} is set from {one.before:g} to {one.after:g}: {one.why}"
        _note(ctx, setting, reason)
        ask(ctx, partial(_set, ctx, one))
        ctx.note(replace(setting, done="set"), f"{one.name} is {one.after:g}, read back")
    if proposed:
        ctx.tell(f"{_count(len(proposed))} set and read back")


def _set(ctx: Context, one: ParameterChange) -> None:
    """Set one that was read before: if it now seems absent, its answers were lost."""
    try:
        ctx.vehicle.set_parameter(one.name, one.after)
    except ParameterAbsentError:
        raise VehicleTimeoutError(f"set {one.name}", 0.0) from None


def restore_all(vehicle: Vehicle, changes: ParameterChanges, tell: Callable[[str, str, str, float], None]) -> str:
    """Restore the parameters of a disarmed vehicle; returns why some could not be restored, or nothing.

    A parameter that has neither its old value nor ours was changed by somebody else, and is not touched. `tell` takes name,
    ``restored`` or ``released``, a sentence and the value that it has now; `changes` is not modified here.
    """
    problems = []
    for name, before in list(changes.before.items()):
        try:
            done, sentence, value = _restore(vehicle, name, before, changes.ours[name])
        except CommandRefusedError as error:
            problems.append(str(error))
        except LinkError as error:
            return "; ".join([*problems, str(error)])
        else:
            tell(name, done, sentence, value)
    return "; ".join(problems)


def state_of(now: float, before: float, ours: float) -> Literal["as before", "of somebody else", "changed"]:
    """Whether a parameter has its value of before a delivery, another one that somebody else has set, or still ours."""
    if _same(now, before):
        return "as before"
    return "changed" if _same(now, ours) else "of somebody else"


def _restore(vehicle: Vehicle, name: str, before: float, ours: float) -> tuple[str, str, float]:
    """Restore one parameter, with a repetition of unanswered requests."""
    for _ in range(_TRIES - 1):
        try:
            return _restore_once(vehicle, name, before, ours)
        except VehicleTimeoutError:
            continue
    return _restore_once(vehicle, name, before, ours)


def _restore_once(vehicle: Vehicle, name: str, before: float, ours: float) -> tuple[str, str, float]:
    now = vehicle.parameter(name).value
    state = state_of(now, before, ours)
    if state == "as before":
        return "restored", f"{name} is {before:g} again", now
    if state == "of somebody else":
        return "released", f"{name} is {now:g}, set by somebody else: not changed", now
    found = vehicle.set_parameter(name, before).value
    return "restored", f"{name} restored from {now:g} to {before:g}", found


def _same(one: float, other: float) -> bool:
    """Whether two values are one 32-bit float."""
    return abs(one - other) <= _SAME * max(1.0, abs(one), abs(other))


def restore_at_end(ctx: Context) -> None:
    """Restore parameters at the end of a delivery if the vehicle is disarmed on the ground; in the air its failsafes are not changed."""
    changes = ctx.parameters
    if not changes.before:
        return
    count = len(changes.before)
    if not ctx.job.restore_parameters:
        ctx.tell(f"{_count(count)} left changed on the drone, as ordered: {changes.words()}")
        return
    if not ctx.on_ground:
        why = "the drone does not stand disarmed on the ground"
    else:
        done: list[str] = []

        def report(name: str, how: str, sentence: str, value: float) -> None:
            done.append(name)
            if how == "released":
                ctx.tell(sentence)
            _note(ctx, ParameterNote(name=name, done=how, value=value), sentence)

        why = restore_all(ctx.vehicle, changes, report)
        if done:
            ctx.tell(f"parameters restored and read back: {', '.join(done)}")
    if changes.before:
        ctx.note(ParameterNote(done="left", names=tuple(changes.before)), f"not restored: {changes.words()}")
        ctx.tell(
            f"{_count(len(changes.before))} not restored ({why}): {changes.words()}; restore with: "
            f"skyway params restore {ctx.journal.path}"
        )


def _count(number: int) -> str:
    return "1 parameter" if number == 1 else f"{number} parameters"


def change_lines(settings: Sequence[ParameterChange], *, restored: bool) -> list[str]:
    """List the changes to be made, one per line."""
    if not settings:
        return []
    after = "restored at the end" if restored else "not restored"
    return [f"{_count(len(settings))} to set on the drone (old > new; {after}):", *(f"  {one}" for one in settings)]
