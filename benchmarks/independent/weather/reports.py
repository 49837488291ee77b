"""Weather reports, read from the raw records: when they were observed, when they were out, and what they say.

Vectors are (north, east), m/s, where the air moves TOWARDS. A report without a speed, or with a speed and no direction, is none.
"""

from __future__ import annotations

import csv
import gzip
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[3]
WIND = ROOT.parent / "shared" / "data" / "wind"
AIRPORTS = {"EWR": (40.6825, -74.1694), "JFK": (40.6386, -73.7622), "LGA": (40.7794, -73.8803)}
MELBOURNE, LONDON = (-37.8136, 144.9631), (51.5225, -0.1546)
OBSERVED_S, OUT_AFTER_S = 51 * 60.0, 5 * 60.0
"""An hourly METAR is observed nine minutes before the next hour, and is out about five minutes later."""
MPS_PER_MPH, MPS_PER_KMH = 0.44704, 1.0 / 3.6
ABSURD_MPS = 60.0


@dataclass(frozen=True, eq=False)
class Site:
    """Reports of one site, ascending in time.

    Attributes
    ----------
    id, lat, lon
        Which, and where.
    time_s, out_s : ndarray, shape (reports,)
        POSIX seconds of the observation, and from when on people can know it.
    wind : ndarray, shape (reports, 2)
    temp_c : ndarray, shape (reports,)
        NaN where unknown.
    """

    id: str
    lat: float
    lon: float
    time_s: NDArray[np.float64]
    out_s: NDArray[np.float64]
    wind: NDArray[np.float64]
    temp_c: NDArray[np.float64]

    def latest(self, time_s: float) -> int:
        """The last report that is out at a time; -1 before the first."""
        return int(np.searchsorted(self.out_s, time_s, side="right")) - 1

    def as_metars(self) -> Site:
        """The same reports, stamped with their hour, as they were observed and published: nine minutes before its end."""
        return replace(self, time_s=self.time_s + OBSERVED_S, out_s=self.time_s + OBSERVED_S + OUT_AFTER_S)


def vector(speed_mps: NDArray[np.float64], from_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Wind vectors of speeds and directions FROM, shape (..., 2)."""
    towards = np.radians(from_deg + 180.0)
    return np.stack((speed_mps * np.cos(towards), speed_mps * np.sin(towards)), axis=-1)


def new_york() -> tuple[Site, ...]:
    """EWR, JFK and LGA in 2013; times are the stamps of the file."""
    packed = WIND / "nyc_2013_hourly_wind.csv.gz"
    return _new_york(packed if packed.exists() else ROOT / "missions" / "examples" / "newyork" / "wind.csv")


@lru_cache(maxsize=2)
def _new_york(path: Path) -> tuple[Site, ...]:
    rows: dict[str, list[tuple[float, float, float, float]]] = {name: [] for name in AIRPORTS}
    for row in _rows(path):
        stamp = _posix(row["time_hour"])
        speed = _number(row["wind_speed"], MPS_PER_MPH)
        calm = speed == 0.0
        degrees = 0.0 if calm else _number(row["wind_dir"])
        if degrees == 0.0 and not calm:
            degrees = np.nan  # direction 0 is for calms alone
        rows[row["origin"]].append((stamp, speed, degrees, (_number(row["temp"]) - 32.0) / 1.8))
    return tuple(_site(name, AIRPORTS[name], rows[name]) for name in AIRPORTS)


@lru_cache(maxsize=1)
def melbourne() -> tuple[Site, ...]:
    """Melbourne in the winter of 2023; the file has local clock time."""
    zone = ZoneInfo("Australia/Melbourne")

    def entry(row: dict[str, str]) -> tuple[float, float, float, float]:
        stamp = datetime.fromisoformat(row["time"]).replace(tzinfo=zone).timestamp()
        return stamp, _number(row["windspeed"], MPS_PER_KMH), _number(row["winddir"]), _number(row["temp"])

    return (_site("melbourne", MELBOURNE, _entries(WIND / "melbourne_2023_hourly_weather.csv", entry)),)


@lru_cache(maxsize=1)
def london() -> tuple[Site, ...]:
    """Marylebone Road, 1998 to 2005."""

    def entry(row: dict[str, str]) -> tuple[float, float, float, float]:
        return _posix(row["time_utc"]), _number(row["wind_speed_mps"]), _number(row["wind_from_deg"]), np.nan

    return (_site("london", LONDON, _entries(WIND / "london_1998_2005_hourly_wind.csv.gz", entry)),)


def _entries(
    path: Path, entry: Callable[[dict[str, str]], tuple[float, float, float, float]]
) -> list[tuple[float, float, float, float]]:
    return [entry(row) for row in _rows(path)]


def _rows(path: Path) -> Iterator[dict[str, str]]:
    raw = path.read_bytes()
    text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8")
    yield from csv.DictReader(text.splitlines())


def _posix(text: str) -> float:
    return datetime.fromisoformat(text).astimezone(UTC).timestamp()


def _number(text: str, factor: float = 1.0) -> float:
    return float(text) * factor if text not in ("", "NA") else float("nan")


def _site(name: str, place: tuple[float, float], rows: list[tuple[float, float, float, float]]) -> Site:
    """Sorted, the last of several at a time, without what is no report."""
    by_time = {row[0]: row for row in rows}
    table = np.array([by_time[stamp] for stamp in sorted(by_time)])
    speed, degrees = table[:, 1], np.where(table[:, 1] == 0.0, 0.0, table[:, 2])
    good = (speed >= 0.0) & (speed < ABSURD_MPS) & np.isfinite(degrees)
    time_s = table[good, 0]
    return Site(name, *place, time_s, time_s.copy(), vector(speed[good], degrees[good]), table[good, 3])
