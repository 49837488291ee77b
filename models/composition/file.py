"""Compositions as JSON (``"schema": "skyway.composition/1"``), written and read without loss.

SoC 0 to 1, energies in Wh, instants ISO 8601 UTC, unknown = null.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import msgspec

from skyway.models.base.errors import Fault, InputError, one_line, refuse
from skyway.models.base.files import read_text, write_atomically
from skyway.models.base.statistics import Figure
from skyway.models.base.units import J_PER_WH, iso, parse_instant
from skyway.models.composition import schema
from skyway.models.composition.composition import Composition, WayBack
from skyway.models.composition.conditions import Condition
from skyway.models.composition.distributions import ArrivalDistribution, DeliveryCosts, EnergyDistribution
from skyway.models.composition.heights import LegHeights, NearObstacle, TerrainUse
from skyway.models.composition.service import DroneService, LegSegment, Place, Stop
from skyway.models.flight.clearance import Clearance
from skyway.models.wind.summary import Wind

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

SCHEMA = "skyway.composition/1"
MAX_BYTES = 64 * 1024 * 1024


_STRUCTS: dict[type, type[msgspec.Struct]] = {
    Place: schema.Place,
    Wind: schema.Wind,
    Figure: schema.Figure,
    LegSegment: schema.Segment,
    DroneService: schema.Leg,
    Stop: schema.Stop,
    ArrivalDistribution: schema.Arrival,
    EnergyDistribution: schema.EnergyDistribution,
    DeliveryCosts: schema.DeliveryCosts,
    Condition: schema.Condition,
    LegHeights: schema.LegHeights,
    NearObstacle: schema.NearObstacle,
    Clearance: schema.Clearance,
    TerrainUse: schema.TerrainUse,
    WayBack: schema.WayBack,
    Composition: schema.Composition,
}
"""Structure in the file of each class."""
_CLASSES = {struct: kind for kind, struct in _STRUCTS.items()}
_INSTANTS = ("depart", "arrive", "mean", "p50", "p95", "time", "not_before")
T = TypeVar("T")


def to_json(composition: Composition) -> dict[str, Any]:
    """Return the composition as plain JSON values."""
    return _tidy(_plain(composition), composition)


def _tidy(document: dict[str, Any], composition: Composition) -> dict[str, Any]:
    """Omit empty fields, and add the path of the scenario; likewise in the plans of a way back."""
    scenario = {"path": composition.scenario_path, "sha256": composition.scenario_sha256}
    back = composition.way_back
    if back is None:
        del document["return"]
    else:
        for name, plan in (("plan", back.plan), ("undelivered", back.undelivered)):
            if plan is not None:
                document["return"][name] = _tidy(document["return"][name], plan)
        if back.release == "gripper":
            del document["return"]["release"]
        if back.undelivered_to is None:
            del document["return"]["undelivered_to"], document["return"]["undelivered"]
    for name in ("conditions", "terrain", "authorized", "zones", "not_before", "energy", "costs"):
        if not document[name]:
            del document[name]
    for leg in document["legs"]:
        if leg["heights"] is None:
            del leg["heights"]
    for place in document["stations"].values():
        for name in ("least_m", "least_agl_m"):
            if place[name] is None:
                del place[name]
    return document | {"schema": SCHEMA, "scenario": scenario}


def figure_json(figure: Figure | None) -> dict[str, float] | None:
    """Return a figure as plain JSON values: value, 95 % interval, standard error, and the part of it that changes with the seed."""
    plain: dict[str, float] | None = _plain(figure)
    return plain


def _plain(value: Any) -> Any:
    """Return a value, with everything in it, in the form of the file."""
    struct = _STRUCTS.get(type(value))
    if struct is not None:
        names = zip(struct.__struct_encode_fields__, struct.__struct_fields__, strict=True)
        return {name: _plain(getattr(value, own_name, None)) for name, own_name in names}
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return iso(value) if isinstance(value, datetime) else value


def save(composition: Composition, path: str | PathLike[str], *, force: bool = False) -> None:
    """Write the composition atomically.

    Raises an `InputError` if the file exists and `force` is not given, or if its folder cannot be written.
    """
    write_atomically(Path(path), json.dumps(to_json(composition), indent=1, allow_nan=False) + "\n", force=force)


def load(path: str | PathLike[str]) -> Composition:
    """Read a composition written by `save` or by ``skyway plan --json``.

    An `InputError` refuses a file that is unreadable, not JSON, of another schema, or has a field that is missing or out of
    range.
    """
    return from_json(read_text(Path(path), max_bytes=MAX_BYTES), file=str(path))


def from_json(data: bytes | str, *, file: str = "composition") -> Composition:
    """Read a composition from JSON text; `file` is named in errors (`InputError`)."""
    try:
        raw = msgspec.json.decode(data, type=schema.Composition)
    except (msgspec.ValidationError, msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise InputError(f"not a {SCHEMA} file: {error}", file, remedy="write one with skyway plan -o") from error
    if raw.schema != SCHEMA:
        raise InputError("unknown schema", file, field="schema", value=raw.schema, remedy=f"expected {SCHEMA}")
    return _composition(raw, file, "")


def _composition(raw: schema.Composition, file: str, where: str) -> Composition:
    """Return one plan of a file, with those of its way back."""
    _check_references(raw, file, where)
    services = tuple(
        _read(DroneService, leg, file, f"{where}legs[{n}].", id=leg.id or f"leg-{n}", energy_j=leg.energy_wh * J_PER_WH)
        for n, leg in enumerate(raw.services)
    )
    _check_order(services, file, where)
    return _read(
        Composition,
        raw,
        file,
        where,
        services=services,
        origin=raw.origin or services[0].origin,
        destination=raw.destination or services[-1].destination,
        scenario_path=raw.scenario.path,
        scenario_sha256=raw.scenario.sha256,
        way_back=_way_back(raw, services, file, where),
    )


def _way_back(raw: schema.Composition, services: tuple[DroneService, ...], file: str, where: str) -> WayBack | None:
    """Return the plan of the drone after the delivery; an `InputError` refuses a way back that does not begin at the delivery."""
    back = raw.way_back
    if back is None:
        return None
    plans: dict[str, Composition | None] = {}
    for name, plan in (("plan", back.plan), ("undelivered", back.undelivered)):
        place = f"{where}return.{name}."
        found = plans[name] = None if plan is None else _composition(plan, file, place)
        if found is None:
            continue
        if found.way_back is not None:
            raise InputError("must not have another way back", file, field=f"{place}return")
        if found.origin != services[-1].destination:
            raise InputError("does not start where the delivery ends", file, field=f"{place}from", value=found.origin)
        if found.services[0].depart < services[-1].arrive:
            value = iso(found.services[0].depart)
            raise InputError("departs before the delivery arrives", file, field=f"{place}legs[0].depart", value=value)
    to = raw.destination or services[-1].destination if back.plan is None else back.plan.destination
    if back.station != to:
        raise InputError("is not where the way back ends", file, field=f"{where}return.to", value=back.station)
    return _read(WayBack, back, file, f"{where}return.", **plans)


def _read(kind: Callable[..., T], raw: msgspec.Struct, file: str, where: str, **given: Any) -> T:
    """Return the value of a structure of the file; `where` is its place, for errors, and `given` fields are taken unchanged."""
    names = zip(raw.__struct_fields__, raw.__struct_encode_fields__, strict=True)
    own = {one.name for one in fields(cast("Any", kind))}.difference(given)
    return kind(**given, **{n: _value(n, getattr(raw, n), file, where + name) for n, name in names if n in own})


def _value(name: str, value: Any, file: str, where: str) -> Any:
    """Return the value of one field of a structure, or of one item of a list or mapping."""
    if type(value) in _CLASSES:
        return _read(_CLASSES[type(value)], value, file, f"{where}.")
    if isinstance(value, list):
        return tuple(_value("", one, file, f"{where}[{number}]") for number, one in enumerate(value))
    if isinstance(value, dict):
        return {key: _value("", one, file, f"{where}.{key}") for key, one in value.items()}
    return parse_instant(value, field=where, file=file) if name in _INSTANTS and value is not None else value


def _check_order(services: tuple[DroneService, ...], file: str, begin: str) -> None:
    faults = [
        Fault("arrives before it departs", file, field=f"{begin}legs[{number}].arrive", value=iso(service.arrive))
        for number, service in enumerate(services)
        if service.arrive <= service.depart
    ]
    faults += [
        Fault(
            "departs before the last leg arrived", file, field=f"{begin}legs[{number}].depart", value=iso(after.depart)
        )
        for number, (before, after) in enumerate(pairwise(services), start=1)
        if after.depart < before.arrive
    ]
    refuse(faults)


def _check_references(raw: schema.Composition, file: str, begin: str) -> None:
    if not raw.services:
        raise InputError("has no legs", file, field=f"{begin}legs")
    named = [
        (f"{begin}legs[{i}]", key)
        for i, leg in enumerate(raw.services)
        for key in (leg.origin, *leg.via, leg.destination)
    ]
    named += [(f"{begin}stops[{i}].station", stop.station) for i, stop in enumerate(raw.stops)]
    faults = [
        Fault("names a station that is not in stations", file, field=where, value=key)
        for where, key in named
        if key not in raw.stations
    ]
    faults += [
        Fault("are not those of its via and to", file, field=f"{begin}legs[{i}].segments", value=segment.head)
        for i, leg in enumerate(raw.services)
        if leg.segments and [one.head for one in leg.segments] != [*leg.via, leg.destination]
        for segment in leg.segments[:1]
    ]
    faults += [
        Fault("has lists of different lengths", file, field=f"{begin}legs[{i}].heights")
        for i, leg in enumerate(raw.services)
        if leg.heights is not None
        and (
            not len(leg.heights.along_m) == len(leg.heights.ground_m) == len(leg.heights.top_m) > 0
            or not len(leg.heights.path_along_m) == len(leg.heights.path_height_m) > 0
        )
    ]
    faults += [
        Fault("must be one line of plain text", file, field=f"{begin}stations", value=key)
        for key in raw.stations
        if not key or one_line(key) != key
    ]
    faults += [
        Fault("does not start where the last leg ended", file, field=f"{begin}legs[{i + 1}].from", value=after.origin)
        for i, (before, after) in enumerate(pairwise(raw.services))
        if before.destination != after.origin
    ]
    refuse(faults)
