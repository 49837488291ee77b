"""What the pages show of missions, vehicles and commands, without a browser."""

from __future__ import annotations

import asyncio
import gc
import json
import math
import weakref
from collections import deque
from types import SimpleNamespace

import pytest

from skyway.cli.main import main
from skyway.link.supervisor.journal.file import SCHEMA
from skyway.missions import Frame, Mission, MissionDocument, MissionItem, read, write
from skyway.missions.items.commands import Command
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.base.formatting import counter
from skyway.web.folder import Folder
from skyway.web.live.fleet import Fleet
from skyway.web.live.flights import Flights
from skyway.web.live.runs import Run
from skyway.web.server import look_for_waste
from skyway.web.work.calls import call
from skyway.web.work.history import energy_per_km, flown, reports, told
from skyway.web.work.missions import converted, shown
from skyway.web.work.replayed import shown as played


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
    rows = [{"measured_m": 10_000.0, "energy_j": 360_000.0}, {"measured_m": 0.0, "energy_j": 0.0}]
    assert energy_per_km(rows) == pytest.approx(10.0)
    assert energy_per_km([]) is None


def test_the_reports_of_a_folder_are_those_that_skyway_wrote(tmp_path, page):
    mark = '<meta name="generator" content="skyway report">'
    for name, words in (
        ("a.html", f"{mark}<title>delivered: A &amp; B</title>"),
        ("b.html", "<title>else</title>"),
        ("c.html", mark),
    ):
        (tmp_path / name).write_text(words)
    assert reports(str(tmp_path), ["a.html", "b.html", "c.html", "d.html"]) == [
        {"file": "a.html", "title": "delivered: A & B"}
    ]
    (page.folder / "a.html").write_text("<script>1</script>")
    (page.folder / "a.txt").write_text("no report")
    status, headers, text = page.ask("/api/report?file=a.html")
    assert (status, text) == (200, "<script>1</script>")
    assert headers["content-type"] == "application/octet-stream"
    assert headers["content-disposition"].startswith("attachment")
    assert [page.ask(f"/api/report?file={one}")[0] for one in ("a.txt", "..%2Fa.html", "none.html")] == [404, 404, 404]


def test_the_way_flown_and_its_energy_are_summed_in_the_air_alone():
    metre = 1.0 / 111_319.49  # degrees of longitude at the equator
    rows = [  # time, flight, air, metres east, W
        (0.0, 1, False, 0.0, 10.0), (5.0, 1, True, 0.0, 400.0), (10.0, 1, True, 100.0, 600.0), (15.0, 1, True, 200.0, None),
        (20.0, 1, False, 200.0, 10.0), (25.0, 2, True, 300.0, 400.0), (200.0, 2, True, 900.0, 400.0),
    ]  # fmt: skip
    names = ("time_s", "flight", "air", "lon", "power_w")
    track = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    track["lon"] = [metre * one for one in track["lon"]]
    track["lat"] = [0.0] * len(rows)
    assert flown(track) == pytest.approx((200.0, 100.0, 2500.0), rel=1e-4)
    assert flown({}) == (0.0, 0.0, 0.0)


def test_work_ends_with_the_browser_that_asked_for_it(tmp_path):
    (tmp_path / "a.tlog").write_bytes(b"")
    fastapi = pytest.importorskip("fastapi", reason="needs the extra web")
    from skyway.web.documents import add

    begun, ended = asyncio.Event(), []

    class Workers:
        async def ask(self, *_):
            begun.set()
            try:
                await asyncio.Event().wait()
            finally:
                ended.append(True)

    app = fastapi.FastAPI()
    add(app, SimpleNamespace(folder=Folder(tmp_path), workers=Workers(), scenario=None))

    async def run():
        messages = [{"type": "http.request", "body": b"", "more_body": False}]

        async def receive():
            if messages:
                return messages.pop()
            await begun.wait()
            return {"type": "http.disconnect"}

        async def send(_):
            return

        scope = {"type": "http", "method": "GET", "path": "/api/replay", "query_string": b"log=a.tlog", "headers": []}
        await app(scope, receive, send)

    asyncio.run(asyncio.wait_for(run(), 10.0))
    assert ended == [True]


def test_a_replay_shows_no_wind_of_the_flight_before_and_counts_time_as_the_command(shared_data, capsys):
    log = shared_data / "logs" / "dronekit_copter_flight.tlog"
    found = played(str(log))
    assert main(["replay", str(log)]) == 0
    told = capsys.readouterr().out
    (first_s, landed_s), (again_s, _) = found["flights"][:2]
    assert again_s - landed_s > 20.0
    times, wind = found["columns"]["time_s"], found["columns"]["wind_north_mps"]
    of_flight = [wind[n] for n, one in enumerate(times) if first_s + 5.0 < one < landed_s - 5.0]
    on_ground = [wind[n] for n, one in enumerate(times) if landed_s + 11.0 < one < again_s - 1.0]
    assert of_flight
    assert on_ground
    assert None not in of_flight
    assert set(on_ground) == {None}
    assert f"  leg 1: {counter(first_s)} to {counter(landed_s)}, " in told
    for one in found["events"][:3]:
        assert f"  {counter(one['time_s'])}  {one['text']}\n" in told
    (wind_note,) = [note for note in found["notes"] if note.startswith("wind: ")]
    assert "(drag identified from the whole log, unlike in a live flight)" in wind_note
    assert wind_note in told
    assert "warning: 17,093 bytes of the file belong to no message" in found["notes"]


def test_a_replay_says_why_it_has_no_wind(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("time_s,vel_north_mps,vel_east_mps,roll_rad\n" + "".join(f"{n},5,0,0.1\n" for n in range(60)))
    (why,) = (one for one in played(str(path))["notes"] if one.startswith("wind: "))
    assert why.startswith("wind: not measured: the kind of vehicle is unknown")


def test_a_damaged_journal_is_named_and_other_files_are_not(tmp_path):
    (tmp_path / "notes.jsonl").write_text('{"a": 1}\n{"b"\n')
    (tmp_path / "empty.jsonl").write_text("")
    start = json.dumps(
        {"n": 1, "time": "2013-07-10T18:00:00Z", "event": "start", "state": "connecting", "data": {"schema": SCHEMA}}
    )
    (tmp_path / "damaged.jsonl").write_text(f"{start}\n\x00\n{start}\n")
    found = told(str(tmp_path), [(name, 0.0) for name in ("notes.jsonl", "empty.jsonl", "damaged.jsonl")])
    assert [one["file"] for one in found] == ["damaged.jsonl"]
    assert "damaged.jsonl:2: not a record of a journal" in found[0]["unread"]


def test_a_file_that_nobody_foresaw_is_told_and_takes_no_process_with_it(monkeypatch, capsys):
    def fails(*_):
        raise ZeroDivisionError("no vehicle moves")

    monkeypatch.setattr("skyway.web.work.replayed.shown", fails)
    found = call("replayed.shown", ("a.tlog",))
    assert isinstance(found, SkywayError)
    assert "an error of skyway itself: ZeroDivisionError('no vehicle moves')" in str(found)
    assert "Traceback" in capsys.readouterr().err


def test_a_report_is_kept_under_the_name_of_its_journal_whatever_its_letters(page):
    (page.folder / "\u6f22'\"x.html").write_text("words")
    status, headers, text = page.ask("/api/report?file=%E6%BC%A2'%22x.html")
    assert (status, text) == (200, "words")
    assert headers["content-disposition"] == "attachment; filename*=UTF-8''%E6%BC%A2_x.html"


def test_a_log_whose_clock_lies_is_shown_without_a_date(tmp_path, shared_data):
    raw = (shared_data / "logs" / "dronekit_copter_flight.tlog").read_bytes()[:200_000]
    lying, at = b"", 0
    while at + 16 < len(raw):  # eight bytes of microseconds before each message of MAVLink 1
        size = 16 + raw[at + 9]
        lying += (int.from_bytes(raw[at : at + 8], "big") + 10**18).to_bytes(8, "big") + raw[at + 8 : at + size]
        at += size
    for name, content in (("true.tlog", raw), ("lying.tlog", lying)):
        (tmp_path / name).write_bytes(content)
    true, false = (played(str(tmp_path / name)) for name in ("true.tlog", "lying.tlog"))
    assert true["begin_s"] == pytest.approx(1436056003.48, abs=0.1)
    assert false["begin_s"] is None
    assert len(false["columns"]["lat"]) > 1


class _Page:
    """As many objects as a page has, all of which know it."""

    def __init__(self):
        self.parts = [[self] for _ in range(4000)]


def test_what_closed_pages_leave_is_found_though_nobody_asks_for_it():
    before = gc.get_threshold()
    try:
        look_for_waste()
        opened = deque(maxlen=100)  # the newest are still looked at, and were looked through more than once
        seen = []
        for _ in range(400):
            opened.append(_Page())
            seen.append(weakref.ref(opened[-1]))
        assert sum(one() is not None for one in seen) < 250
    finally:
        gc.set_threshold(*before)
