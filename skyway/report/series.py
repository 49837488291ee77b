"""Time series of a flight: position, height, charge and winds, as columns."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.report import fields as of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.link.supervisor.journal import Record

_QUANTITIES = (
    "height_m", "ground_speed_mps", "power_w", "forecast_north_mps", "forecast_east_mps", "wind_north_mps",
    "wind_east_mps", "wind_sigma_mps", "believed_north_mps", "believed_east_mps", "left_s", "late_s", "cross_track_m",
    "commanded_mps", "energy_factor", "forecast_mean_mps", "forecast_p10_mps", "forecast_p90_mps", "forecast_from_deg",
    "believed_mean_mps",
)  # fmt: skip
_MEASURED = frozenset({"wind_north_mps", "wind_east_mps", "wind_sigma_mps"})
_SHARES = ("soc", "soc_land", "planned_soc_land", "p_below_reserve")
_SAME_S = 10.0
"""A truth no further away in time than this belongs to an estimate."""


def series_of(records: tuple[Record, ...]) -> dict[str, Any]:
    """Return columns: ``track`` (the vehicle's telemetry and the filter) and ``truth`` (of a simulation)."""
    track: dict[str, list[Any]] = {"time_s": [], "flight": [], "lat": [], "lon": [], "air": []}
    track |= {name: [] for name in (*_QUANTITIES, *_SHARES)}
    true: dict[str, list[Any]] = {"time_s": [], "wind_north_mps": [], "wind_east_mps": [], "soc": []}
    for at_s, record in of.timed(records):
        data = record.data
        if record.event == "track":
            at = of.place(data.get("lat"), data.get("lon")) or (None, None)
            track["time_s"].append(at_s)
            track["flight"].append(record.flight)
            track["lat"].append(at[0])
            track["lon"].append(at[1])
            track["air"].append(of.truth(data, "landed") is False)
            unmeasured = of.measured_words(data) is None  # the filter tells its forecast where nothing was measured
            for name in _QUANTITIES:
                known = None if unmeasured and name in _MEASURED else of.number(data, name)
                track[name].append(known)
            for name in _SHARES:
                track[name].append(of.share(data, name))
        elif record.event == "truth":
            true["time_s"].append(at_s)
            true["wind_north_mps"].append(of.number(data, "wind_north_mps"))
            true["wind_east_mps"].append(of.number(data, "wind_east_mps"))
            true["soc"].append(of.share(data, "soc"))
    return {"track": track, "truth": true, "log": None}


def log_series(paths: Sequence[Path]) -> dict[str, list[Any]]:
    """Return the columns of recordings, a row a second: finer than the journal's.

    Raises
    ------
    InputError
        No log, or none of a vehicle whose time of day is known.
    """
    rows: dict[float, tuple[float, ...]] = {}
    for path in paths:
        rows |= _log_rows(path)
    columns = zip(*(rows[second] for second in sorted(rows)), strict=True)
    names = ("time_s", "lat", "lon", "height_m", "soc", "ground_speed_mps")
    return {name: [_known(value) for value in column] for name, column in zip(names, columns, strict=True)}


def _log_rows(path: Path) -> dict[float, tuple[float, ...]]:
    """Return the last sample of each second, of the first vehicle in a log."""
    import numpy as np

    from skyway.link.logs.reader import open_log
    from skyway.models.base.errors import Fault, InputError
    from skyway.models.drones.telemetry import QUANTITIES

    log = open_log(path)
    if not log.summary.time_base.absolute or not log.summary.systems:
        raise InputError(Fault("has no telemetry with a time of day, to set beside the journal", str(path)))
    wanted = ("lat_deg", "lon_deg", "height_m", "soc", "vel_north_mps", "vel_east_mps")
    at = [QUANTITIES.index(name) for name in wanted]
    rows: dict[float, tuple[float, ...]] = {}
    for track in log.tracks():
        if track.system != log.summary.systems[0] or not len(track):
            continue
        last = np.flatnonzero(np.diff(np.floor(track.time_s), append=math.inf) > 0.0)
        for time_s, row in zip(track.time_s[last].tolist(), track.values[last][:, at].tolist(), strict=True):
            rows[math.floor(time_s)] = (time_s, *row[:4], math.hypot(row[4], row[5]))
    if not rows:
        raise InputError(Fault("has no telemetry", str(path)))
    return rows


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def wind_errors(series: dict[str, Any], begin_s: float, end_s: float | None) -> dict[str, Any]:
    """Return the winds of a flight, and how far estimate and forecast were from the truth (RMS of the vector).

    Estimate and truth are summarised as a forecast is: mean speed, 10 and 90 %, prevailing direction.
    """
    track, truth = series["track"], series["truth"]
    rows = [
        i for i, at_s in enumerate(track["time_s"])
        if at_s >= begin_s and (end_s is None or at_s <= end_s) and track["wind_north_mps"][i] is not None
    ]  # fmt: skip
    found: dict[str, Any] = {}
    found["estimate"] = _summary([(track["wind_north_mps"][i], track["wind_east_mps"][i]) for i in rows])
    sigmas = [s for i in rows if (s := track["wind_sigma_mps"][i]) is not None]
    found["estimate_sigma_mps"] = sum(sigmas) / len(sigmas) if sigmas else None
    near = [(i, j) for i, j in _nearest([track["time_s"][i] for i in rows], rows, truth["time_s"])]
    found["truth"] = _summary([(truth["wind_north_mps"][j], truth["wind_east_mps"][j]) for _, j in near])
    for name, key in (("wind", "estimate_rms_mps"), ("forecast", "forecast_rms_mps")):
        found[key] = _rms(track, truth, name, near)
    return found


def _nearest(times: list[float], rows: list[int], true_times: list[float]) -> list[tuple[int, int]]:
    """Pair each row with the truth closest in time; both are in order."""
    found, j = [], 0
    for row, at_s in zip(rows, times, strict=True):
        while j + 1 < len(true_times) and abs(true_times[j + 1] - at_s) <= abs(true_times[j] - at_s):
            j += 1
        if true_times and abs(true_times[j] - at_s) <= _SAME_S:
            found.append((row, j))
    return found


def _summary(pairs: list[tuple[Any, Any]]) -> dict[str, Any] | None:
    """Summarise winds as every wind is; None without any."""
    import numpy as np

    from skyway.models.wind.summary import summary_of

    known = np.array([(north, east) for north, east in pairs if north is not None and east is not None])
    if not len(known):
        return None
    found = summary_of(known[:, 0], known[:, 1], np.ones(len(known)))
    return {"north_mps": found.north_mps, "east_mps": found.east_mps, **found.as_data(), "words": str(found)}


def _rms(
    track: dict[str, list[Any]], truth: dict[str, list[Any]], name: str, near: list[tuple[int, int]]
) -> float | None:
    squares = []
    for i, j in near:
        values = (
            track[f"{name}_north_mps"][i], truth["wind_north_mps"][j],
            track[f"{name}_east_mps"][i], truth["wind_east_mps"][j],
        )  # fmt: skip
        if None not in values:
            squares.append((values[0] - values[1]) ** 2 + (values[2] - values[3]) ** 2)
    return math.sqrt(sum(squares) / len(squares)) if squares else None
