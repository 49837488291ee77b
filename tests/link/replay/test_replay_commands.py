"""The commands replay and calibrate, as a person types them."""

import csv
import json
import math
import re
import shutil
import socket

import pytest
from drone_truth import fly
from test_log_readers import record

from skyway.cli.commands import replay
from skyway.cli.main import main
from skyway.models.drones.drag_file import read_drag
from skyway.models.drones.fleet import read_fleet

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "flight.tlog"
    record(path, fly(seed=3, duration_s=240.0, courses_deg=(0.0, 180.0), sigma_mps=0.7, c1=0.3, c2=0.0))
    return path


@pytest.fixture
def skyway(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments, code=0):
        capsys.readouterr()
        assert main([str(argument) for argument in arguments]) == code
        found = capsys.readouterr()
        return found.out if code in (0, 1) else found.err

    return run


def test_replay_json_says_what_the_issue_asks_for(skyway, flight):
    report = json.loads(skyway("replay", flight, "--speed", "max", "--json"))
    assert report["schema"] == "skyway.replay/1"
    assert report["format"] == "tlog"
    assert report["messages"] == sum(report["by_type"].values())
    assert report["systems"] == [1]
    assert len(report["legs"]) == 1
    assert report["wind"]


def test_replay_for_people_tells_legs_battery_wind_and_forecast(skyway, flight):
    text = skyway("replay", flight, "--wind", "5@143", "--from", "0:00:30", "--to", "200")
    for word in ("leg 1", "cruise", "wind:", "forecast: 5.0 m/s", "vehicles: 1"):
        assert word in text


def test_figures_for_people_have_the_digits_that_are_known(skyway, flight, tmp_path):
    text = skyway("replay", flight, "--wind", "5@143")
    told = r"\n  wind: \d+\.\d m/s from \d{3}° on average, known for .+ of the flight; at its end \d+\.\d ± \d\.\d m/s from \d{3}° \("
    assert re.search(told, text)
    assert re.search(r"\n  forecast: 5\.0 m/s from 143°; on average \d+\.\d m/s apart, \d+\.\d m/s RMS\n", text)
    (tmp_path / "table.csv").write_text("time_s,soc\n0,0.9\n1,0.8\n")
    assert "\n  0.0 to 1.0 by the table's time column\n" in skyway("replay", "table.csv")


def test_a_wind_that_is_unknown_at_the_end_is_not_told_as_that_of_the_end(skyway, shared_data):
    log = shared_data / "power" / "m100_flight_271.csv"
    (line,) = [one for one in skyway("replay", log).splitlines() if one.startswith("  wind:")]
    told = json.loads(skyway("replay", log, "--json"))
    summary = told["wind_summary"]
    last = summary["last_known"]
    assert not summary["known_at_end"]
    assert last["t"] == told["wind"][-1]["t"] < told["legs"][-1]["end"] - 60.0
    assert summary["known_share"] == pytest.approx(
        1.0 - summary["inconsistent_s"] / told["legs"][-1]["time_s"], abs=0.02
    )
    assert (
        f"known for {100 * summary['known_share']:.0f} % of the flight; unknown at its end, last known at 0:00:57:"
        in line
    )
    assert f": {last['speed_mps']:.1f} ± {last['sigma_mps']:.1f} m/s from {last['from_deg']:03.0f}°" in line


def test_a_flight_that_ends_in_a_known_wind_says_so(skyway, flight):
    summary = json.loads(skyway("replay", flight, "--json"))["wind_summary"]
    assert summary["known_at_end"]
    assert summary["known_share"] > 0.95
    assert summary["inconsistent_s"] == 0


def test_a_replay_cut_off_while_the_filter_is_inconsistent_knows_no_wind_at_its_end(skyway, shared_data):
    log = shared_data / "power" / "m100_flight_271.csv"
    early = json.loads(skyway("replay", log, "--to", "0:00:50", "--drag", _drag(skyway, log), "--json"))["wind_summary"]
    late = json.loads(skyway("replay", log, "--to", "0:01:20", "--drag", "drag.toml", "--json"))["wind_summary"]
    assert early["known_at_end"]
    assert not late["known_at_end"]
    assert early["known_share"] > late["known_share"]


def _drag(skyway, log):
    skyway("calibrate", "wind", log, "-o", "drag.toml")
    return "drag.toml"


def _in_other_units(log, path, column, factor):
    """Write a table with a column in another unit."""
    header, *rows = list(csv.reader(log.open()))
    place = header.index(column)
    changed = [[repr(float(cell) * factor) if at == place else cell for at, cell in enumerate(row)] for row in rows]
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([header, *changed])
    return path


@pytest.mark.parametrize(
    ("column", "factor", "told"),
    [
        (
            "y",
            1e-3,
            "column y has 0.47 W on average in flight, less than any multirotor needs: it is probably in kilowatts",
        ),
        ("y", 1e3, "column y has 46"),
        (
            "time",
            1e3,
            'column time is probably in milliseconds (time_unit = "ms" with --columns): in seconds the speeds give 99',
        ),
        (
            "time",
            1e6,
            'column time is probably in microseconds (time_unit = "us" with --columns): in seconds the speeds give 99',
        ),
    ],
)
def test_a_column_in_another_unit_is_told_and_not_calibrated_with(skyway, shared_data, tmp_path, column, factor, told):
    log = shared_data / "power" / "m100_flight_271.csv"
    assert skyway("replay", log).count("warning:") == 1
    wrong = _in_other_units(log, tmp_path / "wrong.csv", column, factor)
    assert f"\n  warning: {told}" in skyway("replay", wrong)
    assert f": {told}" in skyway("calibrate", "energy", wrong, "--mass", "3.68", code=2)


def test_values_beyond_all_numbers_do_not_stop_the_look_at_units(skyway, tmp_path):
    rows = "".join(f"{number},{(-1) ** number}e308,1e308,1e308,1e308,1e308,1e308\n" for number in range(30))
    (tmp_path / "huge.csv").write_text(f"time_s,lat_deg,lon_deg,height_m,vel_north_mps,vel_east_mps,voltage_v\n{rows}")
    told = skyway("replay", "huge.csv")
    assert "column voltage_v has 1,000,000,000 V on average in flight: it is probably in millivolts" in told
    assert "column time_s" not in told


def test_rows_seconds_apart_are_told_without_any_position(skyway, tmp_path):
    rows = "".join(f"{100 * number},10,0.0\n" for number in range(30))
    (tmp_path / "table.csv").write_text(f"time_s,height_m,vel_down_mps\n{rows}")
    told = 'column time_s is probably in milliseconds (time_unit = "ms" with --columns): in seconds there is one row every 100 s'
    assert f"warning: {told}\n" in skyway("replay", "table.csv")


def test_a_multirotor_is_not_calibrated_with_a_power_that_its_mass_cannot_fly_on(skyway, shared_data):
    log = shared_data / "power" / "m100_flight_271.csv"
    told = skyway("calibrate", "energy", log, "--mass", "36.8", "--id", "big", code=2)
    assert "has 465 W on average in flight, where a multirotor of 36.8 kg needs 736 to 110,400 W" in told


def test_the_uncertainty_of_a_calibrated_drag_is_not_told_as_that_of_the_wind(skyway, shared_data):
    told = skyway("calibrate", "wind", shared_data / "power" / "m100_flight_271.csv")
    assert (
        "  uncertainty of the drag in this flight ± 6.3 %\n  mean wind of the whole flight 2.2 m/s from 157°\n" in told
    )


def test_a_package_is_of_a_drone(skyway, flight):
    told = skyway("replay", flight, "--payload", "5", code=2)
    assert told == "skyway: --payload: needs --drone (got '5.0'); name the drone that carries it\n"


def test_replay_follows_in_the_order_of_time(skyway, flight):
    lines = [
        line for line in skyway("replay", flight, "--follow", "wind,battery,mission").splitlines() if line[:2] == "0:"
    ]
    assert lines == sorted(lines, key=lambda line: line[:7])
    assert any("wind" in line for line in lines)
    assert any("battery" in line for line in lines)


def test_replay_writes_a_table_and_a_picture_and_overwrites_neither(skyway, flight, tmp_path):
    skyway("replay", flight, "--csv", "flight.csv", "--plot", "flight.png")
    assert (tmp_path / "flight.csv").stat().st_size > 10_000
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")
    assert "exists already" in skyway("replay", flight, "--csv", "flight.csv", code=2)


def test_replay_at_a_finite_speed_takes_its_time(skyway, flight, monkeypatch):
    slept = []
    wall = [100.0]

    def sleep(seconds):
        slept.append(seconds)
        wall[0] += seconds

    monkeypatch.setattr(replay.time, "sleep", sleep)
    monkeypatch.setattr(replay.time, "monotonic", lambda: wall[0])
    skyway("replay", flight, "--speed", "10", "--follow", "wind", "--to", "60")
    assert sum(slept) == pytest.approx(6.0, abs=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--speed", "fast"), "is not a speed"),
        (("--speed", "0"), "is not a speed"),
        (("--from", "later"), "not a time of the log"),
        (("--from", "0:09:00"), "after the end"),
        (("--from", "60", "--to", "30"), "is not after --from"),
        (("--follow", "birds"), "cannot be followed"),
        (("--system", "9"), "these did: 1"),
        (("--wind", "strong"), "not a wind"),
        (("--plot", "flight.doc"), "not a picture format"),
        (("--control", "5000"), "needs --connect"),
        (("--plot", "a.png", "--connect", "udpout:127.0.0.1:9"), "--plot: cannot be combined with --connect"),
        (("--json", "--connect", "udpout:127.0.0.1:9"), "--json: cannot be combined with --connect"),
    ],
)
def test_replay_refuses_what_makes_no_sense_in_one_line(skyway, flight, arguments, message):
    text = skyway("replay", flight, *arguments, code=2)
    assert message in text
    assert len(text.splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("empty.tlog", b"", "is empty"),
        ("half.tlog", b"\x00\x05\x0a\xfd\x09", "no valid message"),
        ("half.bin", b"\xa3\x95", "no valid message"),
        ("half.ulg", b"ULog\x01\x12", "header is damaged or truncated"),
        ("half.csv", b"time_s,ro", "no known telemetry columns"),
        ("header.csv", b"time_s,roll_rad\n", "no valid message"),
        ("picture.tlog", b"\x89PNG\r\n\x1a\n", "no valid message"),
        ("picture.png", b"\x89PNG\r\n\x1a\n", "not a known flight log format"),
        ("flight.tlog.gz", b"\x1f\x8b\x08\x00\x00\x00\x00\x00", "not a known flight log format; decompress it first"),
    ],
)
@pytest.mark.parametrize("command", [("replay",), ("calibrate", "wind"), ("calibrate", "energy")])
def test_what_is_no_log_is_said_in_one_line(skyway, tmp_path, command, name, data, message):
    (tmp_path / name).write_bytes(data)
    text = skyway(*command, name, code=2)
    assert message in text
    assert len(text.splitlines()) == 1


def test_a_log_cut_off_in_a_message_counts_its_rest(skyway, flight, tmp_path):
    (tmp_path / "cut.tlog").write_bytes(flight.read_bytes()[:-5])
    report = json.loads(skyway("replay", "cut.tlog", "--json"))
    assert report["messages"] == 5519
    assert report["skipped_bytes"] > 0


@pytest.mark.parametrize("command", [("calibrate", "wind"), ("forecast",), ("replay",)])
def test_a_log_of_which_much_is_damaged_is_used_with_a_warning(capsys, flight, tmp_path, command):
    data = flight.read_bytes()
    middle = len(data) // 2
    (tmp_path / "half.tlog").write_bytes(data[:middle] + b"\x00" * (len(data) - middle))
    (tmp_path / "whole.tlog").write_bytes(data)
    warnings = []
    for name in ("whole.tlog", "half.tlog"):
        main([*command, str(tmp_path / name)])
        warnings.append("of its bytes belong to no message" in capsys.readouterr().err)
    assert warnings == [False, True]


@pytest.mark.parametrize(
    ("columns", "stuck"), [("0.05,0.02,0.3,{0:.3f},2.0", "attitude"), ("{1:.3f},0.02,0.3,5.0,2.0", "velocity")]
)
def test_a_stuck_sensor_is_told_and_not_believed(skyway, tmp_path, columns, stuck):
    header = "time_s,roll_rad,pitch_rad,yaw_rad,vel_north_mps,vel_east_mps,vel_down_mps,height_m"
    rows = [f"{second / 5},{columns.format(5 + second % 7 / 10, second % 9 / 100)},0,50" for second in range(600)]
    (tmp_path / "stuck.csv").write_text("\n".join([header, *rows]) + "\n")
    report = json.loads(skyway("replay", "stuck.csv", "--vehicle", "multirotor", "--json"))
    assert any(f"the {stuck} does not change" in event["text"] for event in report["events"])
    assert report["wind_summary"]["measurements"].get("tilt", 0) <= 6


def test_sensors_that_give_no_numbers_measure_no_wind(skyway, tmp_path):
    rows = [f"{second},nan,,inf,nan,nan,nan,50" for second in range(120)]
    (tmp_path / "nan.csv").write_text(
        "\n".join(["time_s,roll_rad,pitch_rad,yaw_rad,vel_north_mps,vel_east_mps,vel_down_mps,height_m", *rows])
    )
    report = json.loads(skyway("replay", "nan.csv", "--json"))
    assert report["wind"] == []
    assert any("no wind could be measured" in event["text"] for event in report["events"])


def test_times_that_go_backwards_are_held_and_said(skyway, tmp_path):
    (tmp_path / "back.csv").write_text("time_s,roll_rad,soc\n2,0.1,0.9\n1,0.2,0.8\n3,0.3,0.7\n")
    assert "1 row is earlier than the row before, whose time is used" in skyway("replay", "back.csv")


def test_a_log_under_a_wrong_name_is_read_and_said_so(capsys, flight, tmp_path):
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight.read_bytes())
    assert main(["replay", str(path)]) == 0
    assert "is a .tlog" in capsys.readouterr().err


def test_replay_serves_the_log(skyway, flight):
    station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    station.bind(("127.0.0.1", 0))
    station.settimeout(5.0)
    text = skyway("replay", flight, "--speed", "max", "--connect", f"udpout:127.0.0.1:{station.getsockname()[1]}")
    assert "sent 5520 packets" in text
    assert station.recv(2048)[0] == 0xFD
    station.close()


def test_a_log_is_sent_in_real_time_unless_told_otherwise(skyway, flight, monkeypatch):
    """A ground station can follow it, and loses no packets of a log sent at once."""
    clock = [0.0]
    monkeypatch.setattr("skyway.link.replay.server.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("skyway.link.replay.server.time.sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    skyway("replay", flight, "--to", "30", "--connect", "udpout:127.0.0.1:9")
    assert clock[0] == pytest.approx(30.0, abs=0.5)


def test_calibrate_wind_writes_a_drag_that_replay_uses(skyway, flight, tmp_path):
    report = json.loads(skyway("calibrate", "wind", flight, "-o", "drag.toml", "--json"))
    assert report["identified"]
    drag = read_drag(tmp_path / "drag.toml")
    assert drag.linear_per_s + 16.0 * drag.quadratic_per_m == pytest.approx(0.3, rel=0.15)
    again = json.loads(skyway("replay", flight, "--drag", "drag.toml", "--json"))
    assert again["drag"]["source"] == "given"


def test_calibrate_wind_says_no_of_a_hover_and_yes_when_the_wind_is_given(skyway, tmp_path):
    path = tmp_path / "hover.tlog"
    record(path, fly(seed=1, duration_s=120.0, speed_mps=0.0, mean=(-5.0, 0.0), sigma_mps=0.2, c1=0.3, c2=0.0))
    assert "cannot be identified: the drone hovers" in skyway("calibrate", "wind", path, code=1)
    report = json.loads(skyway("calibrate", "wind", path, "--wind", "5@0", "--json"))
    assert report["drag"]["linear_per_s"] == pytest.approx(0.3, rel=0.1)


def test_calibrate_wind_refuses_a_given_wind_that_the_flight_contradicts(skyway, flight, tmp_path):
    found = json.loads(skyway("calibrate", "wind", flight, "--json"))["wind"]
    told = math.degrees(math.atan2(found["east_mps"], found["north_mps"])) % 360.0  # towards: the wrong end
    refused = skyway("calibrate", "wind", flight, "--wind", f"6@{told:.0f}", "-o", "drag.toml", code=2)
    assert "flight.tlog: --wind: the flight contradicts the given wind" in refused
    assert not (tmp_path / "drag.toml").exists()


def test_a_vtol_is_calibrated_on_its_wings_only(skyway, shared_data):
    log = shared_data / "logs" / "cuav_quadplane_flight.tlog"
    refused = skyway("calibrate", "wind", log, "--wind", "1@115", code=2)
    assert "--wind: only 0 s of flight on rotors" in refused
    assert "omit the wind" in refused
    refused = skyway("calibrate", "energy", log, "--payload", "0", code=2)
    assert "is the log of a VTOL" in refused


def test_calibrate_energy_writes_a_drone_that_plan_uses(skyway, flight, tmp_path):
    from skyway.missions.examples import NEW_YORK

    shutil.copytree(NEW_YORK, tmp_path / "scenario")
    fitted = tmp_path / "scenario" / "drones.toml"
    text = skyway("calibrate", "energy", flight, "--payload", "0", "--model", "endurance", "-o", fitted, "--force")
    assert "endurance model written" in text
    assert "endurance model fitted to 1 flight:" in fitted.read_text()
    assert "the effect of the load is unknown" in text
    assert "# the effect of the load is unknown" in fitted.read_text()
    (drone,) = read_fleet(fitted)
    assert drone.energy_model.power_w(drone.mass_kg) == pytest.approx(550.0, rel=0.02)
    what = ("--from", "bellevue", "--to", "jacobi", "--payload", "0.5", "--wind", "4@270", "--json")
    planned = json.loads(skyway("plan", "scenario", *what, "--planner", "pfs-charge-aware"))
    assert planned["drone_parameters"]["endurance_empty_min"] == pytest.approx(drone.endurance_empty_s / 60.0)
    laden_w = drone.energy_model.power_w(drone.mass_kg + 0.5)
    assert planned["energy_wh"] == pytest.approx(laden_w * planned["flight_time_s"] / 3600.0, rel=0.05)


def test_calibrate_energy_needs_to_know_what_was_carried(skyway, flight):
    assert "--payload" in skyway("calibrate", "energy", flight, code=2)
    assert "once per log" in skyway("calibrate", "energy", flight, "--payload", "1", "--payload", "2", code=2)


def test_calibrate_energy_refuses_a_copy_of_a_flight(skyway, flight, tmp_path):
    shutil.copy(flight, tmp_path / "copy.tlog")
    asked = ("calibrate", "energy", flight, "copy.tlog", "--payload", "0", "-o", "drones.toml")
    assert "copy.tlog: is the same flight as" in skyway(*asked, code=2)
    assert not (tmp_path / "drones.toml").exists()


def test_calibrate_energy_lists_every_m100_flight(skyway, shared_data):
    logs = sorted((shared_data / "power").glob("*.csv"))
    report = json.loads(skyway("calibrate", "energy", *logs, "--mass", "3.68", "--air-density", "1.2", "--json"))
    assert len(report["flights"]) == 5
    assert report["models"]["momentum"]["worst"] <= 0.10
    assert report["models"]["momentum"]["median"] <= 0.024
    assert all(flight["published_error"] is not None for flight in report["flights"])


def test_a_drone_of_another_mass_does_not_keep_name_and_battery_of_the_one_it_was_started_from(
    skyway, flight, tmp_path
):
    asked = ("calibrate", "energy", flight, "--payload", "0", "--mass", "3.68", "-o", "m100.toml")
    refused = skyway(*asked, code=2)
    assert "3.68 kg is not DJI Matrice 200 V2" in refused
    assert "--id and --battery" in refused
    assert not (tmp_path / "m100.toml").exists()
    skyway(*asked, "--id", "m100", "--name", "DJI Matrice 100", "--battery", "130")
    (drone,) = read_fleet(tmp_path / "m100.toml")
    assert (drone.id, drone.name, drone.mass_kg) == ("m100", "DJI Matrice 100", 3.68)
    assert drone.battery_j == pytest.approx(130.0 * 3600.0)
    assert "not measured, copied from m200-v2" in (tmp_path / "m100.toml").read_text()
    assert "out of range" in skyway(*asked, "--force", "--id", "m100", "--battery", "0", code=2)


def test_a_drone_file_predicts_a_log_of_a_flight_that_it_was_not_fitted_to(skyway, shared_data, tmp_path):
    logs = sorted((shared_data / "power").glob("*.csv"))
    who = ("--mass", "3.68", "--id", "m100", "--battery", "130", "--model", "momentum")
    skyway("calibrate", "energy", *logs[:4], *who, "-o", "m100.toml")
    report = json.loads(skyway("replay", logs[4], "--drone", "m100.toml", "--payload", "0.5", "--json"))["prediction"]
    assert report["drone"] == "m100"
    assert report["mass_kg"] == pytest.approx(4.18)
    assert report["error"] == pytest.approx(report["predicted_wh"] / report["measured_wh"] - 1.0, abs=1e-3)
    assert abs(report["error"]) < 0.10
    assert "m100 at 4.18 kg predicts" in skyway("replay", logs[4], "--drone", "m100.toml", "--payload", "0.5")


def test_a_prediction_needs_a_drone_and_a_package_that_it_carries(skyway, flight):
    told = skyway("replay", flight, "--drone", "m999", code=2)
    assert "no such drone" in told
    assert "a drone of the scenario New York (m200" in told
    assert "a built-in one (m200-v2" in told
    assert "m200-v2 carries 0 to 1.45 kg" in skyway("replay", flight, "--drone", "m200-v2", "--payload", "9", code=2)
    assert "predicts" in skyway("replay", flight, "--drone", "m200-v2")
    assert "m200 at" in skyway("replay", flight, "--drone", "m200"), "as plan and dispatch call it"


def test_the_table_of_a_replay_holds_the_covariance_of_the_wind(skyway, flight, tmp_path):
    skyway("replay", flight, "--csv", "flight.csv")
    with (tmp_path / "flight.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["estimated_sigma_mps"]]
    half = [0.5 * (float(row["estimated_var_north_m2ps2"]) + float(row["estimated_var_east_m2ps2"])) for row in rows]
    assert half == pytest.approx([float(row["estimated_sigma_mps"]) ** 2 for row in rows], rel=1e-6)
