"""Fields of a file, one by one, combined to series."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.readers.pressure_levels import at_heights
from skyway.models.weather.readers.turning import turned
from skyway.models.weather.weather import EAST, MAX_CELLS, NORTH, FieldKey, Weather, with_components

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.weather.weather import Places


class Record(NamedTuple):
    """One field at one time of one member."""

    file: str
    model: str
    issued_s: float
    valid_s: float
    member: str
    """Empty: no ensemble."""
    quantity: str | None
    """None: not used; then there are no values."""
    height_m: float
    name: str
    grid: str
    places: Places
    values: NDArray[np.float64] | None
    """Shape (points,)."""
    angle_deg: NDArray[np.float64] | None
    """Of a wind along the grid: its angle, shape (points,); None: the wind is east and north."""
    analysis: bool
    note: str


def assembled(records: Sequence[Record], form: str) -> list[Weather]:
    """Combine fields, one `Weather` for each issue of a model on a grid; analyses of a model are one series."""
    groups: dict[tuple[str, str, float], list[Record]] = {}
    at_once = _analysed(records)
    for one in records:
        analysed = (one.model, one.grid) in at_once
        groups.setdefault((one.model, one.grid, math.nan if analysed else one.issued_s), []).append(one)
    merged: dict[tuple[str, str, str], list[Record]] = {}
    for (model, grid, issued_s), group in groups.items():  # NaN is not a key
        merged.setdefault((model, grid, str(issued_s)), []).extend(group)
    return [
        _series(
            group, form, math.nan if (model, grid) in at_once else group[0].issued_s, analysed=(model, grid) in at_once
        )
        for (model, grid, _), group in merged.items()
    ]


def _analysed(records: Sequence[Record]) -> set[tuple[str, str]]:
    """Models on grids that have only analyses, at several times."""
    issues: dict[tuple[str, str], set[float]] = {}
    forecast: set[tuple[str, str]] = set()
    for one in records:
        key = one.model, one.grid
        issues.setdefault(key, set()).add(one.issued_s)
        if not one.analysis or one.valid_s != one.issued_s:
            forecast.add(key)
    return {key for key, times in issues.items() if len(times) > 1 and key not in forecast}


def _series(records: Sequence[Record], form: str, issued_s: float, *, analysed: bool) -> Weather:
    file = records[0].file
    used = [one for one in records if one.quantity is not None]
    places = records[0].places
    times = np.unique([one.valid_s for one in used or records])
    members = _members(records)
    slot = {time: number for number, time in enumerate(times.tolist())}
    row = {name: number for number, name in enumerate(members)}
    shape = (len(members), len(times), len(places))
    keys = {FieldKey(one.quantity or "", one.height_m) for one in used}
    if math.prod(shape) * max(len(keys), 1) > MAX_CELLS:
        problem = f"holds {shape[0]} members, {shape[1]} times and {shape[2]:,} points: too large"
        raise InputError(problem, file, remedy="name the region (--scenario), or cut the file to it")
    fields = {key: np.full(shape, np.nan) for key in sorted(keys)}
    angles: dict[FieldKey, NDArray[np.float64]] = {}
    for one in used:
        key = FieldKey(one.quantity or "", one.height_m)
        if one.values is not None:
            fields[key][row.get(one.member, 0), slot[one.valid_s]] = one.values
        if one.angle_deg is not None:
            angles[key] = one.angle_deg
    _turn(fields, angles, file)
    if ("rain", 0.0) in fields:
        fields[FieldKey("rain", 0.0)] *= 3600.0  # kg/m2/s is mm/s
    fields, left_out, told = at_heights(fields)
    others = tuple(dict.fromkeys([*(one.name for one in records if one.quantity is None), *left_out]))
    notes = tuple(dict.fromkeys([*(one.note for one in records if one.note), *told]))
    return Weather(
        tuple(dict.fromkeys(one.file for one in records)), form, records[0].model, issued_s, places, members, times, with_components(fields, file),
        observed=analysed, others=others, notes=notes,
    )  # fmt: skip


def _members(records: Sequence[Record]) -> tuple[str, ...]:
    """Members in the order of their numbers; a field without a number is of the control."""
    names = {one.member for one in records}
    if names <= {""}:
        return ("",)
    return tuple(sorted({name or "0" for name in names}, key=lambda name: (len(name), name)))


def _turn(fields: dict[FieldKey, NDArray[np.float64]], angles: dict[FieldKey, NDArray[np.float64]], file: str) -> None:
    """Turn the winds along the grid to true north."""
    for key in [key for key in angles if key.quantity == EAST]:
        other = FieldKey(NORTH, key.height_m)
        if other in fields:
            fields[other], fields[key] = turned(fields[key], fields[other], angles[key])
    alone = {key.height_m for key in angles} - {
        key.height_m
        for key in angles
        if FieldKey(EAST, key.height_m) in fields and FieldKey(NORTH, key.height_m) in fields
    }
    if alone:
        problem = "has only one component of the wind, along a grid that is turned"
        raise InputError(problem, file, remedy="give u and v in one file")
