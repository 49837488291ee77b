"""SRTM tiles ``.hgt``: a square degree of big-endian heights, named by its south-west corner; also in a .zip or .gz.

Source: SRTM Topography (NASA/JPL documentation, version 2.1): 1201 x 1201 nodes at 3 arc seconds, 3601 x 3601 at 1, rows from
north to south, edges shared with the neighbours, metres above the EGM96 geoid, -32768 for a void. North of 50 degrees tiles of
3601 x 1801 are in use as well.
"""

from __future__ import annotations

import gzip
import re
import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.terrain.raster import WGS84, Raster

if TYPE_CHECKING:
    from numpy.typing import NDArray

VOID = -32768
NAME = re.compile(r"([NS])(\d{2})([EW])(\d{3})(?!\d)", re.IGNORECASE)
_SHAPES = {2 * rows * columns: (rows, columns) for rows, columns in ((1201, 1201), (3601, 3601), (3601, 1801), (1201, 601))}  # fmt: skip
MAX_BYTES = max(_SHAPES)


def is_hgt(path: Path) -> bool:
    """Whether a file is a tile by its name: ``N40W074.hgt``, or that in a .zip or .gz."""
    name = path.name.lower()
    return name.endswith((".hgt", ".hgt.gz", ".hgt.zip")) or (
        name.endswith(".zip") and NAME.match(path.name) is not None
    )


def read_hgt(path: Path) -> Raster:
    """Read a tile; its name gives its position. Raises an `InputError` with its problem."""
    file = str(path)
    tile = _Tile(path)
    found = NAME.match(Path(tile.member).name) or NAME.match(path.name)
    if found is None:
        remedy = "name it by its south-west corner, as it was published: N40W074.hgt"
        raise InputError("does not have its position in its name", file, remedy=remedy)
    south = int(found[2]) * (1 if found[1].upper() == "N" else -1)
    west = int(found[4]) * (1 if found[3].upper() == "E" else -1)
    if not (-90 <= south < 90 and -180 <= west < 180):
        raise InputError("is named for a place that does not exist", file, value=found[0], remedy="as it was published: N40W074.hgt")  # fmt: skip
    rows, columns = tile.shape
    step = 1.0 / (columns - 1), -1.0 / (rows - 1)
    kind = "SRTM .hgt" + {".gz": " in .gz", ".zip": " in .zip"}.get(path.suffix.lower(), "")
    return Raster(
        file, kind, rows, columns, (float(west), south + 1.0), step, WGS84, "node", "EGM96", 1.0, tile, "int16, big-endian",
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Tile:
    """The heights of a tile; a packed one is unpacked when it is first requested."""

    path: Path

    @cached_property
    def member(self) -> str:
        """Name of the tile itself."""
        if self.path.suffix.lower() != ".zip":
            return self.path.name
        try:
            with zipfile.ZipFile(self.path) as archive:
                names = [name for name in archive.namelist() if name.lower().endswith(".hgt")]
        except (OSError, zipfile.BadZipFile, ValueError) as error:
            raise InputError(f"cannot be read: {error}", str(self.path), remedy="fetch it again") from error
        if len(names) != 1:
            problem = f"holds {len(names)} .hgt files; one is expected"
            raise InputError(problem, str(self.path), remedy="unpack it and give its tiles")
        return names[0]

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, from the size of the file."""
        size = self.path.stat().st_size if self._is_plain else len(self._unpacked)
        if size not in _SHAPES:
            sizes = " or ".join(f"{known:,}" for known in _SHAPES)
            raise InputError(f"has {size:,} bytes; a tile has {sizes}: it is truncated, or another format", str(self.path), remedy="fetch it again")  # fmt: skip
        return _SHAPES[size]

    @property
    def _is_plain(self) -> bool:
        return self.path.suffix.lower() == ".hgt"

    @cached_property
    def _unpacked(self) -> bytes:
        try:
            if self.path.suffix.lower() == ".gz":
                with gzip.open(self.path, "rb") as stream:
                    return stream.read(MAX_BYTES + 1)
            with zipfile.ZipFile(self.path) as archive, archive.open(self.member) as stream:
                return stream.read(MAX_BYTES + 1)
        except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError, NotImplementedError) as error:
            raise InputError(f"cannot be unpacked: {error}", str(self.path), remedy="fetch it again") from error

    def read(self, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
        """Heights as stored, NaN for voids."""
        try:
            whole = np.memmap(self.path, ">i2", "r", shape=self.shape) if self._is_plain else np.frombuffer(self._unpacked, ">i2").reshape(self.shape)  # fmt: skip
        except OSError as error:
            raise file_error("read", self.path, error) from error
        stored = np.asarray(whole[slice(*rows), slice(*columns)])
        out = stored.astype(np.float32)
        out[stored == VOID] = np.nan
        return out
