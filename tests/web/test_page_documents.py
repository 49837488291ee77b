"""What the pages show of missions, vehicles and commands, without a browser."""

from __future__ import annotations

import asyncio
import json
import math
from types import SimpleNamespace

import pytest

from skyway.cli.main import main
from skyway.missions import Frame, Mission, MissionDocument, MissionItem, read, write
from skyway.missions.items.commands import Command
from skyway.models.base.errors import InputError
from skyway.web.folder import Folder
from skyway.web.live.fleet import Fleet
from skyway.web.live.flights import Flights
from skyway.web.live.runs import Run
from skyway.web.work.history import energy_per_km, told
from skyway.web.work.missions import converted, shown


@pytest.fixture
def mission(tmp_path):
    """A mission with two findings whose remedy is certain, and others."""
    place = {"frame": Frame.GLOBAL_RELATIVE_ALT, "x": 407_000_000, "y": -740_000_000, "z": 50.0}
    items = (
        MissionItem(Command.NAV_TAKEOFF, **place),
        MissionItem(Command.NAV_WAYPOINT, **(place | {"x": 407_100_000}), param2=math.nan),
        MissionItem(Command.DO_DIGICAM_CONTROL, x=12_345_678),
        MissionItem(Command.NAV_WAYPOINT, **(place | {"x": 407_200_000})),
    )
    path = tmp_path / "one.plan"
    write(MissionDocument(Mission(items=items)), path)
    return path


def test_a_mission_is_shown_with_what_check_finds_of_it(mission, capsys):
    found = shown(str(mission), None, {"wind": "6@250", "payload": "0.5"})
    assert main(["check", str(mission), "--wind", "6@250", "--payload", "0.5", "--json"]) == 1
    checked = json.loads(capsys.readouterr().out)
    assert [(one["code"], one["item"], one["severity"]) for one in found["findings"]] == [
        (one["code"], one["item"], one["severity"]) for one in checked["findings"]
    ]
    assert not found["ok"]
    assert found["count"] == len(found["items"]) == 4
    assert found["legs"][0]["points"][-1] == [40.72, -74.0]
    landing = next(one for one in found["findings"] if one["code"] == "no-landing")
    assert landing["place"] == [40.72, -74.0]


def test_only_certain_findings_are_mended_and_by_the_command_alike(mission, tmp_path, capsys):
    made = converted(str(mission), ".plan", {}, None)
    mended = tmp_path / "mended.plan"
    mended.write_bytes(dict(made["files"])["one.plan"])
    before, after = ({one["code"] for one in shown(str(path), None, {})["findings"]} for path in (mission, mended))
    assert before - after == {"parameter-not-given", "fraction-lost"}
    assert "no-landing" in after
    assert main(["check", str(mission), "--fix", str(tmp_path / "by-command.plan")]) == 1
    assert "item 1: write 0, as the vehicle does" in capsys.readouterr().err
    assert read(tmp_path / "by-command.plan") == read(mended)


def test_a_conversion_says_what_is_not_kept(mission):
    made = converted(str(mission), ".waypoints", None, None)
    assert [name for name, _ in made["files"]] == ["one.waypoints"]
    assert made["files"][0][1].startswith(b"QGC WPL 110")


def test_the_digest_holds_every_vehicle_once_whatever_a_watch_prints(tmp_path):
    fleet = Fleet(SimpleNamespace(folder=Folder(tmp_path), workers=None, flights=Flights(Folder(tmp_path))))
    row = {"lat": 1.0, "lon": 2.0, "mode": "<script>1</script>", "silent_s": 0.0}
    for line in ("", "{", "[]", "null", "7", '{"system": "x"}', '{"vehicles": 3}', "wrote file"):
        fleet.heard("a", line)
    for _ in range(2):
        for number in range(500):
            fleet.heard("a", json.dumps(row | {"system": number}))
    fleet.heard("b", json.dumps(row | {"system": 1}))
    digest = asyncio.run(fleet.digest())
    assert len(digest["vehicles"]) == 501
    assert len(json.dumps(digest)) < 100_000
    for connection in ("", "--json", "x" * 300):
        with pytest.raises(InputError):
            fleet.watch(connection)
    fleet.stop("a")
    assert len(asyncio.run(fleet.digest())["vehicles"]) == 1


@pytest.mark.parametrize("outlives", [False, True])
def test_a_command_is_run_in_its_own_process_and_its_lines_are_told(outlives):
    lines = []
    run = Run(["check", "/nowhere.plan"], lines.append, outlives=outlives)
    assert asyncio.run(run.finished()) == run.code == 2
    assert lines == list(run.lines) == ["skyway: /nowhere.plan: no such file"]


def test_the_history_leaves_out_what_is_no_journal(tmp_path):
    (tmp_path / "x.jsonl").write_text("{}\n")
    assert told(str(tmp_path), [("x.jsonl", 1.0), ("missing.jsonl", 2.0)]) == []
    rows = [
        {"power_w": 360.0, "flight_s": 1000.0, "distance_m": 10_000.0},
        {"power_w": None, "flight_s": 1.0, "distance_m": 1.0},
    ]
    assert energy_per_km(rows) == pytest.approx(10.0)
    assert energy_per_km([]) is None
