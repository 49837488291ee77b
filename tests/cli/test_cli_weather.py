"""The weather commands as they are typed."""

import json
import sys

import pytest

from skyway.cli.main import main


def run(capsys, *words):
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nam_conus80km_20180917_00z_f000.grib2", ["GRIB, NAM, issued 2018-09-17 00:00Z, 1 course", "lambert 93 x 65, 79.1 km apart", "and 167 more"]),
        ("openmeteo_newyork_20251228.json", ["issue time not told", "2025-12-28 00:00Z to", "Not for planning: has wind speeds or gusts, but no direction"]),
        ("kjfk_taf.json", ["TAF, KJFK, issued 2024-05-09 03:15Z", "2024-05-09 03:00Z to 2024-05-10 06:00Z", "visibility"]),
        ("gfs_wind_heights_baltic_20230720.nc", ["10 times, usually every 3 h", "54.08° N to 54.99° N, 13.08° E to 13.99° E"]),
    ],
)  # fmt: skip
def test_weather_shows_what_a_file_holds(capsys, shared_data, name, says):
    code, out, err = run(capsys, "weather", str(shared_data / "forecast" / name))
    assert (code, err) == (0, "")
    assert [one for one in says if one not in out] == []


def test_weather_as_json_has_the_same(capsys, shared_data):
    files = [str(shared_data / "forecast" / f"ecmwf_10{part}_20160925_13times.grib") for part in "uv"]
    code, out, _ = run(capsys, "weather", *files, "--json")
    (issue,) = json.loads(out)["issues"]
    assert (code, issue["model"], len(issue["times"]), issue["observed"], issue["unusable"]) == (
        0,
        "IFS",
        13,
        True,
        None,
    )
    assert [(one["quantity"], one["height_m"], one["missing"]) for one in issue["fields"]] == [("wind", 10.0, 0.0)]


def test_a_wrong_file_is_one_line_and_exit_code_2(capsys, tmp_path):
    wrong = tmp_path / "a.grib2"
    wrong.write_bytes(b"GRIB\0\0\0\2" + b"\0" * 7 + b"\x99abc")
    code, out, err = run(capsys, "weather", str(wrong))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"{wrong}: message 1, byte 0: is cut off" in err


def test_without_the_extra_one_line_names_it(capsys, shared_data, monkeypatch):
    monkeypatch.setitem(sys.modules, "eccodes", None)
    code, _, err = run(capsys, "weather", str(shared_data / "forecast" / "ecmwf_ens51_z850_tiny.grib"))
    assert code == 2
    assert "this needs eccodes, which is not installed: pip install 'skyway-planner[weather]'" in err
