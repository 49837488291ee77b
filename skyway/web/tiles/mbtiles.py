"""Tiles of MBTiles, an SQLite file."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.web.tiles.content import MAX_ZOOM, Tile, recognized

if TYPE_CHECKING:
    from pathlib import Path


class MBTiles:
    """An open file.

    Attributes
    ----------
    low, high : int
        Least and greatest zoom.
    attribution : str
        Attribution.
    first : Tile or None
        Any of its tiles.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._base = sqlite3.connect(
                f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True, check_same_thread=False
            )
            told = {
                str(name): str(value)[:300]
                for name, value in self._base.execute("SELECT name, value FROM metadata LIMIT 100")
            }
            low, high = self._base.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
            some = self._base.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()
        except (sqlite3.Error, ValueError) as error:
            raise InputError(f"is not an MBTiles file: {error}", str(path), field="--map") from error
        if not isinstance(low, int) or not isinstance(high, int):
            raise InputError("has no tiles", str(path), field="--map")
        self.low, self.high = max(low, 0), min(high, MAX_ZOOM)
        self.attribution = told.get("attribution", "")
        self.first = recognized(some[0])

    def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """Return a tile, rows counted from the north; None if there is none."""
        wanted = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        try:  # rows count from the south there
            found = self._base.execute(wanted, (zoom, column, (1 << zoom) - 1 - row)).fetchone()
        except sqlite3.Error:
            return None
        return recognized(found[0]) if found else None
