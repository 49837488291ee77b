"""Links that are cut: a delivery in virtual time whose link falls silent as it is about to be used for one exchange."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from branches import Branches

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.wire.frames import FrameReader
from skyway.models.queues.pad_service import PadServiceError

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.link.wire.messages import Message

DURATIONS_S = (1.0, 5.0, 10.0, 30.0, 120.0, 600.0, 1800.0)
DIRECTIONS = ("both", "up", "down")
"""What is lost: everything; what we say; what the vehicle says."""
_UNASKED = ("HEARTBEAT", "TIMESYNC")
_DISCRIMINATORS = {
    "COMMAND_LONG": ("command", "param1"),
    "COMMAND_INT": ("command",),
    "PARAM_REQUEST_READ": ("param_id",),
    "PARAM_SET": ("param_id",),
}
_WITH_PARAM1 = (400, 511, 512)


def exchange_of(message: Message) -> str | None:
    """Name what is asked; None for what is said without being asked for anything."""
    if message.name in _UNASKED:
        return None
    parts = [message.name]
    for name in _DISCRIMINATORS.get(message.name, ("mission_type",)):
        if name in message.fields and not (name == "param1" and message["command"] not in _WITH_PARAM1):
            value = message[name]
            parts.append(str(int(value) if isinstance(value, float) else value))
    return ":".join(parts)


@dataclass(frozen=True, order=True)
class Moment:
    """When a cut begins: in a state, as an exchange is about to begin for the first time there, or as the state begins.

    Attributes
    ----------
    state : str
        State of the delivery.
    exchange : str
        See `exchange_of`; ``pads:`` and an operation of the pad service; empty for the beginning of the state.
    """

    state: str
    exchange: str = ""


@dataclass(frozen=True)
class Cut:
    """One cut.

    Attributes
    ----------
    moment : Moment
        When it begins.
    direction : str
        One of `DIRECTIONS`.
    lasts_s : float
        How long.
    """

    moment: Moment
    direction: str
    lasts_s: float

    @property
    def of_pads(self) -> bool:
        """Whether it is the pad service that is away, and not the vehicle."""
        return self.moment.exchange.startswith("pads:")


@dataclass
class CutLink:
    """A transport that loses what passes in one direction or both, for a while.

    Attributes
    ----------
    cuts : tuple of Cut
        What is to be cut, each once; none only notes the moments.
    seen : dict of Moment
        Every moment at which a cut could have begun, in order.
    begun_s : dict of Cut to float
        When each began.
    """

    inner: object
    stage: Stage
    cuts: tuple[Cut, ...] = ()
    seen: dict[Moment, None] = field(default_factory=dict)
    begun_s: dict[Cut, float] = field(default_factory=dict)
    branches: Branches[Cut] | None = None
    _reader: FrameReader = field(default_factory=FrameReader)

    def note(self, exchange: str) -> None:
        """Tell that something is about to be asked."""
        supervisor = self.stage.supervisor
        state = "connecting" if supervisor is None else str(supervisor.context.state)
        for moment in (Moment(state), Moment(state, exchange)):
            self.seen[moment] = None
            mine = None if self.branches is None else self.branches.at(moment, self.stage)
            if mine is not None:
                self.cuts = (mine,)
            for cut in self.cuts:
                if cut.moment == moment:
                    self.begun_s.setdefault(cut, self.stage.lockstep.now_s)

    @property
    def now(self) -> list[Cut]:
        """The cuts that last now."""
        now_s = self.stage.lockstep.now_s
        return [cut for cut, begun_s in self.begun_s.items() if now_s < begun_s + cut.lasts_s]

    def lost(self, direction: str) -> bool:
        """Whether what passes now in this direction is lost."""
        return any(cut.direction in ("both", direction) and not cut.of_pads for cut in self.now)

    def write(self, data: bytes) -> None:
        """Send, or lose."""
        for _, message in self._reader.feed(data):
            exchange = None if message is None else exchange_of(message)
            if exchange is not None:
                self.note(exchange)
        if not self.lost("up"):
            self.inner.write(data)

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Hear, or lose."""
        end = self.stage.lockstep.now_s + timeout_s
        while True:
            data = self.inner.read(max(end - self.stage.lockstep.now_s, 0.0))
            if data and self.lost("down"):
                if self.stage.lockstep.now_s >= end:
                    return b""
                continue
            return data

    def close(self) -> None:
        """Close it."""
        self.inner.close()


class CutPads:
    """A pad service behind the same kind of link."""

    def __init__(self, inner, link) -> None:
        self.inner, self.link = inner, link

    def __getattr__(self, name):
        operation = getattr(self.inner, name)
        if name not in ("status", "charge", "release"):
            return operation

        def asked(*given):
            self.link.note(f"pads:{name}")
            if any(cut.of_pads for cut in self.link.now):
                raise PadServiceError("the pad service fails: timed out")
            return operation(*given)

        return asked


def cut_stage(story: Story, folder: Path, cuts: tuple[Cut, ...] = ()) -> tuple[Stage, CutLink]:
    """A stage whose supervisor hears and speaks through a link that is cut."""
    folder.mkdir(parents=True, exist_ok=True)
    stage = Stage(story, folder)
    link = CutLink(None, stage, cuts)
    connect = stage.lockstep.connect

    def connected(*given, **how):
        link.inner = connect(*given, **how)
        return link

    stage.lockstep.connect = connected
    stage.pads = CutPads(stage.pads, link)
    return stage, link


def moments_of(story: Story, folder: Path) -> list[Moment]:
    """Every moment of an undisturbed delivery at which a cut could begin."""
    stage, link = cut_stage(story, folder)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    return list(link.seen)


@dataclass(frozen=True)
class Ended:
    """How a delivery with a cut ended.

    Attributes
    ----------
    kind : str
        ``delivered``, ``held`` (safe at a station or held, and delivered once it was resumed), else what went wrong.
    """

    kind: str
    state: str
    reason: str
    seconds: float


def fly_cut(story: Story, folder: Path, *cuts: Cut) -> Ended:
    """Fly one delivery through cuts; one that ends undelivered is resumed once, after the last."""
    return _flown(*cut_stage(story, folder, cuts))


def fly_each_cut(story: Story, folder: Path, cuts: list[Cut]) -> dict[Cut, Ended]:
    """How the delivery ends with each of these alone; what comes before them is flown once."""
    stage, link = cut_stage(story, folder)
    waiting: dict[Any, list[Cut]] = {}
    for cut in cuts:
        waiting.setdefault(cut.moment, []).append(cut)
    link.branches = Branches(waiting, folder)
    return link.branches.fly(lambda: _flown(stage, link))


def _flown(stage: Stage, link: CutLink) -> Ended:
    outcome = stage.fly()
    seconds = stage.lockstep.now_s
    first = outcome
    kind = "delivered"
    if not outcome.delivered:
        kind = "held" if outcome.state in ("stopped-safe", "left-to-itself") else outcome.state
        end_s = max((begun_s + cut.lasts_s for cut, begun_s in link.begun_s.items()), default=0.0)
        stage.lockstep.run_for(max(end_s - stage.lockstep.now_s, 0.0) + 600.0)
        stage.supervisor.context.vehicle.connection.close()
        link.cuts = ()
        outcome = stage.fly(resume=True)
        if not outcome.delivered:
            kind = f"not resumed ({outcome.state}: {outcome.reason})"
    return Ended(_checked(stage, kind), first.state, first.reason, seconds)


def _checked(stage: Stage, kind: str) -> str:
    """What the world says of it: nothing crashed, handed over twice, or was flown twice."""
    craft = stage.craft
    if craft.autopilot.crashed:
        return "crashed"
    if not craft.body.grounded or craft.autopilot.armed:
        return "in the air at the end"
    if kind in ("delivered", "held"):
        if craft.station() != stage.story.to or craft.body.payload_kg != 0.0:
            return "said to be delivered, and is not"
        taken_off = sum(event.text == "in the air" for event in stage.world.events)
        landed = sum(record.event == "landed" for record in read_journal(stage.journal_path).records)
        if landed != taken_off:
            return f"{taken_off} take-offs, {landed} landings in the journal"
    return kind
