"""Entries on the desk of a dispatcher, as typed documents: the service, orders, drones, flights, pads out of order, changed promises."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from skyway.models.base.errors import InputError
from skyway.models.drones.drag import DragModel  # noqa: TC001  records are read by their annotations
from skyway.models.ledger.desk import Entry
from skyway.models.orders.order import Order, Vehicle  # noqa: TC001  records are read by their annotations

if TYPE_CHECKING:
    from skyway.models.ledger.desk import Desk, Kind
    from skyway.models.ledger.ledger import Lease

OPEN = ("new", "promised", "under way", "aboard")
CLOSED = ("delivered", "refused", "handed to a person")
"""States of orders: every order ends in one of the closed ones. ``under way``: a drone flies to it or with it; ``aboard``: it is in a drone that
stands somewhere on its way."""
ACTIVE = ("ordered", "flying")
"""States of flights that are not over; ``ended`` ones are looked at by the dispatcher, and then ``closed``."""
STANDING, FLYING, LOST = "standing", "flying", "lost"
"""States of drones; a lost one waits for a person."""
WITH_PACKAGE, TO_PACKAGE, HOME = "with the package", "to the package", "home"
"""Phases of flights."""
T = TypeVar("T", bound=msgspec.Struct)


class ServiceRecord(msgspec.Struct, kw_only=True):
    """Start options of the service, for a resume."""

    begin_s: float
    """When it began, POSIX seconds of its own time."""
    folder: str
    """Where journals and outputs are."""
    ledger: str
    scenario: str | None = None
    wind: str | None = None
    actual_wind: str | None = None
    """As typed: what is expected, and what blows in the simulated world."""
    world: str = ""
    """``HOST:PORT`` of the simulated world."""
    reserve: float = 0.2
    workers: int = 1
    ttl_s: float = 10.0
    """Of leases, of the wall's time."""
    settings: list[str] = []
    seed: int = 1
    strangers: bool = True
    """Of the simulated world: its seed, and whether others charge, too."""
    drags: dict[str, DragModel] = {}
    """By drone type: by it the tilt of a drone measures the wind."""


class Promise(msgspec.Struct, kw_only=True):
    """Promise to an order."""

    drone: str
    fetched_s: float
    delivered_s: float
    """POSIX seconds."""
    chance: float | None = None
    """Probability that it is there by when it is due, as the plan was flown in many worlds."""
    p50_s: float | None = None
    p95_s: float | None = None
    """It is there by then with these probabilities, POSIX seconds; None where it is not in so many worlds."""


class OrderRecord(msgspec.Struct, kw_only=True):
    """An order and what has become of it."""

    order: Order
    place: str
    """Where its package is, while it is in no drone."""
    drone: str | None = None
    """Which drone flies to it, or has it aboard."""
    promise: Promise | None = None
    first: Promise | None = None
    """The newest promise, and the first one."""
    changes: int = 0
    reason: str = ""
    delivered_s: float | None = None


class PlanStep(msgspec.Struct, kw_only=True, frozen=True):
    """One planned flight or charge."""

    kind: str
    origin: str
    destination: str
    begin_s: float
    end_s: float
    soc_begin: float
    soc_end: float
    pad: int | None = None


class PlannedPart(msgspec.Struct, kw_only=True, frozen=True):
    """One flight of a route that has not begun."""

    order: str | None
    phase: str
    steps: tuple[PlanStep, ...]

    @property
    def begin_s(self) -> float:
        """When it begins, with a charge or a take-off."""
        return self.steps[0].begin_s

    @property
    def end_s(self) -> float:
        """When it has landed."""
        return self.steps[-1].end_s


class DroneRecord(msgspec.Struct, kw_only=True):
    """A drone's state, now or after its flight."""

    vehicle: Vehicle
    """As it was put on the desk."""
    system: int
    place: str
    soc: float
    flight: str | None = None
    aboard: str | None = None
    """Order whose package is in it."""
    route: tuple[PlannedPart, ...] = ()
    """What it does next."""
    reason: str = ""


class Progress(msgspec.Struct, kw_only=True):
    """Progress of a flight."""

    at_s: float
    state: str
    flights: int = 0
    station: str | None = None
    soc: float | None = None
    late_s: float = 0.0
    """Behind its plan."""
    since_s: float = 0.0
    """When the state began."""
    lat: float | None = None
    lon: float | None = None
    wind: tuple[float, float, float, float, float, float] | None = None
    """Measured last, at cruise height: POSIX seconds, latitude and longitude, north and east (TOWARDS, m/s), variance."""


class End(msgspec.Struct, kw_only=True):
    """End of a flight."""

    at_s: float
    state: str
    reason: str
    station: str | None
    soc: float | None
    arrived: bool
    """It did what it was to: it stands where it was to be, and what it carried was released."""
    sure: bool = True
    """What became of the package is known."""
    aboard: bool = False
    """The package is still in the drone."""


class FlightRecord(msgspec.Struct, kw_only=True):
    """A flight: one part of a route that has begun."""

    drone: str
    type: str
    system: int
    order: str | None
    phase: str
    mass_kg: float
    composition: dict[str, Any]
    steps: tuple[PlanStep, ...]
    not_before_s: float
    journal: str
    progress: Progress | None = None
    end: End | None = None

    @property
    def begin_s(self) -> float:
        """When it was to begin."""
        return self.steps[0].begin_s

    @property
    def end_s(self) -> float:
        """When it was to be over."""
        return self.steps[-1].end_s

    @property
    def late_s(self) -> float:
        """How far behind its plan it is, as far as that is told."""
        return 0.0 if self.progress is None else self.progress.late_s


class PadRecord(msgspec.Struct, kw_only=True):
    """A pad that is out of order."""

    station: str
    pad: int
    from_s: float
    until_s: float
    reason: str = ""


class ChangeRecord(msgspec.Struct, kw_only=True):
    """A promise that was changed."""

    at_s: float
    order: str
    before: Promise | None
    after: Promise | None
    why: str


def written(value: msgspec.Struct) -> str:
    """Return a document of a record."""
    return msgspec.json.encode(value).decode()


def read(entry: Entry, kind: type[T]) -> T:
    """Read a record from its document; an `InputError` says that it is none."""
    try:
        return msgspec.json.decode(entry.document, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(
            f"the desk has a {entry.kind} that cannot be read: {error}", field=entry.kind, value=entry.id
        ) from error


class Board:
    """The records of a desk as one program has read them, and the changes that it has yet to write."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self._known: dict[tuple[str, str], Entry] = {}
        self._changed: dict[tuple[str, str], Entry] = {}

    def read(self, kind: Kind, record: type[T], states: tuple[str, ...] = ()) -> dict[str, tuple[str, T]]:
        """Read all records of a kind in some states: state and record by id."""
        found = {}
        for entry in self.desk.entries(kind, states):
            self._known[entry.kind, entry.id] = entry
            found[entry.id] = (entry.state, read(entry, record))
        return found

    def change(self, kind: Kind, id: str, state: str, record: msgspec.Struct, *, keeper: str | None = None) -> None:  # noqa: A002
        """Change a record, or put a new one down, with the next `write`."""
        known = self._known.get((kind, id))
        keeper = keeper or (known.keeper if known is not None else self.desk.dispatcher)
        version = 0 if known is None else known.version
        entry = Entry(kind, id, version, state, keeper, written(record))
        if known is None or (known.state, known.keeper, known.document) != (state, keeper, entry.document):
            self._changed[kind, id] = entry

    def keeper(self, kind: Kind, id: str) -> str:  # noqa: A002
        """Whose lease an entry is changed under."""
        return (self._changed.get((kind, id)) or self._known[kind, id]).keeper

    def count(self, kind: Kind) -> int:
        """How many entries of a kind there are, those to be written included."""
        return self.desk.count(kind) + sum(one.kind == kind and one.version == 0 for one in self._changed.values())

    def write(self, lease: Lease) -> None:
        """Write all changes, or none."""
        changed, self._changed = self._changed, {}
        for entry in self.desk.put(lease, list(changed.values())) if changed else ():
            self._known[entry.kind, entry.id] = entry

    def forget_changes(self) -> None:
        """Drop what was not written."""
        self._changed = {}
