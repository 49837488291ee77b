"""Compositions as JSON (``"schema": "skyway.composition/1"``), written and read without loss.

SoC 0 to 1, energies in Wh, instants ISO 8601 UTC, unknown = null.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.models.base.errors import Fault, InputError, one_line
from skyway.models.base.figure import Figure
from skyway.models.base.files import read_text, write_atomically
from skyway.models.base.units import J_PER_WH, iso, parse_instant
from skyway.models.composition import schema
from skyway.models.composition.composition import (
    ArrivalDistribution,
    Composition,
    DroneService,
    LegSegment,
    Place,
    Stop,
    Wind,
)

if TYPE_CHECKING:
    from datetime import datetime
    from os import PathLike

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
            "delivery_mean_s": figure_json(c.arrival.delivery_mean),
            "delivery_p50_s": figure_json(c.arrival.delivery_p50),
            "delivery_p95_s": figure_json(c.arrival.delivery_p95),
            "runs": c.arrival.runs,
        },
        "on_time_probability": c.on_time_probability,
        "on_time": figure_json(c.on_time),
        "success_probability": c.success_probability,
        "success": figure_json(c.success),
        "planning_time_s": c.planning_time_s,
        "notes": list(c.notes),
        "parameters": dict(c.parameters),
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
        "p_hold_room": service.p_hold_room,
        "wind": _wind_json(service.wind),
        "course_wind": None if service.course_wind is None else _wind_json(service.course_wind),
        "tailwind_mps": service.tailwind_mps,
        "crosswind_mps": service.crosswind_mps,
        "segments": [
            {
                "to": segment.head,
                "distance_m": segment.distance_m,
                "bearing_deg": segment.bearing_deg,
                "wind": _wind_json(segment.wind),
                "tailwind_mps": segment.tailwind_mps,
                "crosswind_mps": segment.crosswind_mps,
            }
            for segment in service.segments
        ],
        "diverts": list(service.diverts),
    }


def _wind_json(wind: Wind) -> dict[str, float | None]:
    return {"speed_mps": wind.speed_mps, "p10_mps": wind.p10_mps, "p90_mps": wind.p90_mps, "from_deg": wind.from_deg}


def figure_json(figure: Figure | None) -> dict[str, float] | None:
    """Return a figure as plain JSON values: value, 95 % interval, standard error, and what of it another seed would show."""
    if figure is None:
        return None
    parts = {"value": figure.value, "low": figure.low, "high": figure.high}
    return parts | {"standard_error": figure.error, "seed_error": figure.seed_error}


def _stop_json(stop: Stop) -> dict[str, Any]:
    return {
        "station": stop.station,
        "arrive": iso(stop.arrive),
        "wait_s": stop.wait_s,
        "hold_s": stop.hold_s,
        "hold_room_s": stop.hold_room_s,
        "p_pad_free": stop.p_pad_free,
        "recharge_s": stop.recharge_s,
        "soc_from": stop.soc_from,
        "soc_to": stop.soc_to,
        "leave": iso(stop.leave),
    }


def _iso_or_none(instant: datetime | None) -> str | None:
    return None if instant is None else iso(instant)


def save(composition: Composition, path: str | PathLike[str], *, force: bool = False) -> None:
    """Write the composition, whole or not at all.

    Raises
    ------
    InputError
        The file exists and `force` is not given, or its folder cannot be written.
    """
    write_atomically(Path(path), json.dumps(to_json(composition), indent=1, allow_nan=False) + "\n", force=force)


def load(path: str | PathLike[str]) -> Composition:
    """Read a composition written by `save` or by ``skyway plan --json``.

    Raises
    ------
    InputError
        Unreadable, not JSON, of another schema, or with a field that is missing or out of range.
    """
    return from_json(read_text(Path(path), max_bytes=MAX_BYTES), file=str(path))


def from_json(data: bytes | str, *, file: str = "composition") -> Composition:
    """Read a composition from JSON text; `file` is named in errors (`InputError`)."""
    try:
        raw = msgspec.json.decode(data, type=schema.Composition)
    except (msgspec.ValidationError, msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise InputError(
            Fault(f"not a {SCHEMA} file: {error}", file, remedy="write one with skyway plan -o")
        ) from error
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
            delivery_mean=_figure(raw.arrival.delivery_mean_s),
            delivery_p50=_figure(raw.arrival.delivery_p50_s),
            delivery_p95=_figure(raw.arrival.delivery_p95_s),
            runs=raw.arrival.runs,
        ),
        planning_time_s=raw.planning_time_s,
        seed=raw.seed,
        scenario_path=raw.scenario.path,
        scenario_sha256=raw.scenario.sha256,
        on_time_probability=raw.on_time_probability,
        success_probability=raw.success_probability,
        notes=tuple(raw.notes),
        success=_figure(raw.success),
        on_time=_figure(raw.on_time),
        parameters=raw.parameters,
    )


def _figure(raw: schema.Figure | None) -> Figure | None:
    return None if raw is None else Figure(raw.value, raw.low, raw.high, raw.standard_error, raw.seed_error)


def _wind(raw: schema.Wind) -> Wind:
    return Wind(raw.speed_mps, raw.from_deg, raw.p10_mps, raw.p90_mps)


def _service(leg: schema.Leg, number: int, file: str) -> DroneService:
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
        wind=_wind(leg.wind),
        tailwind_mps=leg.tailwind_mps,
        crosswind_mps=leg.crosswind_mps,
        diverts=tuple(leg.diverts),
        p_hold_room=leg.p_hold_room,
        course_wind=None if leg.course_wind is None else _wind(leg.course_wind),
        segments=tuple(
            LegSegment(one.head, one.distance_m, one.bearing_deg, _wind(one.wind), one.tailwind_mps, one.crosswind_mps)
            for one in leg.segments
        ),
    )


def _stop(stop: schema.Stop, number: int, file: str) -> Stop:
    return Stop(
        station=stop.station,
        arrive=parse_instant(stop.arrive, field=f"stops[{number}].arrive", file=file),
        wait_s=stop.wait_s,
        recharge_s=stop.recharge_s,
        hold_s=stop.hold_s,
        soc_from=stop.soc_from,
        soc_to=stop.soc_to,
        p_pad_free=stop.p_pad_free,
        hold_room_s=stop.hold_room_s,
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


def _check_references(raw: schema.Composition, file: str) -> None:
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
        Fault("are not those of its via and to", file, field=f"legs[{i}].segments", value=segment.head)
        for i, leg in enumerate(raw.legs)
        if leg.segments and [one.head for one in leg.segments] != [*leg.via, leg.destination]
        for segment in leg.segments[:1]
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
