"""Structure of a composition file: the fields of each class of `models.composition`, in their order.

Fields have the names of the class; `rename` gives their names in the file. Fields of `_Derived` follow from other fields:
they are written for readers, and not read. See `models.composition.file`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from skyway.models.composition.release import Release  # noqa: TC001  msgspec reads it

_Soc = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
_Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
_Bearing = Annotated[float, msgspec.Meta(ge=0.0, le=360.0)]
_Lat = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
_Lon = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
_Derived = Any


class Scenario(msgspec.Struct):
    """Where the scenario was read from."""

    path: str | None = None
    sha256: str | None = None


class Place(msgspec.Struct):
    """A station or delivery target."""

    lat: _Lat
    lon: _Lon
    elevation_m: float | None = None
    name: str | None = None
    pads: Annotated[int, msgspec.Meta(ge=0)] = 0
    least_m: float | None = None
    least_agl_m: float | None = None
    """Left out where there are none."""


class Wind(msgspec.Struct, kw_only=True):
    """One wind, or those that may blow."""

    speed_mps: _NotNegative
    p10_mps: _NotNegative | None = None
    p90_mps: _NotNegative | None = None
    from_deg: _Bearing | None


class Figure(msgspec.Struct, rename={"error": "standard_error"}):
    """A sampled figure with its interval."""

    value: float
    low: float
    high: float
    error: _NotNegative = 0.0
    seed_error: _NotNegative = 0.0


class Segment(msgspec.Struct, rename={"head": "to"}):
    """One segment of a leg."""

    head: str
    distance_m: _NotNegative
    bearing_deg: _Bearing
    wind: Wind
    tailwind_mps: float
    crosswind_mps: float


class Leg(msgspec.Struct, kw_only=True, rename={"origin": "from", "destination": "to"}):
    """One flight."""

    id: str = ""
    origin: str
    destination: str
    via: list[str] = []
    distance_m: _NotNegative
    bearing_deg: _Bearing
    ground_speed_mps: _Positive
    depart: str
    arrive: str
    flight_time_s: _Derived = None
    energy_wh: _NotNegative
    soc_depart: _Soc
    soc_arrive: _Soc
    p_reserve: _Fraction | None = None
    p_hold: _Fraction | None = None
    p_hold_room: _Fraction | None = None
    wind: Wind
    course_wind: Wind | None = None
    tailwind_mps: float = 0.0
    crosswind_mps: float = 0.0
    segments: list[Segment] = []
    diverts: list[str] = []
    heights: LegHeights | None = None
    """Left out where there is none."""


class Stop(msgspec.Struct, kw_only=True):
    """A stay between two flights."""

    station: str
    arrive: str
    wait_s: _NotNegative
    hold_s: _NotNegative
    hold_room_s: _NotNegative = 0.0
    p_pad_free: _Fraction | None = None
    recharge_s: _NotNegative
    soc_from: _Soc
    soc_to: _Soc
    leave: _Derived = None


class Arrival(msgspec.Struct, rename={f"delivery_{name}": f"delivery_{name}_s" for name in ("mean", "p50", "p95")}):
    """When the package arrives."""

    mean: str | None = None
    p50: str | None = None
    p95: str | None = None
    delivery_mean: Figure | None = None
    delivery_p50: Figure | None = None
    delivery_p95: Figure | None = None
    runs: int | None = None
    p_arrive: _Fraction | None = None


class Condition(msgspec.Struct, kw_only=True):
    """A wind or pads observed at the time of planning."""

    kind: Literal["wind", "pads"]
    place: str
    time: str
    age_s: float
    source: str
    speed_mps: _NotNegative | None = None
    from_deg: _Bearing | None = None
    busy: Annotated[int, msgspec.Meta(ge=0)] | None = None


class NearObstacle(msgspec.Struct, kw_only=True):
    """An obstacle in the corridor of a leg."""

    name: str
    along_m: float
    top_m: float


class LegHeights(msgspec.Struct, kw_only=True):
    """Heights of a leg over a terrain model."""

    along_m: list[float]
    ground_m: list[float]
    top_m: list[float]
    path_along_m: list[float]
    path_height_m: list[float]
    least_m: float
    least_along_m: float
    obstacles: list[NearObstacle] = []


class Clearance(msgspec.Struct, kw_only=True):
    """Clearance over terrain and obstacles."""

    least_m: _Positive
    corridor_width_m: _Positive
    position_error_m: _NotNegative
    max_height_m: _Positive


class TerrainUse(msgspec.Struct, kw_only=True):
    """Terrain that the plan was made over."""

    files: list[str]
    clearance: Clearance


class EnergyDistribution(msgspec.Struct, kw_only=True, rename={"mean": "mean_wh", "p95": "p95_wh"}):
    """Energy flown with."""

    mean: Figure
    p95: Figure


class DeliveryCosts(msgspec.Struct, kw_only=True):
    """Cost of the delivery."""

    currency: str
    mean: Figure
    p95: Figure
    energy: _NotNegative
    pad_fees: _NotNegative
    refill: _NotNegative
    wear: _NotNegative


class WayBack(msgspec.Struct, kw_only=True, rename={"station": "to"}):
    """Plan of the drone after the delivery."""

    asked: str
    station: str
    dwell_s: _NotNegative = 0.0
    release: Release = "gripper"
    """Left out where it is a gripper."""
    plan: Composition | None = None
    undelivered_to: str | None = None
    undelivered: Composition | None = None
    """The last two left out where nothing is kept for that."""


class Composition(
    msgspec.Struct,
    kw_only=True,
    rename={"origin": "from", "destination": "to", "services": "legs", "way_back": "return"},
):
    """The whole file, and each plan in it."""

    schema: str
    id: str = ""
    scenario: Scenario = msgspec.field(default_factory=Scenario)
    planner: str
    drone: str
    drone_parameters: dict[str, float | str | None] = {}
    payload_kg: _NotNegative
    airspeed_mps: _Positive
    max_ground_speed_mps: _Positive = 20.0
    cruise_height_m: _Positive
    climb_rate_mps: _Positive = 5.0
    descent_rate_mps: _Positive = 3.0
    reserve_soc: _Fraction
    seed: int | None = None
    depart: str
    origin: str = ""
    destination: str = ""
    stations: dict[str, Place]
    services: list[Leg]
    stops: list[Stop]
    delivery_time_s: _Derived = None
    flight_time_s: _Derived = None
    wait_time_s: _Derived = None
    recharge_time_s: _Derived = None
    distance_m: _Derived = None
    energy_wh: _Derived = None
    min_soc: _Derived = None
    arrival: Arrival = msgspec.field(default_factory=Arrival)
    on_time_probability: _Fraction | None = None
    on_time: Figure | None = None
    success_probability: _Fraction | None = None
    success: Figure | None = None
    planning_time_s: _NotNegative = 0.0
    notes: list[str] = []
    parameters: dict[str, str] = {}
    conditions: list[Condition] = []
    terrain: TerrainUse | None = None
    authorized: list[str] = []
    zones: list[str] = []
    not_before: str | None = None
    energy: EnergyDistribution | None = None
    costs: DeliveryCosts | None = None
    """All left out where there are none."""
    way_back: WayBack | None = None
    """Left out where it is unknown."""
