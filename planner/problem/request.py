"""Requests to a planner."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from types import NoneType
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.ranges import MIN_PERCENT, divided, fraction_faults, kind_faults, range_faults
from skyway.models.composition.composition import State
from skyway.models.composition.release import RELEASES, hover_s, hovers
from skyway.planner.problem.objective import Objective

if TYPE_CHECKING:
    from skyway.models.composition.composition import Recharge
    from skyway.models.composition.release import Release

DEFAULT_RESERVE_SOC = 0.2
DEFAULT_EPSILON = 1e-3
RECHARGES = ("full", "enough")
HOME, NEAREST_PAD, NO_RETURN = "home", "nearest-pad", "none"
"""What may become of the drone after the delivery, besides the id of a station: back to where it began, to the pad that is
nearest in time, or nothing: it stays."""
BACK = "back"
"""Where an undelivered package may go, besides the id of a station: to where it came from."""
MAX_DWELL_S = 12 * 3600.0
YEARS = (1900, 2200)
"""Departures beyond these years are slips of the pen."""
MAX_BUSY = 1000
"""Drones at one station."""
MAX_SEED = 2**64 - 1
LATEST_DEADLINE_H = 48
"""After the departure: as far as forecasts are looked at."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """One delivery, from its current state.

    Attributes
    ----------
    state : State
        Where the drone is, when, with which charge; see `models.composition.composition.State`.
    destination : str
        Station id.
    payload_kg : float
        Mass of the package.
    drone : str or None
        Drone id; None lets the planner choose from the skyline of the fleet.
    airspeed_mps : float or None
        Planned airspeed; None is the drone's cruise airspeed.
    reserve_soc : float
        No landing below it, except with probability `epsilon`.
    epsilon : float
        See `reserve_soc`.
    recharge : ``full`` or ``enough``
        Charge to 100 % at each stop, or what the next flight needs (planners that choose by themselves ignore it).
    escape : bool
        At a target without pads the drone must still reach a station at or above the reserve.
    return_to : str
        What becomes of the drone after the delivery: ``home``, ``nearest-pad``, ``none`` or the id of a station. At a
        destination with pads ``nearest-pad`` is where it stands.
    dwell_s : float
        Time at the target, from touch-down to take-off: loading, a signature. It is flown out of, not charged in.
    release : str
        How the package leaves the drone, one of `models.composition.release.RELEASES`. Where that is in the air, `dwell_s` is the time
        of the hover, and the drone does not land at the target.
    undelivered_to : str or None
        Where the package goes if it cannot be delivered: ``back`` to where it came from, or the id of a station. The
        charge for it is kept. None: no charge is kept for that.
    not_back_by : tuple of str
        Stations that the way back cannot begin with.
    seed : int
        Of everything that is sampled.
    objective : Objective
        Of the planner ``robust``; the others know the mean only. Text is read: ``"p95"``,
        ``"on-time 2013-07-10T16:00-04:00"``.
    not_before : datetime or None
        Aware; the package does not arrive before. The drone waits on the ground, at its last stop or at its origin.
    stop_at : tuple of str
        Stations at which the drone must stop on its way, in this order; only the planner ``robust`` can.
    """

    state: State
    destination: str
    payload_kg: float
    drone: str | None = None
    airspeed_mps: float | None = None
    reserve_soc: float = DEFAULT_RESERVE_SOC
    epsilon: float = DEFAULT_EPSILON
    recharge: Recharge = "enough"
    escape: bool = True
    seed: int = 0
    objective: Objective = field(default_factory=Objective)
    stop_at: tuple[str, ...] = ()
    not_before: datetime | None = None
    return_to: str = NEAREST_PAD
    dwell_s: float = 0.0
    undelivered_to: str | None = None
    release: Release = "gripper"
    not_back_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        objective: object = self.objective
        if isinstance(objective, str):
            object.__setattr__(self, "objective", Objective.parse(objective))
        refuse(_check_kinds(self))
        faults = [*_check_state(self.state), *_check_objective(self), *_check_earliest(self)]
        payload = "kilograms, 0 to 1000"
        faults += range_faults(
            "payload_kg", self.payload_kg, 0.0, 1000.0, payload, divided(self.payload_kg, 1000.0, 1000.0)
        )
        faults += fraction_faults(
            "reserve_soc", self.reserve_soc, 0.95, "--reserve 0 to 95 percent", least=MIN_PERCENT / 100.0
        )
        faults += range_faults(
            "epsilon", self.epsilon, 0.0, 0.5, "a probability from 0 to 0.5", divided(self.epsilon, 100.0, 0.5)
        )
        if self.airspeed_mps is not None:
            meant = divided(self.airspeed_mps, 3.6, 150.0)
            faults += range_faults("airspeed_mps", self.airspeed_mps, 1.0, 150.0, "metres per second, 1 to 150", meant)
        if self.recharge not in RECHARGES:
            lower = str(self.recharge).strip().lower()
            remedy = f"did you mean {lower}?" if lower in RECHARGES else "full or enough"
            faults.append(Fault("is not known", field="recharge", value=self.recharge, remedy=remedy))
        faults += range_faults("dwell_s", self.dwell_s, 0.0, MAX_DWELL_S, "0 to 12 h (43200 s)")
        if self.release not in RELEASES:
            faults.append(Fault("is not known", field="release", value=self.release, remedy=", ".join(RELEASES)))
        elif self.in_air and self.dwell_s not in (0.0, hover_s(self.release)):
            remedy = f"remove it: {self.release} hovers as long as necessary"
            faults.append(
                Fault("the drone does not land at the target", field="dwell_s", value=self.dwell_s, remedy=remedy)
            )
        if not _is_count(self.seed, MAX_SEED):
            faults.append(Fault("out of range", field="seed", value=self.seed, remedy="a whole number, 0 or more"))
        if faults:
            raise InputError(faults)
        if self.in_air:
            object.__setattr__(self, "dwell_s", hover_s(self.release))

    def onward(self, state: State) -> Request:
        """Return the rest of the delivery from another state: once its deadline has passed, it arrives as early as possible."""
        deadline = self.objective.deadline
        late = deadline is not None and deadline <= state.time
        return replace(self, state=state, objective=Objective() if late else self.objective)

    @property
    def in_air(self) -> bool:
        """Whether the package is released in the air: the drone does not land at the target."""
        return hovers(self.release)


def _is_count(value: Any, most: int) -> bool:
    """Whether it is a whole number of any kind, from 0 up."""
    try:
        return not isinstance(value, bool) and 0 <= operator.index(value) <= most
    except TypeError:
        return False


def _check_kinds(request: Request) -> list[Fault]:
    """Check that the parts are what their names say, before they are looked into."""
    state = request.state
    faults = kind_faults("state", state, State, 'State(datetime(…, tzinfo=…), "STATION")')
    if not faults:
        aware = "a datetime with a time zone: datetime(2013, 7, 10, 18, tzinfo=UTC)"
        faults += kind_faults("state.time", state.time, datetime, aware)
        faults += kind_faults("state.busy_pads", state.busy_pads, Mapping, '{"STATION": drones there}')
        faults += kind_faults("state.pads_free_s", state.pads_free_s, Mapping, '{"STATION": (POSIX seconds, …)}')
        place: Any = state.position
        if place is not None and not (isinstance(place, tuple | list) and len(place) == 2):
            remedy = "(lat, lon), degrees"
            faults.append(Fault("is not a place", field="state.position", value=repr(place), remedy=remedy))
    faults += kind_faults("not_before", request.not_before, (datetime, NoneType), "a datetime with a time zone")
    faults += kind_faults("stop_at", request.stop_at, (tuple, list), '("STATION", …)')
    return faults


def _check_state(state: State) -> list[Fault]:
    faults = fraction_faults("state.soc", state.soc, 1.0, "--soc 0 to 100 percent")
    if (state.station is None) == (state.position is None):
        faults.append(Fault("either a station or a position must be given", field="state"))
    if state.position is not None:
        for name, value, most in zip(("lat", "lon"), state.position, (90.0, 180.0), strict=False):
            faults += range_faults(f"state.position.{name}", value, -most, most, f"degrees, {-most:g} to {most:g}")
    if state.time.tzinfo is None:
        remedy = "give it a time zone: datetime(2013, 7, 10, 18, tzinfo=UTC)"
        faults.append(
            Fault("the time has no UTC offset", field="state.time", value=state.time.isoformat(), remedy=remedy)
        )
    elif not YEARS[0] <= state.time.year <= YEARS[1]:
        remedy = f"a year from {YEARS[0]} to {YEARS[1]}"
        faults.append(Fault("out of range", field="state.time", value=state.time.isoformat(), remedy=remedy))
    for station, count in state.busy_pads.items():
        if not _is_count(count, MAX_BUSY):
            remedy = f"how many drones are there, a whole number from 0 to {MAX_BUSY}"
            faults.append(Fault("out of range", field=f"state.busy_pads[{station!r}]", value=count, remedy=remedy))
    for station, times in state.pads_free_s.items():
        if len(times) > state.busy_pads.get(station, 0) or not all(math.isfinite(time) for time in times):
            remedy = "POSIX seconds, one for each busy pad at most"
            faults.append(Fault("not times", field=f"state.pads_free_s[{station!r}]", value=times, remedy=remedy))
    return faults


def _check_earliest(request: Request) -> list[Fault]:
    """Check the time before which the package is not to arrive."""
    earliest, time = request.not_before, request.state.time
    deadline = request.objective.deadline if isinstance(request.objective, Objective) else None
    if earliest is None or time.tzinfo is None:
        return []
    value = earliest.isoformat()
    if earliest.tzinfo is None:
        return [Fault("the time has no UTC offset", field="not_before", value=value, remedy="give it a time zone")]
    if (earliest - time).total_seconds() > LATEST_DEADLINE_H * 3600.0:
        what = f"is more than {LATEST_DEADLINE_H} h after the departure"
        return [Fault(what, field="not_before", value=value, remedy=f"the departure is at {time.isoformat()}")]
    if deadline is not None and deadline.tzinfo is not None and deadline <= earliest:
        remedy = f"the deadline is at {deadline.isoformat()}"
        return [Fault("is not before the deadline", field="not_before", value=value, remedy=remedy)]
    return []


def _check_objective(request: Request) -> list[Fault]:
    asked: object = request.objective
    if not isinstance(asked, Objective):
        remedy = "Objective('mean'), Objective('p95') or Objective('on-time', deadline)"
        return [Fault("is not an objective", field="objective", value=asked, remedy=remedy)]
    deadline, time = asked.deadline, request.state.time
    if deadline is None or time.tzinfo is None:
        return []
    value = deadline.isoformat()
    if deadline.tzinfo is None:
        return [Fault("the deadline has no UTC offset", field="objective", value=value, remedy="give it a time zone")]
    if not 0.0 < (deadline - time).total_seconds() <= LATEST_DEADLINE_H * 3600.0:
        what = "before the departure" if deadline <= time else f"more than {LATEST_DEADLINE_H} h after the departure"
        remedy = f"the departure is at {time.isoformat()}"
        return [Fault(f"the deadline is {what}", field="objective", value=value, remedy=remedy)]
    return []
