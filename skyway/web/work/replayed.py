"""Logs and journals for the replay page: columns over time, flights and events."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.link.replay.replay import Replay

MOST_ROWS = 20_000
"""Rows that a browser gets; of longer logs each second, third … row."""
MOST_EVENTS = 2_000
FIRST_S, LAST_S = 0.0, 253_370_764_800.0
"""POSIX seconds of 1970 and of 9999: times of a log outside these have no date."""
NAMES = (
    "time_s",
    "lat",
    "lon",
    "height_m",
    "ground_speed_mps",
    "soc",
    "heading_deg",
    "wind_north_mps",
    "wind_east_mps",
    "wind_sigma_mps",
    "health",
)
"""Columns of the document. Winds blow TO; `health` is 1 if the wind filter is consistent, 0 if not."""


def shown(path: str) -> dict[str, Any]:
    """Return a log, or the journal of a supervised flight, for the player."""
    file = Path(path)
    return _journal(file) if file.suffix == ".jsonl" else _log(file)


def _log(file: Path) -> dict[str, Any]:
    """Process a log as ``skyway replay`` does."""
    from skyway.link.logs.reader import open_log
    from skyway.link.replay.known_wind import kept_s
    from skyway.link.replay.replay import replay

    found = replay(open_log(file))
    track = found.seconds
    if not len(track):
        raise InputError("has no telemetry", str(file))
    step = max(1, math.ceil(len(track) / MOST_ROWS))
    at = slice(None, None, step)
    wind = _wind_at(found, track.time_s[at], kept_s(track.time_s))
    columns = {
        "time_s": track.time_s[at],
        "lat": track["lat_deg"][at],
        "lon": track["lon_deg"][at],
        "height_m": track["height_m"][at],
        "ground_speed_mps": np.hypot(track["vel_north_mps"][at], track["vel_east_mps"][at]),
        "soc": track["soc"][at],
        "heading_deg": np.degrees(track["yaw_rad"][at]) % 360.0,
        **wind,
    }
    flights = [[leg.start_s, leg.end_s] for leg in found.legs]
    events = [{"time_s": one.time_s, "text": one.text} for one in found.events[:MOST_EVENTS]]
    begin_s = min(found.summary.start_s, float(track.time_s[0]))
    absolute = found.summary.time_base.absolute
    return _document(file, columns, flights, events, begin_s, absolute=absolute) | {"notes": _notes(found)}


def _notes(found: Replay) -> list[str]:
    """What ``skyway replay`` says of a log as a whole."""
    from skyway.link.replay.wind_words import wind_sentence

    summary = found.summary
    told = [f"vehicle: {found.vehicle.kind} ({found.vehicle.told_by})", f"wind: {wind_sentence(found)}"]
    told += [f"warning: {one}" for one in summary.time_base.doubts]
    if summary.skipped_bytes:
        told.append(f"warning: {counted(summary.skipped_bytes, 'byte')} of the file belong to no message")
    if len(found.events) > MOST_EVENTS:
        told.append(f"only the first {counted(MOST_EVENTS, 'event')} are shown, of {len(found.events):,}")
    return told


def _wind_at(found: Replay, time_s: NDArray[np.float64], kept_s: float) -> dict[str, NDArray[np.float64]]:
    """The estimated wind at some times: the last one before each, unless it is older than `kept_s` or the filter is inconsistent."""
    wind = found.wind
    aloft = np.zeros(len(time_s), dtype=np.bool_)
    for leg in found.legs:
        aloft |= (time_s >= leg.start_s) & (time_s <= leg.end_s)
    doubted = found.known.doubted(time_s)
    health = np.where(doubted & aloft, 0.0, np.nan)
    if not len(wind):
        nothing = np.full(len(time_s), np.nan)
        return dict.fromkeys(("wind_north_mps", "wind_east_mps", "wind_sigma_mps"), nothing) | {"health": health}
    last = np.searchsorted(wind.time_s, time_s, side="right") - 1
    begun = last >= 0
    last = np.maximum(last, 0)
    known = begun & (time_s - wind.time_s[last] <= kept_s) & ~doubted
    sigma = np.sqrt(np.maximum((wind.covariance[last, 0] + wind.covariance[last, 2]) / 2.0, 0.0))
    columns = {"wind_north_mps": wind.wind[last, 0], "wind_east_mps": wind.wind[last, 1], "wind_sigma_mps": sigma}
    shown = {name: np.where(known, values, np.nan) for name, values in columns.items()}
    return shown | {"health": np.where(known, 1.0, health)}


def _journal(file: Path) -> dict[str, Any]:
    from skyway.report.report import flight

    report = flight(file)
    track = report.series.track
    columns = {
        name: np.array([math.nan if value is None else value for value in track.get(name, [])], dtype=float)
        for name in NAMES
        if name in track
    }
    if not len(columns.get("time_s", ())):
        raise InputError("has no flight yet", str(file))
    flights = [
        [leg.depart_s, leg.land_s if leg.land_s is not None else float(columns["time_s"][-1])] for leg in report.legs
    ]
    events = [
        {"time_s": one.time_s, "text": f"{one.state}: {one.reason or one.event}"} for one in report.events[:MOST_EVENTS]
    ]
    begin_s = float(columns["time_s"][0])
    return _document(file, columns, flights, events, begin_s, absolute=True) | {"notes": []}


def _document(
    file: Path,
    columns: dict[str, NDArray[np.float64]],
    flights: Sequence[Sequence[float]],
    events: list[dict[str, Any]],
    begin_s: float,
    *,
    absolute: bool,
) -> dict[str, Any]:
    count = len(columns["time_s"])
    dated = absolute and all(
        FIRST_S <= one < LAST_S for one in (begin_s, float(columns["time_s"][-1]))
    )  # else: wrong clock
    rows = {
        name: _plain(columns.get(name, np.full(count, np.nan)), 7 if name in {"lat", "lon"} else 3) for name in NAMES
    }
    return {
        "name": file.name, "begin_s": begin_s if dated else None, "columns": rows | {"time_s": _plain(columns["time_s"] - begin_s, 2)},
        "flights": [[round(one - begin_s, 2) for one in pair] for pair in flights],
        "events": [{"time_s": round(one["time_s"] - begin_s, 2), "text": one["text"][:300]} for one in events],
    }  # fmt: skip


def _plain(values: NDArray[np.float64], digits: int) -> list[float | None]:
    return [round(one, digits) if math.isfinite(one) else None for one in np.asarray(values, dtype=float).tolist()]
