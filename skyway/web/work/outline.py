"""The outline under the network: coast, water and streets, from a GeoJSON file given by the operator."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import InputError
from skyway.models.network.geojson import features, read_geojson

MAX_POINTS = 400_000
WATER = ("water", "sea", "ocean", "lake", "river", "bay", "coastline")
"""Words that mark a shape as water, in any of its `PROPERTIES`."""
PROPERTIES = ("kind", "natural", "class", "type", "water", "waterway")
STREETS = ("highway", "class", "kind", "type")
"""Properties with the kind of a street: motorway, primary, path."""
DEEPEST = 20
"""Collections within collections."""


def shapes(path: str) -> dict[str, Any]:
    """Return the shapes of a file: ``kind`` (water, land or street), ``words`` with the kind of street, ``closed``, and ``rings`` of longitude and latitude.

    It is read again if it has changed.
    """
    return _shapes(path, Path(path).stat().st_mtime_ns if Path(path).is_file() else 0)


@lru_cache(maxsize=2)
def _shapes(path: str, changed_ns: int) -> dict[str, Any]:  # noqa: ARG001  part of the key
    found: list[dict[str, Any]] = []
    points = 0
    for one in features(read_geojson(Path(path)), path):
        properties = one.get("properties")
        properties = properties if isinstance(properties, dict) else {}
        water = bool({str(properties.get(key, "")).lower() for key in PROPERTIES} & set(WATER))
        street = next((str(properties[key])[:40].lower() for key in STREETS if key in properties), "")
        for rings, closed in _rings(one.get("geometry"), path):
            kind = "water" if water else "land" if closed else "street"
            points += sum(len(ring) for ring in rings)
            if points > MAX_POINTS:
                remedy = f"simplify it to {MAX_POINTS:,} points"
                raise InputError("has too many points to be drawn", path, value=points, remedy=remedy)
            found.append({"kind": kind, "words": street, "closed": closed, "rings": rings})
    return {"shapes": found}


def _rings(geometry: Any, path: str, depth: int = 0) -> list[tuple[list[list[list[float]]], bool]]:
    """Rings of a geometry, and whether they are closed."""
    if not isinstance(geometry, dict):
        return []  # a feature without a place
    kind, places = geometry.get("type"), geometry.get("coordinates")
    if kind == "GeometryCollection":
        parts = geometry.get("geometries")
        if depth >= DEEPEST or not isinstance(parts, list):
            raise InputError("has collections that are not lists, or too deep", path, field="geometries")
        return [pair for one in parts for pair in _rings(one, path, depth + 1)]
    if kind not in {"Polygon", "MultiPolygon", "LineString", "MultiLineString"}:
        return []
    if not isinstance(places, list):
        raise InputError("has coordinates that are not a list", path, field="coordinates")
    if kind == "MultiPolygon":
        return [(_places(part, path), True) for part in places]
    return [(_places([places] if kind == "LineString" else places, path), kind == "Polygon")]


def _places(rings: Any, path: str) -> list[list[list[float]]]:
    try:
        found = [[[round(float(x), 6), round(float(y), 6)] for x, y, *_ in ring] for ring in rings]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("has coordinates that are not numbers", path, field="coordinates") from error
    if not all(math.isfinite(value) for ring in found for place in ring for value in place):
        raise InputError("has coordinates that are not numbers", path, field="coordinates")
    return found
