"""Verified upload: send, read back, compare in meaning, and then repeat or roll back.

Only the items read back are trusted: acknowledgements are lost, duplicated, late, or meant for others.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

from skyway.link.protocol.download import Download
from skyway.link.protocol.mission_words import PASSING, MissionKind, in_words
from skyway.link.protocol.upload import Upload, UploadEnd
from skyway.link.protocol.verdict import AskVerdict
from skyway.missions.autopilots.read_back import Difference, diff
from skyway.missions.autopilots.wire import (
    WireItem,
    fence_from_wire,
    fence_to_wire,
    rally_from_wire,
    rally_to_wire,
)
from skyway.missions.items.geofence import Geofence
from skyway.missions.items.mission import Mission
from skyway.missions.items.rally import RallyPoints
from skyway.models.base.errors import InputError
from skyway.models.base.views import how_often

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.protocol.exchange import Steps, Target
    from skyway.missions.autopilots.family import Family

Part = Mission | Geofence | RallyPoints
"""Contents that can be uploaded."""
ATTEMPTS = 6
_REREADS = 2


class UploadState(Enum):
    """Result of an upload."""

    VERIFIED = "verified"
    REFUSED = "refused"
    ROLLED_BACK = "rolled back"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class UploadOutcome:
    """Outcome of an upload, and the vehicle's list after it."""

    state: UploadState
    """Verified: it was read back and means the same. Refused: the vehicle still has its old list, or it has accepted the new one
    and reports that it will not fly it. Rolled back: its old list was sent again and read back. Unknown: see `holds`;
    a start is blocked."""
    kind: MissionKind
    """The contents sent."""
    holds: str
    """The vehicle's actual or possible contents, for a person."""
    reason: str = ""
    """Reason why it is not verified; empty if it is."""
    items: tuple[int, ...] = ()
    """Our numbers of the items that a refusal concerns."""
    differences: tuple[Difference, ...] = ()
    """Differences in the latest read-back."""
    attempts: int = 0
    """Transfers begun."""
    infeasible: bool = False
    """It was accepted, read back the same, but the vehicle reports that it will not fly it."""

    @property
    def blocks_start(self) -> bool:
        """Whether the vehicle must not be started after this."""
        return self.state is UploadState.UNKNOWN or self.infeasible

    @property
    def verified(self) -> bool:
        """Whether the vehicle has the contents that were sent."""
        return self.state is UploadState.VERIFIED

    def __str__(self) -> str:
        text = f"{self.kind.word}: {self.state.value}; the vehicle holds {self.holds}"
        return f"{text} ({self.reason})" if self.reason else text


@dataclass(frozen=True, slots=True)
class UploadJob:
    """Contents, target and options of an upload."""

    target: Target
    family: Family
    part: Part
    """Desired contents."""
    current: int = 0
    """Our number of the item to be flown first."""
    may_roll_back: Callable[[], bool] = field(default=lambda: False)
    """Whether the old contents may be restored now: only while disarmed."""
    texts: Callable[[], Sequence[str]] = field(default=tuple)
    """The vehicle's texts so far, the newest last."""
    progress: Callable[[str, int, int], None] | None = None
    """Called with (stage, items done, items)."""

    @property
    def kind(self) -> MissionKind:
        """Which of the three lists."""
        return kind_of(self.part)

    @property
    def shift(self) -> int:
        """Offset of the autopilot's item numbers to ours."""
        return self.family.home_items if self.kind is MissionKind.MISSION else 0


def kind_of(part: Part) -> MissionKind:
    """Which of the three lists something belongs to."""
    if isinstance(part, Mission):
        return MissionKind.MISSION
    return MissionKind.FENCE if isinstance(part, Geofence) else MissionKind.RALLY


def encode(part: Part, family: Family, current: int = 0) -> tuple[WireItem, ...]:
    """Convert contents to the wire format of an autopilot."""
    if isinstance(part, Mission):
        return family.to_wire(part, current=current)
    return fence_to_wire(part) if isinstance(part, Geofence) else rally_to_wire(part)


def decode(items: Sequence[WireItem], kind: MissionKind, family: Family) -> Part:
    """Decode a received list. Raises an `InputError` if the items do not form a fence, or rally points."""
    if kind is MissionKind.MISSION:
        return family.from_wire(items)
    return fence_from_wire(items) if kind is MissionKind.FENCE else rally_from_wire(items)


def compare(sent: Part, items: Sequence[WireItem], family: Family) -> tuple[Difference, ...]:
    """Return the differences in meaning between the items sent and read back."""
    try:
        return diff(sent, decode(items, kind_of(sent), family), family.name)
    except InputError as error:
        return (Difference(None, "items", "valid", str(error)),)


def upload_verified(job: UploadJob) -> Steps[UploadOutcome]:
    """Upload until the read-back means the same, the vehicle refuses, or no further attempt is possible."""
    run = _Run(job)
    before = None
    if job.may_roll_back():
        down = run.download("reading what is there")
        yield down
        if down.items is None:
            holds = "what it held before: nothing was sent"
            if down.lacks:
                return run.outcome(UploadState.REFUSED, holds, down.problem)
            return run.outcome(UploadState.UNKNOWN, holds, f"it cannot be read: {down.problem}")
        before = down.items
    return (yield from run.send_until_verified(before))


class _Run:
    """One verified upload in progress."""

    def __init__(self, job: UploadJob) -> None:
        self.job = job
        self.wire = encode(job.part, job.family, job.current)
        self.attempts = 0
        self.differences: tuple[Difference, ...] = ()
        self._texts = len(job.texts())
        self._sent = -1
        self._unread = ""

    def outcome(self, state: UploadState, holds: str, reason: str = "", items: tuple[int, ...] = ()) -> UploadOutcome:
        differences = () if state is UploadState.VERIFIED else self.differences
        return UploadOutcome(state, self.job.kind, holds, reason, items, differences, self.attempts)

    def download(self, what: str) -> Download:
        job = self.job
        return Download(job.target, job.kind, progress=self._progress(what))

    def _upload(self, items: Sequence[WireItem], what: str) -> Upload:
        self.attempts += 1
        job = self.job
        return Upload(job.target, items, job.kind, progress=self._progress(what))

    def _progress(self, what: str) -> Callable[[int, int], None] | None:
        told = self.job.progress
        return None if told is None else lambda done, total: told(what, done, total)

    def send_until_verified(self, before: tuple[WireItem, ...] | None) -> Steps[UploadOutcome]:
        """Send and read back, a bounded number of times."""
        reason = ""
        concerned: tuple[int, ...] = ()
        found: tuple[WireItem, ...] | None = ()
        for _ in range(ATTEMPTS):
            said = len(self.job.texts())
            up = self._upload(self.wire, "sending")
            yield up
            self._sent = max(self._sent, up.sent)
            reason, concerned = self._why(up), self._ours(up)
            found = yield from self._read_back(self.job.part)
            if found is None:
                return self.outcome(UploadState.UNKNOWN, self._may_hold(), f"it cannot be read back: {self._unread}")
            if not self.differences:
                return (yield from self._judged(up.heard_s, said))
            if up.end is UploadEnd.REFUSED or (up.end is UploadEnd.BROKEN and up.asked < 0):
                break  # refused, or busy for as long as any other transfer may last
        return (yield from self._give_up(before, found or (), reason, concerned))

    def _judged(self, taken_s: float, said: int) -> Steps[UploadOutcome]:
        """Verified, unless the vehicle reports that it will not fly the mission, in texts after the first `said`."""
        holds = f"what was sent, {self._count()}"
        job = self.job
        if job.kind is not MissionKind.MISSION or not job.family.judges_missions or not self.wire:
            return self.outcome(UploadState.VERIFIED, holds)
        asked = AskVerdict(job.target, taken_s)
        yield asked
        words = job.family.refusals(job.texts()[said:])
        if asked.refused is False or (asked.refused is None and not words):
            return self.outcome(UploadState.VERIFIED, holds)
        why = " / ".join(dict.fromkeys(words)) or "it reports that there is no valid mission, without a reason"
        refused = self.outcome(
            UploadState.REFUSED, f"{holds}, which it will not fly", why, job.family.items_refused(words)
        )
        return replace(refused, infeasible=True)

    def _read_back(self, wanted: Part) -> Steps[tuple[WireItem, ...] | None]:
        """Read the list and compare it; twice if it differs, since late packets may have interfered."""
        found = None
        for _ in range(_REREADS):
            down = self.download("reading back")
            yield down
            if down.items is None:
                self._unread = down.problem
                continue
            found = down.items
            self.differences = compare(wanted, found, self.job.family)
            if not self.differences:
                break
        return found

    def _give_up(
        self, before: tuple[WireItem, ...] | None, found: tuple[WireItem, ...], reason: str, concerned: tuple[int, ...]
    ) -> Steps[UploadOutcome]:
        """Restore the vehicle's old contents, if possible."""
        job, why = self.job, reason or f"what was read back differs {how_often(self.attempts)}"
        differences = self.differences
        if before is not None and self._same(before, found):
            return self.outcome(UploadState.REFUSED, "what it held before", why, concerned)
        if before is not None and job.may_roll_back():
            old = [replace(item, seq=number) for number, item in enumerate(before)]
            for _ in range(ATTEMPTS):
                yield self._upload(old, "rolling back")
                down = self.download("reading back")
                yield down
                if down.items is None:
                    holds = f"{self._may_hold()}, or what it held before"
                    return self.outcome(UploadState.UNKNOWN, holds, f"{why}; rolling back: {down.problem}", concerned)
                if self._same(before, down.items):
                    self.differences = differences
                    return self.outcome(UploadState.ROLLED_BACK, "what it held before", why, concerned)
        holds = f"a mixture: {len(differences)} differences from what was sent, the first {differences[0]}"
        return self.outcome(UploadState.UNKNOWN, holds, why, concerned)

    def _same(self, before: tuple[WireItem, ...], found: tuple[WireItem, ...]) -> bool:
        try:
            was = decode(before, self.job.kind, self.job.family)
        except InputError:
            return before == found
        return not compare(was, found, self.job.family)

    def _why(self, up: Upload) -> str:
        """The vehicle's reason as text; empty if it accepted everything."""
        said = [text for text in self.job.texts()[self._texts :] if "received" not in text.lower()]
        words = f"; it said: {' / '.join(said[-3:])}" if said else ""
        if up.end is UploadEnd.REFUSED:
            return f"{self._named(self._ours(up))}{in_words(up.answer)}{words}"
        if up.end is UploadEnd.BROKEN or (up.end is UploadEnd.SILENT and up.answer in PASSING):
            return f"the transfer was aborted: {in_words(up.answer)}{words}"
        return "the vehicle stopped answering" if up.end is UploadEnd.SILENT else ""

    def _ours(self, up: Upload) -> tuple[int, ...]:
        if up.end is not UploadEnd.REFUSED:
            return ()
        return tuple(number - self.job.shift for number in up.concerned if number >= self.job.shift)

    @staticmethod
    def _named(items: tuple[int, ...]) -> str:
        return f"item {' or '.join(map(str, items))}: " if items else ""

    def _count(self) -> str:
        return f"{len(self.wire) - self.job.shift} items"

    def _may_hold(self) -> str:
        """Possible contents of the vehicle after a transfer whose end was not received."""
        total, sent = len(self.wire), self._sent + 1
        if self.job.family.takes_uploads_whole:
            if sent < total:
                return "what it held before: it takes an upload over whole or not at all, and not all was sent"
            return f"either what it held before or all of the {self._count()} sent"
        first = max(sent - self.job.shift, 0)
        kept = "what it held before" if self.job.kind is MissionKind.FENCE else f"its old items, cut to {self._count()}"
        if self.job.kind is MissionKind.FENCE and sent < total:
            return kept
        if not first:
            return f"what it held before, or {kept}"
        return f"a mixture: up to {first} new items (numbers 0 to {first - 1}) and otherwise {kept}"
