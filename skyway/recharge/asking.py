"""Typed values of a mission to cut, as the options of the cut."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway import typed_values
from skyway.checking import conditions_of, over_of, weather_of
from skyway.missions.checks.route import DEFAULT_SPEED_MPS, fly
from skyway.missions.checks.weather import ForecastWind
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.base.errors import InputError
from skyway.models.base.units import parse_instant
from skyway.models.drones.time_belief import GROUND_S
from skyway.models.network.files import read_stations
from skyway.models.network.van_stands import read_van_stands
from skyway.models.scenario.file import FILE
from skyway.recharge.problem import PadQueues, RechargeOptions
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.items.document import MissionDocument
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.network.station import Station
    from skyway.models.network.van_stands import VanStand
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.fixed_route.pad_windows import Window

GREATEST_SPEED_MPS = 20.0
MOST_PACKS = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Typed options besides the mission, in the units of the command line."""

    pads: Path | None = None
    vans: Path | None = None
    drone: str | None = None
    fleet: Path | None = None
    wind: str | None = None
    depart: str | None = None
    forecast: list[Path] | None = None
    payload_kg: float = 0.0
    soc_percent: float = 100.0
    reserve_percent: float = 20.0
    epsilon: float = 0.001
    transit_speed_mps: float | None = None
    transit_height_m: float | None = None
    terrain: list[str] | None = None
    obstacles: list[str] | None = None
    clearance_m: float | None = None
    level_ground: bool = False
    home: str | None = None
    home_elevation_m: float | None = None
    laps: int = 1
    swap_s: float | None = None
    ground_s: float = GROUND_S
    packs: int | None = None
    chargers: int | None = None
    single: bool = False
    seed: int = 0
    reorder: bool = False
    windows: dict[str, list[list[float]]] | None = None
    """By the id of a pad, the windows of this drone: for missions that several drones share."""


def region_of(asked: Asked) -> Scenario | None:
    """Return the scenario of the named pads, None if they are a file of stations."""
    path = asked.pads
    if path is None:
        if asked.vans is None:
            raise InputError("no pads are given", field="--pads", remedy="give --pads, or --vans")
        return None
    named = path.is_dir() or path.suffix == ".toml" or path.name == FILE or not path.exists()
    if not path.exists() and str(path) != "newyork":
        raise InputError(
            "no such file or folder", str(path), field="--pads", remedy="stations (CSV, GeoJSON) or a scenario"
        )
    return load_scenario(path) if named else None


def stands_of(asked: Asked) -> tuple[VanStand, ...]:
    """Return the stands of vans with their times."""
    if asked.vans is None:
        return ()
    depart_s = None if asked.depart is None else parse_instant(asked.depart, field="--depart").timestamp()
    return read_van_stands(asked.vans, depart_s)


def pads_of(asked: Asked, region: Scenario | None, stands: Sequence[VanStand] = ()) -> tuple[Station, ...]:
    """Return the named pads, and those of vans."""
    fixed: tuple[Station, ...] = ()
    if region is not None:
        fixed = region.network.stations
    elif asked.pads is not None:
        fixed = read_stations(asked.pads)
    known = {pad.id for pad in fixed}
    for stand in stands:
        if stand.station.id in known:
            raise InputError(
                "is also the id of a pad",
                str(asked.vans),
                field="van",
                value=stand.station.id,
                remedy="name the van otherwise",
            )
    return (*fixed, *(stand.station for stand in stands))


def with_home(document: MissionDocument, asked: Asked) -> MissionDocument:
    """Return the mission with the typed home and its height."""
    mission = document.mission
    home = mission.home
    if asked.home is not None:
        place = typed_values.parse_position(asked.home)
        if place is None:
            raise InputError("is not a place", field="--home", value=asked.home, remedy="write lat,lon")
        home = Home(Point.of_degrees(*place), None if home is None else home.altitude_m)
    if asked.home_elevation_m is not None:
        if home is None:
            raise InputError("needs a home", field="--home-elevation", remedy="give --home lat,lon too")
        if not -500.0 <= asked.home_elevation_m <= 9000.0:
            raise InputError("is not between -500 and 9000 m", field="--home-elevation", value=asked.home_elevation_m)
        home = replace(home, altitude_m=asked.home_elevation_m)
    return replace(document, mission=replace(mission, home=home))


def options_of(
    asked: Asked,
    document: MissionDocument,
    region: Scenario | None,
    zones: Airspace | None,
    stands: Sequence[VanStand] = (),
) -> RechargeOptions:
    """Return the options of a cut; an `InputError` names each wrong option."""
    over = over_of(region, asked.terrain, asked.obstacles, asked.clearance_m)
    weather = weather_of(region, asked.wind, asked.depart, asked.forecast, zoned=_timed(asked, zones, stands))
    conditions = conditions_of(
        region,
        asked.drone,
        weather,
        asked.payload_kg,
        asked.soc_percent,
        asked.reserve_percent,
        asked.fleet,
    )
    if not 1e-6 <= asked.epsilon <= 0.5:
        raise InputError("is not between 0.000001 and 0.5", field="--epsilon", value=asked.epsilon)
    if not 1 <= asked.laps <= 1000:
        raise InputError("is not between 1 and 1000", field="--laps", value=asked.laps)
    if asked.swap_s is not None and not 0.0 <= asked.swap_s <= 36_000.0:
        raise InputError("is not between 0 and 36000 s", field="--swap", value=asked.swap_s)
    if not 0.0 <= asked.ground_s <= 36_000.0:
        raise InputError("is not between 0 and 36000 s", field="--ground-time", value=asked.ground_s)
    _check_packs(asked)
    speed = _transit_speed(asked, document, conditions)
    height = asked.transit_height_m
    if height is not None and not 5.0 <= height <= 1000.0:
        raise InputError("is not between 5 and 1000 m", field="--transit-height", value=height)
    queues = None
    if region is not None and isinstance(weather, ForecastWind):
        queues = PadQueues(region.load, region.network.stations, weather.depart_s)
    return RechargeOptions(
        conditions,
        TransitRules(speed, height, over, zones),
        queues,
        asked.epsilon,
        asked.level_ground,
        asked.laps,
        asked.swap_s,
        asked.packs,
        asked.chargers or 1,
        asked.single,
        asked.seed,
        _windows(asked, stands),
        asked.reorder,
        asked.ground_s,
    )


def _timed(asked: Asked, zones: Airspace | None, stands: Sequence[VanStand]) -> bool:
    """Whether the departure matters beyond the forecast: for zones, vans or bookings of pads."""
    return zones is not None or bool(stands) or asked.windows is not None


def _check_packs(asked: Asked) -> None:
    """Refuse impossible packs: none, or some without a change of batteries."""
    if asked.packs is None and asked.chargers is None:
        return
    if asked.packs is None:
        raise InputError("needs --packs", field="--chargers", remedy="say how many batteries there are")
    if asked.swap_s is None:
        raise InputError("needs --swap", field="--packs", remedy="say how many seconds a change takes: --swap 90")
    if not 1 <= asked.packs <= MOST_PACKS:
        raise InputError(f"is not between 1 and {MOST_PACKS}", field="--packs", value=asked.packs)
    if asked.chargers is not None and not 1 <= asked.chargers <= MOST_PACKS:
        raise InputError(f"is not between 1 and {MOST_PACKS}", field="--chargers", value=asked.chargers)


def _windows(asked: Asked, stands: Sequence[VanStand]) -> dict[str, tuple[Window, ...]]:
    """Return the times in which pads can be used: while their van is there, and as far as they belong to this drone."""
    windows: dict[str, tuple[Window, ...]] = {stand.station.id: ((stand.from_s, stand.until_s),) for stand in stands}
    own = {pad: tuple((first, last) for first, last in each) for pad, each in (asked.windows or {}).items()}
    return windows | own


def _transit_speed(asked: Asked, document: MissionDocument, conditions: FlightConditions) -> float:
    """Return the speed of the ways to pads: as typed, otherwise the greatest of the mission."""
    most = min(GREATEST_SPEED_MPS, conditions.drone.max_ground_speed_mps, conditions.drone.max_airspeed_mps)
    if asked.transit_speed_mps is not None:
        if not 1.0 <= asked.transit_speed_mps <= most:
            raise InputError(
                f"is not between 1 and {most:g} m/s", field="--transit-speed", value=asked.transit_speed_mps
            )
        return asked.transit_speed_mps
    flown = [step.speed_mps for step in fly(document.mission).steps]
    return min(max(flown, default=DEFAULT_SPEED_MPS), most)
