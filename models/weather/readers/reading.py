"""Weather files of any format, read together."""

from __future__ import annotations

import bz2
import re
import time
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.files import read_bytes
from skyway.models.weather.readers.bulletins import is_bulletin, read_bulletin
from skyway.models.weather.readers.open_meteo import is_open_meteo, read_open_meteo
from skyway.models.weather.readers.series import assembled
from skyway.models.weather.readers.triangles import TriangleGrids, UnknownPlacesError
from skyway.models.weather.weather import EAST, NORTH, FieldKey, Places, Weather, joined
from skyway.models.wind.observed.wrapped import unwrapped

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from skyway.models.weather.readers.series import Record
    from skyway.models.weather.weather import Box

MAX_BYTES = 2_000_000_000
MAX_TEXT = 64_000_000
FORMS = "GRIB, NetCDF, JSON of Open-Meteo, METAR or TAF (text, or JSON of avwx or aviationweather.gov), NBM text, or CSV with time, site, member, speed_mps, from_deg"


def read_weather(
    paths: Sequence[Path],
    box: Box | None = None,
    *,
    near_s: float | None = None,
    stations: Mapping[str, tuple[float, float]] | None = None,
    height_m: float = 10.0,
) -> list[Weather]:
    """Read weather files, cut to a region; parts of one issue of one model are combined.

    Parameters
    ----------
    paths : sequence of Path
        In any form; ``.gz`` and ``.bz2`` are unpacked.
    box : Box, optional
        The region; grids are cut to it, with a margin.
    near_s : float, optional
        POSIX seconds near the time of bulletins without a month; by default now.
    stations : mapping, optional
        Latitude and longitude of stations, by their names in bulletins and CSV.
    height_m : float
        Above ground, of the winds in CSV.

    Raises
    ------
    InputError
        A file cannot be read, or its form is unknown; names the file and the position.
    """
    near = time.time() if near_s is None else near_s
    known = dict(stations or {})
    parts: list[Weather] = []
    grib = _Grib(box)
    for path in paths:
        parts += _read(path, box, near, known, height_m, grib)
    records = grib.finished()
    return joined([*parts, *assembled(records, "GRIB")])


class _Grib:
    """GRIB files, read in any order: a file whose grid positions are in another file is read again afterwards."""

    def __init__(self, box: Box | None) -> None:
        self._box, self._grids = box, TriangleGrids()
        self._records: list[Record] = []
        self._waiting: list[tuple[bytes, str]] = []

    def read(self, data: bytes, file: str) -> None:
        """Read one."""
        from skyway.models.weather.readers.grib import read_grib

        try:
            self._records += read_grib(data, file, self._box, self._grids)
        except UnknownPlacesError:
            self._waiting.append((data, file))

    def finished(self) -> list[Record]:
        """Return the fields of all. Raises an `InputError` naming a file without places."""
        from skyway.models.weather.readers.grib import read_grib

        for data, file in self._waiting:
            self._records += read_grib(data, file, self._box, self._grids)
        return self._records


def _read(
    path: Path,
    box: Box | None,
    near_s: float,
    stations: dict[str, tuple[float, float]],
    height_m: float,
    grib: _Grib,
) -> list[Weather]:
    file = str(path)
    data = read_bytes(path, max_bytes=MAX_BYTES)
    if data[:3] == b"BZh":
        data = _unzipped(data, file)
    if not data.strip():
        raise InputError("is empty", file, remedy=f"give {FORMS}")
    if data[:3] == b"CDF" or data[:8] == b"\x89HDF\r\n\x1a\n":
        from skyway.models.weather.readers.netcdf import read_netcdf

        return read_netcdf(data, file, box)
    if re.search(rb"GRIB...[\x01\x02]", data[:4096], re.DOTALL):
        grib.read(data, file)
        return []
    if len(data) > MAX_TEXT or b"\0" in data[:4096]:
        raise InputError("is of no form that is read here", file, remedy=f"give {FORMS}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"is neither text in UTF-8 (byte {error.start}) nor GRIB or NetCDF", file, remedy=f"give {FORMS}"
        ) from error
    return _from_text(path, text, near_s, stations, height_m)


def _from_text(
    path: Path, text: str, near_s: float, stations: dict[str, tuple[float, float]], height_m: float
) -> list[Weather]:
    file = str(path)
    if text.lstrip()[:1] in ("{", "["):
        try:
            value = msgspec.json.decode(text)
        except (msgspec.DecodeError, RecursionError) as error:
            raise InputError(f"is damaged JSON: {error}", file, remedy="download the file again") from error
        if is_open_meteo(value):
            return read_open_meteo(text, file)
        bulletin = unwrapped(value, near_s)
        if bulletin is None or not is_bulletin(bulletin[0]):
            raise InputError("is JSON, but no weather that is read here", file, remedy=f"give {FORMS}")
        return read_bulletin(bulletin[0], file, bulletin[1], {**bulletin[2], **stations})
    head = next((line for line in text.splitlines() if line.strip()), "")
    if "speed_mps" in head and "member" in head:
        return [_table(path, stations, height_m)]
    if is_bulletin(text) and "," not in head:
        return read_bulletin(text, file, near_s, stations)
    shown = head.strip()[:60]
    raise InputError("is of no form that is read here", file, 1, value=shown, remedy=f"give {FORMS}")


def _table(path: Path, stations: Mapping[str, tuple[float, float]], height_m: float) -> Weather:
    """Read our own CSV; its sites are those of the file."""
    from skyway.models.wind.forecast_file import read_forecast_table, site_names

    names = site_names(path)
    table = read_forecast_table(path, names)
    places = [stations.get(name, (np.nan, np.nan)) for name in names]
    lat, lon = np.array(places, dtype=np.float64).reshape(-1, 2).T
    fields = {FieldKey(NORTH, height_m): table.north, FieldKey(EAST, height_m): table.east}
    told = "1 site" if len(names) == 1 else f"{len(names)} sites"
    return Weather(
        (str(path),), "CSV", "CSV", np.nan, Places(lat, lon, told, names=tuple(names)), table.members, table.times_s, fields,
        holds=True, probability=table.probability,
    )  # fmt: skip


def _unzipped(data: bytes, file: str) -> bytes:
    unpacker = bz2.BZ2Decompressor()
    try:
        found = unpacker.decompress(data, max_length=MAX_BYTES)
    except OSError as error:
        raise InputError(f"is damaged: {error}", file, remedy="download the file again") from error
    if not unpacker.eof:
        raise InputError("is cut off, or too large when unpacked", file, remedy="download the file again")
    return found
