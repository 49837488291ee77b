"""Weather files that are damaged, or not what they should be: one clear error each."""

import numpy as np
import pytest
import weather_files as wf
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.weather.readers.reading import read_weather

SPEED = {"wind_speed_10m": "km/h", "wind_direction_10m": "°"}


@pytest.fixture(scope="module")
def grib(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grib")
    return wf.write_grib(
        folder / "a.grib2", lambda _m, hour, _h, lat, _lon: (hour + 0 * lat, lat), hours=(0, 1)
    ).read_bytes()


def nc(path, **eastly):
    attributes = {"standard_name": "eastward_wind", "units": "m s-1", **eastly.pop("attributes", {})}
    lat = eastly.pop("lat", np.array([40.0, 41.0]))
    units = eastly.pop("time_units", "hours since 2013-07-10")
    return wf.write_netcdf(
        path,
        {
            "time": (("time",), np.array([12.0]), {"units": units, "calendar": eastly.pop("calendar", "standard")}),
            "lat": (("lat",), lat, {"units": "degrees_north"}),
            "lon": (("lon",), np.array([-75.0, -74.0]), {"units": "degrees_east"}),
            "a": (("time", "lat", "lon"), np.zeros((1, 2, 2)), attributes),
        },
    )  # fmt: skip


CASES = {
    "cut off": (lambda p, g: p.write_bytes(g[:-10]), r"message 8, byte \d+: is cut off, 10 bytes are missing; download the file again"),
    "no end": (lambda p, g: p.write_bytes(g[:-4] + b"XXXX"), r"message 8, .*does not end as a GRIB message must"),
    "edition": (lambda p, g: p.write_bytes(g[:7] + b"\x02" + g[8:250].replace(b"GRIB", b"....") + b"GRIB\0\0\0\x09" + b"\0" * 99), "cut off|unknown edition"),
    "empty": (lambda p, _: p.write_bytes(b""), "is empty"),
    "html": (lambda p, _: p.write_text("<html>Not found</html>"), "of no form that is read here .*<html>"),
    "binary": (lambda p, _: p.write_bytes(b"\0\1\2\3" * 99), "of no form that is read here"),
    "json": (lambda p, _: p.write_text('{"hourly": '), "is damaged JSON"),
    "other json": (lambda p, _: p.write_text('{"a": 1}'), "is JSON, but no weather"),
    "refused": (lambda p, _: p.write_text('{"error": true, "reason": "Too many requests"}'), "the service refused .Too many requests"),
    "unit": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1, 2, 3]}, {"wind_speed_10m": "bft"})), r"hourly.wind_speed_10m: not a unit .*bft"),
    "count": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1]}, SPEED)), "has 1 values for 3 times"),
    "word": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1, "x", 3]}, SPEED)), "a value that is not a number"),
    "place": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1, 2, 3]}, SPEED, lat=140.0)), "lat"),
    "nc wrong variable": (lambda p, _: nc(p, attributes={"standard_name": "sea_water_temperature"}), "no variable of the weather, but a; wind needs standard_name"),
    "nc unit": (lambda p, _: nc(p, attributes={"units": "furlong"}), "a:units: not a unit of speed .*furlong"),
    "nc swapped": (lambda p, _: nc(p, lat=np.array([100.0, 101.0])), "latitudes beyond 90°: lat and lon look swapped"),
    "nc calendar": (lambda p, _: nc(p, calendar="noleap"), "time: not a unit of time .*noleap"),
    "nc time": (lambda p, _: nc(p, time_units="fortnights since May"), "not a unit of time .*fortnights"),
    "nc along a grid": (lambda p, _: nc(p, attributes={"standard_name": "x_wind"}), "along the axes of a grid of unknown direction"),
    "nc cut off": (lambda p, _: (nc(p), p.write_bytes(p.read_bytes()[:1500])), "is a damaged NetCDF file"),
    "taf period": (lambda p, _: p.write_text("TAF KJFK 101120Z 1012/1099 22010KT"), "no such day and hour"),
    "taf wind": (lambda p, _: p.write_text("TAF KJFK 101120Z 1012/1118 CAVOK"), "KJFK: has no wind"),
    "taf direction": (lambda p, _: p.write_text("TAF KJFK 101120Z 1012/1118 44410KT"), "not a direction .*44410KT"),
    "taf nil": (lambda p, _: p.write_text("TAF AMD KJFK 101120Z NIL="), "no TAF in force, only NIL or CNL .*KJFK 101120Z NIL"),
    "taf cancelled": (lambda p, _: p.write_text("TAF KJFK 101120Z 1012/1118 22010KT=\nTAF AMD KJFK 101300Z 1013/1118 CNL="), "no TAF in force"),
    "negative": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1, -5, 3]}, SPEED)), r"a wind speed of -1.38889 m/s: impossible; check its unit"),
    "direction": (lambda p, _: wf.write_json(p, wf.open_meteo({"wind_speed_10m": [1, 2, 3], "wind_direction_10m": [10, 725, 3]}, SPEED)), "a wind direction of 725"),
    "gap by number": (lambda p, _: wf.write_json(p, wf.open_meteo({"temperature_2m": [20, -9999, 3]}, {"temperature_2m": "°C"})), "a temperature of -9725.85 K"),
    "csv": (lambda p, _: p.write_text("idate,vdate,station\n1,2,3\n"), "of no form that is read here .*idate"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_damaged_file_is_one_clear_line_that_names_it(tmp_path, grib, case):
    make, said = CASES[case]
    path = tmp_path / "weather.dat"
    make(path, grib)
    with pytest.raises(InputError, match=said) as caught:
        read_weather([path], near_s=wf.ISSUED_S)
    assert len(caught.value.faults) == 1
    assert str(path) in str(caught.value)


@pytest.fixture(scope="module")
def spoilt(grib, tmp_path_factory):
    """A function that writes the first messages with some bytes changed."""
    path = tmp_path_factory.mktemp("w") / "a.grib2"

    def spoil(changes):
        octets = bytearray(grib[: grib.index(b"7777") + 4])
        for place, value in changes:
            octets[place] = value
        path.write_bytes(octets)
        return path

    return spoil


@settings(max_examples=60, derandomize=True)
@given(changes=st.lists(st.tuples(st.integers(8, 170), st.integers(0, 255)), min_size=1, max_size=3))
def test_a_grib_with_wrong_bytes_is_read_or_refused_never_a_crash(spoilt, changes):
    path = spoilt(changes)
    try:
        read_weather([path], near_s=wf.ISSUED_S)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017


def test_speeds_without_directions_cannot_be_planned_with(shared_data):
    for name in ("openmeteo_melbourne_20251025.json", "openmeteo_newyork_20251228.json"):
        (found,) = read_weather([shared_data / "forecast" / name])
        with pytest.raises(InputError, match="but no direction: unusable for planning; ask for the direction"):
            found.needs_wind()
