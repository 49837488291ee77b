"""Weather files made for tests, by other libraries than those of the readers where there are any."""

import json
from datetime import UTC, datetime

import numpy as np

ISSUED = datetime(2013, 7, 10, 12, tzinfo=UTC)
ISSUED_S = ISSUED.timestamp()
LAMBERT = {"lat0": 38.5, "lon0": -97.5}
"""HRRR's projection."""


def newyork_grid(ni=13, nj=9):
    """Latitudes and longitudes of a quarter-degree grid about New York, rows from the north."""
    return np.meshgrid(
        np.linspace(42.0, 42.0 - 0.25 * (nj - 1), nj), np.linspace(-75.5, -75.5 + 0.25 * (ni - 1), ni), indexing="ij"
    )


def write_grib(
    path,
    wind,
    *,
    members=None,
    hours=(0, 1, 2),
    heights=(10, 80),
    edition=2,
    packing="grid_simple",
    grid="regular_ll",
    missing=(),
    issued_h=12,
):
    """Write u and v of ``wind(member, hour, height, lat, lon)``, which gives components as the grid has them."""
    import pyproj  # noqa: F401
    import eccodes as ec  # isort: skip

    with path.open("wb") as stream:
        for member in members or [None]:
            for hour in hours:
                for height in heights:
                    handle = ec.codes_grib_new_from_samples(f"regular_ll_sfc_grib{edition}")
                    _set_grid(ec, handle, grid)
                    ec.codes_set_values(
                        handle,
                        np.arange(
                            {
                                "regular_ll": 117,
                                "rotated_ll": 63,
                                "lambert": 120,
                                "stereo_north": 120,
                                "stereo_south": 120,
                            }[grid],
                            dtype=np.float64,
                        ),
                    )
                    _set(ec, handle, dataDate=20130710, dataTime=100 * issued_h, bitsPerValue=16, centre="ecmf")
                    if member is not None:
                        _set(
                            ec,
                            handle,
                            productDefinitionTemplateNumber=1,
                            perturbationNumber=member,
                            numberOfForecastsInEnsemble=len(members),
                        )
                    _set(ec, handle, step=hour)
                    lat, lon = ec.codes_get_array(handle, "latitudes"), ec.codes_get_array(handle, "longitudes")
                    lon = np.mod(lon + 180.0, 360.0) - 180.0
                    for name, values in zip(("u", "v"), wind(member, hour, height, lat, lon), strict=True):
                        _set(ec, handle, shortName=name, typeOfLevel="heightAboveGround", level=height)
                        known = np.array(values)
                        if len(missing):
                            _set(ec, handle, bitmapPresent=1, missingValue=-9999.0)
                            known[list(missing)] = -9999.0
                        ec.codes_set_values(handle, known)
                        ec.codes_set(handle, "packingType", packing)
                        ec.codes_write(handle, stream)
                    ec.codes_release(handle)
    return path


def _set(ec, handle, **keys):
    for key, value in keys.items():
        ec.codes_set(handle, key, value)


def _set_grid(ec, handle, grid):
    if grid == "regular_ll":
        _set(
            ec, handle, Ni=13, Nj=9, latitudeOfFirstGridPointInDegrees=42, latitudeOfLastGridPointInDegrees=40,
            longitudeOfFirstGridPointInDegrees=284.5, longitudeOfLastGridPointInDegrees=287.5, iDirectionIncrementInDegrees=0.25,
            jDirectionIncrementInDegrees=0.25,
        )  # fmt: skip
        return
    _set(ec, handle, gridType="polar_stereographic" if grid.startswith("stereo") else grid)
    if grid.startswith("stereo"):
        south = grid == "stereo_south"
        _set(
            ec, handle, Nx=12, Ny=10, latitudeOfFirstGridPointInDegrees=-70 if south else 60, longitudeOfFirstGridPointInDegrees=200,
            LaDInDegrees=-60 if south else 60, orientationOfTheGridInDegrees=249, DxInMetres=30_000, DyInMetres=30_000, jScansPositively=1,
            resolutionAndComponentFlags=56, shapeOfTheEarth=6, projectionCentreFlag=128 if south else 0,
        )  # fmt: skip
    elif grid == "rotated_ll":
        _set(
            ec, handle, Ni=9, Nj=7, latitudeOfFirstGridPointInDegrees=-3, latitudeOfLastGridPointInDegrees=3,
            longitudeOfFirstGridPointInDegrees=356, longitudeOfLastGridPointInDegrees=4, iDirectionIncrementInDegrees=1,
            jDirectionIncrementInDegrees=1, jScansPositively=1, latitudeOfSouthernPoleInDegrees=-49.3,
            longitudeOfSouthernPoleInDegrees=-73.9, angleOfRotation=0, uvRelativeToGrid=1,
        )  # fmt: skip
    else:
        _set(
            ec, handle, Nx=12, Ny=10, latitudeOfFirstGridPointInDegrees=40.2, longitudeOfFirstGridPointInDegrees=285.2,
            LaDInDegrees=38.5, LoVInDegrees=262.5, DxInMetres=13_000, DyInMetres=13_000, Latin1InDegrees=38.5, Latin2InDegrees=38.5,
            jScansPositively=1, uvRelativeToGrid=1, shapeOfTheEarth=6,
        )  # fmt: skip


def open_meteo(columns, units, *, hours=3, start="2013-07-10T12:00", offset_s=0, lat=40.7, lon=-73.9):
    """An answer of Open-Meteo as a dict."""
    begin = datetime.fromisoformat(start)
    times = [f"{begin.replace(hour=begin.hour + hour):%Y-%m-%dT%H:%M}" for hour in range(hours)]
    return {
        "latitude": lat, "longitude": lon, "generationtime_ms": 0.1, "utc_offset_seconds": offset_s, "timezone": "GMT", "elevation": 3.0,
        "hourly_units": {"time": "iso8601", **units}, "hourly": {"time": times, **columns},
    }  # fmt: skip


def write_json(path, value):
    """Write JSON."""
    path.write_text(json.dumps(value), encoding="utf-8")
    return path


def write_netcdf(path, variables, *, version=4):
    """Write ``{name: (dimensions, values, attributes)}`` as NetCDF of version 3 (SciPy) or 4 (h5netcdf)."""
    sizes = {
        dim: size for dims, values, _ in variables.values() for dim, size in zip(dims, np.shape(values), strict=True)
    }
    if version == 3:
        from scipy.io import netcdf_file

        with netcdf_file(path, "w") as file:
            for dim, size in sizes.items():
                file.createDimension(dim, size)
            for name, (dims, values, attributes) in variables.items():
                one = file.createVariable(name, np.asarray(values).dtype.newbyteorder("=").char, dims)
                one[...] = values
                for key, value in attributes.items():
                    setattr(one, key, value)
        return path
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.dimensions = sizes
        for name, (dims, values, attributes) in variables.items():
            one = file.create_variable(name, dims, data=np.asarray(values))
            for key, value in attributes.items():
                one.attrs[key] = value
    return path
