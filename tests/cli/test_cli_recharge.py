"""``skyway recharge`` as it is typed."""

import json
import re
from dataclasses import replace
from datetime import timedelta

import pytest

from skyway.missions import Command, Frame, Home, Mission, MissionDocument, MissionItem, read, write
from skyway.missions.items.coordinates import Point
from skyway.models.base.units import parse_instant
from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window
from skyway.recharge.made_of import opened

PADS = "id,name,lat,lon,elevation_m,pads\nbarn,Barn,47.3978,8.5450,488,2\nshed,Shed,47.4045,8.5580,495,1\n"


def place(lat, lon, command=Command.NAV_WAYPOINT, height=60.0):
    point = Point.of_degrees(lat, lon)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=height)


@pytest.fixture
def patrol(tmp_path):
    """A patrol about a field, five times round, and two pads; in a folder of its own."""
    corners = [(47.4, 8.546), (47.404, 8.546), (47.404, 8.557), (47.4, 8.557)]
    items = [
        place(47.398, 8.545, Command.NAV_TAKEOFF),
        place(*corners[0]),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 30.0, 0.0, 1.0),
        *(place(*corner) for corner in corners[1:]),
        MissionItem(Command.DO_JUMP, Frame.MISSION, 1.0, 4.0),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION),
    ]
    home = Home(Point.of_degrees(47.398, 8.545), 488.0)
    write(MissionDocument(Mission(tuple(items), home, 15.0, 8.0, 12, 2)), tmp_path / "patrol.plan")
    (tmp_path / "pads.csv").write_text(PADS)
    return tmp_path


def test_a_patrol_becomes_one_mission_a_battery(skyway, patrol):
    typed = [
        "recharge",
        patrol / "patrol.plan",
        "--pads",
        patrol / "pads.csv",
        "--drone",
        "m200-v2",
        "-o",
        patrol / "out",
    ]
    answer = skyway(*map(str, typed), "--wind", "6@250", "--single")
    assert answer.code == 0
    assert "none lost, none twice" in answer.out
    told = json.loads((patrol / "out/recharge.json").read_text())
    assert told["schema"] == "skyway.recharge/1"
    assert len(told["flights"]) >= 2
    assert told["ends_s"][1] <= told["ends_s"][0] <= told["ends_s"][2]
    assert told["p_reserve"] >= 0.99
    for flight in told["flights"]:
        for file in flight["files"].values():
            mission = read(patrol / "out" / file).mission
            assert mission.items[0].command == Command.NAV_TAKEOFF
            assert mission.items[-1].command in (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH)
        checked = skyway(
            "check",
            str(patrol / "out" / file),
            "--drone",
            "m200-v2",
            "--wind",
            "6@250",
            "--soc",
            str(100 * flight["soc_start"]),
        )
        assert checked.code == 0
        assert "error" not in checked.out
    whole = {name: read(patrol / f"out/{name}/all-batteries.plan").mission for name in ("px4", "ardupilot")}
    for mission in whole.values():
        lands = [item.command for item in mission.items].count(Command.NAV_LAND)
        assert lands == len(told["flights"])
    begins = [int(one) for one in re.findall(r"(\d+) for battery", " ".join(answer.out.split()))]
    items = whole["ardupilot"].items
    assert [items[one - 1].command for one in begins] == [Command.NAV_TAKEOFF] * (len(told["flights"]) - 1)
    assert "MPC_XY_CRUISE" in (patrol / "out/px4/vehicle.param").read_text()


def test_nothing_is_written_where_something_is_wrong(skyway, patrol):
    typed = ["recharge", str(patrol / "patrol.plan"), "--pads", str(patrol / "pads.csv"), "-o", str(patrol / "out")]
    cases = {
        ("--reserve", "97"): "no pad in reach",
        ("--transit-speed", "90"): "--transit-speed",
        ("--epsilon", "2"): "--epsilon",
        ("--laps", "0"): "--laps",
        ("--home", "here"): "--home",
        ("--drone", "none"): "no such drone",
        ("--wind", "strong"): "not a wind",
        ("--pads", str(patrol / "nowhere.csv")): "no such file",
    }
    for extra, said in cases.items():
        answer = skyway(*typed, *extra)
        assert answer.code == 2, extra
        assert said in answer.err
        assert len(answer.err.strip().splitlines()) == 1, answer.err
        assert not (patrol / "out").exists()
    assert [one.name for one in patrol.iterdir() if one.name.startswith(".")] == []


def test_a_folder_is_replaced_only_if_it_is_ours_and_that_is_asked(skyway, patrol):
    typed = ["recharge", str(patrol / "patrol.plan"), "--pads", str(patrol / "pads.csv"), "-o", str(patrol / "out")]
    (patrol / "out").mkdir()
    (patrol / "out/notes.txt").write_text("mine")
    refused = skyway(*typed, "--force")
    assert refused.code == 2
    assert "not written by skyway recharge" in refused.err
    (patrol / "out/notes.txt").unlink()
    assert skyway(*typed, "--autopilot", "px4").code == 0
    assert not (patrol / "out/ardupilot").exists()
    assert skyway(*typed).code == 2
    assert skyway(*typed, "--force").code == 0
    assert (patrol / "out/ardupilot/battery-1.plan").exists()


def test_flights_are_checked_with_the_drone_of_the_same_fleet_file(skyway, patrol):
    fleet = patrol / "drones.toml"
    fleet.write_text(
        'schema = "skyway.fleet/1"\n[[drone]]\nid = "half"\nname = "Half"\nprovider = "me"\nbase = "m200-v2"\n'
        "battery_wh = 175\nendurance_empty_min = 19\nendurance_full_min = 12\n"
    )
    drone = ["--fleet", fleet, "--drone", "half", "--wind", "6@250"]
    asked = ["recharge", patrol / "patrol.plan", "--pads", patrol / "pads.csv", "-o", patrol / "out", "--json"]
    answer = skyway(*asked, *drone)
    assert answer.code == 0, answer.err
    for flight in json.loads(answer.out)["flights"]:
        file, soc = patrol / "out" / flight["files"]["px4"], 100 * flight["soc_start"]
        checked = skyway("check", file, *drone, "--soc", soc, "--json")
        assert checked.code == 0, checked.out
        left_of_turns = json.loads(checked.out)["legs"][0]["soc_end"] - flight["soc_end"]
        assert 0.0 <= left_of_turns < 0.05  # turns and landings, which check by itself leaves out
    assert "no such drone" in skyway("check", file, "--fleet", fleet, "--drone", "other").err


def test_batteries_that_are_changed_take_the_time_that_is_told(skyway, patrol):
    typed = ["recharge", str(patrol / "patrol.plan"), "--pads", str(patrol / "pads.csv"), "--drone", "m200-v2"]
    assert skyway(*typed, "-o", str(patrol / "charged")).code == 0
    answer = skyway(*typed, "-o", str(patrol / "swapped"), "--swap", "90", "--json")
    assert answer.code == 0
    charged = json.loads((patrol / "charged/recharge.json").read_text())
    told = json.loads(answer.out)
    assert told["end_s"] < charged["end_s"]
    before = None
    for flight in told["flights"]:
        assert flight["soc_start"] == 1.0
        if before is not None:
            assert flight["depart_s"] == pytest.approx(before["arrive_s"] + 90.0 + before["ground_s"], abs=0.01)
            assert before["charge_s"] == pytest.approx(90.0, abs=0.01)
            assert before["wait_s"] == pytest.approx(0.0, abs=0.01)
        if flight["stay"]:
            assert flight["soc_end"] == pytest.approx(flight["stay"]["soc_from"], abs=0.002)
        before = flight["stay"]
    assert "batteries are needed" in told["notes"][-1]
    assert skyway(*typed, "-o", str(patrol / "x"), "--swap=-1").code == 2
    for wrong in (["--packs", "2"], ["--swap", "90", "--packs", "0"], ["--swap", "90", "--chargers", "1"]):
        assert skyway(*typed, "-o", str(patrol / "x"), *wrong).code == 2


def test_a_mission_without_a_home_gets_one_by_word(skyway, patrol):
    text = [
        "QGC WPL 110",
        "0\t1\t3\t22\t0\t0\t0\t0\t47.398\t8.545\t60\t1",
        "1\t0\t3\t16\t0\t0\t0\t0\t47.404\t8.557\t60\t1",
    ]
    (patrol / "raw.waypoints").write_text("\n".join(text) + "\n")
    typed = ["recharge", str(patrol / "raw.waypoints"), "--pads", str(patrol / "pads.csv"), "-o", str(patrol / "out")]
    without = skyway(*typed)
    assert without.code == 2
    assert "the mission's home is unknown" in without.err
    answer = skyway(*typed, "--home", "47.398,8.545", "--home-elevation", "488")
    assert answer.code == 0
    assert "the mission ended in the air: it returns to launch" in answer.out


VANS = "van,lat,lon,elevation_m,from,until\nvan,47.3978,8.5450,488,{0},{1}\nvan,47.4045,8.5580,495,0:45,2:30\n"


def test_a_mission_for_an_aeroplane_asks_for_the_drone(skyway, patrol):
    document = read(patrol / "patrol.plan")
    winged = replace(document, mission=replace(document.mission, vehicle_type=1))
    write(winged, patrol / "winged.plan")
    typed = ["recharge", str(patrol / "winged.plan"), "--pads", str(patrol / "pads.csv"), "-o", str(patrol / "out")]
    answer = skyway(*typed)
    assert answer.code == 2
    assert "--drone: the mission was planned for an aeroplane or a VTOL; name the drone that flies it" in answer.err
    assert not (patrol / "out").exists()
    assert skyway(*typed, "--drone", "m200-v2").code == 0


def test_a_van_is_landed_on_while_it_stands_there(skyway, patrol):
    vans = patrol / "vans.csv"
    vans.write_text(VANS.format("0:00", "0:30"))
    typed = ["recharge", str(patrol / "patrol.plan"), "--vans", str(vans), "-o", str(patrol / "out")]
    answer = skyway(*typed, "--drone", "m200-v2", "--wind", "6@250", "--autopilot", "px4", "--json")
    assert answer.code == 0, answer.err
    windows = {"van-1": (0.0, 1800.0), "van-2": (2700.0, 9000.0)}
    told = json.loads(answer.out)
    assert told["p_reserve"] >= 0.997  # charging that takes longer has time left before the van drives on
    stays = [flight["stay"] for flight in told["flights"] if flight["stay"]]
    assert stays
    for stay in stays:
        first, last = windows[stay["pad"]]
        assert first - 1e-6 <= stay["arrive_s"] < stay["leave_s"] <= last + 1e-6
    vans.write_text(VANS.format("0:30", "0:00"))
    reversed_times = skyway(*typed, "--force")
    assert reversed_times.code == 2
    assert "vans.csv:2: until: is not later than from" in reversed_times.err
    vans.write_text(VANS.format("noon", "0:00"))
    assert "vans.csv:2: from: is not a time (got 'noon'); hours and minutes" in skyway(*typed, "--force").err
    vans.write_text("van,lat,lon,elevation_m,from,until\nvan,47.3978,8.5450,488,0:00,0:05\n")
    assert (
        "pads are not available when necessary, or not long enough" in skyway(*typed, "--wind", "6@250", "--force").err
    )
    assert "give --pads, or --vans" in skyway("recharge", str(patrol / "patrol.plan"), "-o", str(patrol / "no")).err


def test_another_order_is_told_with_its_bound_written_and_found_again(skyway, tmp_path):
    from skyway.recharge.made_of import opened

    items = [place(47.398, 8.545, Command.NAV_TAKEOFF)]
    for number in (0, 3, 1, 2):
        items += [
            place(47.4, 8.546 + 0.0006 * number),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 30.0, 0.0, 1.0),
            place(47.41, 8.546 + 0.0006 * number),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        ]
    items.append(MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION))
    home = Home(Point.of_degrees(47.398, 8.545), 488.0)
    write(MissionDocument(Mission(tuple(items), home, 15.0, 8.0, 12, 2)), tmp_path / "lines.plan")
    (tmp_path / "pads.csv").write_text(PADS)
    typed = ["recharge", tmp_path / "lines.plan", "--pads", tmp_path / "pads.csv", "--drone", "m200-v2", "--soc", "60"]
    out = tmp_path / "out"
    answer = skyway(*map(str, typed), "--reorder", "-o", str(out))
    assert answer.code == 0
    assert "of 4 parts moved or reversed" in answer.out
    assert "lower bound for any order" in answer.out
    assert "none lost, none twice" in answer.out
    told = json.loads((out / "recharge.json").read_text())["order"]
    assert 0.0 < told["bound_s"] <= told["end_s"] < told["before_s"]
    again = opened(out)
    assert again.found.order.end_s == told["end_s"]
    written = [item.command for item in read(out / "reordered.plan").mission.items]
    assert written == [item.command for item in again.found.problem.work.mission.items]


def test_two_drones_share_a_survey_and_each_flies_a_folder_of_its_own(skyway, tmp_path):
    from skyway.recharge.made_of import opened

    lines = []
    for number in range(4):
        west, east = (47.4 + number * 0.0006, 8.546), (47.4 + number * 0.0006, 8.556)
        lines += [
            place(*west),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 30.0, 0.0, 1.0),
            place(*east),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        ]
    items = [place(47.398, 8.545, Command.NAV_TAKEOFF), *lines, MissionItem(Command.NAV_RETURN_TO_LAUNCH)]
    home = Home(Point.of_degrees(47.398, 8.545), 488.0)
    write(MissionDocument(Mission(tuple(items), home, 15.0, 8.0, 12, 2)), tmp_path / "lines.plan")
    (tmp_path / "pads.csv").write_text(PADS)
    typed = ["recharge", tmp_path / "lines.plan", "--pads", tmp_path / "pads.csv", "--drone", "m200-v2", "--soc", "45"]
    out = tmp_path / "out"
    answer = skyway(*map(str, typed), "--drones", "2", "-o", str(out))
    assert answer.code == 0
    assert "none lost, none twice" in answer.out
    told = json.loads((out / "recharge.json").read_text())
    assert told["schema"] == "skyway.recharge-drones/1"
    assert sum(one["units"] for one in told["drones"]) == told["units"] == 4
    assert 0.0 < told["bound_s"] <= told["end_s"]
    assert told["alone_s"] is None or told["end_s"] < told["alone_s"]
    again = [opened(out / one["folder"]) for one in told["drones"]]
    assert max(one.found.plan.end_s for one in again) == told["end_s"]
    refused = skyway("fly", str(out), "--connect", "tcp:127.0.0.1:1")
    assert refused.code == 2
    assert "is the work of several drones" in refused.err
    world = skyway("sim", str(out), "--tcp", "0", "--duration", "0.1", "--speedup", "20")
    assert world.code == 0
    assert [line.split(":")[0] for line in world.out.splitlines() if "tcp" in line] == ["vehicle 1", "vehicle 2"]
    one_drone = skyway(*map(str, typed), "--drones", "2", "-o", str(out))
    assert one_drone.code == 2
    assert "exists already" in one_drone.err


def test_a_patrol_is_not_shared_and_that_is_said(skyway, patrol):
    typed = ["recharge", patrol / "patrol.plan", "--pads", patrol / "pads.csv", "--drones", "2", "-o", patrol / "out"]
    answer = skyway(*map(str, typed), "--drone", "m200-v2")
    assert answer.code == 2
    assert "cannot be shared among drones" in answer.err
    assert not (patrol / "out").exists()


DEPART = "2026-07-10T12:00+02:00"


def test_pads_are_shared_by_a_ledger_with_whoever_books_there(skyway, patrol):
    noon = parse_instant(DEPART)
    taken = [Window(station="shed", pad=1, start=noon, end=noon + timedelta(hours=6))]
    taken.append(Window(station="barn", pad=1, start=noon, end=noon + timedelta(hours=6)))
    file = patrol / "pads.db"
    with open_ledger(str(file)) as ledger:
        ledger.book(ledger.acquire("others", "a test"), "theirs", taken)
    typed = ["recharge", str(patrol / "patrol.plan"), "--pads", str(patrol / "pads.csv"), "--drone", "m200-v2"]
    typed += ["--wind", "6@250", "--autopilot", "px4", "--ledger", str(file)]
    without = skyway(*typed, "-o", str(patrol / "one"))
    assert without.code == 2
    assert "needs --depart" in without.err
    assert not (patrol / "one").exists()
    answer = skyway(*typed, "--depart", DEPART, "-o", str(patrol / "one"), "--json")
    assert answer.code == 0, answer.err
    stays = [one["stay"] for one in json.loads(answer.out)["flights"] if one["stay"]]
    assert {one["pad"] for one in stays} == {"barn"}
    with open_ledger(str(file)) as ledger:
        own = [one.window for one in ledger.holds() if one.holder != "others"]
    assert {one.pad for one in own} == {2}
    for stay in stays:
        begin, end = (noon + timedelta(seconds=stay[name]) for name in ("arrive_s", "leave_s"))
        assert any(one.start <= begin and end <= one.end for one in own)
    assert len(opened(patrol / "one").found.plan.stops) == len(stays)
    # all pads are taken now; the same folder takes the place of its own bookings
    refused = skyway(*typed, "--depart", DEPART, "-o", str(patrol / "two"))
    assert (
        refused.code == 2
        or json.loads((patrol / "two/recharge.json").read_text())["flights"][0]["stay"]["arrive_s"]
        >= (own[0].end - noon).total_seconds()
    )
    assert skyway(*typed, "--depart", DEPART, "-o", str(patrol / "one"), "--force").code == 0
    with open_ledger(str(file)) as ledger:
        assert audit(ledger) == []


@pytest.mark.slow
def test_several_drones_book_their_pads(skyway, patrol):
    typed = ["recharge", str(patrol / "lines.plan"), "--pads", str(patrol / "pads.csv"), "--drone", "m200-v2"]
    lines = [place(47.4 + 0.0003 * n, lon) for n in range(8) for lon in ((8.546, 8.557) if n % 2 else (8.557, 8.546))]
    home = Home(Point.of_degrees(47.398, 8.545), 488.0)
    items = [place(47.398, 8.545, Command.NAV_TAKEOFF)]
    for number in range(0, 16, 2):
        items += [lines[number], MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 20.0, 0.0, 1.0)]
        items += [lines[number + 1], MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION)]
    items.append(MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION))
    write(MissionDocument(Mission(tuple(items), home, 15.0, 8.0, 12, 2)), patrol / "lines.plan")
    file = str(patrol / "pads.db")
    typed += ["--wind", "6@250", "--soc", "42", "--drones", "2", "--ledger", file, "--depart", DEPART]
    assert skyway(*typed, "-o", str(patrol / "shared")).code == 0
    told = json.loads((patrol / "shared/recharge.json").read_text())
    assert told["pads"]
    with open_ledger(file) as ledger:
        assert len({one.itinerary for one in ledger.holds()}) == len({one["drone"] for one in told["pads"]})
        assert audit(ledger) == []
    for drone in told["drones"]:
        opened(patrol / "shared" / drone["folder"])
