"""With the keyboard alone, as a person without a mouse: planned, saved, uploaded, flown, replayed; stops and pads of the map moved."""

from __future__ import annotations

import json

import pytest

from tests.web.browsing import HELD_MS, chromium, person, state
from tests.web.conftest import ended, served
from tests.web.departures import DRAG, calibrated, no_flight_twice, taken, the_journal
from tests.web.simulated import simulated
from tests.web.test_recharge_page import PADS, mission

pytestmark = pytest.mark.slow
MOST_TABS = 250
HERE = """() => { const e = document.activeElement; const label = [...(e.labels || [])].map((one) => one.textContent.trim()).join(' ');
    return [e.tagName.toLowerCase(), label || e.getAttribute('aria-label') || e.textContent.trim()]; }"""


def to(tab, name, tag=None, key="Tab"):
    """Press Tab until something of this name has the focus."""
    for _ in range(MOST_TABS):
        found_tag, found = tab.evaluate(HERE)
        if found.startswith(name) and tag in (None, found_tag):
            return
        tab.keyboard.press(key)
    raise AssertionError(f"Tab does not lead to {name}")


def typed(tab, label, words):
    """Go to a field and type in place of what stands there."""
    to(tab, label, "input")
    tab.keyboard.press("Control+a")
    tab.keyboard.type(words)
    tab.keyboard.press("Tab")


def chosen(tab, label, words, key="Tab"):
    """Go to a list and choose by the first letters."""
    to(tab, label, "select", key)
    tab.wait_for_function(
        "(words) => [...document.activeElement.options].some((one) => one.textContent.startsWith(words))", arg=words
    )
    tab.keyboard.type(words)
    tab.wait_for_function(
        "(words) => document.activeElement.selectedOptions[0].textContent.startsWith(words)", arg=words
    )


def pressed(tab, name, tag="button"):
    to(tab, name, tag)
    tab.keyboard.press("Enter")


def held(tab, name):
    to(tab, name, "button")
    tab.keyboard.down(" ")
    tab.wait_for_timeout(HELD_MS)
    tab.keyboard.up(" ")


def at_station(tab, station):
    """Go from station to station, as the map says them."""
    for _ in range(100):
        if tab.inner_text(".map .only-heard").startswith(f"{station}:"):
            return
        tab.keyboard.press("n")
    raise AssertionError(station)


def picked(tab, words):
    """Choose from the menu of the map, which has the focus."""
    for _ in range(12):
        if tab.evaluate(HERE)[1] == words:
            tab.keyboard.press("Enter")
            return
        tab.keyboard.press("ArrowDown")
    raise AssertionError(words)


def commanded(tab, words, *, wanted=True):
    tab.wait_for_function(
        "([words, wanted]) => document.querySelector('#plan-command').textContent.includes(words) === wanted && !document.querySelector('.answer .status').textContent",
        arg=[words, wanted],
    )


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def test_a_delivery_is_planned_saved_uploaded_flown_and_replayed_with_the_keyboard_alone(browser, site, tmp_path):
    calibrated(tmp_path)
    with simulated("bellevue", speedup=8.0) as simulation, person(browser, site.address, "/") as tab:
        tab.wait_for_function("window.skywayMap?.state.region")
        for label, words in (("Start", "bellevue"), ("Deliver to", "jacobi"), ("Package", "0.8")):
            typed(tab, label, words)
        chosen(tab, "Drone", "m200")
        to(tab, "Departure", "input")
        tab.keyboard.type("07102013")
        tab.keyboard.press("Tab")
        tab.keyboard.type("0200PM")
        typed(tab, "Reserve", "50")
        typed(tab, "Wind", "3@250")
        tab.wait_for_selector("dl.figures")
        commanded(tab, "--depart 2013-07-10T14:00-04:00")
        _routed(tab)
        _saved(tab, tmp_path)
        _uploaded(tab, simulation)
        _flown(tab, simulation, tmp_path)
        _replayed(tab)


def _routed(tab):
    """Pin a stop, move it, forbid a station, leave out a segment; and take it all back."""
    before = tab.inner_text("#plan-command")
    to(tab, "Map of the network", "canvas")
    at_station(tab, "columbia")
    tab.keyboard.press("Enter")
    picked(tab, "Stop here on the way")
    commanded(tab, "--stop-at columbia")
    tab.wait_for_function("window.skywayMap.stops().includes('columbia')")
    assert tab.evaluate(HERE)[0] == "canvas"
    tab.keyboard.press("Enter")
    picked(tab, "Move this stop to another station")
    at_station(tab, "yankee-stadium")
    tab.keyboard.press("Enter")
    commanded(tab, "--stop-at yankee-stadium")
    assert "--avoid columbia" in tab.inner_text("#plan-command")
    tab.keyboard.press("s")
    segment = tab.inner_text(".map-menu-title")
    picked(tab, "Do not fly this segment")
    commanded(tab, segment)
    pressed(tab, f"avoid {segment}")
    commanded(tab, segment, wanted=False)
    assert tab.evaluate(HERE)[0] in {"button", "input"}  # what was pressed is gone: the focus is next to it
    for _ in range(4):  # each of the four
        pressed(tab, "Undo")
    tab.wait_for_function("(was) => document.querySelector('#plan-command').textContent === was", arg=before)


def _saved(tab, folder):
    tab.wait_for_function("!document.querySelector('.answer .status').textContent")
    to(tab, "Save, export, open", "summary")
    tab.keyboard.press("Enter")
    typed(tab, "Name", "keys")
    for kind, name in (("plan", "keys.plan"), ("plan.json", "keys.json")):
        to(tab, "Format", "select", "Shift+Tab")
        for key in ("ArrowUp", "ArrowDown"):
            for _ in range(6):
                if tab.evaluate("document.activeElement.value") != kind:
                    tab.keyboard.press(key)
        pressed(tab, "Save in the work folder")
        tab.get_by_text(f"saved {name}").wait_for()
        assert (folder / name).is_file()


def _uploaded(tab, simulation):
    pressed(tab, "Missions", "a")
    tab.wait_for_selector(".drop")
    chosen(tab, "Missions in the work folder", "keys.plan")
    tab.wait_for_selector(".answer table")
    typed(tab, "Connection", simulation.drone)
    to(tab, "I am sure", "input")
    tab.keyboard.press(" ")
    pressed(tab, "Upload and read back")
    tab.get_by_text("upload: done").wait_for()


def _flown(tab, simulation, folder):
    pressed(tab, "Fly", "a")
    tab.wait_for_selector(".tabs")
    chosen(tab, "Plan", "keys.json")
    typed(tab, "Connection to the drone", simulation.drone)
    typed(tab, "Pads", simulation.pads)
    chosen(tab, "Drag of the drone", DRAG)
    tab.wait_for_function("document.querySelector('#fly-command').textContent.includes('--pads tcp:')")
    pressed(tab, "Connect and check")
    tab.get_by_role("button", name="Start: take off").wait_for()
    held(tab, "Start: take off")
    state(tab, "flying")
    shown = "document.querySelector('.flight .state')?.textContent"
    for _ in range(
        5
    ):  # said again where it was refused: a simulation that is kept waiting by others seems lost for seconds
        tab.get_by_role("button", name="Pause").wait_for()
        pressed(tab, "Pause")
        tab.wait_for_function(f"{shown} === 'paused' || window.skywayFlights.asked.at(-1)?.wrong")
        if tab.evaluate(f"{shown} === 'paused'"):
            break
    state(tab, "paused")
    tab.get_by_role("button", name="Resume").wait_for()
    pressed(tab, "Resume")
    state(tab, "delivered", "stopped-safe", "left-to-itself", "landed-elsewhere", "crashed")
    assert tab.inner_text(".flight .state") == "delivered"
    records = the_journal(folder)
    assert taken(records) == ["take", "yes", "pause", "go"]
    no_flight_twice(records, simulation)


def _replayed(tab):
    pressed(tab, "Replay this flight", "a")
    scrubbed(tab)


def scrubbed(tab):
    """Play a log: by the slider, from event to event, and at another speed."""
    tab.wait_for_function("window.skywayPlayer?.logs.length === 1")
    at = "window.skywayPlayer.at"
    to(tab, "Time of the log", "input")
    tab.keyboard.press("End")
    assert tab.evaluate(at) == tab.evaluate("window.skywayPlayer.end")
    tab.keyboard.press("Home")
    tab.keyboard.press("PageUp")
    there = tab.evaluate(at)
    assert there > 0
    to(tab, "Next event", "button", "Shift+Tab")
    tab.keyboard.press(" ")  # this button, not Play
    assert tab.evaluate(at) > there
    assert not tab.evaluate("window.skywayPlayer.playing")
    there = tab.evaluate(at)
    to(tab, "Time of the log", "input")
    tab.keyboard.press("Tab")
    tab.keyboard.press("ArrowDown")
    tab.keyboard.press("ArrowDown")
    tab.keyboard.press("Enter")
    tab.wait_for_function(f"{at} >= {there}")
    chosen(tab, "Speed", "120 x", "Shift+Tab")
    to(tab, "Play", "button", "Shift+Tab")
    there = tab.evaluate(at)
    tab.keyboard.press("Enter")
    tab.wait_for_function(f"{at} > {there}")
    tab.keyboard.press("Enter")
    tab.wait_for_function("!window.skywayPlayer.playing")


def test_pads_are_put_and_moved_with_the_keyboard_alone(browser, tmp_path):
    for name, words in (("long.plan", mission()), ("pads.csv", PADS)):
        (tmp_path / name).write_text(words)
    page = served(tmp_path)
    try:
        with person(browser, page.address, "/recharge") as tab:
            tab.wait_for_function("window.skywayMap?.state.region")
            chosen(tab, "Mission", "long.plan")
            chosen(tab, "Pads", "pads.csv")
            tab.wait_for_selector("dl.figures")
            to(tab, "The ground of all pads is as high as home", "input")
            tab.keyboard.press(" ")
            to(tab, "Map of the mission and its pads", "canvas")
            tab.keyboard.press("m")
            name = tab.inner_text(".map .only-heard")
            was = tab.evaluate("(name) => window.skywayMap.state.marks.find((one) => one.id === name).place", name)
            tab.keyboard.press("Enter")
            picked(tab, "Move this pad")
            for _ in range(2):
                tab.keyboard.press("ArrowUp")
            tab.keyboard.press("Shift+ArrowRight")
            tab.keyboard.press("Enter")
            tab.get_by_role("button", name=f"{name} at").wait_for()
            now = "(name) => window.skywayMap.state.marks.find((one) => one.id === name)?.place"
            tab.wait_for_function(f"([name, lat]) => ({now})(name)?.[0] > lat", arg=[name, was[0]])
            assert tab.evaluate(now, name)[1] > was[1]
            tab.keyboard.press("Escape")
            tab.keyboard.press("Enter")
            picked(tab, "Put a pad here")
            tab.get_by_role("button", name="pad-1 at").wait_for()
            tab.wait_for_selector("dl.figures")
            pressed(tab, "Save in the work folder")
            tab.get_by_text("saved long-batteries-pads.csv, long-batteries").wait_for()
        assert json.loads((tmp_path / "long-batteries" / "recharge.json").read_text())
        assert "pad-1" in (tmp_path / "long-batteries-pads.csv").read_text()
    finally:
        ended(page)
