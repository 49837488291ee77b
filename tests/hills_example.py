"""Airspace and forecast of the example "hills": ``python -m tests.hills_example`` writes both again.

Nothing in them is real. The forecast is an ensemble in the form of Open-Meteo: a south-westerly that freshens and veers over the day, stronger and gustier over
the ridges of the example's terrain model, with six members that keep their courses.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from skyway.models.terrain.files import read_terrain

FOLDER = Path(__file__).resolve().parents[1] / "missions" / "examples" / "hills"
DAY = "2026-06-01"
HOURS = range(6, 19)
MEMBERS = 6
LATS, LONS = (44.94, 45.02, 45.10), (-30.19, -30.04, -29.89)
SEED = 20260601
Shape = dict[str, Any]


def airspace() -> str:
    """Zones as ED-269: a reserve to fly over, blasting to wait for or to fly around, an airfield that asks for an authorization, a control area above all."""
    always = [{"permanent": "YES"}]
    blasting = [{"permanent": "NO", "startDateTime": f"{DAY}T10:00:00Z", "endDateTime": f"{DAY}T11:00:00Z"}]
    weekdays = [
        {"permanent": "YES", "schedule": [{"day": ["MON", "TUE", "WED", "THU", "FRI"], "startTime": "08:00:00Z", "endTime": "17:00:00Z"}]}
    ]  # fmt: skip
    features = [
        _zone("HERON", "Heron reserve", "PROHIBITED", always, _box(44.93, -30.158, 45.085, -30.146), upper=(75, "AGL"), message="No flight below 75 m."),
        _zone("QUARRY", "Quarry, blasting", "PROHIBITED", blasting, _circle(45.0255, -30.03, 700), upper=(99999, "AMSL")),
        _zone("FIELD", "Airfield", "REQ_AUTHORISATION", weekdays, _circle(45.0, -29.99, 1500), upper=(120, "AGL"), message="Call the tower."),
        _zone("AREA", "Control area", "PROHIBITED", always, _circle(45.02, -30.05, 25_000), lower=(900, "AMSL"), upper=(99999, "AMSL")),
    ]  # fmt: skip
    return json.dumps({"title": "Zones of the hills (invented)", "features": features}, indent=1) + "\n"


def _circle(lat: float, lon: float, radius_m: float) -> Shape:
    return {"type": "Circle", "center": [lon, lat], "radius": radius_m}


def _box(south: float, west: float, north: float, east: float) -> Shape:
    corners = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    return {"type": "Polygon", "coordinates": [corners]}


def _zone(
    identifier: str,
    name: str,
    restriction: str,
    applicability: list[Shape],
    shape: Shape,
    *,
    lower: tuple[float, str] = (0, "AGL"),
    upper: tuple[float, str],
    message: str = "",
) -> Shape:
    return {
        "identifier": identifier, "country": "XXX", "name": name, "restriction": restriction, "message": message, "applicability": applicability,
        "geometry": [{
            "uomDimensions": "M", "lowerLimit": lower[0], "lowerVerticalReference": lower[1], "upperLimit": upper[0], "upperVerticalReference": upper[1],
            "horizontalProjection": shape,
        }],
    }  # fmt: skip


def forecast() -> str:
    """An ensemble at nine points, 10 and 100 m, with gusts and the temperature."""
    terrain = read_terrain([str(FOLDER / "terrain.tif")], [])
    rng = np.random.default_rng(SEED)
    hour = np.array(HOURS)
    offset = rng.normal(
        0.0, [[0.5], [9.0]], (MEMBERS, 2, 1)
    )  # of speed (m/s) and direction (degrees), kept through the day
    drift = np.cumsum(rng.normal(0.0, [[0.15], [2.0]], (MEMBERS, 2, len(hour))), axis=-1)
    own = offset + drift
    own[0] = 0.0  # the control
    blocks = []
    for lat in LATS:
        for lon in LONS:
            ground_m = float(terrain.ground_m(np.array([lat]), np.array([lon]))[0])
            exposed = 1.0 + 0.15 * np.clip((ground_m - 200.0) / 150.0, -1.0, 1.0)
            columns: dict[str, list[float]] = {}
            for number in range(MEMBERS):
                name = f"_member{number:02d}" if number else ""
                speed = np.maximum(exposed * (2.6 + 1.2 * np.sin(np.pi * (hour - 6) / 14.0) + own[number, 0]), 0.5)
                source = np.mod(235.0 + 2.5 * (hour - 6) + 20.0 * (lon + 30.05) + own[number, 1], 360.0)
                columns[f"wind_speed_10m{name}"] = speed.round(1).tolist()
                columns[f"wind_direction_10m{name}"] = source.round().tolist()
                columns[f"wind_speed_100m{name}"] = (1.42 * speed).round(1).tolist()
                columns[f"wind_direction_100m{name}"] = np.mod(source + 6.0, 360.0).round().tolist()
                columns[f"wind_gusts_10m{name}"] = (speed * (1.5 + 0.2 * exposed)).round(1).tolist()
                columns[f"temperature_2m{name}"] = (17.0 + 5.0 * np.sin(np.pi * (hour - 7) / 15.0) - 0.0065 * ground_m).round(1).tolist()  # fmt: skip
            units = {name: "°" if "direction" in name else "°C" if "temperature" in name else "m/s" for name in columns}
            times = [f"{DAY}T{each:02d}:00" for each in HOURS]
            blocks.append(
                {"latitude": lat, "longitude": lon, "utc_offset_seconds": 0, "timezone": "GMT", "elevation": round(ground_m),
                 "hourly_units": {"time": "iso8601", **units}, "hourly": {"time": times, **columns}}
            )  # fmt: skip
    return (
        "[\n" + ",\n".join(json.dumps(block, ensure_ascii=False, separators=(",", ":")) for block in blocks) + "\n]\n"
    )


def files() -> dict[str, str]:
    """What is written, by name."""
    return {"airspace.json": airspace(), "forecast.json": forecast()}


if __name__ == "__main__":
    for file, text in files().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
