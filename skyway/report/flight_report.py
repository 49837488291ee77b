"""The struct of a flight report: what was planned and what happened; ``skyway.flight/1`` as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import msgspec

from skyway.models.base.formatting import local_clock, zone_name

if TYPE_CHECKING:
    from skyway.link.supervisor.journal import parts
    from skyway.models.composition.schema import LegHeights
    from skyway.report.series import LegWind, Series


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """Where the plan was made: folder and digest."""

    path: str | None
    sha256: str | None


class Delivery(msgspec.Struct, frozen=True, kw_only=True, rename={"origin": "from", "destination": "to"}):
    """The delivery: its places, its vehicle, its settings."""

    origin: str | None
    destination: str | None
    drone: str | None
    drone_name: str | None
    vehicle: str | None
    autopilot: str | None
    payload_kg: float | None
    reserve_soc: float | None
    planner: str | None
    supervised: bool | None
    asking: str | None
    forecast: parts.Forecast
    scenario: Scenario
    hands_over: bool
    """A package was to be handed over; otherwise the flight only moved the drone, or did the work of a mission."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome, or that there is none yet.

    `arrived`: it ended as intended; `delivered`: with a package handed over; `resumed`: number of resumes.
    """

    ended: bool
    state: str
    arrived: bool
    delivered: bool
    reason: str | None
    station: str | None
    time: str
    flights: int
    resumed: int
    proof: str | None = None
    proof_reason: str | None = None
    """`proof`, `proof_reason`: what became of the package, and what shows it."""


class PlannedLeg(msgspec.Struct, frozen=True, kw_only=True, rename={"origin": "from", "destination": "to"}):
    """A leg of the plan."""

    origin: str | None
    destination: str | None
    via: list[str]
    depart_s: float | None
    arrive_s: float | None
    flight_s: float | None
    distance_m: float | None
    soc_depart: float | None
    soc_arrive: float | None
    ground_speed_mps: float | None
    p_reserve: float | None
    heights: LegHeights | None = None


class Stop(msgspec.Struct, frozen=True, kw_only=True):
    """Time at a station, planned or spent: how long it waits, how long it charges and to what."""

    station: str | None
    arrive_s: float | None
    leave_s: float | None = None
    wait_s: float | None = 0.0
    charge_s: float | None = 0.0
    soc_from: float | None
    soc_to: float | None = None


class Station(msgspec.Struct, frozen=True):
    """A station on the map."""

    lat: float
    lon: float
    name: str | None


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """The plan; `stations` grows by those that a map shows besides."""

    legs: list[PlannedLeg]
    stops: list[Stop]
    stations: dict[str, Station]
    cruise_height_m: float | None
    climb_rate_mps: float | None
    descent_rate_mps: float | None
    airspeed_mps: float | None


class Times(msgspec.Struct, frozen=True, kw_only=True):
    """Times and charges of the whole that happened."""

    depart_s: float | None
    delivery_s: float | None
    flight_s: float | None
    wait_s: float | None
    charge_s: float | None
    lowest_soc: float | None
    flights: int | None


class PlannedTimes(Times, frozen=True, kw_only=True):
    """The same as planned, with the arrival on average, and by which half and 95 % of such deliveries arrive.

    `runs`: number of simulated deliveries behind the arrival; None where the planner simulated none, and promises nothing.
    """

    arrive_mean_s: float | None
    arrive_p50_s: float | None
    arrive_p95_s: float | None
    runs: int | None


class Totals(msgspec.Struct, frozen=True, kw_only=True):
    """The whole, planned and actual."""

    planned: PlannedTimes
    actual: Times


class FlownLeg(msgspec.Struct, frozen=True, kw_only=True, rename={"origin": "from", "destination": "to"}):
    """A flight: its plan at the take-off, and its actual values."""

    flight: int
    origin: str | None
    destination: str | None
    via: tuple[str, ...]
    depart_s: float
    land_s: float | None = None
    landed_at: str | None = None
    as_planned: bool | None = None
    planned_s: float | None
    flight_s: float | None = None
    soc_depart: float | None
    planned_soc: float | None
    soc_land: float | None = None
    used_soc: float | None = None
    modelled_soc: float | None = None
    diverts: tuple[str, ...]
    ground_speed_mps: float | None
    way: tuple[tuple[float, float], ...]
    wind: LegWind
    most_cross_track_m: float | None = None


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """Something that was decided, and by what."""

    time_s: float
    flight: int
    state: str
    action: str | None
    where: str | None
    reason: str | None
    new_plan: bool | None
    figures: dict[str, float]


class PlanInForce(msgspec.Struct, frozen=True, kw_only=True):
    """A plan that came into force, as its route."""

    time_s: float
    reason: str | None
    route: list[str]


class Preflight(msgspec.Struct, frozen=True, kw_only=True):
    """The list before a take-off."""

    time_s: float
    flight: int
    reason: str | None
    checks: tuple[parts.Checked, ...]


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """A record of the journal, as a reader of the report sees it."""

    n: int
    time_s: float
    state: str
    event: str
    flight: int
    reason: str | None


class RadioSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A radio over the whole flight; `worst_loss` in any stretch of the journal, `worst_margin` of RSSI over noise at either end."""

    radio: str
    used_share: float
    received: int
    lost: int
    loss: float | None
    worst_loss: float | None
    worst_at_s: float | None
    delay_s: float | None
    round_trip_s: float | None
    lowest_rssi: int | None
    worst_margin: int | None


class AircraftSeen(msgspec.Struct, frozen=True, kw_only=True):
    """Another aircraft that came near, or the reaction to it."""

    time_s: float
    flight: int
    said: str


class RemoteIdSeen(msgspec.Struct, frozen=True, kw_only=True):
    """Statuses of the Remote ID module, in order, and the operator data sent to it."""

    operator: str | None
    self_id: str | None
    said: list[AircraftSeen]


class Sources(msgspec.Struct, frozen=True, kw_only=True):
    """Names of the files that it was made from."""

    journal: str
    logs: list[str]
    plan: str | None


class FlightReport(msgspec.Struct, frozen=True, kw_only=True):
    """What was planned and what happened."""

    schema: str
    timezone: str = "UTC"
    """In which the page tells the times: that of the scenario, where it is known."""
    delivery: Delivery
    outcome: Result
    planned: Planned
    totals: Totals
    legs: list[FlownLeg]
    stops: list[Stop]
    decisions: list[Decision]
    plans: list[PlanInForce]
    preflights: list[Preflight]
    contingencies: list[Event]
    events: list[Event]
    series: Series
    radios: list[RadioSeen] = []
    aircraft: list[AircraftSeen] = []
    remote_id: RemoteIdSeen | None = None
    sources: Sources | None = None

    @property
    def zone(self) -> ZoneInfo:
        """In which times are told."""
        return ZoneInfo(self.timezone)

    def clock(self, at_s: float | None) -> str:
        """Return the time of day of POSIX seconds in this zone: ``14:03:22``."""
        return local_clock(at_s, self.zone)

    @property
    def zone_name(self) -> str:
        """Its name at the time of the flight: ``EDT``."""
        at_s = min((leg.depart_s for leg in self.legs), default=self.totals.planned.depart_s)
        return self.timezone if at_s is None else zone_name(at_s, self.zone)
