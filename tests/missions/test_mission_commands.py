"""The commands mission, convert, check and show, as a person types them."""

import json
import xml.etree.ElementTree as ET

import pytest
import typer
from typer.testing import CliRunner

from skyway.cli.command_groups import GROUPS, add_command
from skyway.missions.files import mission_file
from skyway.models.base.errors import InputError
from skyway.models.composition import file as composition_file

app = typer.Typer()
for name in GROUPS["Missions"]:
    add_command(app, name)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run_one(*arguments):
        result = CliRunner().invoke(app, [str(argument) for argument in arguments])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return run_one


@pytest.fixture
def plan_json(tmp_path, two_legs):
    composition_file.save(two_legs, tmp_path / "plan.json")
    return "plan.json"


def written(result):
    return [line.split()[1] for line in result.stdout.splitlines() if line.startswith("wrote ")]


def test_a_composition_becomes_one_plan_for_px4_with_its_parameters(run, plan_json, tmp_path):
    result = run("mission", plan_json, "-o", "out.plan")
    assert result.exit_code == 0
    assert written(result) == ["out.plan", "out.param"]
    assert len(mission_file.read(tmp_path / "out.plan").mission.items) == 13
    assert "MPC_XY_VEL_MAX,15" in (tmp_path / "out.param").read_text()


def test_ardupilot_gets_a_mission_per_leg_with_fence_and_rally_files(run, plan_json, tmp_path):
    result = run("mission", plan_json, "-o", "out.waypoints", "--autopilot", "ardupilot", "--whole")
    assert written(result)[:3] == ["out.leg1.waypoints", "out.leg1.fence.waypoints", "out.leg1.rally.waypoints"]
    assert mission_file.read(tmp_path / "out.leg2.waypoints").fence.polygons
    assert "RALLY_LIMIT_KM,0" in (tmp_path / "out.param").read_text()


def test_a_single_fence_area_is_counted_in_the_singular(run, plan_json):
    assert "1 fence area" in run("mission", plan_json, "-o", "out.plan", "--leg", "2").stdout
    assert "fence areas" not in run("mission", plan_json, "-o", "other.plan", "--leg", "2").stdout


def test_one_leg_alone(run, plan_json, tmp_path):
    assert run("mission", plan_json, "-o", "leg.plan", "--leg", "2", "--width", "0").exit_code == 0
    document = mission_file.read(tmp_path / "leg.plan")
    assert len(document.mission.items) == 7
    assert not document.fence


def test_an_armed_hold_is_written_with_its_warning(run, plan_json):
    result = run("mission", plan_json, "-o", "out.plan", "--armed-hold")
    assert "warning: the vehicle stays ARMED at mast" in result.stderr
    assert result.exit_code == 0


def test_nothing_is_overwritten_without_force(run, plan_json, tmp_path):
    (tmp_path / "out.param").write_text("mine")
    with pytest.raises(InputError, match=r"out\.param: exists already"):
        run("mission", plan_json, "-o", "out.plan")
    assert not (tmp_path / "out.plan").exists()
    assert run("mission", plan_json, "-o", "out.plan", "--force").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--leg", "7"], "legs are numbered from 1: the plan has legs 1 to 2"),
        (["--leg", "0"], "legs are numbered from 1"),
        (["--leg", "-1"], "legs are numbered from 1"),
        (["--leg", "1", "--whole"], "exclude each other"),
        (["--leg", "1", "--armed-hold"], "exclude each other"),
        (["--width", "3"], "is not between 20"),
        (["--elevation", "mast"], "not a height"),
        (["--elevation", "mast=high"], "not a height"),
        (["--climb", "0"], "climb_rate_mps: is not between"),
    ],
)
def test_wrong_options_of_mission_are_refused(run, plan_json, arguments, message):
    with pytest.raises(InputError, match=message):
        run("mission", plan_json, "-o", "out.plan", *arguments)


def test_converting_there_and_back_loses_nothing(run, plan_json, tmp_path):
    run("mission", plan_json, "-o", "out.plan")
    assert written(run("convert", "out.plan", "out.waypoints")) == [
        "out.waypoints",
        "out.fence.waypoints",
        "out.rally.waypoints",
    ]
    run("convert", "out.waypoints", "back.plan")
    there, back = mission_file.read(tmp_path / "out.plan"), mission_file.read(tmp_path / "back.plan")
    assert back.mission.items == there.mission.items
    assert (back.fence, back.rally, back.mission.home) == (there.fence, there.rally, there.mission.home)


def test_converting_says_what_the_new_format_does_not_keep(run, tmp_path):
    inner = {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 47.5, 8.5, 50]}
    survey = {"type": "ComplexItem", "complexItemType": "survey", "version": 5}
    survey["TransectStyleComplexItem"] = {"version": 2, "Items": [inner, inner]}
    raised = {
        **inner,
        "frame": 0,
        "params": [0, 0, 0, None, 47.5, 8.5, 450],
        "AltitudeMode": 3,
        "Altitude": 50,
        "AMSLAltAboveTerrain": 450,
        "pilot": "Ada",
    }
    mission = {"version": 2, "items": [survey, raised], "cruiseSpeed": 15, "plannedHomePosition": [47.5, 8.5, None]}
    (tmp_path / "a.plan").write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
    told = run("convert", "a.plan", "a.waypoints").stderr.splitlines()
    assert told == [
        "not kept: the survey becomes its 2 items, from item 0: it can no longer be edited as one",
        "not kept: what it was planned for: cruiseSpeed 15",
        "not kept: the height of home is unknown: row 0 has NaN",
        "not kept: that the heights of 1 items were computed above terrain: they stay, above sea level",
        "not kept: fields of items: pilot",
    ]
    (tmp_path / "b.waypoints").write_text("QGC WPL 110\n# gate\n0 1 3 22 0 0 0 0 47.5 8.5 15 1\n")
    [line] = run("convert", "b.waypoints", "b.plan").stderr.splitlines()
    assert "filled in because QGroundControl requires it: plannedHomePosition, firmwareType" in line
    [line] = run("convert", "b.waypoints", "c.waypoints").stderr.splitlines()[:1]
    assert line == "not kept: home is unknown: row 0 is 0, 0"


def test_ok_is_said_only_where_nothing_was_found(run, tmp_path):
    rows = "0 1 0 16 0 0 0 0 47 8 400 1\n1 0 3 22 0 0 0 0 47 8 60 1\n2 0 3 16 0 0 0 0 {0} 8 60 1\n3 0 3 21 0 0 0 0 {0} 8 0 1\n"
    (tmp_path / "far.waypoints").write_text("QGC WPL 110\n" + rows.format(50))
    result = run("check", "far.waypoints")
    assert result.exit_code == 1
    assert result.stdout.splitlines()[-1].endswith("warnings: not ok")
    assert "-" not in result.stdout.splitlines()[-2]
    assert json.loads(run("check", "far.waypoints", "--json").stdout)["ok"] is False
    (tmp_path / "endless.waypoints").write_text("QGC WPL 110\n" + rows.format(47.01) + "4 0 0 177 2 -1 0 0 0 0 0 1\n")
    endless = run("check", "endless.waypoints")
    assert (endless.exit_code, endless.stdout.splitlines()[-1]) == (0, "1 warning")


def test_a_fence_left_over_is_not_mixed_with_another_mission(run, plan_json, tmp_path):
    run("mission", plan_json, "-o", "fenced.plan")
    run("mission", plan_json, "-o", "open.plan", "--width", "0")
    run("convert", "fenced.plan", "out.waypoints")
    (tmp_path / "out.waypoints").unlink()
    with pytest.raises(InputError, match=r"out\.fence\.waypoints: exists already"):
        run("convert", "open.plan", "out.waypoints")
    run("convert", "open.plan", "out.waypoints", "--force")
    assert not mission_file.read(tmp_path / "out.waypoints").fence


def test_a_suffix_that_is_no_format_is_refused(run, plan_json):
    with pytest.raises(InputError, match=r"not a mission format; name it \.plan"):
        run("mission", plan_json, "-o", "out.kml")


def test_a_copy_in_which_nothing_is_corrected_is_not_written(run, plan_json, tmp_path):
    run("mission", plan_json, "-o", "out.plan")
    result = run("check", "out.plan", "--fix", "mended.plan")
    assert "no finding has a certain correction: mended.plan was not written" in result.stderr
    assert "wrote" not in result.stderr
    assert not (tmp_path / "mended.plan").exists()


def test_a_file_with_only_a_fence_says_what_was_checked(run, plan_json):
    run("mission", plan_json, "-o", "out.waypoints", "--autopilot", "ardupilot", "--whole")
    result = run("check", "out.leg1.fence.waypoints")
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [
        "info: mission: there are no mission items; checked the fence of 1 area [no-mission]", "ok",
    ]  # fmt: skip


def test_a_sound_mission_checks_with_exit_code_0(run, plan_json):
    run("mission", plan_json, "-o", "out.plan")
    result = run("check", "out.plan", "--drone", "m200-v2", "--wind", "5@270", "--payload", "1")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == "ok"
    assert "leg 1: items 0 to 5" in result.stdout


@pytest.mark.parametrize("stated", [("--payload", "5"), ("--wind", "25@200")])
def test_a_stated_load_or_wind_that_forbids_the_flight_gives_exit_code_1(run, plan_json, stated):
    run("mission", plan_json, "-o", "out.plan")
    result = run("check", "out.plan", *stated)
    assert result.exit_code == 1
    assert "error: " in result.stdout
    assert "(vehicle assumed: DJI Matrice 200 V2)" in result.stdout


def test_errors_give_exit_code_1_and_json_says_the_same(run, plan_json):
    run("mission", plan_json, "-o", "out.plan", "--armed-hold")
    result = run("check", "out.plan", "--drone", "m200-v2", "--soc", "30", "--autopilot", "px4", "--json")
    assert result.exit_code == 1
    report = json.loads(result.stdout)
    assert (report["schema"], report["ok"]) == ("skyway.check/1", False)
    assert "below-reserve" in {finding["code"] for finding in report["findings"]}
    assert [leg["item_to"] for leg in report["legs"]] == [5, 10]


def test_json_goes_with_exit_code_0_too(run, plan_json):
    run("mission", plan_json, "-o", "out.plan")
    result = run("check", "out.plan", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["ok"] is True


def test_a_scenario_brings_fleet_zones_pads_and_forecast(run, tmp_path):
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario.file import read_scenario

    region = read_scenario(NEW_YORK)
    first, second = region.network.stations[0], region.network.stations[1]
    rows = ["QGC WPL 110", f"0 1 0 16 0 0 0 0 {first.lat} {first.lon} {first.elevation_m or 0} 1"]
    rows += [f"1 0 3 22 0 0 0 0 {first.lat} {first.lon} 60 1", "2 0 2 178 1 10 -1 0 0 0 0 1"]
    rows += [f"3 0 3 16 0 0 0 0 {second.lat} {second.lon} 60 1", f"4 0 3 21 0 0 0 0 {second.lat} {second.lon} 0 1"]
    (tmp_path / "hop.waypoints").write_text("\n".join(rows))
    options = ["--scenario", NEW_YORK, "--drone", region.drones[0].id, "--depart", "2013-07-10T14:00-04:00"]
    result = run("check", "hop.waypoints", *options, "--json")
    leg = json.loads(result.stdout)["legs"][0]
    assert 0.0 <= leg["p_reserve"] <= 1.0
    assert leg["distance_m"] > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--drone", "zeppelin"], "no such drone"),
        (["--wind", "west"], "not a wind"),
        (["--wind", "5@270", "--depart", "2013-07-10T14:00Z"], "exclude each other"),
        (["--depart", "2013-07-10T14:00Z"], "a forecast needs a scenario"),
        (["--soc", "130"], "out of range"),
        (["--payload", "-1"], "is not between 0 and 1000"),
        (["--scenario", "nowhere"], "no such folder"),
    ],
)
def test_wrong_options_of_check_are_refused(run, plan_json, arguments, message):
    run("mission", plan_json, "-o", "out.plan")
    with pytest.raises(InputError, match=message):
        run("check", "out.plan", *arguments)


def test_a_file_that_is_not_there_is_refused(run):
    with pytest.raises(InputError, match=r"nothing\.plan: no such file") as caught:
        run("check", "nothing.plan")
    assert caught.value.exit_code == 2


def test_a_mission_is_shown_as_a_table(run, plan_json):
    run("mission", plan_json, "-o", "out.plan")
    text = run("show", "out.plan").stdout
    assert "home 40.7000000,-74.0000000, ground 120 m" in text
    assert "NAV_TAKEOFF" in text
    assert "COMPONENT_ARM_DISARM" in text
    assert "fence area 0: stay inside" in text
    assert "rally point 1: 40.7100000,-73.9000000" in text


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_mission_is_drawn(run, plan_json, tmp_path, suffix):
    pytest.importorskip("matplotlib")
    run("mission", plan_json, "-o", "out.plan")
    picture = tmp_path / f"map{suffix}"
    assert run("show", "out.plan", "--plot", picture).exit_code == 0
    if suffix == ".svg":
        assert ET.parse(picture).getroot().tag.endswith("svg")
    else:
        assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(InputError, match="exists already"):
        run("show", "out.plan", "--plot", picture)
    with pytest.raises(InputError, match="is not a picture format"):
        run("show", "out.plan", "--plot", "map.bmp")


@pytest.mark.parametrize("command", ["mission", "convert", "check", "show"])
def test_every_command_has_help_with_examples(run, command):
    text = run(command, "--help").stdout
    assert "Examples:" in text
    assert f"skyway {command} " in text


def test_every_real_mission_is_shown_and_drawn(run, shared_data, tmp_path):
    pytest.importorskip("matplotlib")
    for name in ("luk8426__V8_Gewicht_Absetzen.plan", "canberrauav__Dalby-fence.txt", "ardupilot__fence-110.txt"):
        source = shared_data / "missions" / name
        assert run("show", source, "--plot", tmp_path / f"{name}.png").exit_code == 0
