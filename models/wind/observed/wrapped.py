"""Bulletins of stations wrapped in JSON.

The JSON of avwx (``data.raw``) and of aviationweather.gov (``rawOb``, ``rawTAF``) contains the bulletin as published; this text is
read by the same readers as plain text.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any


def unwrapped(value: Any, near_s: float) -> tuple[str, float, dict[str, tuple[float, float]]] | None:
    """Return the bulletin in decoded JSON, a time near its own, and its places; None if there is none."""
    entries = value if isinstance(value, list) else [value]
    texts, places = [], {}
    for one in entries:
        if not isinstance(one, dict):
            return None
        data: dict[str, Any] = one["data"] if isinstance(one.get("data"), dict) else one
        text = next(
            (data[key] for key in ("raw", "rawOb", "rawTAF", "raw_text") if isinstance(data.get(key), str)), None
        )
        if text is None:
            return None
        texts.append(text)
        for stamp in (data.get("obsTime"), data.get("issueTime"), data.get("reportTime"), one.get("created")):
            near_s = _stamp(stamp, near_s)
        station: dict[str, Any] = one["station"] if isinstance(one.get("station"), dict) else data
        name = next(
            (
                part[key]
                for part in (station, one)
                for key in ("icaoId", "icao", "station")
                if isinstance(part.get(key), str)
            ),
            None,
        )
        lat, lon = (
            next((station[key] for key in keys if isinstance(station.get(key), int | float)), None)
            for keys in (("lat", "latitude"), ("lon", "longitude"))
        )
        if name is not None and lat is not None and lon is not None:
            places[name] = float(lat), float(lon)
    return "\n".join(texts), near_s, places


def _stamp(value: Any, otherwise: float) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    try:
        instant = datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return otherwise
    return instant.replace(tzinfo=instant.tzinfo or UTC).timestamp()
