"""GeoJSON objects and their features."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from pathlib import Path

MAX_BYTES = 64 * 1024 * 1024


def read_geojson(path: Path) -> dict[str, Any]:
    """Read a file that must hold one GeoJSON object."""
    try:
        document = json.loads(read_text(path, max_bytes=MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", str(path)) from error
    if not isinstance(document, dict) or "type" not in document:
        raise InputError("is not GeoJSON", str(path), remedy="expected a FeatureCollection")
    return document


def features(document: dict[str, Any], file: str) -> list[dict[str, Any]]:
    """Return the features of a GeoJSON object of any kind; an `InputError` for a collection without a list of them."""
    if document["type"] == "FeatureCollection":
        found = document.get("features")
        if not isinstance(found, list):
            raise InputError("must be a list", file, None, "features", found)
        return [feature if isinstance(feature, dict) else {} for feature in found]
    if document["type"] == "Feature":
        return [document]
    return [{"type": "Feature", "geometry": document, "properties": {}}]
