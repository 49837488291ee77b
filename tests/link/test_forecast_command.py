"""What yesterday's drones measured becomes the forecast that today's plan is made with."""

import csv
import json
from datetime import UTC, datetime

import numpy as np
import pytest
from drone_truth import fly

from skyway.cli.main import main
from skyway.models.drones.drag import DragModel
from skyway.models.drones.drag_file import drag_file

TAKE_OFF = datetime(2013, 7, 10, 17, 0, tzinfo=UTC).timestamp()
WIND = (-6.0, 5.0)
"""True mean wind, (north, east) TOWARDS: 7.8 m/s from 320 degrees."""


@pytest.fixture
def skyway(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments, code=0):
        capsys.readouterr()
        assert main([str(argument) for argument in arguments]) == code
        return capsys.readouterr()

    return run


def write_log(path, *, seed=0, lat=40.75, lon=-73.95, begin_s=TAKE_OFF):
    """A flight of 3 minutes near New York at 60 m, as a table that carries the names of telemetry."""
    track = fly(seed=seed, duration_s=180.0, mean=WIND, sigma_mps=0.5, c1=0.3, c2=0.0).track(0)
    names = ("vel_north_mps", "vel_east_mps", "vel_down_mps", "roll_rad", "pitch_rad", "yaw_rad", "height_m", "landed")
    columns = [begin_s + track.time_s - track.time_s[0], *(track[name] for name in names)]
    columns += [np.full(len(track), lat), np.full(len(track), lon)]
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time_s", *names, "lat_deg", "lon_deg"])
        writer.writerows(zip(*(column.tolist() for column in columns), strict=True))


@pytest.fixture
def logs(tmp_path):
    write_log(tmp_path / "one.csv", seed=1)
    write_log(tmp_path / "two.csv", seed=2, lat=40.85, lon=-73.80, begin_s=TAKE_OFF + 900.0)
    (tmp_path / "drag.toml").write_text(drag_file(DragModel(linear_per_s=0.3)))


@pytest.mark.usefixtures("logs")
def test_two_logs_are_fused_and_the_forecast_comes_nearer_to_what_they_measured(skyway):
    report = json.loads(skyway("forecast", "one.csv", "two.csv", "--drag", "drag.toml", "--json").out)
    assert report["schema"] == "skyway.forecast-update/1"
    assert len(report["observations"]) == 4
    now, later = report["hours"][0], report["hours"][-1]
    assert now["after"]["speed_mps"] == pytest.approx(7.8, abs=1.5)
    assert now["after"]["from_deg"] == pytest.approx(320.0, abs=15.0)
    assert now["after"]["sigma_mps"] < 0.6 * now["before"]["sigma_mps"]
    assert later["after"]["sigma_mps"] > now["after"]["sigma_mps"]
    assert {row["site"] for row in report["field"]} == {"EWR", "JFK", "LGA"}


def test_a_log_without_a_date_is_refused_with_what_would_have_one(skyway, tmp_path):
    write_log(tmp_path / "undated.csv", begin_s=0.0)
    told = skyway("forecast", "undated.csv", code=2).err
    assert "has no date" in told
    assert "GPS time" in told
    assert "--wind" not in told


@pytest.mark.usefixtures("logs")
def test_the_wind_that_is_told_at_each_site_is_that_of_the_written_forecast(skyway, tmp_path):
    report = json.loads(skyway("forecast", "one.csv", "two.csv", "--drag", "drag.toml", "-o", "new.csv", "--json").out)
    rows = list(csv.DictReader((tmp_path / "new.csv").read_text().splitlines()))
    now = max(row["time"] for row in rows if row["time"] <= report["depart"])
    for told in report["field"]:
        winds = [row for row in rows if (row["site"], row["time"]) == (told["site"], now)]
        mean = sum(float(row["speed_mps"]) * float(row["probability"]) for row in winds)
        assert told["speed_mps"] == pytest.approx(mean, abs=0.01)
        assert told["p10_mps"] < mean < told["p90_mps"]


@pytest.mark.usefixtures("logs")
def test_the_wind_at_the_sites_is_surer_with_each_drone(skyway):
    def sigma(*names):
        options = ("--depart", "2013-07-10T17:31:00Z", "--drag", "drag.toml", "--json")
        return {row["site"]: row["sigma_mps"] for row in json.loads(skyway("forecast", *names, *options).out)["field"]}

    both, one, none = sigma("one.csv", "two.csv"), sigma("one.csv"), sigma()
    assert all(both[site] < 0.8 * none[site] for site in none)
    assert sum(both.values()) < sum(one.values())


@pytest.mark.usefixtures("logs")
def test_the_written_forecast_is_read_back_by_plan_and_wind(skyway, tmp_path):
    told = skyway("forecast", "one.csv", "two.csv", "--drag", "drag.toml", "-o", "new.csv", "--slot", "30").out
    assert "4 measurements of 2.5 minutes" in told
    assert "plan --forecast new.csv" in told
    shown = json.loads(
        skyway("wind", "--forecast", "new.csv", "--depart", "2013-07-10T17:30:00Z", "--hours", "1", "--json").out
    )
    assert shown["hours"][0]["from_deg"] == pytest.approx(320.0, abs=20.0)
    assert "exists already" in skyway("forecast", "one.csv", "-o", "new.csv", code=2).err
    assert (tmp_path / "new.csv").stat().st_size > 10_000


def test_without_logs_the_forecast_of_the_record_is_written_as_it_is(skyway):
    skyway("forecast", "--depart", "2013-07-10T17:00:00Z", "-o", "plain.csv", "--hours", "3")
    again = json.loads(
        skyway("forecast", "--forecast", "plain.csv", "--depart", "2013-07-10T17:00Z", "--hours", "3", "--json").out
    )
    assert again["observations"] == []
    assert again["hours"][0]["before"] == again["hours"][0]["after"]


@pytest.mark.usefixtures("logs")
def test_a_replay_is_compared_with_the_forecast_of_the_record_at_the_height_that_is_flown(skyway):
    report = json.loads(skyway("replay", "one.csv", "--drag", "drag.toml", "--scenario", "newyork", "--json").out)
    told = report["wind_summary"]["forecast"]
    assert told["vector_rms_mps"] >= told["vector_difference_mps"] > 0.0
    assert 0.0 < told["speed_mps"] < 15.0
    skyway("forecast", "--depart", "2013-07-10T17:00:00Z", "-o", "plain.csv", "--hours", "48")
    same = json.loads(skyway("replay", "one.csv", "--drag", "drag.toml", "--forecast", "plain.csv", "--json").out)
    assert same["wind_summary"]["forecast"]["speed_mps"] == pytest.approx(told["speed_mps"], abs=0.02)


@pytest.mark.usefixtures("logs")
def test_measurements_after_the_departure_do_not_count(skyway, tmp_path):
    between = ("--drag", "drag.toml", "--depart", "2013-07-10T17:05:00Z", "--json")
    answer = skyway("forecast", "one.csv", "two.csv", *between)
    assert "2 measurements after the departure: ignored" in answer.err
    assert answer.out == skyway("forecast", "one.csv", *between).out
    before = ("--drag", "drag.toml", "--depart", "2013-07-10T16:00:00Z", "-o", "new.csv")
    answer = skyway("forecast", "one.csv", *before, code=2)
    assert "2 measurements after the departure: ignored" in answer.err
    assert "no measurement of the logs counts for a departure at" in answer.err
    assert not (tmp_path / "new.csv").exists()


@pytest.mark.usefixtures("logs")
def test_a_log_given_twice_counts_once(skyway, tmp_path):
    (tmp_path / "copy.csv").write_bytes((tmp_path / "one.csv").read_bytes())
    answer = skyway("forecast", "one.csv", "copy.csv", "--drag", "drag.toml", "--json")
    assert "copy.csv: 2 measurements as in an earlier log: counted once" in answer.err
    assert answer.out == skyway("forecast", "one.csv", "--drag", "drag.toml", "--json").out


def test_measurements_far_from_every_site_or_of_another_day_change_nothing(skyway, tmp_path):
    write_log(tmp_path / "far.csv", lat=47.0, lon=8.0)
    write_log(tmp_path / "old.csv", begin_s=TAKE_OFF - 3 * 86_400.0)
    (tmp_path / "drag.toml").write_text(drag_file(DragModel(linear_per_s=0.3)))
    write_log(tmp_path / "one.csv")
    asked = ("--drag", "drag.toml", "--depart", "2013-07-10T17:10:00Z", "--json")
    answer = skyway("forecast", "far.csv", "old.csv", "one.csv", *asked)
    assert "km from every wind site" in answer.err
    assert "more than 24 h before the departure" in answer.err
    assert answer.out == skyway("forecast", "one.csv", *asked).out
    assert "no measurement of the logs counts" in skyway("forecast", "far.csv", "old.csv", *asked, code=2).err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no time is known for the forecast"),
        (("missing.csv",), "cannot be read"),
        (("--slot", "0"), "out of range"),
        (("--depart", "noon"), "--depart"),
        (("--forecast", "missing.csv", "--depart", "2013-07-10T17:00Z"), "missing.csv"),
        (("hollow.csv",), "has no date"),
    ],
)
def test_bad_input_is_one_line(skyway, tmp_path, arguments, message):
    (tmp_path / "hollow.csv").write_text("time_s,soc\n0,1\n1,1\n")
    answer = skyway("forecast", *arguments, code=2)
    assert message in answer.err
    assert len(answer.err.splitlines()) == 1
