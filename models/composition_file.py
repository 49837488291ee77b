"""Compositions as JSON (``"schema": "skyway.composition/1"``), written and read without loss.

SoC 0 to 1, energies in Wh, instants ISO 8601 UTC, unknown = null.
"""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from models.errors import Fault, InputError, one_line
from models.files import read_text, write_atomically
from models.services import ArrivalDistribution, Composition, DroneService, Place, Stop, Wind
from models.units import J_PER_WH, iso, parse_instant

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

SCHEMA = "skyway.composition/1"
MAX_BYTES = 64 * 1024 * 1024


def to_json(composition: Composition) -> dict[str, Any]:
    """Return the composition as plain JSON values."""
    c = composition
    return {
        "schema": SCHEMA,
        "id": c.id,
        "scenario": {"path": c.scenario_path, "sha256": c.scenario_sha256},
        "planner": c.planner,
        "drone": c.drone,
        "drone_parameters": dict(c.drone_parameters),
        "payload_kg": c.payload_kg,
        "airspeed_mps": c.airspeed_mps,
        "max_ground_speed_mps": c.max_ground_speed_mps,
        "cruise_height_m": c.cruise_height_m,
        "climb_rate_mps": c.climb_rate_mps,
        "descent_rate_mps": c.descent_rate_mps,
        "reserve_soc": c.reserve_soc,
        "seed": c.seed,
        "depart": iso(c.depart),
        "from": c.origin,
        "to": c.destination,
        "stations": {
            key: {
                "lat": place.lat,
                "lon": place.lon,
                "elevation_m": place.elevation_m,
                "name": place.name,
                "pads": place.pads,
            }
            for key, place in c.stations.items()
        },
        "legs": [_leg_json(service) for service in c.services],
        "stops": [_stop_json(stop) for stop in c.stops],
        "delivery_time_s": c.delivery_time_s,
        "flight_time_s": c.flight_time_s,
        "wait_time_s": c.wait_time_s,
        "recharge_time_s": c.recharge_time_s,
        "distance_m": c.distance_m,
        "energy_wh": c.energy_j / J_PER_WH,
        "min_soc": c.min_soc,
        "arrival": {
            "mean": _iso_or_none(c.arrival.mean),
            "p50": _iso_or_none(c.arrival.p50),
            "p95": _iso_or_none(c.arrival.p95),
        },
        "on_time_probability": c.on_time_probability,
        "success_probability": c.success_probability,
        "planning_time_s": c.planning_time_s,
        "notes": list(c.notes),
    }


def _leg_json(service: DroneService) -> dict[str, Any]:
    return {
        "id": service.id,
        "from": service.origin,
        "to": service.destination,
        "via": list(service.via),
        "distance_m": service.distance_m,
        "bearing_deg": service.bearing_deg,
        "ground_speed_mps": service.ground_speed_mps,
        "depart": iso(service.depart),
        "arrive": iso(service.arrive),
        "flight_time_s": service.flight_time_s,
        "energy_wh": service.energy_j / J_PER_WH,
        "soc_depart": service.soc_depart,
        "soc_arrive": service.soc_arrive,
        "p_reserve": service.p_reserve,
        "p_hold": service.p_hold,
        "wind": {"speed_mps": service.wind.speed_mps, "from_deg": service.wind.from_deg},
        "tailwind_mps": service.tailwind_mps,
        "crosswind_mps": service.crosswind_mps,
        "diverts": list(service.diverts),
    }


def _stop_json(stop: Stop) -> dict[str, Any]:
    return {
        "station": stop.station,
        "arrive": iso(stop.arrive),
        "wait_s": stop.wait_s,
        "hold_s": stop.hold_s,
        "p_pad_free": stop.p_pad_free,
        "recharge_s": stop.recharge_s,
        "soc_from": stop.soc_from,
        "soc_to": stop.soc_to,
        "leave": iso(stop.leave),
    }


def _iso_or_none(instant: datetime | None) -> str | None:
    return None if instant is None else iso(instant)


def save(composition: Composition, path: Path, *, force: bool = False) -> None:
    """Write the composition, whole or not at all.

    Raises
    ------
    InputError
        The file exists and `force` is not given, or its folder cannot be written.
    """
    write_atomically(path, json.dumps(to_json(composition), indent=1, allow_nan=False) + "\n", force=force)


def load(path: Path) -> Composition:
    """Read a composition written by `save` or by ``skyway plan --json``.

    Raises
    ------
    InputError
        Unreadable, not JSON, of another schema, or with a field that is missing or out of range.
    """
    return from_json(read_text(path, max_bytes=MAX_BYTES), file=str(path))


_Soc = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
_Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
_Bearing = Annotated[float, msgspec.Meta(ge=0.0, le=360.0)]
_Lat = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
_Lon = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]


class _Scenario(msgspec.Struct):
    path: str | None = None
    sha256: str | None = None


class _Place(msgspec.Struct):
    lat: _Lat
    lon: _Lon
    elevation_m: float | None = None
    name: str | None = None
    pads: Annotated[int, msgspec.Meta(ge=0)] = 0


class _Wind(msgspec.Struct):
    speed_mps: _NotNegative
    from_deg: _Bearing


class _Leg(msgspec.Struct, rename={"origin": "from", "destination": "to"}):
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
    wind: _Wind
    id: str = ""
    via: list[str] = []
    p_reserve: _Fraction | None = None
    p_hold: _Fraction | None = None
    tailwind_mps: float = 0.0
    crosswind_mps: float = 0.0
    diverts: list[str] = []


class _Stop(msgspec.Struct):
    station: str
    arrive: str
    wait_s: _NotNegative
    hold_s: _NotNegative
    recharge_s: _NotNegative
    soc_from: _Soc
    soc_to: _Soc
    p_pad_free: _Fraction | None = None


class _Arrival(msgspec.Struct):
    mean: str | None = None
    p50: str | None = None
    p95: str | None = None


class _Composition(msgspec.Struct, rename={"origin": "from", "destination": "to"}):
    schema: str
    planner: str
    drone: str
    payload_kg: _NotNegative
    airspeed_mps: _Positive
    cruise_height_m: _Positive
    reserve_soc: _Fraction
    depart: str
    stations: dict[str, _Place]
    legs: list[_Leg]
    stops: list[_Stop]
    origin: str = ""
    destination: str = ""
    id: str = ""
    scenario: _Scenario = msgspec.field(default_factory=_Scenario)
    drone_parameters: dict[str, float | str | None] = {}
    max_ground_speed_mps: _Positive = 20.0
    climb_rate_mps: _Positive = 5.0
    descent_rate_mps: _Positive = 3.0
    seed: int | None = None
    arrival: _Arrival = msgspec.field(default_factory=_Arrival)
    on_time_probability: _Fraction | None = None
    success_probability: _Fraction | None = None
    planning_time_s: _NotNegative = 0.0
    notes: list[str] = []


def from_json(data: bytes | str, *, file: str = "composition") -> Composition:
    """Read a composition from JSON text; `file` is named in errors (`InputError`)."""
    try:
        raw = msgspec.json.decode(data, type=_Composition)
    except (msgspec.ValidationError, msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise InputError(Fault(f"not a {SCHEMA} file: {error}", file, remedy="write one with skyway plan -o")) from None
    if raw.schema != SCHEMA:
        raise InputError(Fault("unknown schema", file, field="schema", value=raw.schema, remedy=f"expected {SCHEMA}"))
    _check_references(raw, file)
    services = tuple(_service(leg, number, file) for number, leg in enumerate(raw.legs))
    _check_order(services, file)

    def instant_or_none(text: str | None, field: str) -> datetime | None:
        return None if text is None else parse_instant(text, field=field, file=file)

    return Composition(
        id=raw.id,
        planner=raw.planner,
        drone=raw.drone,
        drone_parameters=raw.drone_parameters,
        payload_kg=raw.payload_kg,
        airspeed_mps=raw.airspeed_mps,
        max_ground_speed_mps=raw.max_ground_speed_mps,
        cruise_height_m=raw.cruise_height_m,
        climb_rate_mps=raw.climb_rate_mps,
        descent_rate_mps=raw.descent_rate_mps,
        reserve_soc=raw.reserve_soc,
        depart=parse_instant(raw.depart, field="depart", file=file),
        origin=raw.origin or raw.legs[0].origin,
        destination=raw.destination or raw.legs[-1].destination,
        stations={
            key: Place(place.lat, place.lon, place.elevation_m, place.name, place.pads)
            for key, place in raw.stations.items()
        },
        services=services,
        stops=tuple(_stop(stop, number, file) for number, stop in enumerate(raw.stops)),
        arrival=ArrivalDistribution(
            mean=instant_or_none(raw.arrival.mean, "arrival.mean"),
            p50=instant_or_none(raw.arrival.p50, "arrival.p50"),
            p95=instant_or_none(raw.arrival.p95, "arrival.p95"),
        ),
        planning_time_s=raw.planning_time_s,
        seed=raw.seed,
        scenario_path=raw.scenario.path,
        scenario_sha256=raw.scenario.sha256,
        on_time_probability=raw.on_time_probability,
        success_probability=raw.success_probability,
        notes=tuple(raw.notes),
    )


def _service(leg: _Leg, number: int, file: str) -> DroneService:
    return DroneService(
        id=leg.id or f"leg-{number}",
        origin=leg.origin,
        destination=leg.destination,
        via=tuple(leg.via),
        depart=parse_instant(leg.depart, field=f"legs[{number}].depart", file=file),
        arrive=parse_instant(leg.arrive, field=f"legs[{number}].arrive", file=file),
        distance_m=leg.distance_m,
        bearing_deg=leg.bearing_deg,
        ground_speed_mps=leg.ground_speed_mps,
        energy_j=leg.energy_wh * J_PER_WH,
        soc_depart=leg.soc_depart,
        soc_arrive=leg.soc_arrive,
        p_reserve=leg.p_reserve,
        p_hold=leg.p_hold,
        wind=Wind(leg.wind.speed_mps, leg.wind.from_deg),
        tailwind_mps=leg.tailwind_mps,
        crosswind_mps=leg.crosswind_mps,
        diverts=tuple(leg.diverts),
    )


def _stop(stop: _Stop, number: int, file: str) -> Stop:
    return Stop(
        station=stop.station,
        arrive=parse_instant(stop.arrive, field=f"stops[{number}].arrive", file=file),
        wait_s=stop.wait_s,
        recharge_s=stop.recharge_s,
        hold_s=stop.hold_s,
        soc_from=stop.soc_from,
        soc_to=stop.soc_to,
        p_pad_free=stop.p_pad_free,
    )


def _check_order(services: tuple[DroneService, ...], file: str) -> None:
    faults = [
        Fault("arrives before it departs", file, field=f"legs[{number}].arrive", value=iso(service.arrive))
        for number, service in enumerate(services)
        if service.arrive <= service.depart
    ]
    faults += [
        Fault("departs before the last leg arrived", file, field=f"legs[{number}].depart", value=iso(after.depart))
        for number, (before, after) in enumerate(pairwise(services), start=1)
        if after.depart < before.arrive
    ]
    if faults:
        raise InputError(faults)


def _check_references(raw: _Composition, file: str) -> None:
    if not raw.legs:
        raise InputError(Fault("has no legs", file, field="legs"))
    named = [(f"legs[{i}]", key) for i, leg in enumerate(raw.legs) for key in (leg.origin, *leg.via, leg.destination)]
    named += [(f"stops[{i}].station", stop.station) for i, stop in enumerate(raw.stops)]
    faults = [
        Fault("names a station that is not in stations", file, field=where, value=key)
        for where, key in named
        if key not in raw.stations
    ]
    faults += [
        Fault("must be one line of plain text", file, field="stations", value=key)
        for key in raw.stations
        if not key or one_line(key) != key
    ]
    faults += [
        Fault("does not start where the last leg ended", file, field=f"legs[{i + 1}].from", value=after.origin)
        for i, (before, after) in enumerate(pairwise(raw.legs))
        if before.destination != after.origin
    ]
    if faults:
        raise InputError(faults)
