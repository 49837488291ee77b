"""``scenario``, ``network`` and ``wind``: starting a scenario, finding its faults, seeing what was read."""

import json
import re
import shutil

import pytest

from skyway.cli.main import app

SUMMER = ("--depart", "2025-06-15T12:00+02:00")
CASES = {
    "plan": 3, "compare": 2, "evaluate": 3, "network": 2, "wind": 2, "mission": 3, "convert": 1, "check": 1, "recharge": 3, "show": 1, "sim": 3,
    "scenario init": 1, "scenario check": 1, "replay": 1, "forecast": 2, "calibrate wind": 1, "calibrate energy": 1,
    "bench planners": 2, "fly": 3, "demo": 2, "report": 3, "upload": 1, "download": 1, "clear": 1, "verify": 1, "watch": 1,
    "params get": 1, "params set": 1, "params diff": 1, "settings": 2, "airspace": 2, "terrain": 2, "serve": 2, "health": 1,
}  # fmt: skip


@pytest.mark.parametrize(("command", "examples"), CASES.items(), ids=CASES.keys())
def test_the_help_of_every_command_shows_examples_that_can_be_copied(skyway, command, examples):
    answer = skyway(*command.split(), "--help")
    assert answer.code == 0
    lines = [line for line in answer.out.splitlines() if line.strip().startswith(f"skyway {command} ")]
    lines += [line for line in answer.out.splitlines() if line.strip() == f"skyway {command}"]
    assert len(lines) >= examples
    assert answer.err == ""


def test_no_command_is_left_without_this_test():
    known = {name.split()[0] for name in CASES}
    assert {command.name for command in app.registered_commands} <= known


def test_help_version_and_no_command(skyway):
    assert "plan" in skyway("--help").out
    assert skyway("--version").out.startswith("skyway 0.")
    bare = skyway()
    assert bare.code == 2
    assert "Plan:\n  plan " in bare.out
    group = skyway("scenario")
    assert group.code == 2
    assert "init" in group.out


def test_a_new_scenario_is_sound_and_can_be_planned_in(skyway, tmp_path):
    made = skyway("scenario", "init", "my-scenario")
    assert made.code == 0
    assert "skyway scenario check my-scenario" in made.out
    checked = skyway("scenario", "check", "my-scenario")
    assert checked.code == 0
    assert checked.err == ""
    assert "6 stations, 1 drone, wind of 2025-06-01" in checked.out
    plan = skyway("plan", "my-scenario", "--from", "west", "--to", "clinic", "--payload", "1.4", *SUMMER, "--json")
    assert plan.code == 0
    assert plan.err == ""
    composition = json.loads(plan.out)
    assert composition["recharge_time_s"] > 0
    assert composition["scenario"]["path"].endswith("my-scenario/scenario.toml")
    assert skyway("scenario", "init", "my-scenario").code == 2
    named = skyway("scenario", "check", "my-scenario/scenario.toml")
    assert named.code == 0
    listing = json.loads(skyway("scenario", "check", "my-scenario", "--json").out)
    assert listing == {"schema": "skyway.scenario-check/1", "ok": True, "faults": [], "warnings": []}


def test_all_faults_of_a_scenario_are_told_at_once(skyway, tmp_path):
    assert skyway("scenario", "init", "s").code == 0
    folder = tmp_path / "s"

    def change(name: str, *pairs: tuple[str, str]) -> None:
        text = (folder / name).read_text()
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new, 1)
        (folder / name).write_text(text)

    change(
        "scenario.toml",
        ('timezone = "Europe/Berlin"', 'timezone = "Europe/Atlantis"'),
        ("cruise_height_m = 60", "cruise_height_m = nan"),
        ("climb_rate_mps = 5", "climb_rate = 5"),
        ('speed_unit = "m/s"', 'speed_unit = "furlongs"'),
    )
    change(
        "stations.csv",
        ("52.5900,13.4100", "13.4100,252.5900"),
        ("west,", "depot,"),
        ("south,Station South,52.4300", "south,Station South,NaN"),
        ("38,3,2", "38,-3,2"),
    )
    change("drones.toml", ("# max_payload_kg = 1.45", "max_payload_kg = -1"))
    change("zones.geojson", ("Polygon", "Pentagon"))
    answer = skyway("scenario", "check", "s")
    assert answer.code == 2
    assert answer.out == ""
    for word in (
        "timezone: is not a time zone (got 'Europe/Atlantis')",
        "flight.cruise_height_m: must be a number",
        "flight.climb_rate: is not a field here",
        "furlongs",
        "stations.csv:3: lon: longitude out of range",
        "stations.csv:4: id: two stations have the same id (got 'depot')",
        "stations.csv:5: lat: is not a number (got 'NaN')",
        "stations.csv:6: pads: must be a whole number (got '-3')",
        "max_payload_kg: out of range (got '-1')",
        "zones.geojson",
    ):
        assert word in answer.err, word
    found = skyway("scenario", "check", "s", "--json")
    assert found.code == 2
    faults = json.loads(found.out)["faults"]
    assert len(faults) == len(answer.err.splitlines()) >= 10
    assert all(set(fault) == {"file", "line", "field", "value", "problem", "remedy"} for fault in faults)
    assert skyway("plan", "s", "--from", "depot", "--to", "clinic", "--payload", "1", *SUMMER).code == 2


def test_faults_of_wind_and_load_and_swapped_coordinates_are_told_together(skyway, tmp_path):
    assert skyway("scenario", "init", "s").code == 0
    for name, old, new in (
        ("load.csv", "*,3,0.300,60", "*,3,many,60"),
        ("stations.csv", "52.5900,13.4100", "13.4100,52.5900"),
        ("wind.csv", "2025-06-01T00:00Z,airfield,2.3,302", "2025-06-01T00:00Z,airfield,2.3,-302"),
    ):
        file = tmp_path / "s" / name
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new))
    answer = skyway("scenario", "check", "s")
    assert answer.code == 2
    assert "stations.csv: station north: lat and lon look swapped (got '13.41,52.59')" in answer.err
    assert "load.csv:5: arrivals_per_h" in answer.err
    assert "wind.csv:2: direction" in answer.err


def test_a_missing_part_of_a_scenario_is_named(skyway, tmp_path):
    assert skyway("scenario", "init", "s").code == 0
    for name in ("stations.csv", "wind.csv", "load.csv"):
        (tmp_path / "s" / name).unlink()
    answer = skyway("scenario", "check", "s")
    assert answer.code == 2
    for field, name in (("network.stations", "stations.csv"), ("wind.history", "wind.csv"), ("load.file", "load.csv")):
        assert f"{field}: no such file (got '{name}')" in answer.err


def test_the_network_is_shown_drawn_and_written(skyway, tmp_path):
    answer = skyway("network", "--plot", "net.png", "--geojson", "net.geojson")
    assert answer.code == 0
    assert "46 stations, 139 segments (3.1 to 12.9 km), all joined, 5 no-fly zones" in answer.out
    for station in ("bellevue", "white-plains", "syosset"):
        assert station in answer.out
    assert (tmp_path / "net.png").read_bytes().startswith(b"\x89PNG")
    written = json.loads((tmp_path / "net.geojson").read_text())
    assert written == json.loads(skyway("network", "--json").out)
    assert sum(f["geometry"]["type"] == "LineString" for f in written["features"]) == 139
    assert skyway("network", "--plot", "net.png").code == 2
    assert skyway("network", "--plot", "net.png", "--force").code == 0


def test_the_wind_is_shown_and_drawn(skyway, tmp_path):
    when = ("--depart", "2013-07-10T14:00-04:00", "--hours", "6")
    answer = skyway("wind", *when, "--actual-wind", "2013-07-10", "--plot", "wind.svg")
    assert answer.code == 0
    assert "Wed 14:00" in answer.out
    assert "truth" in answer.out
    assert b"<svg" in (tmp_path / "wind.svg").read_bytes()
    found = json.loads(skyway("wind", *when, "--actual-wind", "2013-07-10", "--json").out)
    assert found["schema"] == "skyway.wind/1"
    assert len(found["hours"]) == 6
    for row in found["hours"]:
        assert row["p10_mps"] <= row["p50_mps"] <= row["p90_mps"]
        assert 0 <= row["from_deg"] < 360
        assert 0 <= row["steadiness"] <= 1 + 1e-9
        assert all(0 <= share <= 1 for share in row["p_hold"].values())
    constant = json.loads(skyway("wind", *when, "--wind", "8@270", "--json").out)
    assert {(round(row["mean_mps"], 6), round(row["from_deg"], 6)) for row in constant["hours"]} == {(8.0, 270.0)}
    assert skyway("wind", *when, "--wind", "8@270", "--plot", "one.png").code == 0


def test_the_wind_of_today_is_forecast_from_the_season_of_any_year(skyway):
    answer = skyway("wind", "--depart", "2031-02-10T08:00-05:00", "--hours", "2")
    assert answer.code == 0
    assert "(2013-01-1" in answer.out


def test_names_with_brackets_are_printed_as_they_are(skyway, tmp_path):
    assert skyway("scenario", "init", "s").code == 0
    file = tmp_path / "s" / "stations.csv"
    file.write_text(file.read_text().replace("Station West", "[bold]West[/bold] $1$ :smile:"))
    assert "[bold]West[/bold] $1$ :smile:" in skyway("network", "s", "--plot", "n.png").out
    request = ("--from", "west", "--to", "depot", "--payload", "1", *SUMMER)
    assert "[bold]West[/bold] $1$ :smile:" in skyway("plan", "s", *request, "--plot", "p.svg").out


def test_labels_of_a_crowded_map_keep_off_each_other():
    import numpy as np

    from skyway.plots.pictures import LabelPlacer, new_figure

    random = np.random.default_rng(3)
    x, y = random.uniform(0.05, 0.95, (2, 14))
    axes = new_figure(9, 9).add_subplot()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    placer = LabelPlacer(axes, x, y)
    for number in range(len(x)):
        placer.place(f"station-{number}", x[number], y[number], fontsize=7)
    boxes = np.array(placer.boxes)
    assert len(boxes) == len(x)
    for number, (x0, y0, x1, y1) in enumerate(boxes):
        others = np.delete(boxes, number, axis=0)
        apart = (others[:, 2] <= x0) | (others[:, 0] >= x1) | (others[:, 3] <= y0) | (others[:, 1] >= y1)
        assert apart.all()


@pytest.fixture
def changed(skyway, tmp_path):
    """A new scenario in folder ``s``, with text replaced in one of its files."""

    def make(name: str, old: str, new: str) -> None:
        assert skyway("scenario", "init", "s").code == 0
        file = tmp_path / "s" / name
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new))

    return make


def test_a_scenario_in_which_nothing_can_be_planned_is_not_ready(changed, refused, skyway, tmp_path):
    changed("scenario.toml", "max_length_m = 16000", "max_length_m = 16")
    assert "s/scenario.toml: network: no segment joins any stations; raise network.max_length_m" in refused(
        "scenario", "check", "s"
    )
    listing = json.loads(skyway("scenario", "check", "s", "--json").out)
    assert (listing["ok"], listing["faults"][0]["field"]) == (False, "network")
    shutil.rmtree(tmp_path / "s")
    changed("scenario.toml", "season_days = 30", "season_days = 20")
    assert skyway("scenario", "check", "s").code == 0
    record = tmp_path / "s" / "wind.csv"
    record.write_text("".join(record.read_text().splitlines(keepends=True)[:5]))
    assert "s/wind.csv: no 48 hours in a row without a gap: too short" in refused("scenario", "check", "s")


TO_THE_CLINIC = ("--from", "west", "--to", "clinic", "--payload", "1.4", *SUMMER)


def test_no_route_for_a_drone_that_hardly_any_wind_lets_fly_names_the_wind(changed, refused):
    changed("drones.toml", "# wind_limit_mps = 12", "wind_limit_mps = 1")
    message = refused("plan", "s", *TO_THE_CLINIC, code=1)
    assert "of the forecast hours is the wind within the limit of m200 (1 m/s)" in message
    exact = refused("plan", "s", *TO_THE_CLINIC, "--planner", "exact", code=1)
    assert "m/s or more, above the limit of m200 (1 m/s)" in exact


def test_no_route_among_full_stations_names_the_wait_for_their_pads(changed, refused):
    changed("load.csv", "0.300,60", "300,6000")
    assert "the stations are full: of those one flight from west " in refused("plan", "s", *TO_THE_CLINIC, code=1)


def test_what_the_way_back_takes_is_told_beside_the_cost_that_does_not_include_it(skyway):
    assert skyway("scenario", "init", "s").code == 0
    told = skyway("plan", "s", *TO_THE_CLINIC, "--return", "home", "--objective", "cost").out
    told = " ".join(told.split())
    (found,) = re.findall(
        r"The way back is not counted in these: typically (\d+ Wh) more, with 2 charges before its end", told
    )
    assert found in told[told.index("Way back (home)") :]
