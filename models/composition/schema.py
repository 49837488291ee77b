"""Structure of a composition file; see `models.composition.file`."""

from __future__ import annotations

from typing import Annotated

import msgspec

_Soc = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
_Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
_Bearing = Annotated[float, msgspec.Meta(ge=0.0, le=360.0)]
_Lat = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
_Lon = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]


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


class Wind(msgspec.Struct):
    """One wind, or those that may blow."""

    speed_mps: _NotNegative
    from_deg: _Bearing | None
    p10_mps: _NotNegative | None = None
    p90_mps: _NotNegative | None = None


class Figure(msgspec.Struct):
    """A sampled figure with its interval."""

    value: float
    low: float
    high: float
    standard_error: _NotNegative = 0.0
    seed_error: _NotNegative = 0.0


class Segment(msgspec.Struct, rename={"head": "to"}):
    """One segment of a leg."""

    head: str
    distance_m: _NotNegative
    bearing_deg: _Bearing
    wind: Wind
    tailwind_mps: float
    crosswind_mps: float


class Leg(msgspec.Struct, rename={"origin": "from", "destination": "to"}):
    """One flight."""

    origin: str
    destination: str
    distance_m: _NotNegative
    bearing_deg: _Bearing
    ground_speed_mps: _Positive
    depart: str
    arrive: str
    energy_wh: _NotNegative
    soc_depart: _Soc
    soc_arrive: _Soc
    wind: Wind
    id: str = ""
    via: list[str] = []
    p_reserve: _Fraction | None = None
    p_hold: _Fraction | None = None
    tailwind_mps: float = 0.0
    crosswind_mps: float = 0.0
    diverts: list[str] = []
    p_hold_room: _Fraction | None = None
    segments: list[Segment] = []
    course_wind: Wind | None = None


class Stop(msgspec.Struct):
    """A stay between two flights."""

    station: str
    arrive: str
    wait_s: _NotNegative
    hold_s: _NotNegative
    recharge_s: _NotNegative
    soc_from: _Soc
    soc_to: _Soc
    p_pad_free: _Fraction | None = None
    hold_room_s: _NotNegative = 0.0


class Arrival(msgspec.Struct):
    """When the package arrives."""

    mean: str | None = None
    p50: str | None = None
    p95: str | None = None
    delivery_mean_s: Figure | None = None
    delivery_p50_s: Figure | None = None
    delivery_p95_s: Figure | None = None
    runs: int | None = None


class Composition(msgspec.Struct, rename={"origin": "from", "destination": "to"}):
    """The whole file."""

    schema: str
    planner: str
    drone: str
    payload_kg: _NotNegative
    airspeed_mps: _Positive
    cruise_height_m: _Positive
    reserve_soc: _Fraction
    depart: str
    stations: dict[str, Place]
    legs: list[Leg]
    stops: list[Stop]
    origin: str = ""
    destination: str = ""
    id: str = ""
    scenario: Scenario = msgspec.field(default_factory=Scenario)
    drone_parameters: dict[str, float | str | None] = {}
    max_ground_speed_mps: _Positive = 20.0
    climb_rate_mps: _Positive = 5.0
    descent_rate_mps: _Positive = 3.0
    seed: int | None = None
    arrival: Arrival = msgspec.field(default_factory=Arrival)
    on_time_probability: _Fraction | None = None
    success_probability: _Fraction | None = None
    planning_time_s: _NotNegative = 0.0
    notes: list[str] = []
    success: Figure | None = None
    on_time: Figure | None = None
    parameters: dict[str, str] = {}
