"""Time series of a flight: position, height, charge and winds, as columns."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.link.supervisor.journal import entries
from skyway.link.supervisor.journal import fields as of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.link.supervisor.journal.file import Record

Columns = dict[str, list[Any]]
"""Values over time by name, all of one length; None is unknown."""
_TRACK = (
    "time_s", "flight", "air", "lat", "lon", "height_m", "ground_speed_mps", "power_w", "forecast_north_mps",
    "forecast_east_mps", "soc", "believed_north_mps", "believed_east_mps", "left_s", "late_s", "cross_track_m",
    "commanded_mps", "energy_factor", "soc_land", "planned_soc_land", "p_below_reserve", "wind_north_mps",
    "wind_east_mps", "wind_sigma_mps", "forecast_mean_mps", "forecast_p10_mps", "forecast_p90_mps", "forecast_from_deg",
    "believed_mean_mps",
)  # fmt: skip
_TRUTH = ("time_s", "wind_north_mps", "wind_east_mps", "soc")
_MEASURED = ("wind_north_mps", "wind_east_mps", "wind_sigma_mps")
_SAME_S = 10.0
"""A truth no further away in time than this belongs to an estimate."""


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """The courses of a flight."""

    track: Columns
    """The vehicle's telemetry and the filter."""
    truth: Columns
    """What really blew, of a simulation."""
    log: Columns | None = None
    """Telemetry of recordings, finer than the journal's."""


class WindFound(msgspec.Struct, frozen=True, kw_only=True):
    """Winds of a flight in the figures and words that every wind is given in."""

    north_mps: float
    east_mps: float
    mean_mps: float | None
    p10_mps: float | None
    p90_mps: float | None
    from_deg: float | None
    sector_share: float | None
    words: str


class WindExpected(msgspec.Struct, frozen=True, kw_only=True):
    """Winds expected at a take-off, in words, and where they come from."""

    words: str | None
    origin: str | None


class LegWind(msgspec.Struct, frozen=True, kw_only=True):
    """Winds of a flight: expected, estimated, true; errors of the first two (RMS of the vector)."""

    forecast: WindExpected
    estimate: WindFound | None = None
    estimate_sigma_mps: float | None = None
    truth: WindFound | None = None
    estimate_rms_mps: float | None = None
    forecast_rms_mps: float | None = None

    @classmethod
    def expected(cls, words: str | None, origin: str | None) -> LegWind:
        """Return what is known at the take-off."""
        return cls(forecast=WindExpected(words=words, origin=origin))


def series_of(records: tuple[Record, ...]) -> Series:
    """Return the time series in a journal."""
    track: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    for at_s, record in of.timed(records):
        if (entry := record.entry(entries.Tracked)) is not None:
            lat, lon = of.place(entry.lat, entry.lon) or (None, None)
            aloft = {"time_s": at_s, "flight": record.flight, "air": entry.landed is False, "lat": lat, "lon": lon}
            unmeasured = entry.measured_words() is None  # the filter tells its forecast where nothing was measured
            track.append(entry.to_json() | aloft | (dict.fromkeys(_MEASURED) if unmeasured else {}))
        elif (true := record.entry(entries.Truth)) is not None:
            truth.append(true.to_json() | {"time_s": at_s})
    return Series(track=_columns(track, _TRACK), truth=_columns(truth, _TRUTH))


def _columns(rows: list[dict[str, Any]], names: tuple[str, ...]) -> Columns:
    return {name: [row.get(name) for row in rows] for name in names}


def log_series(paths: Sequence[Path]) -> Columns:
    """Return the columns of recordings, a row a second: finer than the journal's.

    An `InputError` refuses a file that is no log, or none of a vehicle whose time of day is known.
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
    from skyway.models.base.errors import InputError
    from skyway.models.drones.telemetry import QUANTITIES

    log = open_log(path)
    if not log.summary.time_base.absolute or not log.summary.systems:
        raise InputError("has no telemetry with a time of day, to set beside the journal", str(path))
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
        raise InputError("has no telemetry", str(path))
    return rows


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def wind_errors(series: Series, expected: LegWind, begin_s: float, end_s: float | None) -> LegWind:
    """Return the winds of a flight, and how far estimate and forecast were from the truth (RMS of the vector).

    Estimate and truth are summarised as a forecast is: mean speed, 10 and 90 %, prevailing direction.
    """
    track, truth = series.track, series.truth
    rows = [
        i for i, at_s in enumerate(track["time_s"])
        if at_s >= begin_s and (end_s is None or at_s <= end_s) and track["wind_north_mps"][i] is not None
    ]  # fmt: skip
    sigmas = [s for i in rows if (s := track["wind_sigma_mps"][i]) is not None]
    near = _nearest([track["time_s"][i] for i in rows], rows, truth["time_s"])
    return LegWind(
        forecast=expected.forecast,
        estimate=_summary([(track["wind_north_mps"][i], track["wind_east_mps"][i]) for i in rows]),
        estimate_sigma_mps=sum(sigmas) / len(sigmas) if sigmas else None,
        truth=_summary([(truth["wind_north_mps"][j], truth["wind_east_mps"][j]) for _, j in near]),
        estimate_rms_mps=_rms(track, truth, "wind", near),
        forecast_rms_mps=_rms(track, truth, "forecast", near),
    )


def _nearest(times: list[float], rows: list[int], true_times: list[float]) -> list[tuple[int, int]]:
    """Pair each row with the truth closest in time; both are in order."""
    found, j = [], 0
    for row, at_s in zip(rows, times, strict=True):
        while j + 1 < len(true_times) and abs(true_times[j + 1] - at_s) <= abs(true_times[j] - at_s):
            j += 1
        if true_times and abs(true_times[j] - at_s) <= _SAME_S:
            found.append((row, j))
    return found


def _summary(pairs: list[tuple[Any, Any]]) -> WindFound | None:
    """Summarise winds as every wind is; None without any."""
    import numpy as np

    from skyway.models.wind.summary import summary_of

    known = np.array([(north, east) for north, east in pairs if north is not None and east is not None])
    if not len(known):
        return None
    found = summary_of(known[:, 0], known[:, 1], np.ones(len(known)))
    return WindFound(north_mps=found.north_mps, east_mps=found.east_mps, **found.as_data(), words=str(found))


def _rms(track: Columns, truth: Columns, name: str, near: list[tuple[int, int]]) -> float | None:
    squares = []
    for i, j in near:
        values = (
            track[f"{name}_north_mps"][i], truth["wind_north_mps"][j],
            track[f"{name}_east_mps"][i], truth["wind_east_mps"][j],
        )  # fmt: skip
        if None not in values:
            squares.append((values[0] - values[1]) ** 2 + (values[2] - values[3]) ** 2)
    return math.sqrt(sum(squares) / len(squares)) if squares else None
