"""Forecasts of days of a wind record, with errors as large as published ones, as a weather service would answer: JSON of Open-Meteo.

Made from the reports themselves, with nothing of the planner's model of errors (Gaussian, exponential in time and distance). A forecast here

- is smooth: a report is the middle of its hour, and straight lines lie between reports;
- comes too early or too late, more so for longer leads;
- is a part too strong or too weak, and turned, for all of its hours;
- adds a field of waves of all lengths and periods, whose size changes from one issue to the next.

The waves are as large as the rest leaves open to `COMPONENT_RMSE_MPS`. That rest is measured on other days (`rest_by_lead`).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from benchmarks.independent.weather.reports import Site

HOUR_S = 3600.0
HOURS = 48
LEAD_H = (0.0, 6.0, 24.0, 48.0)
COMPONENT_RMSE_MPS = (1.5, 1.7, 2.0, 2.5)
"""Of a component at 10 m against reports, at `LEAD_H`. Speeds of twelve models at 10 m are 1.5 to 2.6 m/s off (meteo.matrunich.com/benchmark), ECMWF's on
land 1.7 m/s on the first day (PredictWind, "Model Validation Technical Report"); the error of a speed is that of the component along the wind."""
EARLY_H = 0.4, 0.03
"""Standard deviation of how much too early weather comes, hours: at the issue, and more for each hour of lead."""
STRENGTH, TURN_DEG = 0.10, 8.0
SHEAR, SHEAR_SD = 0.2, 0.03
"""Exponent of the profile between 10 and 80 m, and how far an issue is off it."""
SEVERITY = 0.35
"""Standard deviation of the logarithm of the size of the waves, from issue to issue."""
WAVES = 64
LENGTH_KM, PERIOD_H = (15.0, 500.0), (2.0, 72.0)
KM_PER_DEG = 111.2
GRID = (40.55, 40.85, 41.15), (-74.25, -73.9, -73.55)
"""Latitudes and longitudes that are asked for."""
NEAR_KM = 5.0
AGE_H = 2
"""Forecasts are issued each hour, are out an hour later, and orders leave within the next."""


@dataclass(frozen=True, eq=False)
class DayForecasts:
    """Forecasts made of the reports of sites.

    Attributes
    ----------
    rest_mps : ndarray, shape (HOURS + 1,)
        Error of a component without the waves, by the hour of lead.
    """

    sites: tuple[Site, ...]
    rest_mps: NDArray[np.float64]
    scale: float = 1.0

    def wind(self, issue_s: float, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Wind (north, east) at 10 m that is forecast at places, shape (HOURS + 1, places, 2)."""
        lead = np.arange(HOURS + 1.0)
        found = _distorted(self.sites, issue_s, lat, lon, self.scale)
        wanted = self.scale * np.interp(lead, LEAD_H, COMPONENT_RMSE_MPS)
        size = np.sqrt(np.maximum(wanted**2 - (self.scale * self.rest_mps) ** 2, 0.0))
        return np.asarray(found + size[:, None, None] * _waves(_rng(issue_s, 1), lead, lat, lon))

    def answer(self, issue_s: float) -> str:
        """Return what the service answers: a list of places."""
        lat, lon = (part.ravel() for part in np.meshgrid(*GRID, indexing="ij"))
        low = self.wind(issue_s, lat, lon)
        exponent = SHEAR + SHEAR_SD * float(_rng(issue_s, 2).standard_normal())
        times = [datetime.fromtimestamp(issue_s + HOUR_S * hour, UTC) for hour in range(HOURS + 1)]
        places: list[dict[str, Any]] = []
        for place in range(len(lat)):
            hourly: dict[str, list[Any]] = {"time": [f"{one:%Y-%m-%dT%H:%M}" for one in times]}
            units = {"time": "iso8601"}
            for height in (10, 80):
                north, east = low[:, place].T * (height / 10.0) ** exponent
                hourly[f"wind_speed_{height}m"] = np.round(3.6 * np.hypot(north, east), 1).tolist()
                hourly[f"wind_direction_{height}m"] = [
                    round(math.degrees(math.atan2(-e, -n))) % 360 for n, e in zip(north, east, strict=True)
                ]
                units |= {f"wind_speed_{height}m": "km/h", f"wind_direction_{height}m": "°"}
            places.append(
                {
                    "latitude": float(lat[place]), "longitude": float(lon[place]), "utc_offset_seconds": 0, "elevation": 10.0,
                    "hourly_units": units, "hourly": hourly,
                }
            )  # fmt: skip
        return json.dumps(places)

    def file(self, folder: Path, issue_s: float) -> Path:
        """What the service answers of an issue, as a file of a folder."""
        path = folder / f"{int(issue_s)}.json"
        if not path.exists():
            path.write_text(self.answer(issue_s), encoding="utf-8")
        return path

    def newest(self, folder: Path, time_s: float) -> Path:
        """The newest answer that is out at a time, as a file of a folder."""
        return self.file(folder, HOUR_S * (time_s // HOUR_S - (AGE_H - 1)))


def rest_by_lead(sites: Sequence[Site], issues_s: Sequence[float]) -> NDArray[np.float64]:
    """Error of a component, by the hour of lead, that forecasts have without the waves, at the sites of some issues."""
    lat, lon = (np.array([getattr(site, name) for site in sites]) for name in ("lat", "lon"))
    square = np.zeros(HOURS + 1)
    for issue_s in issues_s:
        found = _distorted(sites, issue_s, lat, lon, 1.0, own=True)
        middle = 0.5 * (found[:-1] + found[1:])  # of each hour, as its report
        truth = np.stack([_reports(site, issue_s + HOUR_S * np.arange(0.5, HOURS)) for site in sites], axis=1)
        error = ((middle - truth) ** 2).mean(axis=(1, 2))
        square += np.append(error, error[-1])
    # errors of a lead are those of many leads about it: only the trend is wanted
    fit = np.polynomial.polynomial.polyfit(np.arange(HOURS + 1), square / len(issues_s), 1)
    return np.asarray(np.sqrt(np.maximum(np.polynomial.polynomial.polyval(np.arange(HOURS + 1), fit), 0.0)))


def _rng(issue_s: float, purpose: int) -> np.random.Generator:
    return np.random.default_rng((int(issue_s // 60), purpose, 1913))


def _reports(site: Site, at_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reports as a smooth course: each is the wind in the middle of its hour; shape (times, 2)."""
    return np.stack([np.interp(at_s, site.time_s + 0.5 * HOUR_S, site.wind[:, axis]) for axis in (0, 1)], axis=1)


def _distorted(
    sites: Sequence[Site],
    issue_s: float,
    lat: NDArray[np.float64],
    lon: NDArray[np.float64],
    scale: float,
    *,
    own: bool = False,
) -> NDArray[np.float64]:
    """What happens, too early or late, too strong or weak, and turned, shape (HOURS + 1, places, 2); `own`: the places are the sites."""
    rng = _rng(issue_s, 0)
    lead = np.arange(HOURS + 1.0)
    early_h = scale * (EARLY_H[0] + EARLY_H[1] * lead) * rng.standard_normal()
    at_s: NDArray[np.float64] = np.asarray(issue_s + HOUR_S * (lead + early_h), dtype=np.float64)
    course = np.stack([_reports(site, at_s) for site in sites], axis=1)
    if not own:
        square = np.stack(
            [
                ((lat - site.lat) * KM_PER_DEG) ** 2
                + ((lon - site.lon) * KM_PER_DEG * math.cos(math.radians(site.lat))) ** 2
                for site in sites
            ],
            axis=1,
        )
        weight = 1.0 / np.maximum(np.sqrt(square), NEAR_KM)
        course = np.einsum("ps,tsc->tpc", weight / weight.sum(axis=1, keepdims=True), course)
    strong = 1.0 + scale * STRENGTH * rng.standard_normal()
    turn = scale * math.radians(TURN_DEG) * rng.standard_normal()
    north, east = course[..., 0], course[..., 1]
    cos, sin = strong * math.cos(turn), strong * math.sin(turn)
    return np.stack((cos * north - sin * east, sin * north + cos * east), axis=-1)


def _waves(
    rng: np.random.Generator, lead_h: NDArray[np.float64], lat: NDArray[np.float64], lon: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A field of mean square 1 over issues, shape (times, places, 2)."""
    length, period = (np.exp(rng.uniform(math.log(low), math.log(high), WAVES)) for low, high in (LENGTH_KM, PERIOD_H))
    course = rng.uniform(0.0, 2.0 * math.pi, WAVES)
    x_km, y_km = lon * KM_PER_DEG * math.cos(math.radians(float(lat.mean()))), lat * KM_PER_DEG
    along = np.outer(x_km, np.sin(course)) + np.outer(y_km, np.cos(course))
    angle = 2.0 * math.pi * (along / length)[None] + 2.0 * math.pi * (lead_h[:, None] / period)[:, None]
    severity = math.exp(SEVERITY * float(rng.standard_normal()) - SEVERITY**2)
    phase = rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))
    found = [np.cos(angle + one).sum(axis=2) * math.sqrt(2.0 / WAVES) for one in phase]
    return severity * np.stack(found, axis=-1)
