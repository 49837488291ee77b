"""The outline under the network: coast, water and streets, from a GeoJSON that the operator gives."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import InputError
from skyway.models.network.geojson import features, read_geojson

MAX_POINTS = 400_000
WATER = ("water", "sea", "ocean", "lake", "river", "bay", "coastline")
"""Words that make a shape water, in any of its properties ``kind``, ``natural``, ``class``, ``type``, ``water``."""


def shapes(path: str) -> dict[str, Any]:
    """Return the shapes of a file: ``kind`` (water or land), ``closed``, and ``rings`` of longitude and latitude; read again where it has changed."""
    return _shapes(path, Path(path).stat().st_mtime_ns if Path(path).is_file() else 0)


@lru_cache(maxsize=2)
def _shapes(path: str, changed_ns: int) -> dict[str, Any]:  # noqa: ARG001  part of the key
    found: list[dict[str, Any]] = []
    points = 0
    for one in features(read_geojson(Path(path)), path):
        properties = one.get("properties")
        properties = properties if isinstance(properties, dict) else {}
        words = {str(properties.get(key, "")).lower() for key in ("kind", "natural", "class", "type", "water")}
        kind = "water" if words & set(WATER) else "land"
        for rings, closed in _rings(one.get("geometry") or {}):
            points += sum(len(ring) for ring in rings)
            if points > MAX_POINTS:
                remedy = f"simplify it to {MAX_POINTS:,} points"
                raise InputError("has too many points to be drawn", path, value=points, remedy=remedy)
            found.append({"kind": kind, "closed": closed, "rings": rings})
    return {"shapes": found}


def _rings(geometry: dict[str, Any]) -> list[tuple[list[list[list[float]]], bool]]:
    """Rings of a geometry, and whether they are closed."""
    kind, places = geometry.get("type"), geometry.get("coordinates")
    if kind == "GeometryCollection":
        return [pair for one in geometry.get("geometries") or () for pair in _rings(one)]
    if kind == "Polygon":
        return [(_places(places), True)]
    if kind == "MultiPolygon" and isinstance(places, list):
        return [(_places(part), True) for part in places]
    if kind == "LineString":
        return [(_places([places]), False)]
    if kind == "MultiLineString":
        return [(_places(places), False)]
    return []


def _places(rings: Any) -> list[list[list[float]]]:
    try:
        return [[[round(float(x), 6), round(float(y), 6)] for x, y, *_ in ring] for ring in rings]
    except (TypeError, ValueError) as error:
        raise InputError("has coordinates that are no numbers", field="coordinates") from error
