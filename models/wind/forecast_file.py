"""Files of wind forecasts: one row per time, site and member."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.table import FaultCollector, Problem, read_table
from skyway.models.base.units import from_posix, iso, parse_instant
from skyway.models.wind.columns import MAX_SPEED_MPS, check_year, parse_direction, parse_number
from skyway.models.wind.triangle import speed_from, vector

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.base.table import Chunk
    from skyway.models.wind.ensemble import WindEnsemble

MAX_SLOT_S = 6 * 3600.0
MAX_CELLS = 20_000_000
_COLUMNS = ("time", "site", "member", "speed_mps", "from_deg")


@dataclass(frozen=True, slots=True, eq=False)
class ForecastTable:
    """A forecast as written."""

    times_s: NDArray[np.float64]
    """Shape (slots,). POSIX seconds at which each slot begins, evenly spaced."""
    slot_s: float
    """Their distance; an hour where there is only one."""
    members: tuple[str, ...]
    """In the order of the file."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    """Shape (members, slots, sites) each. m/s TOWARDS."""
    probability: NDArray[np.float64]
    """Shape (members,). Sums to 1."""


def read_forecast_table(path: Path, site_ids: Sequence[str]) -> ForecastTable:
    """Read a forecast; the answer is complete.

    An `InputError` has all faults of the file: first those of its cells, then missing and duplicate rows.
    """
    reader = _Reader(str(path), site_ids)
    chunks = read_table(path, _COLUMNS, reader.faults, optional=("probability",))
    parts = [reader.read(chunk) for chunk in chunks]
    reader.faults.raise_if_any()
    line, time_s, site, member, speed, direction, probability = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    times_s, slot = np.unique(time_s, return_inverse=True)
    slot_s = _step(times_s, reader.faults)
    shape = (len(reader.members), len(times_s), len(site_ids))
    if math.prod(shape) > MAX_CELLS:
        problem = f"{len(line):,} rows for {shape[0]:,} members, {shape[1]:,} times and {shape[2]:,} sites"
        reader.faults.add(problem, "a row for each of them together")
        reader.faults.raise_if_any()
    cell = (member.astype(np.int64) * shape[1] + slot) * shape[2] + site.astype(np.int64)
    reader.check_complete(cell, line, times_s)
    weights = reader.probabilities(member.astype(np.int64), line, probability)
    reader.faults.raise_if_any()
    order = np.argsort(cell)
    north, east = (part[order].reshape(shape) for part in vector(speed, direction))
    return ForecastTable(times_s, slot_s, tuple(reader.members), north, east, weights)


def site_names(path: Path) -> list[str]:
    """Return the names of the sites of a forecast, in the order of the file."""
    faults = FaultCollector(str(path))
    chunks = read_table(path, _COLUMNS, faults, optional=("probability",))
    found = dict.fromkeys(text.strip() for chunk in chunks for text in chunk.columns["site"])
    faults.raise_if_any()
    return list(found)


def forecast_table(ensemble: WindEnsemble, site_ids: Sequence[str]) -> str:
    """Write an ensemble as a file that `read_forecast_table` reads; site ``j`` of the ensemble is ``site_ids[j]``."""
    speed, direction = speed_from(ensemble.north, ensemble.east)
    times = [iso(from_posix(ensemble.start_s + slot * ensemble.slot_s)) for slot in range(ensemble.slots)]
    lines = [",".join((*_COLUMNS, "probability"))]
    for member, (name, probability) in enumerate(zip(ensemble.labels, ensemble.probability.tolist(), strict=True)):
        for slot, time in enumerate(times):
            for site, place in enumerate(site_ids):
                wind = f"{speed[member, slot, site]:.4f},{direction[member, slot, site] % 360.0:.3f}"
                lines.append(f"{time},{place},{name},{wind},{probability!r}")
    return "\n".join(lines) + "\n"


def _step(times_s: NDArray[np.float64], faults: FaultCollector) -> float:
    steps = np.diff(times_s)
    if not len(steps):
        return 3600.0
    usual = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - usual) > 1e-3)
    for number in faults.first(uneven):
        begin, end = (iso(from_posix(times_s[place])) for place in (number, number + 1))
        problem = f"from {begin} to {end} the step is {steps[number] / 3600.0:g} h"
        faults.add(problem, f"the same step everywhere, here {usual / 3600.0:g} h", field="time")
    if usual > MAX_SLOT_S:
        faults.add(f"the times are {usual / 3600.0:g} h apart", "at most 6 h", field="time")
    return usual


class _Reader:
    """Reads one forecast; keeps the members from chunk to chunk."""

    def __init__(self, file: str, site_ids: Sequence[str]) -> None:
        self.faults = FaultCollector(file)
        self.members: dict[str, float] = {}
        self._sites = {site: float(number) for number, site in enumerate(site_ids)}

    def read(self, chunk: Chunk) -> tuple[NDArray[np.float64], ...]:
        """Return line, time, site, member, speed, direction, probability (NaN: none), each (rows,)."""
        faults = self.faults
        speed = chunk.decode("speed_mps", _parse_speed, faults)
        if np.any(speed == 0.0):  # calm needs no direction
            texts = list(chunk.columns["from_deg"])
            for row in np.flatnonzero(speed == 0.0):
                texts[row] = texts[row].strip() or "0"
            chunk.columns["from_deg"] = tuple(texts)
        if "probability" in chunk.columns:
            probability = chunk.decode("probability", _parse_probability, faults)
        else:
            probability = np.full(len(chunk.lines), np.nan)
        return (
            np.array(chunk.lines, dtype=np.float64),
            chunk.decode("time", _parse_time, faults),
            chunk.decode("site", self._parse_site, faults, each_text_once=True),
            self._number_members(chunk),
            speed,
            chunk.decode("from_deg", parse_direction, faults),
            probability,
        )

    def _number_members(self, chunk: Chunk) -> NDArray[np.float64]:
        """Return the number of each row's member, in the order of the file, shape (rows,)."""
        numbers = []
        for line, text in zip(chunk.lines, chunk.columns["member"], strict=True):
            name = text.strip()
            if not name:
                self.faults.add("no member", "a name or number", line=line, field="member")
            numbers.append(self.members.setdefault(name, float(len(self.members))))
        return np.array(numbers)

    def check_complete(self, cell: NDArray[np.int64], line: NDArray[np.float64], times_s: NDArray[np.float64]) -> None:
        """Note each member, time and site that has no row or several."""
        sites, members = list(self._sites), list(self.members)
        rows = np.bincount(cell, minlength=len(members) * len(times_s) * len(sites))
        wrong = np.flatnonzero(rows != 1)
        for number in self.faults.first(wrong):
            rest, site = divmod(number, len(sites))
            member, slot = divmod(rest, len(times_s))
            which = f"member {members[member]}, site {sites[site]}, {iso(from_posix(times_s[slot]))}"
            if rows[number]:
                where = int(line[np.flatnonzero(cell == number)[1]])
                self.faults.add(f"{which} is given twice", "once", line=where)
            else:
                remedy = "every member needs every site at every time"
                self.faults.add(f"{which} is missing", remedy)

    def probabilities(
        self, member: NDArray[np.int64], line: NDArray[np.float64], given: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Probability of each member, shape (members,)."""
        if np.isnan(given).all():
            return np.full(len(self.members), 1.0 / len(self.members))
        _, first = np.unique(member, return_index=True)
        probability = given[first]
        changed = np.flatnonzero(given != probability[member])
        for row in self.faults.first(changed):
            problem = "the probability of a member changes"
            remedy = f"as in line {int(line[first[member[row]]])}"
            self.faults.add(problem, remedy, line=int(line[row]), field="probability", value=given[row])
        total = float(probability.sum())
        if abs(total - 1.0) > 1e-3:
            problem = "the probabilities of the members do not sum to 1"
            self.faults.add(problem, "parts of 1", field="probability", value=f"{total:g}")
        return np.asarray(probability / total) if total > 0.0 else probability

    def _parse_site(self, text: str) -> float | Problem:
        return self._sites.get(text, Problem("unknown site", "the sites are " + ", ".join(self._sites)))


def _parse_time(text: str) -> float | Problem:
    try:
        instant = parse_instant(text)
    except InputError as error:
        return Problem(error.faults[0].problem, error.faults[0].remedy or "")
    return check_year(instant) or instant.timestamp()


def _parse_speed(text: str) -> float | Problem:
    value = parse_number(text)
    if isinstance(value, float) and not 0.0 <= value <= MAX_SPEED_MPS:
        return Problem("not a wind speed", f"metres per second, from 0 to {MAX_SPEED_MPS:g}")
    return value


def _parse_probability(text: str) -> float | Problem:
    value = parse_number(text)
    if isinstance(value, float) and not 0.0 <= value <= 1.0:
        return Problem("not a probability", "from 0 to 1")
    return value
