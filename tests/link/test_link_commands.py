"""The commands that speak with vehicles, against a simulated one on a TCP port."""

import contextlib
import json
import re
import socket
import threading
from dataclasses import replace

import pytest
import typer
from sim_serving import free_port, served
from wires import a_fence, a_mission, some_rally_points

from skyway.cli.command_groups import GROUPS, add_command
from skyway.cli.connection_options import Link
from skyway.link.protocol.parameter_file import read_required
from skyway.link.wire.frames import FrameWriter
from skyway.missions import read, write
from skyway.missions.autopilots.registry import FAMILIES, family_named
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.mission import Mission
from skyway.missions.items.parameters import FlightNeeds, Parameter, dumps
from skyway.models.base.errors import InputError, SkywayError

FLIGHT = FlightNeeds(
    ground_speed_mps=8.0,
    climb_rate_mps=2.0,
    descent_rate_mps=1.5,
    return_height_m=60.0,
    fenced=True,
    has_rally_points=True,
)
app = typer.Typer()
for name in GROUPS["Vehicles"]:
    add_command(app, name)


@pytest.fixture
def run(tmp_path, capsys):
    def go(*words, port=None):
        where = [] if port is None else ["--connect", f"tcp:127.0.0.1:{port}"]
        where += ["--system", "1"] if port is not None and words[0] != "watch" else []
        try:
            code = app([*map(str, words), *where, "--record", str(tmp_path / "rec")], standalone_mode=False) or 0
        except SkywayError as error:
            return error.exit_code, str(error)
        return code, capsys.readouterr().out

    return go


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "m.plan"
    write(MissionDocument(a_mission(8)), path)
    return path


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_a_mission_is_shown_uploaded_verified_downloaded_and_cleared(run, plan, tmp_path, family):
    with served(tcp_port=0, autopilot=family) as there:
        port = there.where()[1]
        code, text = run("upload", plan, port=port)
        assert code == 0
        assert "nothing was sent; add --yes" in text
        assert run("verify", plan, port=port)[0] == 1
        code, text = run("upload", plan, "--yes", "--json", port=port)
        assert code == 0
        assert json.loads(text.splitlines()[-1])["parts"][0]["state"] == "verified"
        code, text = run("verify", plan, port=port)
        assert (code, text.strip()) == (0, "the vehicle holds the mission of the file")
        code, text = run("download", "-o", tmp_path / "back.plan", port=port)
        assert text.startswith("8 items, 0 fence areas, 0 rally points")
        assert run("clear", "--kind", "all", port=port)[0] == 0
        assert run("verify", plan, port=port)[0] == 0
        assert run("clear", "--kind", "all", "--yes", port=port)[0] == 0
        assert run("verify", plan, port=port)[0] == 1
    assert len(list((tmp_path / "rec").glob("*.tlog"))) == 9


def test_parameters_are_read_set_and_compared(run, tmp_path):
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        code, text = run("params", "get", "RTL_ALT", port=port)
        assert text.startswith("RTL_ALT,")
        assert "would be set" in run("params", "set", "RTL_ALT", "6000", port=port)[1]
        assert run("params", "set", "RTL_ALT", "6000", "--yes", port=port)[1].endswith("-> 6000\n")
        file = tmp_path / "p.param"
        file.write_text("RTL_ALT,6000\n")
        assert run("params", "diff", file, port=port)[0] == 0
        file.write_text("RTL_ALT,5000\n# a comment\nNO_SUCH,1\n")
        code, text = run("params", "diff", file, port=port)
        assert code == 1
        assert "NO_SUCH: file 1, vehicle has none" in text


def test_a_comparison_with_nothing_is_no_agreement_and_a_camera_is_no_autopilot(run, tmp_path):
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        file = tmp_path / "p.params"
        file.write_text("# nothing but this\n")
        code, text = run("params", "diff", file, port=port)
        assert (code, text) == (2, f"{file}: has no parameters of an autopilot; lines NAME,VALUE")
        file.write_text("1\t1\tRTL_ALT\t1500\t6\n1\t100\tCAM_MODE\t2\t6\n")
        code, text = run("params", "diff", file, port=port)
        assert (code, text) == (0, "1 line for other components, ignored\nall 1 are as the file says\n")


@pytest.mark.parametrize("sent", [(), ("--yes",)])
def test_a_whole_parameter_is_not_set_to_a_fraction(run, sent):
    with served(tcp_port=0, autopilot="px4") as there:
        port = there.where()[1]
        code, text = run("params", "set", "RTL_TYPE", "1.5", *sent, port=port)
        assert (code, text) == (2, "RTL_TYPE: is a whole number on the vehicle (got '1.5'); 2")
        assert there.world.vehicles[1].autopilot.parameters["RTL_TYPE"] == 0.0
        code, text = run("params", "set", "RTL_TYPE", "3e9", *sent, port=port)
        assert (code, text) == (2, "RTL_TYPE: does not fit this parameter of the vehicle (got '3e+09')")
        code, text = run("params", "set", "RTL_TYPE", "nan", *sent, port=port)
        assert (code, text) == (2, "RTL_TYPE: is not a finite number (got 'nan')")


def test_a_mission_comes_with_the_parameters_it_needs(run, plan, tmp_path):
    settings = family_named("ardupilot").settings
    needs = (
        settings["return-height"].need("at-least", 70.0, "clears the ground"),
        settings["ground-station"].need("read", None, "ours"),
        Parameter("FOO", "equal", 3.0, "of no known meaning"),
    )
    file = tmp_path / "m.param"
    file.write_text(dumps(needs))
    assert read_required(file) == needs
    needs = needs[:2]
    file.write_text(dumps(needs))
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        assert "would be set to 7000" in run("upload", plan, "--parameters", file, port=port)[1]
        code, text = run("upload", plan, "--parameters", file, "--yes", port=port)
        assert code == 0
        assert "set to 7000" in text
        assert there.world.vehicles[1].autopilot.parameters["RTL_ALT"] == 7000.0


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_parameters_for_a_fence_are_not_set_where_the_mission_has_none(run, plan, tmp_path, family):
    needs = family_named(family).parameters(FLIGHT)
    file = tmp_path / "m.param"
    file.write_text(dumps(needs))
    fenced = tmp_path / "fenced.plan"
    write(MissionDocument(a_mission(8), a_fence(), some_rally_points()), fenced)
    with served(tcp_port=0, autopilot=family) as there:
        port, has = there.where()[1], there.world.vehicles[1].autopilot.parameters
        before = {one.name: one.value for one in map(has.at, range(len(has)))}
        for wanted in ([], ["--yes"]):
            code, text = run("upload", plan, "--parameters", file, *wanted, port=port)
            assert code == 2
            assert f"m.param: is for a mission with a fence, and {plan} has none; nothing was sent; upload it" in text
        after = {one.name: one.value for one in map(has.at, range(len(has)))}
        assert {name for name in before if before[name] != after[name]} == set()
        assert run("upload", fenced, "--parameters", file, "--yes", port=port)[0] == 0


def test_parameters_are_not_set_where_another_station_or_the_type_of_one_refuses_the_upload(run, plan, tmp_path):
    file = tmp_path / "m.param"
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port, has = there.where()[1], there.world.vehicles[1].autopilot.parameters
        file.write_text("RTL_ALT,7000\nFENCE_ACTION,1.5\n")
        code, text = run("upload", plan, "--parameters", file, "--yes", port=port)
        assert (code, text) == (2, f"{file}: FENCE_ACTION: is a whole number on the vehicle (got '1.5')")
        file.write_text("RTL_ALT,7000\n")
        code, text = run("upload", plan, "--parameters", file, "--yes", "--gcs-system", "77", port=port)
        assert (code, "its failsafe counts only the heartbeat of system 255" in text) == (3, True)
        assert has["RTL_ALT"] != 7000.0
        assert run("upload", plan, "--parameters", file, "--yes", port=port)[0] == 0
        assert has["RTL_ALT"] == 7000.0


def test_watching_tells_what_is_known_and_what_is_not(run):
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("watch", "--duration", "2.2", "--json", port=there.where()[1])
    row = json.loads(text.splitlines()[-1])
    assert code == 0
    assert row["system"] == 1
    assert row["mode"] == "hold" or row["mode"]
    assert row["wind_mps"] is None
    assert row["soc"] > 0.9
    assert row["loss"] == 0.0
    assert row["silent_s"] < 2.0
    assert set(row["rejected"].values()) == {0}
    assert row["conflict"] is False


def test_watching_without_a_terminal_prints_a_header_once(run):
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("watch", "--duration", "2.2", port=there.where()[1])
    header, *rows = text.splitlines()
    assert code == 0
    assert header.split()[:5] == ["vehicle", "mode", "position", "height", "speed"]
    assert rows
    assert header not in rows


def test_nobody_there_ends_with_3_and_nonsense_with_2(run, plan, tmp_path):
    assert run("verify", plan, "--connect", "tcp:127.0.0.1:9")[0] == 3
    assert run("verify", plan, "--connect", "carrier pigeon")[0] == 2
    empty = tmp_path / "e.plan"
    write(MissionDocument(), empty)
    code, text = run("upload", empty)
    assert code == 2
    assert "has no mission" in text


def test_a_broken_parameter_file_names_its_line(tmp_path):
    file = tmp_path / "p.param"
    file.write_text("RTL_ALT,6000\nwhat is this\nX,nan\n")
    with pytest.raises(InputError, match=r"p.param:2: .*\n.*p.param:3"):
        read_required(file)


def test_a_file_that_holds_no_parameters_is_one_error(plan):
    with pytest.raises(InputError) as caught:
        read_required(plan)
    [fault] = caught.value.faults
    assert "is no parameter file: " in fault.problem
    assert fault.remedy == "a file of lines NAME,VALUE, as skyway mission and ground stations write them"


def test_an_impossible_value_or_an_unknown_name_of_a_parameter_is_refused(run, plan, tmp_path):
    file = tmp_path / "p.param"
    with served(tcp_port=0, autopilot="px4") as there:
        port, has = there.where()[1], there.world.vehicles[1].autopilot.parameters
        file.write_text("MPC_XY_CRUISE,12\nMPC_XY_VEL_MAX,2000\n")
        told = "p.param:2: MPC_XY_VEL_MAX: is outside the plausible range (got '2000'); 0 to 60 m/s"
        code, text = run("upload", plan, "--parameters", file, "--yes", port=port)
        assert (code, text.endswith(told)) == (2, True)
        code, text = run("params", "set", "MPC_XY_VEL_MAX", "2000", "--yes", port=port)
        assert (code, text) == (2, "MPC_XY_VEL_MAX: is outside the plausible range (got '2000'); 0 to 60 m/s")
        file.write_text("MPC_XY_CRUISE,12\nNOT_A_PARAM,1\n")
        for wanted in ([], ["--yes"]):
            code, text = run("upload", plan, "--parameters", file, *wanted, port=port)
            assert code == 2
            assert text.endswith("the vehicle has no NOT_A_PARAM; correct the name, or remove its line")
        assert (has["MPC_XY_CRUISE"], has["MPC_XY_VEL_MAX"]) == (5.0, 12.0)
        file.write_text("MPC_XY_CRUISE,12\n")
        text = run("upload", plan, "--parameters", file, port=port)[1]
        assert "parameter MPC_XY_CRUISE is 5: would be set to 12\n" in text


def test_what_would_be_sent_stands_beside_what_is_on_board(run, plan, tmp_path):
    other = tmp_path / "other.plan"
    write(MissionDocument(a_mission(8, height=70.0), a_fence(), some_rally_points()), other)
    with served(tcp_port=0, autopilot="px4") as there:
        port = there.where()[1]
        assert run("upload", plan, "--yes", port=port)[0] == 0
        code, text = run("upload", other, port=port)
        assert code == 0
        assert re.search(r"1 +NAV_WAYPOINT +40.7394000 +-73.9755000 +71 m +z 51\n", text)
        assert re.search(r"7 +NAV_LAND .* the same\n", text)
        assert "fence: 1 areas to send; 2 differences" in text
        assert "rally points: 2 items to send" in text
        found = json.loads(run("upload", other, "--json", port=port)[1])
        assert found["sent"] is False
        assert found["vehicle"]["capabilities"]
        assert [part["kind"] for part in found["parts"]] == ["fence", "rally", "mission"]
        assert there.world.vehicles[1].autopilot.stores[1] == []
        moved = a_mission(8)
        items = (*moved.items[:3], replace(moved.items[3], y=moved.items[3].y + 10_000), *moved.items[4:])
        write(MissionDocument(Mission(items)), other, force=True)
        text = run("upload", other, port=port)[1]
        assert re.search(r"3 +NAV_WAYPOINT +40.7396000 +-73.9743000 +53 m +longitude -73.9753000\n", text)
        assert (
            "item 3 longitude: on the vehicle -73.9753000, in the file -73.9743000"
            in run("verify", other, port=port)[1]
        )


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_the_same_commands_go_by_mavsdk(run, plan, tmp_path, family):
    pytest.importorskip("mavsdk")
    with served(tcp_port=0, autopilot=family) as there:
        how = {"port": there.where()[1]}
        by = ("--driver", "mavsdk")
        assert run("upload", plan, "--yes", *by, **how)[0] == 0
        assert run("verify", plan, *by, **how)[0] == 0
        assert run("download", "-o", tmp_path / "back.plan", *by, **how)[0] == 0
        assert run("params", "get", "SYSID_THISMAV" if family == "ardupilot" else "MAV_SYS_ID", *by, **how)[0] == 0
        assert run("clear", "--yes", *by, **how)[0] == 0
        assert run("verify", plan, *by, **how)[0] == 1


def test_mavsdk_refuses_a_signing_key_in_one_line(run, plan, tmp_path):
    key = tmp_path / "key"
    key.write_text("ab" * 32)
    key.chmod(0o600)
    with served(tcp_port=0) as there:
        code, text = run("upload", plan, "--driver", "mavsdk", "--key-file", key, port=there.where()[1])
    assert code == 2
    assert (
        text
        == "--driver: the mavsdk driver cannot sign: a signing key needs the default driver; use --driver pymavlink"
    )


def test_what_an_armed_vehicle_may_fly_by_is_not_changed_unless_that_is_asked_for(run, plan):
    with served(tcp_port=0) as there:
        how = {"port": there.where()[1]}
        assert run("upload", plan, "--yes", **how)[0] == 0
        autopilot = there.world.vehicles[1].autopilot
        autopilot.arm(force=True, by="test")
        changes = ("upload", plan), ("clear",), ("params", "set", "MPC_XY_CRUISE", "7")
        for words in changes:
            code, text = run(*words, "--yes", **how)
            assert code == 3
            assert "armed" in text
        assert len(autopilot.stores[0]) == 8
        assert run("verify", plan, **how)[0] == 0
        assert run("upload", plan, **how)[0] == 0, "a look is no change"
        assert run("clear", "--yes", "--armed", **how)[0] == 0
        assert run("verify", plan, **how)[0] == 1


def test_a_vehicle_is_not_taken_for_one_of_another_autopilot(run, plan):
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("upload", plan, "--autopilot", "ardupilot", port=there.where()[1])
    assert (code, text) == (
        2,
        "--autopilot: the vehicle is px4 (got 'ardupilot'); leave it out, and the vehicle is asked",
    )


def test_a_refused_upload_exits_with_3_and_gives_the_vehicles_words(run, tmp_path):
    far = Mission(tuple(replace(item, x=item.x + 10_000_000) for item in a_mission(8).items))
    path = tmp_path / "far.plan"
    write(MissionDocument(far), path)
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("upload", path, "--yes", port=there.where()[1])
    assert code == 3
    assert "too far" in text
    assert "verified" not in text


def test_a_fence_that_is_left_from_another_mission_is_told(run, plan, tmp_path):
    fenced = tmp_path / "fenced.plan"
    write(MissionDocument(a_mission(6), a_fence(), some_rally_points()), fenced)
    with served(tcp_port=0, autopilot="px4") as there:
        port = there.where()[1]
        code, text = run("upload", fenced, "--yes", port=port)
        assert (code, "not in the file" in text) == (0, False)
        for words in (("upload", plan), ("upload", plan, "--yes"), ("verify", plan)):
            code, text = run(*words, port=port)
            assert code == 0
            assert (
                "fence: not in the file, but the vehicle holds and uses 1 area; to remove: skyway clear --kind fence"
                in text
            )
            assert "rally points: not in the file, but the vehicle holds and uses 2 points" in text
        assert len(json.loads(run("verify", plan, "--json", port=port)[1])["besides"]) == 2
        assert run("clear", "--kind", "all", "--yes", port=port)[0] == 0
        code, text = run("upload", plan, "--yes", port=port)
        assert (code, "not in the file" in text) == (0, False)


@pytest.mark.parametrize(
    ("name", "there", "message"),
    [
        ("m.kml", (), "m.kml: has a suffix that is not a mission format"),
        ("m.waypoints", ("m.fence.waypoints",), "m.fence.waypoints: exists already"),
        ("-", (), "-: is not a file"),
    ],
)
def test_a_file_that_could_not_be_written_is_refused_before_anything_is_transferred(
    run, tmp_path, name, there, message
):
    for one in there:
        (tmp_path / one).write_text("other")
    file = name if name == "-" else tmp_path / name
    code, text = run("download", "-o", file, port=9)
    assert code == 2
    assert message in text


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_one_kind_of_list_is_downloaded_alone(run, tmp_path, family):
    everything, bare = tmp_path / "all.plan", tmp_path / "other.plan"
    write(MissionDocument(a_mission(6), a_fence(), some_rally_points()), everything)
    write(MissionDocument(a_mission(8)), bare)
    with served(tcp_port=0, autopilot=family) as there:
        port = there.where()[1]
        assert run("upload", everything, "--yes", port=port)[0] == 0
        for kind, name, told in (
            ("fence", "site.fence.waypoints", "1 fence area"),
            ("rally", "site.rally.waypoints", "2 rally points"),
            ("fence", "fence.plan", "1 fence area"),
            ("mission", "alone.plan", "6 items"),
        ):
            file = tmp_path / name
            assert run("download", "--kind", kind, "-o", file, port=port) == (0, f"{told}\nwrote {file}\n")
        assert sorted(one.name for one in tmp_path.glob("site*")) == ["site.fence.waypoints", "site.rally.waypoints"]
        assert read(tmp_path / "site.fence.waypoints").fence.areas == read(everything).fence.areas
        assert len(read(tmp_path / "site.rally.waypoints").rally) == 2
        alone = read(tmp_path / "fence.plan")
        assert (len(alone.mission), len(alone.fence.areas), len(alone.rally)) == (0, 1, 0)
        assert (len(read(tmp_path / "alone.plan").mission), read(tmp_path / "alone.plan").fence.areas) == (6, ())
        assert run("clear", "--kind", "fence", "--yes", port=port)[0] == 0
        assert run("upload", tmp_path / "site.fence.waypoints", "--yes", port=port)[0] == 0  # and back again
        assert run("verify", everything, port=port)[0] == 0


def test_a_mission_with_errors_is_not_sent_unless_that_is_asked_for(run, tmp_path):
    file = tmp_path / "in-the-air.plan"
    write(MissionDocument(Mission(a_mission(8).items[:-1])), file)
    with served(tcp_port=0, autopilot="px4") as there:
        port = there.where()[1]
        for wanted in ([], ["--yes"], ["--yes", "--json"]):
            code, text = run("upload", file, *wanted, port=port)
            assert code == 2
            first, last = text.splitlines()
            assert first == (
                f"{file}: item 6: the mission ends in the air: there is no LAND or RETURN_TO_LAUNCH after this item; add a LAND"
            )
            assert (
                last == f"{file}: nothing was sent; correct the mission, or upload it all the same with --with-errors"
            )
        assert run("verify", file, port=port)[0] == 1
        code, text = run("upload", file, "--with-errors", port=port)
        assert (code, "error: item 6: the mission ends in the air" in text) == (0, True)
        code, text = run("upload", file, "--with-errors", "--yes", "--json", port=port)
        assert code == 0
        assert [found["code"] for found in json.loads(text)["findings"]][:1] == ["no-landing"]
        assert run("verify", file, port=port)[0] == 0


def test_json_says_the_same_as_the_lines(run, plan, tmp_path):
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        assert json.loads(run("params", "get", "RTL_ALT", "--json", port=port)[1])["parameters"] == {"RTL_ALT": 1500.0}
        found = json.loads(run("params", "set", "RTL_ALT", "2000", "--yes", "--json", port=port)[1])
        assert (found["was"], found["value"], found["set"]) == (1500.0, 2000.0, True)
        file = tmp_path / "p.param"
        file.write_text("RTL_ALT,1000\n")
        code, text = run("params", "diff", file, "--json", port=port)
        assert (code, json.loads(text)["differences"]) == (1, [{"name": "RTL_ALT", "file": 1000.0, "vehicle": 2000.0}])
        code, text = run("verify", plan, "--json", port=port)
        assert code == 1
        assert json.loads(text)["differences"][0]["text"] == "count: on the vehicle 0, in the file 8"
        found = json.loads(run("clear", "--kind", "all", "--json", port=port)[1])
        assert (found["cleared"], found["held"]) == (False, {"mission": 0, "fence": 0, "rally": 0})
        found = json.loads(run("download", "-o", tmp_path / "x.plan", "--json", port=port)[1])
        assert found["items"] == 0


def test_a_negative_value_is_no_option(run):
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("params", "set", "RTL_RETURN_ALT", "-1", port=there.where()[1])
    assert (code, text) == (0, "RTL_RETURN_ALT: 60 -> -1 would be set; add --yes\n")


def test_a_signed_link_takes_the_key_from_a_file_or_the_environment_and_no_link_goes_without(
    run, plan, tmp_path, monkeypatch
):
    key = tmp_path / "key"
    key.write_text("ab" * 32)
    key.chmod(0o600)
    with served(tcp_port=0, autopilot="px4") as there:
        there.world.vehicles[1].radio.set_signing(bytes.fromhex("ab" * 32), 0)
        port = there.where()[1]
        assert run("upload", plan, "--yes", "--key-file", key, port=port)[0] == 0
        monkeypatch.setenv("SKYWAY_SIGNING_KEY_FILE", str(key))
        assert run("verify", plan, port=port)[0] == 0
        monkeypatch.delenv("SKYWAY_SIGNING_KEY_FILE")
        monkeypatch.setenv("SKYWAY_SIGNING_KEY", "cd" * 32)
        monkeypatch.setattr("skyway.link.telemetry.vehicle_monitor.FIND_S", 1.5)
        code, text = run("verify", plan, port=port)
        assert code == 2
        assert re.fullmatch(r"--key-file: no packet is signed with our key: \d+ were rejected; the key .*", text)


def test_watching_tells_how_many_packets_were_not_believed(run):
    """Two vehicles have the same id: the second one's packets are not taken for the first one's."""
    port = free_port()
    beat = {"type": 2, "autopilot": 12, "mavlink_version": 3}
    done = threading.Event()

    def speak():
        with contextlib.ExitStack() as stack:
            both = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
            while not done.wait(0.1):
                for one in both:
                    one.sendto(FrameWriter(1, 1).frame("HEARTBEAT", beat), ("127.0.0.1", port))

    speaker = threading.Thread(target=speak)
    speaker.start()
    code, text = run("watch", "--duration", "1.5", "--json", "--connect", f"udpin:127.0.0.1:{port}")
    done.set()
    speaker.join()
    rejected = json.loads(text.splitlines()[-1])["rejected"]
    assert code == 0
    assert rejected["elsewhere"] >= 5
    assert rejected["forged"] == 0


def test_a_second_vehicle_of_the_same_id_is_told_before_anything_is_sent(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("skyway.link.telemetry.vehicle_monitor.ALONE_S", 1.0)
    port, beat = free_port(), {"type": 2, "autopilot": 12, "mavlink_version": 3}
    done = threading.Event()

    def speak(count):
        with contextlib.ExitStack() as stack:
            all_ = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
            while not done.wait(0.1):
                for one in all_:
                    one.sendto(FrameWriter(1, 1).frame("HEARTBEAT", beat), ("127.0.0.1", port))

    for count in (1, 2):
        done.clear()
        speaker = threading.Thread(target=speak, args=(count,))
        speaker.start()
        with Link(connect=[f"udpin:127.0.0.1:{port}"], record=tmp_path).aboard() as vehicle:
            assert vehicle.system == 1
        done.set()
        speaker.join()
        told = "packets in the name of system 1 also come from another address" in capsys.readouterr().err
        assert told == (count == 2)
