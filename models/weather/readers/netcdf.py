"""NetCDF files with the CF conventions: of version 4 (HDF5) by h5netcdf, of version 3 by SciPy.

A quantity is identified by its `standard_name`, otherwise by its GRIB parameter, otherwise by its name in ERA5, GFS and HRRR extracts; never
by a guess from its values. Winds along the axes of a projection are turned to true north by its grid mapping.

Source: B. Eaton and others, "NetCDF Climate and Forecast (CF) Metadata Conventions" 1.11 (2023), chapters 4 to 6 and 8.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.readers.netcdf_variables import STEP_S, damaged, in_unit, instants, opened
from skyway.models.weather.readers.turning import lambert_angle_deg, polar_angle_deg, rotated_angle_deg, turned
from skyway.models.weather.weather import (
    EAST,
    FROM,
    GUST,
    MAX_CELLS,
    NORTH,
    SPEED,
    SURFACE_M,
    USUAL_HEIGHT_M,
    FieldKey,
    Places,
    Weather,
    grid_spacing_m,
    joined,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.weather.readers.netcdf_variables import Variable
    from skyway.models.weather.weather import Box

STANDARD = {
    "eastward_wind": EAST, "northward_wind": NORTH, "x_wind": EAST, "y_wind": NORTH, "grid_eastward_wind": EAST,
    "grid_northward_wind": NORTH, "wind_speed": SPEED, "wind_from_direction": FROM, "wind_speed_of_gust": GUST,
    "air_temperature": "temperature", "dew_point_temperature": "dewpoint", "relative_humidity": "humidity",
    "rainfall_rate": "rain", "precipitation_flux": "rain", "visibility_in_air": "visibility", "surface_air_pressure": "pressure",
}  # fmt: skip
ALONG_GRID = ("x_wind", "y_wind", "grid_eastward_wind", "grid_northward_wind")
NAMED = (
    (r"u-?_?component[-_]of[-_]wind.*|u_?(\d+)m?|(\d+)m?_?u(?:grd)?|ugrd.*|u", EAST),
    (r"v-?_?component[-_]of[-_]wind.*|v_?(\d+)m?|(\d+)m?_?v(?:grd)?|vgrd.*|v", NORTH),
    (r"(?:i?10fg|fg10|i10fg|gust|wind_speed_gust).*", GUST),
    (r"(?:wind_?speed|ws|si)_?(\d*)m?", SPEED),
    (r"(?:wind_?(?:from_?)?direction|wd|wdir)_?(\d*)m?", FROM),
    (r"t2m|2t|t_?2m", "temperature"),
    (r"d2m|2d", "dewpoint"),
)
"""Names of variables, in lower case, if there is no standard name."""
GRIB_PARAMETERS = {(0, 2, 2): EAST, (0, 2, 3): NORTH, (0, 2, 1): SPEED, (0, 2, 0): FROM, (0, 2, 22): GUST}
STEPS = ("step", "lead_time", "leadtime", "forecast_hour")
"""Dimensions that count from the issue."""
MEMBER_NAMES = ("number", "member", "members", "realization", "ensemble", "ensemble_member", "ens")


def read_netcdf(data: bytes, file: str, box: Box | None = None) -> list[Weather]:
    """Read the weather in a NetCDF file, cut to a region. Raises an `InputError` with departures from the conventions."""
    variables = opened(data, file)
    try:
        found = _Reader(variables, file, box).read()
    except (OSError, RuntimeError, KeyError, IndexError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise damaged(file, error) from error
    if not found:
        held = ", ".join(name for name, one in variables.items() if len(one.dimensions) > 1) or "no variables"
        problem = f"has no variable of the weather, but {held}"
        raise InputError(
            problem, file, remedy="wind needs standard_name eastward_wind and northward_wind, or names such as u10, v10"
        )
    return joined(found)


class _Reader:
    def __init__(self, variables: dict[str, Variable], file: str, box: Box | None) -> None:
        self.variables, self.file, self.box = variables, file, box
        self.notes: list[str] = []
        self.turn: dict[str, NDArray[np.float64]] = {}

    def read(self) -> list[Weather]:
        parts: list[Weather] = []
        others: list[str] = []
        along: list[tuple[int, Variable]] = []
        for one in self.variables.values():
            quantity = self._quantity(one)
            if quantity is None:
                if len(one.dimensions) > 1 and not one.text("bounds"):
                    others.append(one.name)
                continue
            part = self._part(one, quantity)
            if part is not None:
                if one.text("standard_name") in ALONG_GRID:
                    along.append((len(parts), one))
                parts.append(part)
        self._turn(parts, along)
        return [Weather(**{**vars(part), "others": tuple(others), "notes": tuple(self.notes)}) for part in parts]

    def _quantity(self, one: Variable) -> str | None:
        standard = one.text("standard_name").split(" ")[0]
        if standard and standard != "unknown":
            return STANDARD.get(standard)
        grib = tuple(int(value) for value in one.numbers("Grib2_Parameter"))
        if len(grib) == 3:
            return GRIB_PARAMETERS.get((grib[0], grib[1], grib[2]))
        name = (one.text("GRIB_shortName") or one.name).lower()
        return next((quantity for pattern, quantity in NAMED if re.fullmatch(pattern, name)), None)

    def _part(self, one: Variable, quantity: str) -> Weather | None:
        axes = {self._axis(name): number for number, name in enumerate(one.dimensions)}
        if None in axes or len(axes) < len(one.dimensions):
            self.notes.append(f"{one.name} is ignored: its dimensions {', '.join(one.dimensions)} are not all known")
            return None
        shape = [int(size) for size in one.source.shape]
        if np.prod([float(size) for size in shape]) > MAX_CELLS:
            raise InputError(
                f"the variable {one.name} is too large", self.file, remedy="cut it to the region and the hours needed"
            )
        times_s = self._times(one, axes)
        places, chosen = self._places(one, axes)
        heights = self._heights(one, axes, quantity)
        if heights is None:
            return None
        order = [axes[name] for name in ("member", "time", "height") if name in axes]
        space = [number for number in range(len(one.dimensions)) if number not in order]
        values = np.transpose(in_unit(one, quantity, self.file), [*order, *space])
        lead = [shape[axes[name]] if name in axes else 1 for name in ("member", "time", "height")]
        values = values.reshape(*lead, -1)[..., chosen]
        members = tuple(str(number) for number in self._labels(one, axes, lead[0])) if "member" in axes else ("",)
        order_t = np.argsort(times_s, kind="stable")
        if len(np.unique(times_s)) < len(times_s):
            raise InputError("has a time twice", self.file, field=one.name)
        fields = {FieldKey(quantity, height): values[:, order_t, level] for level, height in enumerate(heights)}
        return Weather((self.file,), "NetCDF", self._model(), self._issued(), places, members, times_s[order_t], fields)

    def _axis(self, name: str) -> str | None:
        """What a dimension counts: member, time, height, lat, lon, y, x."""
        one = self.variables.get(name)
        lower = name.lower()
        units = one.text("units").lower() if one is not None else ""
        standard = one.text("standard_name") if one is not None else ""
        axis = one.text("axis").upper() if one is not None else ""
        if standard == "realization" or lower in MEMBER_NAMES or axis == "E":
            return "member"
        if (
            " since " in units
            or axis == "T"
            or lower in ("time", "valid_time")
            or standard == "forecast_period"
            or lower in STEPS
        ):
            return "time"
        if (
            units in ("degrees_north", "degree_north", "degrees_n")
            or standard == "latitude"
            or lower in ("lat", "latitude")
        ):
            return "lat"
        if (
            units in ("degrees_east", "degree_east", "degrees_e")
            or standard == "longitude"
            or lower in ("lon", "longitude")
        ):
            return "lon"
        if (
            standard in ("projection_y_coordinate", "grid_latitude")
            or axis == "Y"
            or lower in ("y", "rlat", "south_north")
        ):
            return "y"
        if (
            standard in ("projection_x_coordinate", "grid_longitude")
            or axis == "X"
            or lower in ("x", "rlon", "west_east")
        ):
            return "x"
        if (
            axis == "Z"
            or standard in ("height", "altitude", "air_pressure", "depth")
            or "height" in lower
            or "level" in lower
        ):
            return "height"
        return (
            "station"
            if lower in ("station", "point", "points", "values", "cell", "ncells", "site")
            else None
            if one is not None or lower != "depth"
            else "height"
        )

    def _coordinates(self, one: Variable) -> list[Variable]:
        names = [*one.text("coordinates").split(), *one.dimensions]
        return [self.variables[name] for name in names if name in self.variables]

    def _times(self, one: Variable, axes: Mapping[str | None, int]) -> NDArray[np.float64]:
        """Times of a variable, POSIX seconds: of its dimension, otherwise of a coordinate along it, otherwise the issue and the steps from it."""
        name = one.dimensions[axes["time"]] if "time" in axes else None
        own = self.variables.get(name or "")
        if own is not None and " since " in own.text("units"):
            return instants(own, self.file)
        wanted = () if name is None else (name,)
        near = [*self._coordinates(one), *self.variables.values()]
        dated = [other for other in near if other.dimensions == wanted and " since " in other.text("units")]
        valid = [other for other in dated if other.text("standard_name") != "forecast_reference_time"]
        if valid:
            return instants(valid[0], self.file)
        issued_s = self._issued()
        unit = STEP_S.get(own.text("units").lower()) if own is not None else None
        if own is None or unit is None or not np.isfinite(issued_s):
            remedy = "CF: a variable with units such as hours since 2026-07-10"
            raise InputError("has no coordinate of time", self.file, field=one.name, remedy=remedy)
        return np.asarray(issued_s + unit * np.atleast_1d(own.values()))

    def _issued(self) -> float:
        for one in self.variables.values():
            if one.text("standard_name") == "forecast_reference_time" or one.name in (
                "forecast_reference_time",
                "reftime",
            ):
                times = instants(one, self.file)
                return float(times[0]) if len(times) == 1 else np.nan
        return np.nan

    def _model(self) -> str:
        return "NetCDF"

    def _heights(self, one: Variable, axes: Mapping[str | None, int], quantity: str) -> list[float] | None:
        """Heights above ground of its levels; None: it is not near the ground."""
        if "height" in axes:
            level = self.variables.get(one.dimensions[axes["height"]])
            if (
                level is None
                or level.text("standard_name") in ("air_pressure", "depth", "altitude")
                or level.text("units") not in ("m", "meter", "meters", "metres", "metre")
            ):
                self.notes.append(f"{one.name} is ignored: its levels are not heights above ground, m")
                return None
            return [float(value) for value in np.atleast_1d(level.values())]
        if quantity in ("rain", "visibility", "pressure"):
            return [SURFACE_M]
        for other in self._coordinates(one):
            if not other.dimensions and other.text("standard_name") == "height":
                return [float(np.atleast_1d(other.values())[0])]
        told = re.search(
            r"(\d+(?:\.\d+)?)[ _-]?(?:m\b|metre|meter)|[uv](?:si)?(\d+)|^(\d+)[uv]",
            f"{one.name} {one.text('long_name')}",
            re.IGNORECASE,
        )
        if told:
            return [float(next(group for group in told.groups() if group))]
        if quantity in (NORTH, EAST, SPEED, FROM):
            self.notes.append(
                f"{one.name} is assumed to be {USUAL_HEIGHT_M:g} m above ground: the file does not state its height"
            )
        return [USUAL_HEIGHT_M]

    def _labels(self, one: Variable, axes: Mapping[str | None, int], count: int) -> list[int]:
        names = self.variables.get(one.dimensions[axes["member"]])
        values = np.atleast_1d(names.values()) if names is not None else np.empty(0)
        return (
            [int(value) for value in values]
            if values.shape == (count,) and np.isfinite(values).all()
            else list(range(count))
        )

    def _places(self, one: Variable, axes: Mapping[str | None, int]) -> tuple[Places, NDArray[np.int64]]:
        space = [name for name in one.dimensions if self._axis(name) in ("lat", "lon", "y", "x", "station")]
        if "lat" in axes and "lon" in axes:
            lat, lon = (np.atleast_1d(self.variables[one.dimensions[axes[part]]].values()) for part in ("lat", "lon"))
            first = axes["lat"] < axes["lon"]
            grid = np.meshgrid(lat, lon, indexing="ij" if first else "xy")
            kind = f"latitude-longitude {len(lon)} x {len(lat)}"
            lat, lon = grid[0].ravel(), grid[1].ravel()
        else:
            near = self._coordinates(one) + list(self.variables.values())
            lat, lon = (
                next(
                    (v.values().ravel() for v in near if self._axis(v.name) == part and v.dimensions == tuple(space)),
                    np.empty(0),
                )
                for part in ("lat", "lon")
            )
            kind = (
                "points"
                if len(space) < 2
                else "grid " + " x ".join(str(self._size(one, name)) for name in reversed(space))
            )
        count = int(np.prod([self._size(one, name) for name in space]))
        if len(lat) != count or len(lon) != count or not np.isfinite(lat).all() or not np.isfinite(lon).all():
            remedy = "CF: coordinates with units degrees_north and degrees_east"
            raise InputError("has no latitudes and longitudes for its points", self.file, field=one.name, remedy=remedy)
        if (np.abs(lat) > 90.0).any() or (np.abs(lon) > 360.0).any():
            raise InputError("has latitudes beyond 90°: lat and lon look swapped", self.file, field=one.name)
        lon = np.mod(lon + 180.0, 360.0) - 180.0
        spacing = grid_spacing_m(lat[:100_000], lon[:100_000]) if space != ["station"] else np.nan
        chosen = np.arange(len(lat))
        if self.box is not None:
            chosen = np.flatnonzero(self.box.wider(max(2.0 * np.nan_to_num(spacing) / 111_000.0, 0.1)).holds(lat, lon))
        return Places(lat[chosen], lon[chosen], kind, float(spacing)), chosen

    def _size(self, one: Variable, name: str) -> int:
        return int(one.source.shape[one.dimensions.index(name)])

    def _turn(self, parts: list[Weather], along: Sequence[tuple[int, Variable]]) -> None:
        """Turn the winds along the axes of a projection to true north."""
        for number, one in along:
            part = parts[number]
            mapping = self.variables.get(one.text("grid_mapping").split(":")[0])
            angle = None if mapping is None else _angle(mapping, part.places)
            if angle is None:
                problem = "is a wind along the axes of a grid of unknown direction"
                raise InputError(
                    problem,
                    self.file,
                    field=one.name,
                    remedy="CF: a grid_mapping of a Lambert, polar stereographic or rotated grid",
                )
            for key in [key for key in part.fields if key.quantity == EAST]:
                pair = [other for at, _ in along if FieldKey(NORTH, key.height_m) in (other := parts[at]).fields]
                if not pair or pair[0].fields[FieldKey(NORTH, key.height_m)].shape != part.fields[key].shape:
                    raise InputError(
                        "is one component of a wind along a turned grid, without the other", self.file, field=one.name
                    )
                north = FieldKey(NORTH, key.height_m)
                pair[0].fields[north], part.fields[key] = turned(part.fields[key], pair[0].fields[north], angle)


def _angle(mapping: Variable, places: Places) -> NDArray[np.float64] | None:
    kind = mapping.text("grid_mapping_name")

    def of(name: str) -> float:
        values = mapping.numbers(name)
        return float(values[0]) if values.size else np.nan

    if kind == "latitude_longitude":
        return np.zeros(len(places))
    if kind == "lambert_conformal_conic":
        parallels = mapping.numbers("standard_parallel")
        return (
            lambert_angle_deg(places.lon, of("longitude_of_central_meridian"), parallels[0], parallels[-1])
            if parallels.size
            else None
        )
    if kind == "polar_stereographic":
        south = of("latitude_of_projection_origin") < 0.0
        return polar_angle_deg(places.lon, of("straight_vertical_longitude_from_pole"), south=south)
    if kind == "rotated_latitude_longitude":
        pole = -of("grid_north_pole_latitude"), of("grid_north_pole_longitude") + 180.0
        return rotated_angle_deg(places.lat, places.lon, *pole)
    return None
