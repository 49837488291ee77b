"""`skyway sim` as a user types it: every option in every form, in one short run each."""

import json
import re
import socket

import pytest

from skyway.cli.main import main
from skyway.cli.typed_words import BARE, fill

SHORT = ["--tcp", "0", "--speedup", "20", "--duration", "0.5"]


TWO_STATIONS = """id,name,lat,lon,elevation_m,pads,holding_spots
bellevue,Bellevue,40.7392,-73.9756,5,2,2
columbia,Columbia,40.8409,-73.9424,45,2,2
"""
SCENARIO = """schema = "skyway.scenario/1"
name = "Two"
timezone = "America/New_York"
[network]
stations = "stations.csv"
rule = "max-length"
max_length_m = 20000
"""


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A folder with two stations: quicker to read than all of New York."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "stations.csv").write_text(TWO_STATIONS, encoding="utf-8")
    (folder / "scenario.toml").write_text(SCENARIO, encoding="utf-8")
    return str(folder)


def run(capsys, *arguments):
    code = main(["sim", *SHORT, *arguments])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        (["--jitter"], ["--jitter=0.01"]),
        (["--jitter", "0.02"], ["--jitter", "0.02"]),
        (["--jitter=0.02"], ["--jitter=0.02"]),
        (["--jitter", "--duplicate", "--reorder"], ["--jitter=0.01", "--duplicate=0.02", "--reorder=0.02"]),
        (["--reorder", "folder", "--jitter"], ["--reorder=0.02", "folder", "--jitter=0.01"]),
        (["--duplicate", "-1"], ["--duplicate", "-1"]),
        (["--", "--jitter"], ["--", "--jitter"]),
    ],
)
def test_options_of_a_bad_link_stand_bare_or_with_a_number(typed, read):
    assert fill(typed, BARE["sim"]) == read


@pytest.mark.parametrize(
    "link",
    [
        ["--loss", "0.1", "--delay", "0.02", "--jitter", "--duplicate", "--reorder"],
        ["--jitter", "0.02", "--duplicate=0.1", "--reorder"],
    ],
)
def test_a_bad_link_as_it_is_typed(two, capsys, link):
    code, out, err = run(capsys, two, *link)
    assert (code, err) == (0, "")
    assert "ended" in out


def test_faults_as_they_are_typed_with_and_without_times(two, capsys):
    faults = [
        "gust@120s",
        "battery-sag",
        "link-loss@60s+20s",
        "gps",
        "battery-drop=0.1@0.3s",
        "pads-taken=bellevue@0.2s",
    ]
    code, out, err = run(capsys, two, "--at", "bellevue", *(word for fault in faults for word in ("--fault", fault)))
    assert (code, err) == (0, "")
    begun = re.findall(r"fault (\S+) begins", out)
    assert sorted(begun) == ["battery-drop", "battery-sag", "gps"], "the others come later"
    assert "pads of bellevue are taken" in out


def test_the_true_wind_is_8_from_270(two, capsys):
    code, _, err = run(capsys, two, "--wind", "8@270")
    assert (code, err) == (0, "")


@pytest.mark.parametrize("wind", ["2013-07-10", "forecast.csv"])
def test_the_true_wind_is_a_day_of_the_record_or_a_file(capsys, tmp_path, monkeypatch, wind):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "forecast.csv").write_text(
        "time,site,member,speed_mps,from_deg\n"
        + "".join(
            f"2013-07-10T{hour:02d}:00Z,{site},1,8,270\n" for hour in range(16, 24) for site in ("EWR", "JFK", "LGA")
        ),
        encoding="utf-8",
    )
    depart = ["--depart", "2013-07-10T14:00-04:00"]
    code, _, err = run(capsys, "--at", "bellevue", "--wind", wind, *depart)
    assert (code, err) == (0, "")


@pytest.mark.parametrize("vehicles", [1, 5])
def test_each_vehicle_says_where_it_is_reached_and_has_its_own_system_id(two, capsys, vehicles):
    arguments = [
        "--vehicles",
        str(vehicles),
        "--at",
        "bellevue",
        "--at",
        "columbia",
        "--autopilot",
        "ardupilot",
        "--duration",
        "5",
    ]
    code, out, _ = run(capsys, two, *arguments)
    assert code == 0
    assert len(set(re.findall(r"vehicle (\d+): tcp:127\.0\.0\.1:\d+", out))) == vehicles
    assert len(set(re.findall(r"vehicle (\d+) +autopilot is up", out))) == vehicles


def test_a_vehicle_connects_to_a_station_that_listens(two, capsys):
    with socket.create_server(("127.0.0.1", 0)) as station:
        code, out, err = run(capsys, two, "--connect", f"tcp:127.0.0.1:{station.getsockname()[1]}", "--duration", "5")
        assert (code, err) == (0, "")
        heard, _ = station.accept()
        with heard:
            assert heard.recv(4096)[0] == 0xFD
    assert "autopilot is up" in out


@pytest.mark.parametrize("connect", ["udpout:127.0.0.1:14540", "udpin:127.0.0.1:0", "tcpin:127.0.0.1:0"])
def test_every_kind_of_connection_opens(two, capsys, connect):
    code, out, err = run(capsys, two, "--connect", connect, "--pads", "tcp:127.0.0.1:0")
    assert (code, err) == (0, "")
    assert out.count("vehicle 1: ") == 2, "--tcp and --connect together"
    assert "pads: tcp:127.0.0.1:" in out


def test_json_lines_for_machines(two, capsys):
    code, out, _ = run(capsys, two, "--json", "--duration", "5")
    assert code == 0
    lines = [json.loads(line) for line in out.splitlines()]
    assert "listening" in lines[0]
    assert {"sim_s": 3.0, "system": 1, "event": "autopilot is up"} in lines


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fault", "storm"], "one of gust"),
        (["--fault", "pads-taken=nowhere"], "no station with pads"),
        (["--speedup", "21"], "0.1 to 20"),
        (["--loss", "2"], "--loss: out of range (got '2.0'); a probability"),
        (["--delay", "-1"], "--delay: out of range"),
        (["--duration", "-1"], "--duration: out of range"),
        (["--vehicles", "0"], "1 to 250"),
        (["--connect", "serial:x"], "KIND:HOST:PORT"),
        (["--connect", "tcp:127.0.0.1:1"], "start the ground station first"),
        (["--wind", "80@270"], "SPEED@FROM"),
        (["--wind", "nosuchfile.csv"], "--wind: neither a date nor a file"),
        (["--parameter", "FOO=1"], "no such parameter"),
        (["--at", "atlantis"], "atlantis"),
        (["--system", "300"], "1 to 255"),
        (["--soc", "130"], "--soc"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(two, capsys, arguments, words):
    code, _, err = run(capsys, two, *arguments)
    assert code == 2
    assert words in err
    assert len(err.splitlines()) == 1
