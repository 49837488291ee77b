"""Replay and History in a real browser: a delivery that was flown in simulation, its journal and its telemetry beside each other, and totals."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from skyway.cli.main import main
from skyway.web.work.replayed import shown
from tests.web.browsing import WIDER, chromium, person
from tests.web.conftest import ended, served

pytestmark = pytest.mark.slow
AT = "window.skywayPlayer.at"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A work folder with the journal and the telemetry of a demonstration, and its page."""
    folder = tmp_path_factory.mktemp("work")
    assert main(["demo", "-o", str(folder / "demo")]) == 0
    (journal,) = (folder / "demo").glob("*.jsonl")
    shutil.copy(journal, folder / "journal.jsonl")
    log = max((folder / "demo").rglob("*.tlog"), key=lambda one: one.stat().st_size)
    shutil.copy(log, folder / "telemetry.tlog")
    shutil.rmtree(folder / "demo")
    page = served(folder)
    yield page
    ended(page)


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def test_two_logs_are_played_forwards_and_backwards_and_from_event_to_event(flown, browser):
    with person(browser, flown.address, "/replay?log=journal.jsonl") as tab:
        tab.get_by_label("Beside it").select_option("telemetry.tlog")
        tab.wait_for_function("window.skywayPlayer?.logs.length === 2")
        apart = """() => { const p = window.skywayPlayer; const [a, b] = p.logs.map((log) => { const k = p.row(log); return [log.columns.lat[k], log.columns.lon[k]]; });
            return 111320 * Math.hypot(a[0] - b[0], (a[1] - b[1]) * Math.cos(a[0] * Math.PI / 180)); }"""
        begun = tab.evaluate("window.skywayPlayer.logs[0].flights[0][0]")
        tab.evaluate(f"window.skywayPlayer.jump({begun} + 200)")
        assert tab.evaluate(apart) < 400.0  # the same flight, told by the supervisor every few seconds and by the drone
        assert tab.evaluate("window.skywayMap.state.vehicles.length") == 2
        assert min(tab.evaluate("window.skywayPlayer.logs.flatMap((log) => log.columns.time_s)")) >= 0.0
        ends = tab.evaluate("window.skywayPlayer.logs.map((log) => log.columns.time_s.at(-1))")
        tab.evaluate("window.skywayPlayer.jump(window.skywayPlayer.end)")
        assert tab.get_by_text("ended: its last values").count() == (abs(ends[0] - ends[1]) > 1.0)
        tab.evaluate(f"window.skywayPlayer.jump({begun} + 200)")
        before = tab.evaluate(AT)
        tab.get_by_label("Speed", exact=True).select_option("30")
        tab.get_by_role("button", name="Play").click()
        tab.wait_for_function(f"{AT} > {before} + 30")
        tab.get_by_role("button", name="Pause").click()
        there = tab.evaluate(AT)
        tab.get_by_label("Speed", exact=True).select_option("-60")
        tab.get_by_role("button", name="Play").click()
        tab.wait_for_function(f"{AT} < {there} - 60")
        tab.get_by_role("button", name="Pause").click()
        tab.get_by_role("button", name="To the beginning").click()
        assert tab.evaluate(AT) == 0
        tab.get_by_role("button", name="Next event").click()
        event = tab.evaluate("window.skywayPlayer.events.find((one) => one.time_s > 0.05).time_s")
        assert tab.evaluate(AT) == pytest.approx(event)
        tab.locator(".events button").last.click()
        last = tab.evaluate("window.skywayPlayer.events.at(-1).time_s")
        assert tab.evaluate(AT) == pytest.approx(min(last, tab.evaluate("window.skywayPlayer.end")))
        shown = "all => all.map((one) => [one.matches('.now'), one.querySelector('button').tabIndex])"
        rows = tab.locator(".events li").evaluate_all(shown)
        times = tab.evaluate("window.skywayPlayer.events.map((one) => one.time_s)")
        at = tab.evaluate(AT)
        assert [now for now, _ in rows] == [at - 1 < one <= at + 1 for one in times]
        assert [stop for _, stop in rows].count(0) == 1
        assert rows[max(n for n, one in enumerate(times) if one <= at + 0.05)][1] == 0
        assert {one[:5] for one in tab.locator(".events li").all_inner_texts() for one in [one.split(" ", 1)[1]]} == {
            "log 1",
            "log 2",
        }


def test_a_log_from_elsewhere_is_shown_in_utc_with_what_is_said_of_it(flown, browser, shared_data):
    shutil.copy(shared_data / "logs" / "flugdrohne_20230621_log66.ulg", flown.folder / "abroad.ulg")
    with person(browser, flown.address, "/replay?log=abroad.ulg") as tab:
        tab.wait_for_function("window.skywayPlayer?.logs.length === 1")
        assert "0:00:00 (2023-06-21 06:42:32 UTC)" in tab.inner_text("output.clock")
        notes = tab.get_by_label("Notes on abroad.ulg").locator("li").all_inner_texts()
        assert any(one.startswith("wind: ") and one.endswith("(nominal drag)") for one in notes)
        assert "vehicle: multirotor (MAV_TYPE 2)" in notes
        tab.set_viewport_size({"width": 320, "height": 700})
        assert tab.evaluate(WIDER) == []


def test_no_wind_is_shown_while_the_filter_is_inconsistent(shared_data):
    log = shown(str(shared_data / "power" / "m100_flight_271.csv"))
    columns = {name: np.array(values, dtype=float) for name, values in log["columns"].items()}
    ((begin_s, end_s),) = log["flights"]
    aloft = (columns["time_s"] >= begin_s) & (columns["time_s"] <= end_s)
    doubted = columns["health"] == 0.0
    assert 75 <= doubted.sum() <= 85
    assert aloft[doubted].all()
    assert np.isnan(columns["wind_north_mps"][doubted]).all()
    assert np.isfinite(columns["wind_north_mps"][columns["health"] == 1.0]).all()
    assert any("unknown at its end" in note for note in log["notes"])


def test_units_and_zones_of_time_are_switched_and_said(flown, browser):
    with person(browser, flown.address, "/replay?log=journal.jsonl") as tab:
        tab.wait_for_function("window.skywayPlayer?.logs.length === 1")
        tab.evaluate("window.skywayPlayer.jump(window.skywayPlayer.logs[0].flights[0][0] + 200)")

        def shown(name):
            tab.wait_for_selector(".nows dl")
            cells = tab.locator(".nows dl > div").all_inner_texts()
            return next(one.split("\n", 1)[1] for one in cells if one.startswith(name))

        speed, height = shown("ground speed"), shown("height")
        assert speed.endswith(" m/s")
        assert height.endswith(" m")
        assert "EDT" in tab.inner_text("output.clock")
        for name, value in (("Speeds", "kn"), ("Heights and lengths", "ft"), ("Times", "utc")):
            with tab.expect_navigation():
                tab.get_by_label(name).select_option(value)
            tab.wait_for_function("window.skywayPlayer?.logs.length === 1")
        tab.evaluate("window.skywayPlayer.jump(window.skywayPlayer.logs[0].flights[0][0] + 200)")
        tab.wait_for_timeout(200)
        assert float(shown("ground speed").removesuffix(" kn")) == pytest.approx(float(speed[:-4]) / 0.514444, abs=0.2)
        assert float(shown("height").removesuffix(" ft")) == pytest.approx(float(height[:-2]) / 0.3048, abs=2.0)
        assert "UTC" in tab.inner_text("output.clock")


def test_the_history_counts_what_the_report_says_and_is_searched(flown, browser, capsys, tmp_path):
    capsys.readouterr()
    assert main(["report", str(flown.folder / "journal.jsonl"), "--json"]) in (0, 1)
    report = json.loads(capsys.readouterr().out)
    first, *others = (flown.folder / "journal.jsonl").read_text().splitlines()
    start = json.loads(first)
    start["data"]["hands_over"] = False
    (flown.folder / "fetched.jsonl").write_text("\n".join([json.dumps(start), *others, ""]))
    (flown.folder / "under-way.jsonl").write_text("\n".join([first, *others[:5], ""]))
    (flown.folder / "broken.jsonl").write_text("\n".join([first, *others[:5], "{", *others[5:], ""]))
    with person(browser, flown.address, "/history") as tab:
        tab.wait_for_selector(".panel table tbody tr:nth-child(3)")
        cells = dict(one.split("\n", 1) for one in tab.locator("dl.figures > div").all_inner_texts())
        assert cells["deliveries"] == "1 of 1\nand 1 not ended, 1 without a package"
        assert cells["flights"] == str(2 * report["totals"]["actual"]["flights"])
        ends = tab.locator(".panel table tbody tr td:nth-child(4)").all_inner_texts()
        assert sorted(ends) == ["arrived, no package", "delivered", "not ended: replanning"]
        tab.get_by_text("broken.jsonl:7: not a record of a journal").wait_for()
        cut = "all => all.filter((one) => one.scrollWidth > one.clientWidth).map((one) => one.innerText)"
        assert tab.locator("dl.figures dd").evaluate_all(cut) == []
        tab.set_viewport_size({"width": 320, "height": 700})
        assert tab.evaluate(WIDER) == []
        tab.set_viewport_size({"width": 1280, "height": 900})
        assert "of 1\n" in cells["kept of 95 % promises"]
        assert cells["reserve kept"].endswith("of 2")
        assert float(cells["energy"].removesuffix(" Wh/km")) > 1.0
        with tab.expect_download() as loading:
            tab.get_by_role("link", name="report of journal.jsonl").click()
        assert main(["report", str(flown.folder / "journal.jsonl"), "-o", str(tmp_path / "report.html")]) == 0
        assert loading.value.suggested_filename == "journal.html"
        assert Path(loading.value.path()).read_bytes() == (tmp_path / "report.html").read_bytes()
        tab.get_by_label("Search").fill("nowhere at all")
        tab.get_by_label("Search").press("Enter")
        tab.wait_for_selector(".panel table", state="detached")
        tab.get_by_label("Search").fill(report["delivery"]["to"])
        tab.get_by_label("Search").press("Enter")
        tab.get_by_role("link", name="journal.jsonl", exact=True).click()
        tab.wait_for_function("window.skywayPlayer?.logs.length === 1")
