"""Base maps from the operator's own file: tiles of MBTiles (an SQLite file of pictures); nothing is fetched from anywhere."""

from __future__ import annotations

import sqlite3
from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import InputError

ENDING = ".mbtiles"
MOST_ZOOM = 24
MAX_BYTES = 2 * 2**20
"""Of one tile."""
_KINDS = ((b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp"))
"""How a picture begins. Tiles of vectors (MVT) are none of these: they would need a style."""


def about(path: str | None) -> dict[str, Any]:
    """Return what a base map covers: `low` and `high` zoom, and who made it; an `InputError` says what is wrong with the file."""
    return {} if path is None else _opened(path)[0]


def tile(path: str, zoom: int, column: int, row: int) -> tuple[str, bytes] | None:
    """Return type and content of a tile, rows counted from the north; None where there is none."""
    if not (0 <= zoom <= MOST_ZOOM and 0 <= column < 1 << zoom and 0 <= row < 1 << zoom):
        return None
    wanted = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
    try:
        found = (
            _opened(path)[1].execute(wanted, (zoom, column, (1 << zoom) - 1 - row)).fetchone()
        )  # rows count from the south there
    except sqlite3.Error:
        return None
    data = found[0] if found else None
    if not isinstance(data, bytes) or len(data) > MAX_BYTES:
        return None
    kind = _kind(data)
    return None if kind is None else (kind, data)


def _kind(data: bytes) -> str | None:
    return next((kind for begin, kind in _KINDS if data.startswith(begin)), None)


@lru_cache(maxsize=4)
def _opened(path: str) -> tuple[dict[str, Any], sqlite3.Connection]:
    file = Path(path)
    if not file.is_file():
        raise InputError("no such file", path, field="--map")
    if file.suffix != ENDING:
        raise InputError("is no base map", path, field="--map", remedy=f"a file {ENDING} with pictures")
    try:
        base = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro&immutable=1", uri=True, check_same_thread=False)
        told = {
            str(name): str(value)[:300] for name, value in base.execute("SELECT name, value FROM metadata LIMIT 100")
        }
        low, high = base.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        first = base.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()
    except (sqlite3.Error, ValueError) as error:
        raise InputError(f"is no MBTiles file: {error}", path, field="--map") from error
    if not isinstance(low, int) or not isinstance(high, int) or not first or not isinstance(first[0], bytes):
        raise InputError("has no tiles", path, field="--map")
    if _kind(first[0]) is None:
        remedy = "a base map of pictures (PNG, JPEG or WebP); tiles of vectors are not drawn"
        raise InputError("has tiles that are no pictures", path, field="--map", remedy=remedy)
    return {"low": max(low, 0), "high": min(high, MOST_ZOOM), "attribution": told.get("attribution", "")}, base
