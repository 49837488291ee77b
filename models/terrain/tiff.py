"""TIFF and BigTIFF files of one band, of which a window is read: stripped or tiled, uncompressed, deflate, LZW or PackBits.

Source: TIFF 6.0 (Adobe, 1992); Adobe Photoshop TIFF Technical Note 3 (2005) for predictor 3; the BigTIFF design of
the libtiff project. Only the image itself is read, never an overview: a mean of heights is lower than the peaks.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_SEGMENTS = 4_000_000
MAX_PIXELS = 2_000_000_000
MAX_WINDOW = 150_000_000
"""Pixels of the largest window that is read: 0.6 GB."""
MAX_TILE = 1 << 28
"""Pixels of a tile or strip."""
MAX_TAG_BYTES = 64 * 1024 * 1024
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_CODES = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d", 13: "I", 16: "Q", 17: "q", 18: "Q"}
_COMPRESSIONS = {1: "none", 5: "LZW", 8: "deflate", 32946: "deflate", 32773: "PackBits"}
_UNREAD = {2: "CCITT", 3: "CCITT", 4: "CCITT", 6: "JPEG", 7: "JPEG", 34712: "JPEG 2000", 34887: "LERC", 34925: "LZMA", 50000: "ZSTD", 50001: "WebP"}  # fmt: skip
_SAMPLES = {(1, 8): "u1", (1, 16): "u2", (1, 32): "u4", (2, 8): "i1", (2, 16): "i2", (2, 32): "i4", (3, 32): "f4", (3, 64): "f8"}  # fmt: skip
"""Sample format and bits, and the type of numpy."""
_AGAIN = "gdal_translate -co COMPRESS=DEFLATE writes it as it can be read"

EXPECTED = "terrain is read from GeoTIFF (.tif) and SRTM (.hgt); obstacles in CSV or GeoJSON go with --obstacles"


@dataclass(frozen=True, slots=True, eq=False)
class TiffImage:
    """The image of a TIFF file: where its parts are, and how they are stored.

    Attributes
    ----------
    file : str
        Name, for errors.
    rows, columns : int
        Pixels.
    compression : str
        ``none``, ``LZW``, ``deflate`` or ``PackBits``.
    predictor : int
        1: none, 2: differences along rows, 3: differences of the bytes of floating-point numbers.
    tile : tuple of int
        Rows and columns of a tile; a strip is a tile as wide as the image.
    tiled, big : bool
        Whether it is in tiles, and a BigTIFF.
    dtype : numpy.dtype
        Of a pixel, in the byte order of the file.
    offsets, lengths : ndarray of int, shape (tiles,)
        Where each tile is; a length of 0 is a tile that was omitted.
    tags : dict
        All other tags: tuples of numbers, or text.
    """

    file: str
    rows: int
    columns: int
    compression: str
    predictor: int
    tile: tuple[int, int]
    tiled: bool
    big: bool
    dtype: np.dtype[np.generic]
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    tags: dict[int, tuple[float, ...] | str]

    def window(self, stream: BinaryIO, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.generic]:
        """Read the pixels of rows and columns [from, to), shape (rows, columns): only tiles that the window touches."""
        (r0, r1), (c0, c1) = rows, columns
        if (r1 - r0) * (c1 - c0) > MAX_WINDOW:
            raise InputError(f"needs more than {MAX_WINDOW:,} heights", self.file, remedy="cut it to the region wanted")
        out = np.zeros((r1 - r0, c1 - c0), dtype=self.dtype.newbyteorder("="))
        height, width = self.tile
        across = -(-self.columns // width)
        for i in range(r0 // height, -(-r1 // height)):
            for j in range(c0 // width, -(-c1 // width)):
                part = self._tile(stream, i * across + j, min(height, self.rows - i * height))
                top, left = i * height, j * width
                a, b = max(r0, top), min(r1, top + height, self.rows)
                c, d = max(c0, left), min(c1, left + width, self.columns)
                out[a - r0 : b - r0, c - c0 : d - c0] = part[a - top : b - top, c - left : d - left]
        return out

    def left_out(self) -> bool:
        """Whether tiles were omitted: their pixels stand for no value."""
        return bool((self.lengths == 0).any())

    def _tile(self, stream: BinaryIO, number: int, rows_left: int) -> NDArray[np.generic]:
        """Pixels of a tile, shape (rows, columns of a tile); a strip at the end may be short."""
        height, width = self.tile
        rows = height if self.tiled else rows_left
        if self.lengths[number] == 0:
            return np.full((rows, width), self.empty_value(), dtype=self.dtype)
        stream.seek(int(self.offsets[number]))
        data = stream.read(int(self.lengths[number]))
        if len(data) < self.lengths[number]:
            raise InputError(f"ends within tile {number + 1} of {len(self.offsets)}: it is truncated", self.file, remedy="fetch it again")  # fmt: skip
        size = rows * width * self.dtype.itemsize
        data = self._unpacked(data, size, number)
        if len(data) < size:
            problem = (
                f"tile {number + 1} of {len(self.offsets)} holds {len(data)} bytes instead of {size}: it is damaged"
            )
            raise InputError(problem, self.file, remedy="fetch it again")
        return self._predicted(np.frombuffer(data, np.uint8, size).reshape(rows, -1))

    def empty_value(self) -> float:
        """Content of omitted tiles: the no-data value, otherwise NaN; for integers without one their minimum."""
        nodata = nodata_of(self.tags)
        if nodata is not None:
            return nodata
        return float("nan") if self.dtype.kind == "f" else float(np.iinfo(self.dtype).min)  # type: ignore[type-var]

    def _unpacked(self, data: bytes, size: int, number: int) -> bytes:
        try:
            if self.compression == "deflate":
                return zlib.decompressobj().decompress(data, size)
            if self.compression == "LZW":
                from skyway.models.terrain.lzw_kernels import lzw_decoded

                out = np.empty(size, dtype=np.uint8)
                return out[: max(lzw_decoded(np.frombuffer(data, np.uint8), out), 0)].tobytes()
            if self.compression == "PackBits":
                return _unpacked_bits(data, size)
        except zlib.error as error:
            problem = f"tile {number + 1} of {len(self.offsets)} is damaged: {error}"
            raise InputError(problem, self.file, remedy="fetch it again") from error
        return data

    def _predicted(self, raw: NDArray[np.uint8]) -> NDArray[np.generic]:
        """Undo the predictor: bytes of rows, shape (rows, bytes), as pixels."""
        itemsize = self.dtype.itemsize
        if self.predictor == 3:  # each row: differences of bytes, and the highest bytes of all pixels first
            planes = np.add.accumulate(raw, axis=1, dtype=np.uint8).reshape(len(raw), itemsize, -1)
            return (
                np.ascontiguousarray(planes.transpose(0, 2, 1)).view(self.dtype.newbyteorder(">")).reshape(len(raw), -1)
            )
        pixels = raw.view(self.dtype)
        if self.predictor == 2:
            whole = np.dtype(f"u{itemsize}")
            same = raw.view(whole.newbyteorder(self.dtype.byteorder)).astype(whole)
            return np.add.accumulate(same, axis=1, dtype=whole).view(self.dtype.newbyteorder("="))
        return pixels


def _unpacked_bits(data: bytes, size: int) -> bytes:
    """PackBits: a count and a run of bytes, or one byte to be repeated."""
    out = bytearray()
    at = 0
    while at < len(data) and len(out) < size:
        count = data[at]
        if count < 128:
            out += data[at + 1 : at + 2 + count]
            at += 2 + count
        else:
            if count > 128:
                out += data[at + 1 : at + 2] * (257 - count)
            at += 2 if count > 128 else 1
    return bytes(out)


def nodata_of(tags: dict[int, tuple[float, ...] | str]) -> float | None:
    """Value that marks missing heights, from GDAL's tag; None without the tag."""
    text = tags.get(42113)
    try:
        return float(text.strip()) if isinstance(text, str) else None
    except ValueError:
        return None


def read_tiff(stream: BinaryIO, file: str) -> TiffImage:
    """Read how the first image of a TIFF file is stored. Raises an `InputError` with the unsupported feature, and the remedy."""
    reader = _Reader(stream, file)
    tags, following = reader.directory(reader.begin())
    for _ in range(64):  # overviews are not wanted, and masks must not be ignored
        if not following:
            break
        other, following = reader.directory(following)
        kind = other.get(254)
        if isinstance(kind, tuple) and kind and int(kind[0]) & 4:
            remedy = "gdal_translate -a_nodata -32768 writes voids as values"
            raise InputError("marks its voids by a mask, which is not supported", file, remedy=remedy)
    return _image(tags, file, big=reader.big, order=reader.order)


class _Reader:
    """Reads the directory of tags."""

    def __init__(self, stream: BinaryIO, file: str) -> None:
        self.stream, self.file = stream, file
        self.order, self.big = "<", False

    def _take(self, at: int, length: int) -> bytes:
        if at >= 1 << 62:
            raise InputError(
                "has a directory that contradicts itself: it is damaged", self.file, remedy="fetch it again"
            )
        self.stream.seek(at)
        data = self.stream.read(length)
        if len(data) < length:
            raise InputError("ends within its directory: it is truncated", self.file, remedy="fetch it again")
        return data

    def _unpack(self, layout: str, at: int) -> tuple[int, ...]:
        return struct.unpack(self.order + layout, self._take(at, struct.calcsize(self.order + layout)))

    def begin(self) -> int:
        """Offset of the first directory."""
        mark = self._take(0, 2)
        if mark not in (b"II", b"MM"):
            raise InputError("is not a TIFF file", self.file, remedy=EXPECTED)
        self.order = "<" if mark == b"II" else ">"
        (version,) = self._unpack("H", 2)
        if version == 43:
            self.big = True
            return self._unpack("HHQ", 4)[2]
        if version != 42:
            raise InputError("is not a TIFF file", self.file, value=f"version {version}", remedy=EXPECTED)
        return self._unpack("I", 4)[0]

    def directory(self, at: int) -> tuple[dict[int, tuple[float, ...] | str], int]:
        """All tags of a directory, and where the next one is; 0 if there is none."""
        if not at:
            raise InputError("has no image", self.file)
        (count,) = self._unpack("Q" if self.big else "H", at)
        if count > 4096:
            raise InputError(f"has {count} tags in its directory: it is damaged", self.file)
        at += 8 if self.big else 2
        step, layout = (20, "HHQ") if self.big else (12, "HHI")
        tags: dict[int, tuple[float, ...] | str] = {}
        for number in range(count):
            here = at + number * step
            tag, kind, length = self._unpack(layout, here)
            if kind in _SIZES:
                tags[tag] = self._values(kind, length, here + (12 if self.big else 8))
        (following,) = self._unpack("Q" if self.big else "I", at + count * step)
        return tags, following

    def _values(self, kind: int, count: int, at: int) -> tuple[float, ...] | str:
        size = _SIZES[kind] * count
        if size > MAX_TAG_BYTES:
            raise InputError("has a tag of more than 64 MB: it is damaged", self.file)
        if size > (8 if self.big else 4):
            (at,) = self._unpack("Q" if self.big else "I", at)
        data = self._take(at, size)
        if kind == 2:
            return data.split(b"\0")[0].decode("latin-1")
        if kind in _CODES:
            return struct.unpack(f"{self.order}{count}{_CODES[kind]}", data)
        return tuple(data) if kind == 7 else ()


def _image(tags: dict[int, tuple[float, ...] | str], file: str, *, big: bool, order: str) -> TiffImage:
    def number(tag: int, default: int) -> int:
        value = tags.get(tag)
        return int(value[0]) if isinstance(value, tuple) and value else default

    rows, columns = number(257, 0), number(256, 0)
    if rows < 1 or columns < 1 or rows * columns > MAX_PIXELS:
        raise InputError("has an impossible size", file, value=f"{columns} x {rows}")
    bands = number(277, 1)
    if bands != 1:
        raise InputError(f"has {bands} bands; a terrain model has one", file, remedy="gdal_translate -b 1 takes the first")  # fmt: skip
    compression = number(259, 1)
    if compression not in _COMPRESSIONS:
        name = _UNREAD.get(compression, f"number {compression}")
        raise InputError(f"is compressed with {name}, which is not supported", file, remedy=_AGAIN)
    sample = number(339, 1), number(258, 1)
    if sample not in _SAMPLES:
        raise InputError("has pixels of an unsupported type", file, value=f"{sample[1]} bits, format {sample[0]}", remedy="gdal_translate -ot Float32")  # fmt: skip
    predictor = number(317, 1)
    if predictor not in (1, 2, 3) or (predictor == 3 and sample[0] != 3) or (predictor == 2 and sample[1] == 64):
        raise InputError("has an unsupported predictor", file, value=predictor, remedy=_AGAIN)
    tiled = 322 in tags
    tile = (number(323, 0), number(322, 0)) if tiled else (min(number(278, rows), rows), columns)
    counts = -(-rows // max(tile[0], 1)) * -(-columns // max(tile[1], 1))
    damaged = "has a directory that contradicts itself: it is damaged"
    places = [tags.get(tag) for tag in ((324, 325) if tiled else (273, 279))]
    if any(not isinstance(one, tuple) or max(one, default=0) >= 1 << 62 for one in places):
        raise InputError(damaged, file, remedy="fetch it again")
    offsets, lengths = (np.array(one, dtype=np.int64) for one in places)
    if (
        min(tile) < 1
        or tile[0] * tile[1] > MAX_TILE
        or not counts == len(offsets) == len(lengths)
        or counts > MAX_SEGMENTS
    ):
        raise InputError(damaged, file, remedy="fetch it again")
    if (offsets < 0).any() or (lengths < 0).any() or int(lengths.max()) > 1 << 30:
        raise InputError(damaged, file, remedy="fetch it again")
    return TiffImage(
        file=file, rows=rows, columns=columns, compression=_COMPRESSIONS[compression],
        predictor=1 if compression == 1 else predictor, tile=tile, tiled=tiled, big=big,
        dtype=np.dtype(order + _SAMPLES[sample]), offsets=offsets, lengths=lengths, tags=tags,
    )  # fmt: skip
