"""The page in a real browser: what an operator does with it, by clicks and keys. Debian's Chromium, headless; elsewhere these tests skip."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.web.browsing import AXE, PATIENT_MS, WIDER, chromium
from tests.web.conftest import ended, served

if TYPE_CHECKING:
    from collections.abc import Iterator

SMALLEST = """() => Math.min(99, ...[...document.querySelectorAll('.scroll > svg.chart')].map((one) => 11.5 * one.clientWidth / one.viewBox.baseVal.width))"""
"""Size of the smallest letters of the charts, in px."""
WIDTHS = (320, 360, 390, 768, 1280)
QUESTION = "/?start=siuh-north&to=white-plains&depart=2013-07-10T14%3A00-04%3A00"

PAGES = (QUESTION, "/missions", "/recharge", "/fly", "/fleet", "/replay", "/history")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as found:
        yield found


@pytest.fixture
def opened(browser, page):
    """Open a page of the site; at the end: nothing was asked of another host, and nothing went wrong in the console."""
    contexts = []

    def open_(path, width=1280, height=900, scheme="light"):
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        context.set_default_timeout(PATIENT_MS)
        tab = context.new_page()
        wrong: list[str] = []
        tab.on("console", lambda message: wrong.append(message.text) if message.type in {"error", "warning"} else None)
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on(
            "request",
            lambda asked: (
                wrong.append(asked.url) if not asked.url.startswith((page.address, "blob:", "data:")) else None
            ),
        )
        contexts.append((context, wrong))
        tab.goto(page.address + path)
        tab.wait_for_selector("#main *")
        return tab

    yield open_
    for context, wrong in contexts:
        context.close()
        assert wrong == []


def _place(tab, station):
    """Where a station is on the screen."""
    script = """(id) => { const m = window.skywayMap; const s = m.state.region.stations.find((one) => one.id === id);
        const box = m.canvas.getBoundingClientRect(); const k = box.width / m.view.width;
        const [x, y] = m.view.toScreen(s.lat, s.lon); return [x * k + box.x, y * k + box.y]; }"""
    tab.wait_for_function("window.skywayMap?.state.region")
    tab.wait_for_timeout(300)
    return tab.evaluate(script, station)


def test_a_delivery_is_planned_by_clicks_alone_and_changed_by_dragging_a_stop(opened):
    tab = opened("/")
    for station, words in (("siuh-north", "Start here"), ("white-plains", "Deliver here")):
        tab.mouse.click(*_place(tab, station))
        tab.get_by_role("menuitem", name=words).click()
    tab.get_by_label("Departure").fill("2013-07-10T14:00")
    tab.get_by_label("Departure").press("Enter")
    tab.wait_for_selector("dl.figures")
    tab.wait_for_selector(".reasons p")
    assert "start=siuh-north" in tab.url
    assert "14%3A00-04%3A00" in tab.url
    assert tab.locator("svg.chart").count() >= 3
    before = tab.inner_text("#plan-command")
    stop = tab.evaluate("window.skywayMap.stops()[0]")
    tab.mouse.move(*_place(tab, stop))
    tab.mouse.down()
    x, y = _place(tab, "columbia")
    tab.mouse.move(x - 15, y, steps=4)
    tab.mouse.move(x, y)
    tab.mouse.up()
    tab.wait_for_function("document.querySelector('#plan-command').textContent.includes('--stop-at columbia')")
    tab.wait_for_function("window.skywayMap.stops().includes('columbia')")
    tab.locator("h2").first.click()
    tab.keyboard.press("Control+z")
    tab.wait_for_function("(was) => document.querySelector('#plan-command').textContent === was", arg=before)


def test_the_map_is_used_by_keys_alone(opened):
    tab = opened("/")
    tab.wait_for_function("window.skywayMap?.state.region")
    tab.locator(".map canvas").focus()
    for key in ("n", "n", "+", "ArrowLeft", "0"):
        tab.keyboard.press(key)
    said = tab.inner_text(".map .only-heard")
    tab.keyboard.press("Enter")
    tab.keyboard.press("Enter")
    tab.wait_for_function("location.search.includes('start=')")
    assert f"start={said.split(':')[0]}" in tab.url


def test_a_segment_is_left_out_by_keys_alone(opened):
    tab = opened(QUESTION)
    tab.wait_for_selector("dl.figures")
    tab.locator(".map canvas").focus()
    tab.keyboard.press("s")
    segment = tab.inner_text(".map-menu-title")
    tab.get_by_role("menuitem", name="Do not fly this segment").focus()
    tab.keyboard.press("Enter")
    tab.wait_for_function(
        "(one) => document.querySelector('#plan-command').textContent.includes(`--avoid ${one}`)", arg=segment
    )
    tab.wait_for_selector(f".chip:has-text('avoid {segment}')")
    flown = """(pair) => { const r = window.skywayMap.state.plans[0]?.route;
        return r && !r.slice(1).some((b, i) => [`${r[i]}:${b}`, `${b}:${r[i]}`].includes(pair)); }"""
    tab.wait_for_function(flown, arg=segment)


def test_what_is_typed_is_planned_saved_in_every_format_and_opened_again(opened, page):
    tab = opened("/?start=bellevue&to=40.75%2C-73.93&depart=2013-07-10T14%3A00-04%3A00&wind=3%40250&drone=m300")
    tab.wait_for_selector("dl.figures")
    tab.get_by_text("After the delivery").click()
    for label, words in (("Drone goes to", "home"), ("Time at the target", "5min"), ("Package goes to, if not handed over", "back"),
                         ("Reserve %", "25"), ("Aim", "p95")):  # fmt: skip
        tab.get_by_label(label, exact=True).fill(words)
        tab.get_by_label(label, exact=True).press("Tab")
    tab.get_by_label("Compare with").select_option("pfs")
    tab.get_by_label("Compare with").select_option("shortest")
    command = "document.querySelector('#plan-command').textContent"
    for option in ("--return home", "--dwell 5min", "--if-undelivered back", "--reserve 25", "--objective p95"):
        tab.wait_for_function(f"(option) => {command}.includes(option)", arg=option)
    tab.wait_for_function("document.querySelectorAll('button[data-plan]').length >= 2")
    tab.locator("button[data-plan]").nth(1).click()
    tab.wait_for_function("window.skywayMap.state.chosen === 1")
    tab.locator("button[data-plan]").first.click()
    tab.wait_for_function("window.skywayMap.state.chosen === 0")
    tab.get_by_text("Save, export, open").click()
    tab.get_by_label("Name", exact=True).fill("round")
    tab.get_by_label("Name", exact=True).press("Tab")
    begins = {
        "plan.json": "{",
        "plan": "{",
        "waypoints": "QGC WPL",
        "geojson": "{",
        "kml": "<?xml",
        "html": "<!doctype html>",
    }
    tab.get_by_label("Format").select_option("plan")
    tab.get_by_role("button", name="Save in the work folder").click()
    tab.locator(".files .status.wrong").filter(has_text="target").wait_for()  # the ground there is not known
    tab.get_by_label("Ground heights").fill("target=12")
    tab.get_by_label("Ground heights").press("Tab")
    for kind, begin in begins.items():
        tab.get_by_label("Format").select_option(kind)
        tab.get_by_role("button", name="Save in the work folder").click()
        name = re.compile(
            rf"saved (round(?:-2)?\.{kind.removeprefix('plan.')})\b"
        )  # with its parameters, which are there twice
        told = tab.locator(".files .status").filter(has_text=name)
        told.wait_for()
        assert (page.folder / name.search(told.inner_text())[1]).read_text().startswith(begin)
    tab.get_by_role("button", name="Clear").click()
    tab.wait_for_selector("dl.figures", state="detached")
    tab.get_by_label("Plans in the work folder").select_option("round.json")
    tab.get_by_role("button", name="Open").click()
    tab.wait_for_selector("dl.figures")
    assert tab.get_by_label("Drone goes to").input_value() == "home"
    assert tab.get_by_label("Reserve %", exact=True).input_value() == "25"


def test_a_station_is_forbidden_by_a_click_and_allowed_again(opened):
    tab = opened(QUESTION)
    tab.wait_for_selector("dl.figures")
    stop = tab.evaluate("window.skywayMap.stops()[0]")
    tab.mouse.click(*_place(tab, stop))
    tab.get_by_role("menuitem", name="Do not land here").click()
    tab.wait_for_function(
        "(stop) => { const s = window.skywayMap.stops(); return s.length && !s.includes(stop); }", arg=stop
    )
    tab.get_by_role("button", name=f"avoid {stop}").click()
    tab.wait_for_function("(stop) => window.skywayMap.stops().includes(stop)", arg=stop)


@pytest.mark.parametrize(("width", "height"), [(820, 1180), (1280, 900), (3840, 2160)])
def test_a_station_is_hit_where_it_is_seen_on_every_screen(opened, width, height):
    tab = opened("/", width, height)
    tab.mouse.click(*_place(tab, "jacobi"))
    assert tab.inner_text(".map-menu-title").endswith("Jacobi, Bronx")


@pytest.mark.parametrize(
    ("width", "height", "scheme"), [(1024, 768, "light"), (3840, 2160, "dark"), (820, 1180, "light")]
)
@pytest.mark.parametrize("path", PAGES)
def test_nothing_is_cut_off_at_any_width_dark_or_light(opened, path, width, height, scheme, tmp_path):
    tab = opened(path, width, height, scheme)
    if path == QUESTION:
        tab.wait_for_selector("dl.figures")
    tab.wait_for_timeout(1000)
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth + 1")
    tab.screenshot(path=str(tmp_path / "page.png"))
    unnamed = "[...document.querySelectorAll('input, select, button, canvas')].filter((e) => !(e.labels?.length || e.getAttribute('aria-label') || e.textContent.trim())).length"
    assert tab.evaluate(unnamed) == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("path", PAGES)
def test_no_page_is_wider_than_its_window(opened, path, scheme):
    tab = opened(path, WIDTHS[0], 700, scheme)
    if path == QUESTION:
        tab.wait_for_selector(".reasons p")
    for width in WIDTHS:
        tab.set_viewport_size({"width": width, "height": 700})
        tab.wait_for_timeout(300)
        assert tab.evaluate(WIDER) == [], width
        assert tab.evaluate("document.querySelector('.brand').getBoundingClientRect().top") >= 4.0, width
        assert tab.evaluate(SMALLEST) >= 8.5, width


def test_no_name_of_a_station_is_cut_off_where_the_map_ends(opened):
    tab = opened("/", 390, 800)
    tab.wait_for_function("window.skywayMap?.state.region && window.skywayMap.view.width > 1")
    tab.evaluate(
        """() => { window.written = []; const kind = CanvasRenderingContext2D.prototype, before = kind.fillText;
            kind.fillText = function (words, x, y) {
                if (window.skywayMap.view.width === 360) window.written.push([words, x, x + this.measureText(words).width]);
                before.call(this, words, x, y); }; }"""
    )
    tab.set_viewport_size({"width": 360, "height": 800})
    tab.wait_for_function("window.skywayMap.view.width === 360 && window.written.length > 20")
    cut = """() => { const map = window.skywayMap, ids = new Set(map.state.region.stations.map((one) => one.id)), wide = map.view.width;
        return window.written.filter(([words, from, to]) => ids.has(words) && from < wide && to > wide).map(([words]) => words); }"""
    assert tab.evaluate(cut) == []


def test_a_mission_is_dropped_mended_and_converted(opened, page, tmp_path):
    path = tmp_path / "<b>drop.plan"
    path.write_text(json.dumps(_PLAN))
    tab = opened("/missions")
    tab.locator("input[type=file]").set_input_files(str(path))
    tab.get_by_text("there is no LAND").first.wait_for()
    tab.get_by_role("button", name="Convert to .waypoints").click()
    tab.get_by_text("saved").first.wait_for()
    assert (page.folder / "_b_drop.waypoints").read_text().startswith("QGC WPL 110")


_PLAN = {
    "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "geoFence": {"circles": [], "polygons": [], "version": 2},
    "rallyPoints": {"points": [], "version": 2},
    "mission": {
        "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "plannedHomePosition": [40.7, -74.0, 10],
        "items": [
            {"type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": number, "frame": 3, "params": [0, 0, 0, None, 40.7 + 0.01 * number, -74.0, 50]}
            for number, command in ((1, 22), (2, 16))
        ],
    },
}  # fmt: skip


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_as_axe_judges_it(opened, scheme):
    if not Path(AXE).is_file():
        pytest.skip("axe-core is not here: npm install axe-core")
    for path in PAGES:
        tab = opened(path, scheme=scheme)
        if path == QUESTION:
            tab.wait_for_selector("dl.figures")
        tab.locator(".map-key summary").evaluate_all("(found) => found.forEach((one) => one.click())")
        tab.wait_for_timeout(1500)
        tab.evaluate(Path(AXE).read_text())
        found = tab.evaluate(
            "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa', 'best-practice']}).then((r) => r.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).slice(0, 3)}`))"
        )
        assert found == [], path


def test_what_works_things_out_ends_with_a_page_that_is_killed(tmp_path):
    page = served(tmp_path)
    assert page.ask("/api/region")[0] == 200
    workers = [
        int(one) for one in Path(f"/proc/{page.process.pid}/task/{page.process.pid}/children").read_text().split()
    ]
    assert len(workers) >= 2  # one that works, and the tracker of their semaphores
    page.kill()
    until = time.monotonic() + PATIENT_MS / 1000.0
    while (left := [one for one in workers if Path(f"/proc/{one}").exists()]) and time.monotonic() < until:
        time.sleep(0.2)
    assert left == []


def test_a_browser_whose_server_is_killed_finds_its_question_when_it_is_back(browser, tmp_path):
    first = served(tmp_path)
    context = browser.new_context()
    context.set_default_timeout(PATIENT_MS)
    tab = context.new_page()
    tab.goto(first.address + QUESTION)
    tab.wait_for_selector("dl.figures")
    first.kill()
    second = served(tmp_path, "--port", str(first.port))
    try:
        tab.wait_for_selector("dl.figures", state="detached")
        tab.wait_for_selector("dl.figures")
        assert tab.locator("input").first.input_value() == "siuh-north"
    finally:
        context.close()
        ended(second)
