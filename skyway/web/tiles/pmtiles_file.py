"""Tiles of PMTiles (version 3), a single file with directories; its format is read by the package pmtiles."""

from __future__ import annotations

import json
import mmap
import zlib
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError
from skyway.web.tiles.content import MAX_BYTES, MAX_ZOOM, Tile, recognized

if TYPE_CHECKING:
    from pathlib import Path

HEADER_BYTES = 127
MAX_DIRECTORY = 4 * 2**20
"""Bytes of an unpacked directory; the format requires about 16 KiB packed."""
DEEPEST = 4
"""Directories within directories."""


class PMTiles:
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
            from pmtiles.tile import Compression, deserialize_header
        except ImportError as error:
            remedy = "pip install 'skyway-planner[web]'"
            raise InputError("the package pmtiles is not installed", str(path), field="--map", remedy=remedy) from error
        try:
            with path.open("rb") as file:
                self._content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            self._header: dict[str, Any] = dict(deserialize_header(self._content[:HEADER_BYTES]))
            self.low, self.high = max(self._header["min_zoom"], 0), min(self._header["max_zoom"], MAX_ZOOM)
            told = json.loads(self._unpacked(self._header["metadata_offset"], self._header["metadata_length"]) or "{}")
            self.attribution = str(told.get("attribution", ""))[:300] if isinstance(told, dict) else ""
            self.first = self._any()
        except Exception as error:  # the package raises various errors for a damaged file
            remedy = "a file of PMTiles version 3, compressed with gzip"
            raise InputError(f"is not a PMTiles file: {error}", str(path), field="--map", remedy=remedy) from error
        if self._header["tile_compression"] not in {Compression.NONE, Compression.GZIP}:
            remedy = "write it with gzip, the usual compression"
            raise InputError(
                "has tiles that are compressed in a way that is not read", str(path), field="--map", remedy=remedy
            )

    def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """Return a tile, rows counted from the north; None if there is none."""
        from pmtiles.tile import find_tile, zxy_to_tileid

        wanted = zxy_to_tileid(zoom, column, row)
        at = self._header["root_offset"], self._header["root_length"]
        try:
            for _ in range(DEEPEST):
                found = find_tile(self._directory(*at), wanted)
                if found is None:
                    return None
                if found.run_length > 0:
                    return self._tile(found.offset, found.length)
                at = self._header["leaf_directory_offset"] + found.offset, found.length
        except (ValueError, EOFError, zlib.error):
            return None  # a damaged directory
        return None

    def _any(self) -> Tile | None:
        at = self._header["root_offset"], self._header["root_length"]
        for _ in range(DEEPEST):
            first = self._directory(*at)[0]
            if first.run_length > 0:
                return self._tile(first.offset, first.length)
            at = self._header["leaf_directory_offset"] + first.offset, first.length
        return None

    def _tile(self, offset: int, length: int) -> Tile | None:
        begin = self._header["tile_data_offset"] + offset
        return recognized(self._content[begin : begin + length]) if length <= MAX_BYTES else None

    @lru_cache(maxsize=64)  # noqa: B019  a file is open for as long as the page runs
    def _directory(self, offset: int, length: int) -> Any:
        from pmtiles.tile import deserialize_directory

        self._unpacked(offset, length)
        return deserialize_directory(self._content[offset : offset + length])

    def _unpacked(self, offset: int, length: int) -> bytes:
        """Return unpacked data; refused if they exceed the limit of a directory."""
        unpacking = zlib.decompressobj(wbits=31)
        found = unpacking.decompress(self._content[offset : offset + min(length, MAX_DIRECTORY)], MAX_DIRECTORY)
        if not unpacking.eof:
            raise ValueError("a directory is larger than it may be, or cut off")
        return found
