"""Deliveries flown from the page, in a real browser, by a simulated drone: by clicks alone, by two people, and beside a page that is killed."""

from __future__ import annotations

import json
import os
import random
import signal
import time
from collections import Counter
from pathlib import Path

import pytest

from skyway.flights.live import read_live
from skyway.link.pads import TcpPads
from skyway.link.supervisor import read_journal
from tests.web.browsing import AXE, FLIGHT_MS, chromium, hold, person, state
from tests.web.conftest import served
from tests.web.departures import ENDS, answered, calibrated, departs, no_flight_twice, planned, taken, the_journal
from tests.web.simulated import simulated

pytestmark = pytest.mark.slow
KILLS = int(os.environ.get("SKYWAY_KILLS", "3"))
"""Beside one flight the page is killed once, as often again with the word to start, and twice as often with orders to pause and go on."""
DELIVERIES = int(os.environ.get("SKYWAY_DELIVERIES", "1"))
"""With other random moments each; 5 make fifty kills and more."""


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def fits(tab, sizes=((1024, 768), (1920, 1080), (820, 1180))):
    for width, height in sizes:
        tab.set_viewport_size({"width": width, "height": height})
        tab.wait_for_timeout(400)
        assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth + 1"), width
    tab.set_viewport_size({"width": 1280, "height": 900})


def judged(tab):
    if Path(AXE).is_file():
        tab.evaluate(Path(AXE).read_text())
        found = tab.evaluate(
            "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa', 'best-practice']}).then((r) => r.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).slice(0, 3)}`))"
        )
        assert found == []


def test_a_delivery_with_a_charge_on_the_way_is_planned_and_flown_by_clicks_alone(browser, site, tmp_path):
    question = (
        "/?start=bellevue&to=jacobi&depart=2013-07-10T14%3A00-04%3A00&wind=3%40250&drone=m200&payload=0.8&reserve=50"
    )
    calibrated(tmp_path)
    with simulated("bellevue") as simulation, person(browser, site.address, question, color_scheme="dark") as tab:
        tab.wait_for_selector("dl.figures")
        tab.get_by_text("Save, export, open").click()
        tab.get_by_label("Format").select_option("plan.json")
        tab.get_by_label("Name", exact=True).fill("plan")
        tab.get_by_label("Name", exact=True).press("Tab")
        tab.get_by_role("button", name="Save in the work folder").click()
        tab.get_by_text("saved plan").wait_for()
        tab.get_by_role("link", name="Fly").click()
        departs(tab, simulation, next(tmp_path.glob("*.json")).name)
        tab.get_by_role("button", name="Start: take off").wait_for()
        assert tab.locator("table.checks tr").count() > 8
        assert tab.locator("table.parameters tr").count() > 2
        judged(tab)
        fits(tab)
        assert simulation.count("parameter .* = ") == simulation.count(r" armed \(") == 0  # nothing before the word
        hold(tab, "Start: take off")
        state(tab, "flying")
        tab.wait_for_selector("svg.chart .ahead")
        judged(tab)
        fits(tab)
        tab.get_by_role("button", name="Pause").click()
        state(tab, "paused")
        tab.get_by_text("still supervised").first.wait_for()
        tab.get_by_role("button", name="Resume").click()
        state(tab, "flying", *ENDS)
        state(tab, "charging", *ENDS)
        assert tab.inner_text(".flight .state") == "charging"
        state(tab, *ENDS)
        records = the_journal(tmp_path)
        assert tab.inner_text(".flight .state") == "delivered"
    assert taken(records) == ["take", "yes", "pause", "go"]
    no_flight_twice(records, simulation)


def test_where_people_charge_they_say_so_by_a_click(browser, site, tmp_path):
    planned(tmp_path, "bellevue", "jacobi", reserve="50")
    calibrated(tmp_path)
    charges = 0
    with simulated("bellevue") as simulation, person(browser, site.address, "/fly") as tab:
        departs(tab, simulation, pads=False)
        hold(tab, "Start: take off")
        pads = TcpPads(simulation.pads)  # the person beside the drone, who connects it
        while True:
            state(tab, "charging", *ENDS)
            if tab.inner_text(".flight .state") != "charging":
                break
            station = next(r.data["station"] for r in reversed(the_journal(tmp_path)) if r.event == "landed")
            tab.wait_for_function("window.skywayFlights.flight.live.charge_to !== null")
            to = tab.evaluate("window.skywayFlights.flight.live.charge_to")
            while pads.charge(station, "1", to).state != "done":
                tab.wait_for_timeout(500)
            pads.release(station, "1")
            tab.get_by_label("Charged to, %").fill(f"{100 * to:.0f}")
            hold(tab, "Charged")
            charges += 1
            answered(tab, tmp_path, "charged", charges)
        pads.close()
        assert tab.inner_text(".flight .state") == "delivered"
    records = the_journal(tmp_path)
    assert charges >= 1
    refused = sum(r.event == "order" and r.data["done"] == "refused" for r in records)  # it had gone on meanwhile
    assert refused < charges
    assert [word.split(" ")[0] for word in taken(records)] == ["take", "yes", *["charged"] * (charges - refused)]
    no_flight_twice(records, simulation)


def test_two_deliveries_are_flown_at_once_a_tab_each_and_both_on_one_map(browser, site, tmp_path):
    for name, ends in (("one.json", ("jersey-city", "hoboken")), ("two.json", ("bellevue", "city-hall"))):
        planned(tmp_path, *ends)
        (tmp_path / "plan.json").rename(tmp_path / name)
    with (
        simulated("jersey-city", speedup=2.0) as first,
        simulated("bellevue", speedup=2.0) as second,
        person(browser, site.address, "/fly") as tab,
    ):
        for number, (plan, simulation) in enumerate((("one.json", first), ("two.json", second)), start=1):
            departs(tab, simulation, plan)
            tab.wait_for_function("(many) => document.querySelectorAll('[role=tab]').length === many", arg=1 + number)
            tab.get_by_role("button", name="Start: take off").wait_for(timeout=FLIGHT_MS)
        for goal in (
            "hoboken",
            "city-hall",
        ):  # both are ready: they take off soon after each other, however slow the machine
            tab.get_by_role("tab", name=goal).click()
            hold(tab, "Start: take off")
            state(tab, "flying")
        tab.get_by_role("tab", name="All", exact=True).click()
        tab.wait_for_function("window.skywayMap.state.vehicles.length === 2")
        tab.get_by_text("2 flights under way").wait_for()
        for goal in ("hoboken", "city-hall"):
            tab.get_by_role("tab", name=goal).click()
            state(tab, "delivered", *ENDS)
            assert tab.inner_text(".flight .state") == "delivered"
            assert goal in tab.inner_text(".flight .big")
    for path, simulation in (
        (next(tmp_path.glob("*-hoboken.jsonl")), first),
        (next(tmp_path.glob("*-city-hall.jsonl")), second),
    ):
        records = read_journal(path).records
        assert taken(records) == ["take", "yes"]
        no_flight_twice(records, simulation)


def test_of_two_browsers_one_commands_the_other_asks_and_is_given_it(browser, site, tmp_path):
    planned(tmp_path, "jersey-city", "hoboken")
    with (
        simulated("jersey-city", speedup=1.5, pad_speedup=4.0) as simulation,
        person(browser, site.address, "/fly") as anna,
    ):
        departs(anna, simulation)
        anna.get_by_label("Your name").fill("Anna")
        anna.get_by_label("Your name").press("Tab")
        anna.get_by_role("button", name="Start: take off").wait_for()
        with person(browser, site.address, "/fly") as ben:
            ben.get_by_role("tab").nth(1).click()
            ben.get_by_text("has command; you watch").wait_for()
            assert ben.get_by_role("button", name="Start: take off").is_disabled()
            ben.get_by_label("Your name").fill("Ben")
            ben.get_by_label("Your name").press("Tab")
            hold(anna, "Start: take off")
            state(anna, "flying")
            state(ben, "flying")
            ben.evaluate("window.skywayFlights.order('pause')")  # as a browser would that does not keep to its buttons
            ben.get_by_text("has command: ask for it first").first.wait_for()
            ben.get_by_role("button", name="Take command").click()
            anna.get_by_text("Ben asks for command").first.wait_for()
            anna.get_by_role("button", name="Give command").click()
            ben.get_by_text("You have command.").wait_for()
            anna.get_by_text("Ben has command; you watch.").wait_for()
            ben.get_by_role("button", name="Pause").click()
            state(anna, "paused")
            ben.get_by_role("button", name="Resume").click()
            state(ben, "delivered")
            state(anna, "delivered")
    records = the_journal(tmp_path)
    assert taken(records) == ["take", "yes", "take", "give", "pause", "go"]
    refused = [(r.data["name"], r.data["word"]) for r in records if r.event == "order" and r.data["done"] == "refused"]
    assert refused == [("Ben", "pause")]
    no_flight_twice(records, simulation)


@pytest.mark.parametrize("seed", range(7, 7 + DELIVERIES))
def test_the_page_is_killed_again_and_again_and_the_flight_neither_notices_nor_is_commanded_twice(
    browser, pages, tmp_path, seed
):
    playwright = pytest.importorskip("playwright.sync_api")
    planned(tmp_path, "jersey-city", "hoboken")
    rng = random.Random(seed)
    killed = Counter()
    page = served(tmp_path)
    pages[:] = [page]
    with simulated("jersey-city", speedup=1.5, pad_speedup=4.0) as simulation:
        with person(browser, page.address, "/fly", minds=False) as tab:

            def killed_within(most_s):
                nonlocal page
                time.sleep(rng.uniform(0.0, most_s))
                killed.update(read_live(live).state for live in tmp_path.glob("*.live"))
                page.kill()
                page = pages[0] = served(tmp_path, "--port", str(page.port))
                done("window.skywayFlights.flight.live.state")

            def done(script):
                """Run a script; a page whose server was another one loads itself again meanwhile, and the script with it is lost."""
                for _ in range(20):
                    try:
                        tab.wait_for_function("window.skywayFlights?.flight && !window.skywayFlights.lost")
                        return tab.evaluate(script)
                    except playwright.Error as error:
                        if "navigation" not in str(error):
                            raise
                raise AssertionError("the page loads itself again and again")

            departs(tab, simulation)
            killed_within(3.0)  # perhaps before this browser has asked for command
            state(tab, "ready")
            if not done("window.skywayFlights.flight.mine"):
                tab.get_by_role("button", name="Take command").click()
                tab.get_by_text("You have command.").wait_for()
            for _ in range(KILLS):  # the word is said again where it was lost, with the same question
                if done("window.skywayFlights.flight.live.question !== null"):
                    done("void window.skywayFlights.order('yes')")
                    killed_within(0.3)
            if done("window.skywayFlights.flight.live.question !== null"):
                hold(tab, "Start: take off")
            state(tab, "flying")
            for _ in range(KILLS):
                done("void window.skywayFlights.order('pause')")
                killed_within(0.5)
                done("void window.skywayFlights.order('go')")
                killed_within(2.0)
            if done("window.skywayFlights.flight.live.paused"):
                done("void window.skywayFlights.order('go')")
            state(tab, *ENDS)
            assert tab.inner_text(".flight .state") == "delivered"
        records = the_journal(tmp_path)
    print(
        f"killed while the delivery was under way: {sum(killed.values()) - sum(killed[one] for one in ENDS)}, {dict(killed)}"
    )
    assert taken(records).count("yes") == 1
    no_flight_twice(records, simulation)


def test_a_browser_that_loses_its_network_says_so_and_finds_the_flight_again_and_a_dead_supervisor_is_continued(
    browser, site, tmp_path
):
    planned(tmp_path, "jersey-city", "hoboken")
    with (
        simulated("jersey-city", speedup=2.0, pad_speedup=6.0) as simulation,
        person(browser, site.address, "/fly", minds=False) as tab,
    ):
        departs(tab, simulation)
        hold(tab, "Start: take off")
        state(tab, "flying")
        tab.context.set_offline(True)
        tab.get_by_text("the data shown are old").wait_for()
        tab.context.set_offline(False)
        tab.wait_for_function("!window.skywayFlights.lost")
        state(tab, "flying")
        (path,) = tmp_path.glob("*.live")
        os.kill(read_live(path).pid, signal.SIGKILL)
        tab.get_by_text("nobody supervises it").first.wait_for()
        tab.get_by_role("button", name="Continue this flight").click()
        tab.wait_for_function("window.skywayFlights.flight.runs")
        state(tab, *ENDS)
        assert tab.inner_text(".flight .state") == "delivered"
        records = the_journal(tmp_path)
    assert len([r for r in records if r.event == "leg"]) == 1
    assert [r.event for r in records].count("resume") >= 1
    no_flight_twice(records, simulation)


def test_the_demonstration_is_flown_by_itself_and_by_a_diverting_person(browser, pages, tmp_path):
    page = served(tmp_path, "--demo")
    pages.append(page)
    with person(browser, page.address, "/fly") as tab:
        tab.get_by_role("tab").nth(1).click()
        state(tab, "flying")
        tab.get_by_role("button", name="Take command").click()
        tab.get_by_text("You have command.").wait_for()
        hold(tab, "Return to the last stop")
        state(tab, "diverting")
        state(tab, "stopped-safe")
        tab.wait_for_function("window.skywayFlights.flight.live.ended")  # it has restored the parameters
    assert json.loads(page.ask("/api/fleet")[2])["flights"][0]["ended"]
