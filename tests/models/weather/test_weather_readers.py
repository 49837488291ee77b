"""Weather files are read as other libraries, and other people's parsers, read them."""

import bz2
import json

import numpy as np
import pyproj
import pytest
import weather_files as wf

from skyway.models.base.errors import InputError
from skyway.models.weather.placing import Placing
from skyway.models.weather.readers.grib import loaded_eccodes
from skyway.models.weather.readers.reading import read_weather
from skyway.models.weather.weather import EAST, GUST, NORTH, Box, FieldKey
from skyway.models.wind.triangle import speed_from, vector

NY = Box(40.4, -74.3, 41.0, -73.5)


def wind_of(weather, height=10.0):
    return weather.fields[FieldKey(EAST, height)], weather.fields[FieldKey(NORTH, height)]


def turned_by_pyproj(crs, lat, lon, u, v):
    """East and north of components along a projection: its axes are followed for a metre by PROJ itself."""
    there, back = (
        pyproj.Transformer.from_crs(*pair, always_xy=True) for pair in (("EPSG:4326", crs), (crs, "EPSG:4326"))
    )
    x, y = there.transform(lon, lat)
    step = 1e-4 if np.abs(x).max() < 400.0 else 100.0
    lon2, lat2 = back.transform(x, y + step)
    angle = np.arctan2((np.mod(lon2 - lon + 180.0, 360.0) - 180.0) * np.cos(np.radians(lat)), lat2 - lat)
    return u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)


def test_winds_along_a_lambert_grid_are_turned_to_true_north(shared_data):
    (found,) = read_weather([shared_data / "forecast" / "nam_conus80km_20180917_00z_f000.grib2"])
    assert (found.model, len(found.others)) == ("NAM", 174)  # u and v share a message: 154 messages, 181 fields
    ec, raw = loaded_eccodes(), {}
    ec.codes_grib_multi_support_on()
    with (shared_data / "forecast" / "nam_conus80km_20180917_00z_f000.grib2").open("rb") as stream:
        while (handle := ec.codes_grib_new_from_file(stream)) is not None:
            if ec.codes_get(handle, "shortName") in ("10u", "10v"):
                raw[ec.codes_get(handle, "shortName")] = ec.codes_get_values(handle)
            ec.codes_release(handle)
    ec.codes_grib_multi_support_off()
    convergence = (
        pyproj.Proj("+proj=lcc +lat_1=25 +lat_2=25 +lat_0=25 +lon_0=265 +R=6371229")
        .get_factors(found.places.lon, found.places.lat)
        .meridian_convergence
    )
    a = np.radians(convergence)
    east, north = wind_of(found)
    np.testing.assert_allclose(east[0, 0], raw["10u"] * np.cos(a) + raw["10v"] * np.sin(a), atol=1e-6)
    np.testing.assert_allclose(north[0, 0], raw["10v"] * np.cos(a) - raw["10u"] * np.sin(a), atol=1e-6)
    near = np.argmin(np.hypot(found.places.lat - 40.7, found.places.lon + 73.8))
    assert convergence[near] == pytest.approx(8.9, abs=0.2)


def test_the_sea_wind_agrees_with_the_speed_and_direction_in_its_own_file(shared_data):
    (found,) = read_weather([shared_data / "forecast" / "gfswave_atlantic_20210826_12z_f000.grib2"])
    east, north = wind_of(found)
    near = np.argmin(np.hypot(found.places.lat - 40.5, found.places.lon + 73.8333))
    speed, degrees = speed_from(north[0, 0, near], east[0, 0, near])
    assert (speed, degrees) == (pytest.approx(3.91, abs=0.01), pytest.approx(269.8, abs=0.1))
    assert np.isnan(east).mean() == pytest.approx(0.71, abs=0.01)


@pytest.mark.parametrize("grid", ["lambert", "rotated_ll", "stereo_north", "stereo_south"])
def test_turned_grids_of_our_own_making_give_the_wind_that_was_put_in(tmp_path, grid):
    crs = "+proj=lcc +lat_1=38.5 +lat_2=38.5 +lat_0=38.5 +lon_0=262.5 +R=6371229"
    if grid == "rotated_ll":
        crs = "+proj=ob_tran +o_proj=longlat +o_lon_p=0 +o_lat_p=49.3 +lon_0=-73.9 +R=6371229 +to_meter=0.0174532925199433"
    if grid.startswith("stereo"):
        crs = f"+proj=stere +lat_0={-90 if grid == 'stereo_south' else 90} +lon_0=249 +R=6371229"
    path = wf.write_grib(
        tmp_path / "a.grib2", lambda _m, hour, h, lat, lon: (3.0 + hour + 0 * lat, h / 10.0 + 0 * lat), grid=grid
    )
    (found,) = read_weather([path])
    lat, lon = found.places.lat, found.places.lon
    for height in (10.0, 80.0):
        for hour in range(3):
            east, north = turned_by_pyproj(crs, lat, lon, 3.0 + hour, height / 10.0)
            np.testing.assert_allclose(wind_of(found, height)[0][0, hour], east, atol=2e-3)
            np.testing.assert_allclose(wind_of(found, height)[1][0, hour], north, atol=2e-3)


@pytest.mark.parametrize("packing", ["grid_simple", "grid_ccsds", "grid_jpeg", "grid_complex_spatial_differencing"])
def test_members_times_heights_and_gaps_come_out_as_they_were_put_in(tmp_path, packing):
    def wind(member, hour, height, lat, lon):
        return (
            member + 0.1 * hour + 0.01 * lon,
            0 * lat if height == 80 else height * 0.1 + 0.02 * lat,
        )  # a calm is a constant field

    path = wf.write_grib(tmp_path / "e.grib2", wind, members=[0, 1, 10], packing=packing, missing=(0, 5))
    (found,) = read_weather([path], NY)
    assert (found.members, found.issued_s) == (("0", "1", "10"), wf.ISSUED_S)
    assert found.times_s.tolist() == [wf.ISSUED_S + 3600.0 * hour for hour in range(3)]
    assert NY.holds(found.places.lat, found.places.lon).sum() >= 4
    lat, lon = found.places.lat, found.places.lon
    first = (lat == 42.0) & np.isin(lon, (-75.5, -74.25))
    for row, member in enumerate((0, 1, 10)):
        for hour in range(3):
            for height in (10.0, 80.0):
                u, v = wind(member, hour, height, lat, lon)
                east, north = wind_of(found, height)
                np.testing.assert_allclose(east[row, hour], np.where(first, np.nan, u), atol=1e-3)
                np.testing.assert_allclose(north[row, hour], np.where(first, np.nan, v), atol=1e-3)


def test_components_steps_and_models_in_files_of_their_own_are_put_together(shared_data, tmp_path):
    folder = shared_data / "forecast"
    (found,) = read_weather([folder / "ecmwf_10v_20160925_13times.grib", folder / "ecmwf_10u_20160925_13times.grib"])
    assert (found.wind_heights_m, len(found.times_s), found.observed) == ((10.0,), 13, True)
    steps = [
        wf.write_grib(tmp_path / f"{h}.grib2", lambda _m, hour, _h, lat, _lon: (hour + 0 * lat, 0 * lat), hours=(h,))
        for h in (2, 1)
    ]
    packed = tmp_path / "1.grib2.bz2"
    packed.write_bytes(bz2.compress(steps[1].read_bytes()))
    (found,) = read_weather([steps[0], packed])
    assert wind_of(found)[0][0, :, 0].tolist() == [1.0, 2.0]


def test_a_grib_1_ensemble_keeps_all_its_members(shared_data):
    (found,) = read_weather([shared_data / "forecast" / "ecmwf_ens51_z850_tiny.grib"])
    assert (found.members[0], found.members[-1], len(found.members)) == ("0", "50", 51)
    with pytest.raises(InputError, match="has no wind, only geopotential at 850 hPa"):
        found.needs_wind()


@pytest.mark.parametrize(
    ("unit", "factor"), [("km/h", 3.6), ("m/s", 1.0), ("mp/h", 3600 / 1609.344), ("kn", 3600 / 1852)]
)
def test_open_meteo_speeds_are_metres_per_second_whatever_their_unit(tmp_path, unit, factor):
    columns = {
        "wind_speed_80m": [5.0 * factor, None, 0.0],
        "wind_direction_80m": [270, 10, None],
        "windgusts_10m": [9.0 * factor] * 3,
    }
    units = {"wind_speed_80m": unit, "wind_direction_80m": "°", "windgusts_10m": unit}
    answer = wf.open_meteo(columns, units, offset_s=-14400, start="2013-07-10T08:00")
    (found,) = read_weather([wf.write_json(tmp_path / "a.json", answer)])
    assert found.times_s[0] == wf.ISSUED_S
    np.testing.assert_allclose(wind_of(found, 80.0)[0][0, :, 0], [5.0, np.nan, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.fields[FieldKey(GUST, 10.0)], 9.0)


def test_open_meteo_members_models_and_places_are_kept_apart(tmp_path):
    def columns(base):
        table, units = {}, {}
        for model in ("icon_seamless_eps", "gfs025"):
            for member in ("", "_member01", "_member02"):
                for name, value in (("wind_speed_10m", base + len(member)), ("wind_direction_10m", 90)):
                    column = f"{name}{member}_{model}"
                    table[column] = [None if member == "_member02" else value] * 3
                    units[column] = "undefined" if member == "_member02" else {"wind_speed_10m": "m/s"}.get(name, "°")
        return table, units

    answers = [wf.open_meteo(*columns(base), lat=lat) for base, lat in ((1.0, 40.7), (2.0, 40.9))]
    found = read_weather([wf.write_json(tmp_path / "e.json", answers)])
    assert sorted(one.model for one in found) == ["gfs025", "icon_seamless_eps"]
    assert all(one.members == ("0", "_member01"[-2:]) for one in found)
    assert all("ignored: 02" in one.notes[0] for one in found)
    east, _ = wind_of(found[0])
    np.testing.assert_allclose(east[:, 0], [[-1.0, -2.0], [-10.0, -11.0]], atol=1e-9)


def grid_netcdf(tmp_path, version, **wind):
    lat, lon = np.linspace(40.0, 41.5, 4), np.linspace(285.0, 287.0, 5)
    values = np.arange(2 * 4 * 5 * 3, dtype=np.float32).reshape(3, 5, 4, 2)  # time, lon, lat, height
    attributes = {"standard_name": "eastward_wind", "units": "m s-1", "_FillValue": np.float32(7.0), **wind}
    packed = (np.round(values)).astype(np.int16)
    return wf.write_netcdf(
        tmp_path / "a.nc",
        {
            "time": (("time",), np.array([0.0, 60.0, 180.0]), {"units": "minutes since 2013-07-10 14:00:00 +02:00", "calendar": "standard"}),
            "lon": (("lon",), lon, {"units": "degrees_east"}),
            "lat": (("lat",), lat, {"units": "degrees_north"}),
            "height": (("height",), np.array([10.0, 100.0]), {"units": "m", "axis": "Z"}),
            "eastly": (("time", "lon", "lat", "height"), values, attributes),
            "northly": (("time", "lon", "lat", "height"), packed, {"standard_name": "northward_wind", "units": "km h-1", "scale_factor": 0.36, "add_offset": 3.6}),
        },
        version=version,
    ), values  # fmt: skip


@pytest.mark.parametrize("version", [3, 4])
def test_netcdf_of_either_version_is_read_by_its_conventions(tmp_path, version):
    path, values = grid_netcdf(tmp_path, version)
    (found,) = read_weather([path])
    assert found.wind_heights_m == (10.0, 100.0)
    assert found.times_s.tolist() == [wf.ISSUED_S, wf.ISSUED_S + 3600.0, wf.ISSUED_S + 10_800.0]
    at = np.flatnonzero((found.places.lat == 40.5) & (np.abs(found.places.lon + 74.0) < 1e-9))[0]
    east, north = wind_of(found, 100.0)
    np.testing.assert_allclose(east[0, :, at], values[:, 2, 1, 1])
    np.testing.assert_allclose(north[0, :, at], 0.1 * values[:, 2, 1, 1] + 1.0, rtol=1e-6)
    assert np.isnan(east).sum() == 1  # 7.0 says missing


def test_netcdf_winds_along_a_projection_are_turned(tmp_path):
    crs = "+proj=lcc +lat_1=30 +lat_2=60 +lat_0=40 +lon_0=-97 +R=6371229"
    x, y = np.meshgrid(1.9e6 + np.arange(5) * 2e4, 2e5 + np.arange(4) * 2e4)
    lon, lat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    one = {"units": "m/s", "grid_mapping": "crs", "coordinates": "latitude longitude t", "long_name": "wind at 80 m"}
    path = wf.write_netcdf(
        tmp_path / "l.nc",
        {
            "t": ((), np.int32(12), {"units": "hours since 2013-07-10"}),
            "latitude": (("y", "x"), lat, {"units": "degrees_north"}),
            "longitude": (("y", "x"), lon, {"units": "degrees_east"}),
            "crs": ((), np.int32(0), {"grid_mapping_name": "lambert_conformal_conic", "standard_parallel": np.array([30.0, 60.0]), "longitude_of_central_meridian": -97.0}),
            "U": (("y", "x"), np.full((4, 5), 3.0), {"standard_name": "x_wind", **one}),
            "V": (("y", "x"), np.full((4, 5), 4.0), {"standard_name": "y_wind", **one}),
        },
    )  # fmt: skip
    (found,) = read_weather([path])
    east, north = turned_by_pyproj(crs, lat.ravel(), lon.ravel(), 3.0, 4.0)
    np.testing.assert_allclose(wind_of(found, 80.0)[0][0, 0], east, atol=2e-3)
    np.testing.assert_allclose(wind_of(found, 80.0)[1][0, 0], north, atol=2e-3)


def test_a_taf_is_read_as_avwx_reads_it(shared_data):
    path = shared_data / "forecast" / "kjfk_taf.json"
    (found,) = read_weather([path])
    checked = 0
    for group in json.loads(path.read_text())["data"]["forecast"]:
        if group["type"] != "FROM" or group["wind_speed"] is None:
            continue
        begin = np.datetime64(group["start_time"]["dt"][:19], "s").astype(np.int64)
        north, east = vector(group["wind_speed"]["value"] * 1852 / 3600, group["wind_direction"]["value"])
        at = np.flatnonzero(found.times_s == begin + 3600)[0]  # avwx takes half hours for whole ones
        if group["raw"].startswith("0903"):
            continue  # it lasts half an hour
        np.testing.assert_allclose([wind_of(found)[1][0, at, 0], wind_of(found)[0][0, at, 0]], [north, east], atol=1e-9)
        checked += 1
    assert checked == 5


@pytest.mark.parametrize(
    ("groups", "hour", "knots", "degrees", "gust"),
    [
        ("22010G20KT", 5, 10, 220, 20),
        ("22010KT FM101530 30020G35KT", 2, 10, 220, None),
        ("22010KT FM101530 30020G35KT", 4, 20, 300, 35),
        ("22010KT BECMG 1014/1018 22020KT", 4, 15, 220, None),
        ("22010KT TEMPO 1014/1018 32025G40KT", 4, 10, 220, 40),
        ("22010KT PROB30 TEMPO 1014/1018 32025KT", 4, 10, 220, 25),
        ("22010KT FM101600 VRB03KT", 6, 3, 220, None),
        ("00000KT CAVOK", 3, 0, 0, None),
        ("22005MPS 9999", 3, 5 * 3600 / 1852, 220, None),
    ],
)
def test_change_groups_of_a_taf(tmp_path, groups, hour, knots, degrees, gust):
    path = tmp_path / "taf.txt"
    path.write_text(f"TAF KJFK 101120Z 1012/1118 {groups}=\n")
    (found,) = read_weather([path], near_s=wf.ISSUED_S, stations={"KJFK": (40.64, -73.78)})
    at = np.flatnonzero(found.times_s == wf.ISSUED_S + 3600.0 * hour)[0]
    north, east = vector(knots * 1852 / 3600, degrees)
    np.testing.assert_allclose([wind_of(found)[1][0, at, 0], wind_of(found)[0][0, at, 0]], [north, east], atol=1e-9)
    gusts = found.fields.get(FieldKey(GUST, 10.0), np.full_like(wind_of(found)[0], np.nan))
    np.testing.assert_allclose(gusts[0, at, 0], np.nan if gust is None else gust * 1852 / 3600)


def test_the_blend_and_metars_in_json_are_read_as_avwx_reads_them(shared_data):
    path = shared_data / "forecast" / "kjfk_nbm_hourly_20231017.json"
    (found,) = read_weather([path])
    for at, hour in enumerate(json.loads(path.read_text())["data"]["forecast"]):
        assert found.times_s[at] == np.datetime64(hour["time"]["dt"][:19], "s").astype(np.int64)
        north, east = vector(hour["wind_speed"]["value"] * 1852 / 3600, hour["wind_direction"]["value"])
        np.testing.assert_allclose([wind_of(found)[1][0, at, 0], wind_of(found)[0][0, at, 0]], [north, east], atol=1e-9)
    (metars,) = read_weather([shared_data / "forecast" / "kjfk_metar.json"])
    assert (metars.observed, len(metars.times_s)) == (True, 2)
    assert metars.times_s[-1] == np.datetime64("2023-10-17T05:51:00", "s").astype(np.int64)


def test_our_own_table_is_read_with_its_sites_and_members(tmp_path):
    rows = [
        f"2013-07-10T{12 + h}:00Z,{s},{m},5,270,{p}"
        for m, p in (("a", 0.25), ("b", 0.75))
        for h in range(2)
        for s in ("EWR", "JFK")
    ]
    path = tmp_path / "f.csv"
    path.write_text("time,site,member,speed_mps,from_deg,probability\n" + "\n".join(rows))
    (found,) = read_weather([path], stations={"EWR": (40.69, -74.17)})
    assert (found.members, found.places.names, found.holds, found.probability.tolist()) == (
        ("a", "b"),
        ("EWR", "JFK"),
        True,
        [0.25, 0.75],
    )


@pytest.mark.parametrize("form", ["of the climate data store", "packed, of before 2024", "of cfgrib"])
def test_era5_is_read_as_it_is_delivered(tmp_path, form):
    lat, lon, hours = np.array([41.0, 40.5]), np.array([-74.5, -74.0, -73.5]), np.arange(3)
    u = 2.0 + np.arange(18.0).reshape(3, 2, 3)
    steps = form == "of cfgrib"
    time = "step" if steps else "valid_time" if "store" in form else "time"
    said = {"units": "m s**-1"}
    packed = (
        {"scale_factor": 0.5, "add_offset": 1.0, "_FillValue": np.int16(-32767), "missing_value": np.int16(-32767)}
        if "packed" in form
        else {}
    )
    variables = {
        "latitude": (("latitude",), lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "longitude": (("longitude",), lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    if steps:
        variables["time"] = (
            (),
            np.int64(wf.ISSUED_S),
            {"units": "seconds since 1970-01-01", "standard_name": "forecast_reference_time"},
        )
        variables["step"] = (("step",), hours.astype(float), {"units": "hours", "standard_name": "forecast_period"})
        variables["valid_time"] = (
            ("step",),
            (wf.ISSUED_S + 3600 * hours).astype(np.int64),
            {"units": "seconds since 1970-01-01", "standard_name": "time"},
        )
        variables["number"] = ((), np.int64(0), {"standard_name": "realization", "units": "1"})
    elif "packed" in form:
        variables["time"] = (
            ("time",),
            (np.int32(round((wf.ISSUED_S - np.datetime64("1900-01-01", "s").astype(float)) / 3600)) + hours).astype(
                np.int32
            ),
            {"units": "hours since 1900-01-01 00:00:00.0", "calendar": "gregorian"},
        )
    else:
        variables["valid_time"] = (
            ("valid_time",),
            (wf.ISSUED_S + 3600 * hours).astype(np.int64),
            {"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"},
        )
    for name, long_name, standard in (
        ("u10", "10 metre U wind component", "eastward_wind"),
        ("v10", "10 metre V wind component", "northward_wind"),
        ("u100", "100 metre U wind component", "unknown"),
        ("v100", "100 metre V wind component", "unknown"),
    ):
        values = u + (10.0 if "100" in name else 0.0)
        stored = np.round((values - 1.0) / 0.5).astype(np.int16) if packed else values.astype(np.float32)
        more = {"coordinates": "number valid_time time"} if steps else {}
        variables[name] = (
            (time, "latitude", "longitude"),
            stored,
            {"long_name": long_name, **({} if packed else {"standard_name": standard}), **said, **packed, **more},
        )
    (found,) = read_weather([wf.write_netcdf(tmp_path / "era5.nc", variables, version=3 if packed else 4)])
    assert found.wind_heights_m == (10.0, 100.0)
    assert found.times_s.tolist() == [wf.ISSUED_S + 3600.0 * hour for hour in hours]
    np.testing.assert_allclose(wind_of(found, 100.0)[0][0].reshape(3, 2, 3), u + 10.0)
    assert (found.issued_s == wf.ISSUED_S) is steps


def write_triangles(folder, *, places=True, count=600):
    """10 m wind on points that no formula gives, and the files of their latitudes and longitudes."""
    ec = loaded_eccodes()
    rng = np.random.default_rng(5)
    lat, lon = rng.uniform(39.5, 41.8, count), rng.uniform(-75.2, -72.6, count)
    wind = {"v.grib2": (0, 2, 3, 2.0 + 3.0 * (lat - 40.7)), "u.grib2": (0, 2, 2, -4.0 + 2.0 * (lon + 74.0))}
    axes = {"clon.grib2": (0, 191, 2, lon), "clat.grib2": (0, 191, 1, lat)}
    paths = []
    for name, (discipline, category, number, values) in {**wind, **(axes if places else {})}.items():
        handle = ec.codes_grib_new_from_samples("GRIB2")
        keys = {"gridType": "unstructured_grid", "numberOfDataPoints": count, "numberOfGridUsed": 26, "uuidOfHGrid": bytes(range(16)).hex(),
                "centre": "edzw", "discipline": discipline, "parameterCategory": category, "parameterNumber": number, "dataDate": 20130710,
                "dataTime": 1200, "bitsPerValue": 24}  # fmt: skip
        for key, value in keys.items():
            ec.codes_set(handle, key, value)
        if category == 2:
            ec.codes_set(handle, "typeOfFirstFixedSurface", 103)
            ec.codes_set(handle, "scaledValueOfFirstFixedSurface", 10)
            ec.codes_set(handle, "scaleFactorOfFirstFixedSurface", 0)
        ec.codes_set_values(handle, values)
        paths.append(folder / name)
        with paths[-1].open("wb") as stream:
            ec.codes_write(handle, stream)
        ec.codes_release(handle)
    return paths


def test_triangles_are_placed_by_their_latitudes_and_longitudes_in_whatever_order_files_come(tmp_path):
    pytest.importorskip("eccodes")
    for order in (slice(None), slice(None, None, -1)):
        (found,) = read_weather(write_triangles(tmp_path)[order], NY)
        at = found.places
        np.testing.assert_allclose(wind_of(found)[0][0, 0], -4.0 + 2.0 * (at.lon + 74.0), atol=1e-4)
        np.testing.assert_allclose(wind_of(found)[1][0, 0], 2.0 + 3.0 * (at.lat - 40.7), atol=1e-4)
        assert 0 < len(at) < 600
        assert 3_000.0 < at.spacing_m < 15_000.0  # 600 points on 56,000 km2
        placed = Placing(found, np.array([40.7]), np.array([-73.9]), NY)
        np.testing.assert_allclose(placed(wind_of(found)[1])[0, 0], [2.0], atol=1e-3)
    (tmp_path / "one.grib2").write_bytes(b"".join(path.read_bytes() for path in write_triangles(tmp_path)))
    assert len(read_weather([tmp_path / "one.grib2"], NY)) == 1
    with pytest.raises(InputError, match="add the files CLAT and CLON"):
        read_weather(write_triangles(tmp_path, places=False), NY)


def write_levels(path, *, geopotential, near=False):
    """Wind at 1000, 950, 900 hPa, with the geopotential of these and of the ground, or without."""
    ec = loaded_eccodes()
    fields = [("isobaricInhPa", hpa, name, 0.02 * (1000 - hpa) + 5.0) for hpa in (1000, 950, 900, 500) for name in "uv"]
    if geopotential:
        fields += [("isobaricInhPa", hpa, "z", 9.80665 * (250.0 + 9.0 * (1000 - hpa))) for hpa in (1000, 950, 900)]
        fields += [("surface", 0, "z", 9.80665 * 150.0)]
    if near:
        fields += [("heightAboveGround", 10, name, 3.0) for name in ("10u", "10v")]
    with path.open("wb") as stream:
        for kind, level, name, value in fields:
            handle = ec.codes_grib_new_from_samples("regular_ll_pl_grib2" if level > 100 else "regular_ll_sfc_grib2")
            wf._set_grid(ec, handle, "regular_ll")
            for key, given in (
                ("dataDate", 20130710),
                ("dataTime", 1200),
                ("typeOfLevel", kind),
                ("level", level),
                ("shortName", name),
            ):
                ec.codes_set(handle, key, given)
            ec.codes_set_values(handle, np.full(117, value) + np.linspace(0.0, 1e-3, 117))
            ec.codes_write(handle, stream)
            ec.codes_release(handle)
    return path


@pytest.mark.parametrize("geopotential", [True, False])
def test_winds_at_pressure_levels_become_winds_at_heights_and_say_so(tmp_path, geopotential):
    pytest.importorskip("eccodes")
    (found,) = read_weather([write_levels(tmp_path / "p.grib2", geopotential=geopotential)])
    if geopotential:
        assert found.wind_heights_m == pytest.approx((100.0, 550.0, 1000.0), abs=0.2)
        assert "by the geopotential in the file, above the model's ground" in found.notes[-1]
    else:  # ISO 2533: 1000 hPa at 110.9 m, 950 at 540.3 m, 900 at 988.5 m
        assert found.wind_heights_m == pytest.approx((110.9, 540.3, 988.5), abs=0.5)
        assert "by the standard atmosphere, above sea level" in found.notes[-1]
    east, _ = wind_of(found, found.wind_heights_m[1])
    assert east.mean() == pytest.approx(6.0, abs=0.01)
    (near,) = read_weather([write_levels(tmp_path / "n.grib2", geopotential=geopotential, near=True)])
    assert near.wind_heights_m == (10.0,)
