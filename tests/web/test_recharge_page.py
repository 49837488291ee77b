"""The recharge page: a mission dropped, cut at pads, a pad dragged, all of it saved; by the functions of the command."""

from __future__ import annotations

import io
import json
import shlex
import zipfile

import pytest

from skyway.models.base.errors import InputError
from skyway.web.work.question import OF_SCENARIO, Cut, Put
from skyway.web.work.recharged import packed, places, saved, shown
from tests.web.browsing import chromium, person

PADS = "id,name,lat,lon,elevation_m,pads\nbarn,Barn,47.3978,8.5450,488,2\nshed,Shed,47.4045,8.5580,495,1\n"


def mission():
    """Lines of 900 m to and fro: longer than a battery."""
    places_ = [(47.398, 8.545)]
    for row in range(24):
        ends = (8.546, 8.558) if row % 2 == 0 else (8.558, 8.546)
        places_ += [(47.399 + 0.0002 * row, one) for one in ends]
    items = [
        {"type": "SimpleItem", "autoContinue": True, "command": 16 if number else 22, "doJumpId": number + 1, "frame": 3,
         "params": [0, 0, 0, None, lat, lon, 60]}
        for number, (lat, lon) in enumerate(places_)
    ]  # fmt: skip
    items.append(items[0] | {"command": 20, "frame": 2, "params": [0] * 7, "doJumpId": 99})
    body = {"version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 8, "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [47.398, 8.545, 488], "items": items}  # fmt: skip
    return json.dumps({
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": body,
        "geoFence": {"version": 2, "polygons": [], "circles": []}, "rallyPoints": {"version": 2, "points": []},
    })  # fmt: skip


def test_pads_that_were_moved_lose_the_height_of_their_ground_and_new_ones_are_added(tmp_path):
    (tmp_path / "pads.csv").write_text(PADS)
    asked = {
        "pads": str(tmp_path / "pads.csv"),
        "put": [{"id": "shed", "lat": 47.4, "lon": 8.55}, {"id": "pad-1", "lat": 47.41, "lon": 8.56}],
    }
    found = {one["id"]: (one["lat"], one["lon"]) for one in places(None, asked)}
    assert found == {"barn": (47.3978, 8.545), "shed": (47.4, 8.55), "pad-1": (47.41, 8.56)}
    with pytest.raises(InputError, match="stay where they are"):
        saved(
            None,
            {"pads": OF_SCENARIO, "put": [{"id": "a", "lat": 0.0, "lon": 1.0}]},
            str(tmp_path),
            "made",
            "made-pads.csv",
        )


def test_the_command_that_is_shown_says_all_that_was_asked():
    asked = Cut(
        mission="a b.plan",
        wind="6@250",
        payload="0,5",
        swap="90",
        packs="3",
        reorder=True,
        level_ground=True,
        put=(Put("x", 1.0, 2.0),),
    )
    words = shlex.split(asked.command(None, "pads.csv", "out"))
    assert words == ["skyway", "recharge", "a b.plan", "--pads", "pads.csv", "--wind", "6@250", "--swap", "90", "--packs", "3", "--payload", "0.5", "--level-ground",
                     "--reorder", "-o", "out"]  # fmt: skip
    assert shlex.split(Cut(mission="a.plan").command(None, OF_SCENARIO, "out"))[3:5] == ["--pads", "newyork"]
    with pytest.raises(InputError, match="whole number"):
        shown(None, {"mission": "a.plan", "laps": "1.5"})


def test_the_address_of_the_page_keeps_what_was_asked():
    asked = Cut(
        mission="a b.plan",
        wind="6@250",
        payload="",
        soc="80",
        reorder=True,
        put=(Put("x ü&", 1.0, 2.0), Put("", -90.0, 180.0)),
    )
    assert Cut.of_address(asked.query()) == asked
    assert Cut().query() == {}
    assert Cut.of_address({"reserve": "25", "home": "x" * 301, "evil": "1", "command": "1", "reorder": "maybe"}) == Cut(
        reserve="25"
    )
    for places_ in (
        "[",
        "[1]",
        '[{"id":"x","lat":91,"lon":0}]',
        '[{"id":"x","lat":1e400,"lon":0}]',
        "[" * 20_000,
        '[{"id":"x"}]',
    ):
        assert Cut.of_address({"put": places_}) == Cut()


@pytest.mark.slow
def test_what_is_saved_is_what_the_command_writes(tmp_path):
    from skyway.cli.main import main

    (tmp_path / "pads.csv").write_text(PADS)
    (tmp_path / "long.plan").write_text(mission())
    asked = {
        "mission": str(tmp_path / "long.plan"),
        "pads": str(tmp_path / "pads.csv"),
        "wind": "6@250",
        "autopilot": "px4",
    }
    assert saved(None, asked, str(tmp_path), "made", "made-pads.csv") == ["made"]
    words = [
        "recharge",
        asked["mission"],
        "--pads",
        asked["pads"],
        "--wind",
        "6@250",
        "--autopilot",
        "px4",
        "-o",
        str(tmp_path / "typed"),
    ]
    assert main(words) == 0
    names = sorted(path.relative_to(tmp_path / "typed") for path in (tmp_path / "typed").rglob("*") if path.is_file())
    assert len(names) > 4
    for name in names:
        assert (tmp_path / "made" / name).read_bytes() == (tmp_path / "typed" / name).read_bytes(), name
    inside = zipfile.ZipFile(io.BytesIO(packed(None, asked, "made"))).namelist()
    assert sorted(inside) == [f"made/{name}" for name in map(str, names)]


@pytest.mark.slow
def test_a_mission_is_dropped_cut_a_pad_dragged_and_all_of_it_saved(tmp_path):
    from tests.web.conftest import ended, served

    (tmp_path / "from").mkdir()
    for name, text in (("long.plan", mission()), ("pads.csv", PADS)):
        (tmp_path / "from" / name).write_text(text)
    (tmp_path / "work").mkdir()
    page = served(tmp_path / "work")
    command = "document.querySelector('#recharge-command').textContent"
    try:
        with chromium() as browser, person(browser, page.address, "/recharge") as tab:
            for name in ("long.plan", "pads.csv"):
                tab.locator("input[type=file]").set_input_files(str(tmp_path / "from" / name))
                tab.wait_for_function(
                    "(name) => [...document.querySelectorAll('select')].some((one) => one.value === name)", arg=name
                )
            tab.wait_for_selector("dl.figures")
            assert tab.locator("svg.chart").count() == 2
            before = tab.inner_text("#recharge-command")
            where = """() => { const m = window.skywayMap; const s = m.state.marks.find((one) => one.id === 'shed');
                const box = m.canvas.getBoundingClientRect(); const [x, y] = m.view.toScreen(...s.place); return [x + box.x, y + box.y]; }"""
            x, y = tab.evaluate(where)
            tab.mouse.move(x, y)
            tab.mouse.down()
            tab.mouse.move(x - 40, y + 40, steps=4)
            tab.mouse.up()
            tab.get_by_text("the ground height of pad shed is unknown").wait_for()
            tab.get_by_label("The ground of all pads is as high as home").check()
            tab.wait_for_function(f"{command}.includes('--level-ground')")
            tab.get_by_role("button", name="Save in the work folder").click()
            tab.get_by_text("saved long-batteries-pads.csv, long-batteries").wait_for()
            assert (tmp_path / "work" / "long-batteries" / "recharge.json").is_file()
            assert "shed" in (tmp_path / "work" / "long-batteries-pads.csv").read_text()
            tab.locator("h2").first.click()
            tab.keyboard.press("Control+z")
            tab.keyboard.press("Control+z")
            tab.wait_for_function(f"(was) => {command} === was", arg=before)
    finally:
        ended(page)


@pytest.mark.slow
def test_a_file_that_is_no_mission_is_said_before_pads_are_chosen(tmp_path):
    from tests.web.conftest import ended, served

    (tmp_path / "flight.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(range(128, 256)))
    page = served(tmp_path)
    try:
        with chromium() as browser, person(browser, page.address, "/recharge?file=flight.ulg") as tab:
            tab.get_by_text("flight.ulg: is not UTF-8 text").wait_for()
    finally:
        ended(page)
