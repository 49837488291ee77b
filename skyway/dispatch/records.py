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
HANDED_OVER = "handed to a person"
CANCELLED = "cancelled"
CLOSED = ("delivered", "refused", CANCELLED, HANDED_OVER)
"""Closed states of orders; every order ends in one of them. Of the others: ``under way``: a drone flies to it or with it; ``aboard``: it is in a drone that
stands somewhere on its way."""
ACTIVE = ("ordered", "flying")
"""States of flights that are not over; the dispatcher processes ``ended`` ones, which are then ``closed``."""
STANDING, FLYING, LOST = "standing", "flying", "lost"
"""States of drones; a lost one waits for a person."""
WITH_PACKAGE, TO_PACKAGE, HOME = "with the package", "to the package", "home"
"""Phases of flights."""
T = TypeVar("T", bound=msgspec.Struct)


class ServiceRecord(msgspec.Struct, kw_only=True):
    """Start options of the service, for a resume."""

    begin_s: float
    """Start of the service, POSIX seconds of its own time."""
    folder: str
    """Folder of journals and outputs."""
    ledger: str
    scenario: str | None = None
    wind: str | None = None
    actual_wind: str | None = None
    """As given on the command line: the forecast, and the wind of the simulated world."""
    world: str = ""
    """``HOST:PORT`` of the simulated world."""
    reserve: float = 0.2
    workers: int = 1
    ttl_s: float = 10.0
    """Lifetime of leases, s of wall time."""
    settings: list[str] = []
    seed: int = 1
    strangers: bool = True
    """Of the simulated world: its seed, and whether other drones charge, too."""
    drags: dict[str, DragModel] = {}
    """Drag by drone type, for the wind from the tilt of a drone."""


class Promise(msgspec.Struct, kw_only=True):
    """Promise to an order."""

    drone: str
    fetched_s: float
    delivered_s: float
    """POSIX seconds."""
    chance: float | None = None
    """Probability of delivery by the due time, from simulations of the plan."""
    p50_s: float | None = None
    p95_s: float | None = None
    """Quantiles of the delivery time, POSIX seconds; None if it is not delivered in as many simulations."""


class OrderRecord(msgspec.Struct, kw_only=True):
    """An order and its state."""

    order: Order
    place: str
    """Place of its package, while that is in no drone."""
    drone: str | None = None
    """Drone that flies to it, or has it on board."""
    promise: Promise | None = None
    first: Promise | None = None
    """The present promise, and the first one."""
    changes: int = 0
    reason: str = ""
    delivered_s: float | None = None
    cancelled_s: float | None = None
    cancelled_by: str = ""
    """When it was cancelled, POSIX seconds, and who asked for it."""


class CancelRecord(msgspec.Struct, kw_only=True):
    """A request to cancel an order, under the id of the order; its states are ``asked``, ``done`` and ``refused``."""

    by: str
    """Who asks."""
    reason: str = ""
    """Why it was refused."""


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


def task_of(order: str | None, phase: str) -> str:
    """Name what a flight is for: ``fetch ORDER``, ``deliver ORDER`` or ``home``."""
    if order is None:
        return phase
    return f"fetch {order}" if phase == TO_PACKAGE else f"deliver {order}"


class PlannedPart(msgspec.Struct, kw_only=True, frozen=True):
    """One flight of a route that has not begun."""

    order: str | None
    phase: str
    steps: tuple[PlanStep, ...]

    @property
    def task(self) -> str:
        """Return what it is for, see `task_of`."""
        return task_of(self.order, self.phase)

    @property
    def begin_s(self) -> float:
        """Return its beginning, a charge or a take-off."""
        return self.steps[0].begin_s

    @property
    def end_s(self) -> float:
        """Return the time of its last landing."""
        return self.steps[-1].end_s


class DroneRecord(msgspec.Struct, kw_only=True):
    """State of a drone, now or after its flight."""

    vehicle: Vehicle
    """As it was added to the desk."""
    system: int
    place: str
    soc: float
    measured_s: float = 0.0
    """When its charge was measured, POSIX seconds."""
    idle: PlanStep | None = None
    """Charge on a pad while it has no task."""
    flight: str | None = None
    aboard: str | None = None
    """Order whose package is on board."""
    route: tuple[PlannedPart, ...] = ()
    """Its next parts."""
    reason: str = ""


class Progress(msgspec.Struct, kw_only=True):
    """Progress of a flight."""

    at_s: float
    state: str
    flights: int = 0
    station: str | None = None
    soc: float | None = None
    late_s: float = 0.0
    """Delay against the plan."""
    since_s: float = 0.0
    """Beginning of the state."""
    lat: float | None = None
    lon: float | None = None
    wind: tuple[float, float, float, float, float, float] | None = None
    """Last wind measurement, at cruise height: POSIX seconds, latitude and longitude, north and east (TOWARDS,
    m/s), variance."""


class End(msgspec.Struct, kw_only=True):
    """End of a flight."""

    at_s: float
    state: str
    reason: str
    station: str | None
    soc: float | None
    arrived: bool
    """The flight reached its destination, and its package, if any, was released."""
    sure: bool = True
    """The outcome for the package is known."""
    aboard: bool = False
    """The package is still on board."""


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
    def task(self) -> str:
        """Return what it is for, see `task_of`."""
        return task_of(self.order, self.phase)

    @property
    def begin_s(self) -> float:
        """Planned beginning."""
        return self.steps[0].begin_s

    @property
    def end_s(self) -> float:
        """Planned end."""
        return self.steps[-1].end_s

    @property
    def late_s(self) -> float:
        """Reported delay against the plan."""
        return 0.0 if self.progress is None else self.progress.late_s


class PadRecord(msgspec.Struct, kw_only=True):
    """A pad that is out of order."""

    station: str
    pad: int
    from_s: float
    until_s: float
    reason: str = ""


class ReopenRecord(msgspec.Struct, kw_only=True):
    """The early end of a closure of a pad, under the id of that closure."""

    at_s: float
    by: str
    """Who opened it."""


class ChangeRecord(msgspec.Struct, kw_only=True):
    """A changed promise."""

    at_s: float
    order: str
    before: Promise | None
    after: Promise | None
    why: str


def written(value: msgspec.Struct) -> str:
    """Return the document of a record."""
    return msgspec.json.encode(value).decode()


def read(entry: Entry, kind: type[T]) -> T:
    """Read a record from its document; an `InputError` if it is invalid."""
    try:
        return msgspec.json.decode(entry.document, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(
            f"the desk has a {entry.kind} that cannot be read: {error}", field=entry.kind, value=entry.id
        ) from error


class Board:
    """The records of a desk as read by one program, and the changes that it has not yet written."""

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

    def pads_out(self) -> dict[str, tuple[str, PadRecord]]:
        """Read the closures of pads, without those that were ended early."""
        opened = {one.id for one in self.desk.entries("reopening")}
        return {name: one for name, one in self.read("pad", PadRecord, ("out",)).items() if name not in opened}

    def read_one(self, kind: Kind, id: str, record: type[T], state: str) -> dict[str, tuple[str, T]]:  # noqa: A002
        """Read one record: state and record by id; empty if it is not in this state."""
        entry = self.desk.get(kind, id)
        if entry is None or entry.state != state:
            return {}
        self._known[entry.kind, entry.id] = entry
        return {entry.id: (entry.state, read(entry, record))}

    def change(self, kind: Kind, id: str, state: str, record: msgspec.Struct, *, keeper: str | None = None) -> None:  # noqa: A002
        """Change a record, or add one, with the next `write`."""
        known = self._known.get((kind, id))
        keeper = keeper or (known.keeper if known is not None else self.desk.dispatcher)
        version = 0 if known is None else known.version
        entry = Entry(kind, id, version, state, keeper, written(record))
        if known is None or (known.state, known.keeper, known.document) != (state, keeper, entry.document):
            self._changed[kind, id] = entry

    def keeper(self, kind: Kind, id: str) -> str:  # noqa: A002
        """Return the holder whose lease protects an entry."""
        return (self._changed.get((kind, id)) or self._known[kind, id]).keeper

    def count(self, kind: Kind) -> int:
        """Return the number of entries of a type, with those not yet written."""
        return self.desk.count(kind) + sum(one.kind == kind and one.version == 0 for one in self._changed.values())

    def write(self, lease: Lease) -> None:
        """Write all changes, or none."""
        changed, self._changed = self._changed, {}
        for entry in self.desk.put(lease, list(changed.values())) if changed else ():
            self._known[entry.kind, entry.id] = entry

    def forget_changes(self) -> None:
        """Drop the changes that were not written."""
        self._changed = {}
