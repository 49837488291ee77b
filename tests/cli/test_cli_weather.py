"""The weather commands as they are typed."""

import json
import sys

import pytest
import weather_files as wf

from skyway.cli.main import main


def run(capsys, *words):
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nam_conus80km_20180917_00z_f000.grib2", ["GRIB, NAM, issued 2018-09-17 00:00 UTC, single forecast", "lambert 93 x 65, 79.1 km apart", "and 166 more"]),
        ("openmeteo_newyork_20251228.json", ["issue time unknown", "2025-12-28 00:00 UTC to", "Not for planning: has wind speeds or gusts, but no direction"]),
        ("kjfk_taf.json", ["TAF, KJFK, issued 2024-05-09 03:15 UTC", "2024-05-09 03:00 UTC to 2024-05-10 06:00 UTC", "visibility"]),
        ("gfs_wind_heights_baltic_20230720.nc", ["10 times, usually every 3 h", "54.08° N to 54.99° N, 13.08° E to 13.99° E"]),
    ],
)  # fmt: skip
def test_weather_shows_what_a_file_holds(capsys, shared_data, name, says):
    code, out, err = run(capsys, "weather", str(shared_data / "forecast" / name))
    assert (code, err) == (0, "")
    words = " ".join(out.split())  # wherever the lines of this terminal end
    assert [one for one in says if one not in words] == []


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


REQUEST = ("--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", "2013-07-10T10:30-04:00")


@pytest.fixture(scope="module")
def westerly(tmp_path_factory):
    """Ten hours of 7 m/s from 270 degrees at 80 m over New York, by Open-Meteo in km/h."""
    path = tmp_path_factory.mktemp("w") / "a.json"
    columns = {"wind_speed_80m": [25.2] * 10, "wind_direction_80m": [270] * 10}
    return wf.write_json(path, wf.open_meteo(columns, {"wind_speed_80m": "km/h", "wind_direction_80m": "°"}, hours=10))


def test_every_command_flies_in_the_forecast_that_is_handed_over(capsys, tmp_path, westerly):
    code, out, _ = run(capsys, "wind", *REQUEST[6:], "--forecast", str(westerly), "--hours", "3", "--json")
    hours = json.loads(out)["hours"]
    assert code == 0
    assert [abs(one["from_deg"] - 270.0) < 15.0 and 6.0 < one["mean_mps"] < 8.5 for one in hours] == [True] * 3
    code, out, err = run(capsys, "plan", *REQUEST, "--forecast", str(westerly), "-o", str(tmp_path / "p.json"))
    assert code == 0, err
    assert "Open-Meteo best match: its one course is given errors: published figures" in " ".join(out.split())
    plan = json.loads((tmp_path / "p.json").read_text())
    assert plan["legs"][0]["wind"]["from_deg"] == pytest.approx(270.0, abs=15.0)
    code, out, err = run(capsys, "mission", str(tmp_path / "p.json"), "-o", str(tmp_path / "m.plan"))
    assert code == 0, err
    words = (
        "check",
        str(tmp_path / "m.plan"),
        "--scenario",
        "newyork",
        "--depart",
        REQUEST[-1],
        "--payload",
        "0.8",
        "--drone",
        "m300",
    )
    checked = {}
    for name, more in (("record", ()), ("forecast", ("--forecast", str(westerly))), ("steady", ("--wind", "6.6@270"))):
        code, out, err = run(capsys, *(words if name != "steady" else (*words[:4], *words[6:])), *more, "--json")
        assert code == 0, err
        checked[name] = json.loads(out)
    assert checked["forecast"] != checked["record"]


def test_weather_for_a_scenario_and_a_departure_says_what_a_plan_would_fly_in(capsys, westerly):
    words = ("weather", str(westerly), "--scenario", "newyork", "--depart")
    code, out, _ = run(capsys, *words, REQUEST[-1])
    assert code == 0
    assert "from 2013-07-10 14:30 UTC on: WindEnsemble(60 members" in out
    code, _, err = run(capsys, *words, "2013-07-13T10:30-04:00")
    assert code == 2
    assert f"{westerly}: does not cover the departure at 2013-07-13T14:30:00Z" in err
    assert "fetch a newer forecast" in err


def test_a_scenario_flies_in_the_forecast_that_it_names(capsys, tmp_path, westerly):
    folder = tmp_path / "s"
    assert run(capsys, "scenario", "init", str(folder))[0] == 0
    toml = folder / "scenario.toml"
    toml.write_text(toml.read_text() + f'\n[forecast]\nfiles = ["{westerly}"]\n')
    code, out, err = run(capsys, "wind", str(folder), "--depart", REQUEST[-1], "--hours", "2", "--json")
    assert code == 2, out  # the template lies elsewhere
    assert "does not cover the region" in err
    toml.write_text(toml.read_text().replace("[forecast]", "[forecast]\nfile = 1"))
    assert "forecast.file" in run(capsys, "scenario", "check", str(folder))[2]


def test_a_forecast_for_drones_to_update_may_have_any_form(capsys, tmp_path, westerly):
    table = tmp_path / "f.csv"
    code, _, err = run(capsys, "forecast", "--forecast", str(westerly), *REQUEST[6:], "--hours", "3", "-o", str(table))
    assert code == 0, err
    code, out, _ = run(capsys, "wind", *REQUEST[6:], "--forecast", str(table), "--hours", "2", "--json")
    assert (code, abs(json.loads(out)["hours"][0]["from_deg"] - 270.0) < 15.0) == (0, True)


def test_verify_learns_an_error_that_plan_uses(capsys, tmp_path, westerly):
    seen = tmp_path / "seen.csv"
    rows = [
        f"2013-07-10T{hour}:{minute}0Z,JFK,{5 + hour % 3},{260 + minute}"
        for hour in range(12, 21)
        for minute in range(6)
    ]
    seen.write_text("time,site,speed_mps,from_deg\n" + "\n".join(rows))
    learnt, picture = tmp_path / "e.json", tmp_path / "e.svg"
    words = ("weather", "verify", str(westerly), "--observed", str(seen), "-o", str(learnt), "--plot", str(picture))
    code, out, err = run(capsys, *words)
    assert code == 0, err
    assert "bias" in out
    assert picture.stat().st_size > 2000
    code, out, err = run(capsys, *words, "--force", "--json")
    assert (code, json.loads(out)["learnt"]["pairs"]) == (0, 54)
    code, out, err = run(
        capsys,
        "wind",
        *REQUEST[6:],
        "--forecast",
        str(westerly),
        "--forecast-error",
        str(learnt),
        "--json",
        "--hours",
        "2",
    )
    assert code == 0, err
    assert run(capsys, "wind", *REQUEST[6:], "--forecast-error", str(learnt))[0] == 2


def test_gusts_beyond_a_limit_close_hours_of_a_plan(capsys, tmp_path):
    names = ("wind_speed_80m", "wind_direction_80m", "wind_gusts_10m", "precipitation")
    columns = {name: [value] * 10 for name, value in zip(names, (5.0, 270, 8.0, 0.0), strict=True)}
    columns["wind_gusts_10m"][2:5] = [16.0] * 3
    units = dict(zip(names, ("m/s", "°", "m/s", "mm"), strict=True))
    path = wf.write_json(tmp_path / "a.json", wf.open_meteo(columns, units, hours=10))
    folder = tmp_path / "s"
    assert run(capsys, "scenario", "init", str(folder))[0] == 0
    toml = folder / "scenario.toml"
    toml.write_text(toml.read_text() + "\n[limits]\ngust_mps = 14\nno_icing = true\n")
    from skyway.scenarios import load_scenario

    world = load_scenario(folder)
    moved = wf.open_meteo(
        columns, units, hours=10, lat=float(world.network.lat.mean()), lon=float(world.network.lon.mean())
    )
    wf.write_json(path, moved)
    a, b = world.network.stations[0].id, world.network.stations[1].id
    words = (
        "plan",
        str(folder),
        "--from",
        a,
        "--to",
        b,
        "--payload",
        "0.5",
        "--depart",
        "2013-07-10T14:10Z",
        "--forecast",
        str(path),
        "--json",
    )
    code, out, err = run(capsys, *words)
    assert code == 0, err
    plan = json.loads(out)
    assert plan["legs"][0]["depart"] >= "2013-07-10T17:00"
    told = " ".join(plan["notes"])
    assert "because of gusts of up to 16 m/s (14 m/s at most)" in told
    assert "lacks the data: icing" in told
