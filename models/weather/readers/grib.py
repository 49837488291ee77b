"""GRIB files of either edition, decoded by ecCodes; winds along the grid are turned to true north.

ecCodes identifies every field. Making one of its handles costs 0.3 ms, so a field of an ensemble that differs from an earlier one
only in issue, lead and member is not identified again, and its values are unpacked by gribberish if that is installed and
agreed with ecCodes on the first field of the kind in the same packing (decision 85).
"""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.readers import triangles
from skyway.models.weather.readers.grib_messages import MAX_POINTS, messages, plain
from skyway.models.weather.readers.pressure_levels import ALTITUDE, GEOPOTENTIAL, LOWEST_HPA, WINDS, level_key_m
from skyway.models.weather.readers.series import Record
from skyway.models.weather.readers.turning import lambert_angle_deg, polar_angle_deg, rotated_angle_deg
from skyway.models.weather.weather import (
    EAST,
    FROM,
    GUST,
    NORTH,
    SPEED,
    SURFACE_M,
    USUAL_HEIGHT_M,
    Places,
    grid_spacing_m,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.models.weather.readers.grib_messages import Message, Plain
    from skyway.models.weather.weather import Box

FAST_PACKINGS = (0, 3, 40, 42)
"""Simple, complex with spatial differencing, JPEG 2000, CCSDS: unpacked bit for bit as by ecCodes in trials."""
NAMES = {
    "u": EAST, "v": NORTH, "ws": SPEED, "si": SPEED, "wdir": FROM, "dd": FROM,
    "gust": GUST, "fg": GUST, "i10fg": GUST, "fg10": GUST, "10fg": GUST, "10fg3": GUST, "10fg6": GUST, "i100fg": GUST,
    "max_i10fg": GUST, "fgust": GUST, "wsmax": GUST, "t": "temperature", "d": "dewpoint", "dpt": "dewpoint", "r": "humidity",
    "prate": "rain", "tprate": "rain", "vis": "visibility", "sp": "pressure", "gh": ALTITUDE, "orog": ALTITUDE, "h": ALTITUDE, "z": GEOPOTENTIAL,
}  # fmt: skip
"""Quantities by ecCodes' short names, without the height before them."""
NEAR_GROUND = ("heightAboveGround", "surface")
TURNED_GRIDS = ("lambert", "lambert_lam", "polar_stereographic", "rotated_ll", "rotated_gg", "reduced_rotated_gg")
STRAIGHT_GRIDS = ("regular_ll", "reduced_ll", "regular_gg", "reduced_gg", "mercator")
NCEP_MODELS = {81: "GFS", 83: "HRRR", 84: "NAM", 96: "GFS", 105: "RAP", 107: "GEFS", 11: "GFS-Wave", 89: "NAM"}
"""Generating processes of NCEP: its table A (on-line, "Generating Process or Model")."""
CENTRES = {"kwbc": "NCEP", "ecmf": "ECMWF", "edzw": "DWD", "lfpw": "Météo-France", "egrr": "Met Office"}


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """A grid, cut to the region."""

    key: str
    places: Places
    chosen: NDArray[np.int64]
    """Points of it that are kept."""
    angle_deg: NDArray[np.float64] | None
    """Angle by which it is turned there; None: unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class _Kind:
    """Common properties of the fields of one series."""

    quantity: str | None
    """None: not used."""
    height_m: float
    name: str
    model: str
    grid: _Grid
    along_grid: bool
    analysis: bool
    note: str


def read_grib(
    data: bytes, file: str, box: Box | None = None, grids: triangles.TriangleGrids | None = None
) -> list[Record]:
    """Read the fields of a GRIB file, cut to a region, for `series.assembled`; an `InputError` names the faulty message.

    `grids` has the positions of grids from other files; those of this file are added.
    """
    return _Reader(file, box, triangles.TriangleGrids() if grids is None else grids).read(data)


class _Reader:
    def __init__(self, file: str, box: Box | None, grids: triangles.TriangleGrids) -> None:
        self.ec: Any = loaded_eccodes()
        self.triangles = grids
        self.file, self.box = file, box
        self.grids: dict[str, _Grid] = {}
        self.kinds: dict[bytes, _Kind] = {}
        self.fast: dict[tuple[bytes, int], bool] = {}
        self.records: list[Record] = []

    def read(self, data: bytes) -> list[Record]:
        unplaced: triangles.UnknownPlacesError | None = None
        for message in messages(data, self.file):
            try:
                known = plain(message)
                if known is None or known.kind not in self.kinds or not self._quickly(message, known):
                    self._slowly(message, known)
            except (self.ec.CodesInternalError, ValueError, ArithmeticError, MemoryError) as error:
                if isinstance(error, triangles.UnknownPlacesError):
                    unplaced = error  # the places may come in a later message
                    continue
                if isinstance(error, InputError):
                    raise
                problem = f"message {message.number}, byte {message.begin}: {str(error).strip().rstrip('.')}"
                raise InputError(problem, self.file, remedy="download the file again") from error
        if unplaced is not None:
            raise unplaced
        return self.records

    def _quickly(self, message: Message, known: Plain) -> bool:
        """Read a field of a known kind; returns whether that was possible."""
        kind = self.kinds[known.kind]
        if kind.quantity is None:
            self._keep(kind, known.issued_s, known.issued_s + known.lead_s, known.member, None)
            return True
        if not self.fast.get((known.kind, known.packing)):
            return False
        values = _unpacked(message.octets)
        if values is None or values.size <= kind.grid.chosen.max(initial=0):
            return False
        self._keep(kind, known.issued_s, known.issued_s + known.lead_s, known.member, values[kind.grid.chosen])
        return True

    def _slowly(self, message: Message, known: Plain | None) -> None:
        """Read a field by ecCodes."""
        with _quiet():
            handle = self.ec.codes_new_from_message(message.octets)
            try:
                self._field(handle, message, known)
            finally:
                self.ec.codes_release(handle)

    def _field(self, handle: int, message: Message, known: Plain | None) -> None:
        on_triangles = self._get(handle, "gridType") == triangles.KIND
        if on_triangles and self.triangles.take(self.ec, handle):
            return
        kind = self._described(handle, message)
        issued_s = self._instant(handle, "dataDate", "dataTime", message)
        valid_s = self._instant(handle, "validityDate", "validityTime", message)
        if known is not None:
            self.kinds[known.kind] = kind
            issued_s, valid_s = known.issued_s, known.issued_s + known.lead_s
        number = self._get(handle, "perturbationNumber" if message.edition == 2 else "number")
        if message.edition == 1 and not (
            number or self._get(handle, "totalNumber") or self._get(handle, "type") in ("pf", "cf")
        ):
            number = None
        values = None
        if kind.quantity is not None:
            full = self.ec.codes_get_values(handle)
            full = np.where(full == self.ec.codes_get_double(handle, "missingValue"), np.nan, full)
            if len(full) <= kind.grid.chosen.max(initial=0):
                raise InputError(f"message {message.number}: has fewer values than its grid has points", self.file)
            values = full[kind.grid.chosen]
            self._compare(message, known, full)
        self._keep(kind, issued_s, valid_s, number, values)

    def _compare(self, message: Message, known: Plain | None, values: NDArray[np.float64]) -> None:
        """Check once for each kind and packing whether gribberish unpacks the same values."""
        if known is None or (known.kind, known.packing) in self.fast or known.packing not in FAST_PACKINGS:
            return
        other = _unpacked(message.octets)
        same = other is not None and other.shape == values.shape and np.array_equal(other, values, equal_nan=True)
        self.fast[known.kind, known.packing] = bool(same)

    def _keep(
        self, kind: _Kind, issued_s: float, valid_s: float, number: int | None, values: NDArray[np.float64] | None
    ) -> None:
        member = "" if number is None else str(number)
        self.records.append(
            Record(
                self.file, kind.model, issued_s, valid_s, member, kind.quantity, kind.height_m, kind.name, kind.grid.key, kind.grid.places,
                values, kind.grid.angle_deg if kind.along_grid else None, kind.analysis, kind.note,
            )
        )  # fmt: skip

    def _get(self, handle: int, key: str) -> Any:
        try:
            return self.ec.codes_get(handle, key)
        except self.ec.KeyValueNotFoundError:
            return None

    def _instant(self, handle: int, date_key: str, time_key: str, message: Message) -> float:
        from datetime import UTC, datetime, timedelta

        date, time = int(self._get(handle, date_key) or 0), int(self._get(handle, time_key) or 0)
        try:
            day = datetime(date // 10_000, date // 100 % 100, date % 100, tzinfo=UTC)
        except ValueError:
            raise InputError(f"message {message.number}: has no date", self.file, field=date_key, value=date) from None
        return (day + timedelta(hours=time // 100, minutes=time % 100)).timestamp()

    def _described(self, handle: int, message: Message) -> _Kind:
        name = str(self._get(handle, "shortName") or "unknown")
        level_kind, level = str(self._get(handle, "typeOfLevel")), float(self._get(handle, "level") or 0.0)
        parts = re.fullmatch(r"(\d+)?([a-zA-Z_].*)", name)
        quantity = NAMES.get(name) or (NAMES.get(parts[2]) if parts else None)
        height = float(parts[1]) if parts and parts[1] and name not in NAMES else level
        note = ""
        if level_kind == "isobaricInhPa" and level >= LOWEST_HPA and quantity in (*WINDS, ALTITUDE, GEOPOTENTIAL):
            height = level_key_m(level)
        elif quantity in (ALTITUDE, GEOPOTENTIAL):
            quantity, height = (quantity, 0.0) if level_kind == "surface" else (None, height)
        elif level_kind not in NEAR_GROUND:
            quantity = None
        elif (
            quantity in (NORTH, EAST, SPEED, FROM, GUST)
            and level_kind == "surface"
            and (height == level or quantity == GUST)
        ):
            height = USUAL_HEIGHT_M
            if quantity != GUST:
                note = "assuming that its surface wind is at 10 m above ground"
        elif quantity in ("rain", "visibility", "pressure"):
            height = SURFACE_M
        if self._get(handle, "derivedForecast") is not None or self._get(handle, "percentileValue") is not None:
            quantity, note = (
                None,
                "means, spreads and quantiles of an ensemble are ignored: none is a time series of the wind",
            )
        step = str(self._get(handle, "stepType") or "instant")
        if quantity not in (None, GUST, "rain") and step not in ("instant", "diff"):
            quantity, note = None, f"{name} over an interval ({step}) is ignored"
        told = name if quantity else f"{name} at {level_kind} {level:g}"
        relative = quantity in (NORTH, EAST) and self._along_grid(handle)
        analysis = str(self._get(handle, "dataType")) == "an"
        grid = self._grid(handle, message)
        if relative and grid.angle_deg is None:
            quantity, note = (
                None,
                f"its winds are along a grid ({grid.places.kind}) of unknown direction, and ignored",
            )
        return _Kind(quantity, height, told, self._model(handle), grid, relative, analysis, note)

    def _along_grid(self, handle: int) -> bool:
        """Whether winds are along the grid: flag table 3.3, bit 5; ecCodes names it for all grids but the polar stereographic one of GRIB 2."""
        named = self._get(handle, "uvRelativeToGrid")
        return bool(named if named is not None else int(self._get(handle, "resolutionAndComponentFlags") or 0) & 0x08)

    def _model(self, handle: int) -> str:
        centre, process = str(self._get(handle, "centre")), self._get(handle, "generatingProcessIdentifier")
        if centre == "ecmf":
            return "ERA5" if self._get(handle, "class") == "ea" else "IFS"
        if centre == "kwbc" and process in NCEP_MODELS:
            return NCEP_MODELS[process]
        return f"{CENTRES.get(centre, centre)} process {process}"

    def _grid(self, handle: int, message: Message) -> _Grid:
        key = str(self._get(handle, "md5Section3" if message.edition == 2 else "md5Section2"))
        if key not in self.grids:
            self.grids[key] = self._cut(handle, message, key)
        return self.grids[key]

    def _cut(self, handle: int, message: Message, key: str) -> _Grid:
        ec, kind = self.ec, str(self._get(handle, "gridType"))
        points = int(self._get(handle, "numberOfDataPoints") or self._get(handle, "numberOfPoints") or 0)
        where = f"message {message.number}"
        if kind == triangles.KIND:
            places, chosen = self.triangles.cut(ec, handle, self.box, self.file)
            return _Grid(key, places, chosen, np.zeros(len(chosen)))
        if kind not in TURNED_GRIDS + STRAIGHT_GRIDS:
            remedy = "give the file on a latitude-longitude, Gaussian, Lambert or polar stereographic grid"
            raise InputError(
                f"{where}: the places of a grid of this kind are not in the file", self.file, value=kind, remedy=remedy
            )
        if points > MAX_POINTS:
            raise InputError(f"{where}: claims {points:,} points", self.file, remedy=f"at most {MAX_POINTS:,}")
        lat, lon = ec.codes_get_array(handle, "latitudes"), ec.codes_get_array(handle, "longitudes")
        lon = np.mod(lon + 180.0, 360.0) - 180.0
        if len(lat) != len(lon) or not len(lat) or not (np.abs(lat) <= 90.0 + 1e-6).all():
            raise InputError(f"{where}: the grid has impossible latitudes or longitudes", self.file)
        spacing = grid_spacing_m(lat[:100_000], lon[:100_000])
        chosen = np.arange(len(lat))
        if self.box is not None:
            margin = 2.0 * (spacing if np.isfinite(spacing) else 0.0) / 111_000.0
            chosen = np.flatnonzero(self.box.wider(max(margin, 0.1)).holds(lat, lon))
        size = [self._get(handle, name) for name in (("Nx", "Ny") if self._get(handle, "Nx") else ("Ni", "Nj"))]
        told = (
            f"{kind} {size[0]} x {size[1]}"
            if all(0 < (n or 0) < 1_000_000 for n in size)
            else f"{kind}, {len(lat):,} points"
        )
        angle = self._angle(handle, kind, lat[chosen], lon[chosen])
        return _Grid(key, Places(lat[chosen], lon[chosen], told, spacing), chosen, angle)

    def _angle(
        self, handle: int, kind: str, lat: NDArray[np.float64], lon: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        def of(*keys: str) -> float:
            values = [value for key in keys if (value := self._get(handle, key)) is not None]
            return float(values[0]) if values else np.nan

        if kind in STRAIGHT_GRIDS:
            return np.zeros(len(lat))
        if kind.startswith("lambert"):
            return lambert_angle_deg(lon, of("LoVInDegrees"), of("Latin1InDegrees"), of("Latin2InDegrees"))
        if kind == "polar_stereographic":
            south = bool(int(of("projectionCentreFlag") or 0) & 0x80)
            return polar_angle_deg(lon, of("orientationOfTheGridInDegrees"), south=south)
        if of("angleOfRotationInDegrees", "angleOfRotation") != 0.0:
            return None
        pole = of("latitudeOfSouthernPoleInDegrees"), of("longitudeOfSouthernPoleInDegrees")
        return rotated_angle_deg(lat, lon, *pole)


@contextmanager
def _quiet() -> Iterator[None]:
    """Prevent ecCodes from writing to standard error: it bypasses Python, and an `InputError` reports the problem."""
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def loaded_eccodes() -> Any:
    """Return ecCodes, loaded after pyproj: each brings its own PROJ, and in the other order the process crashes at its end."""
    import pyproj  # noqa: F401
    import eccodes  # isort: skip

    return eccodes


def _unpacked(octets: bytes) -> NDArray[np.float64] | None:
    """Values of a message by gribberish, missing ones NaN; None if it is not installed or refuses."""
    try:
        import gribberish
    except ImportError:
        return None
    try:
        return np.asarray(gribberish.parse_grib_array(octets, 0), dtype=np.float64).ravel()
    except BaseException as error:  # a Rust panic is not an Exception
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise
        return None
