"""Each order that a flight takes, given by a click or by holding a button: asked for once, carried out by the drone, journaled with who gave it."""

from __future__ import annotations

import pytest

from skyway.link.supervisor.journal.entries import Ordered
from tests.web.browsing import chromium, hold, person, state
from tests.web.departures import ENDS, departs, planned, taken, the_journal
from tests.web.simulated import simulated

pytestmark = pytest.mark.slow
UNDER_WAY = """() => {
  const { vehicle, leg } = window.skywayFlights.flight.live;
  return leg?.way.length && vehicle.lat !== null && Math.hypot(vehicle.lat - leg.way[0][0], vehicle.lon - leg.way[0][1]) > 0.002;
}"""
"""Whether it is some 200 m from where it took off."""


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.mark.parametrize(
    ("button", "held", "word", "on_the_way", "end"),
    [
        ("Stay at the next landing", False, "stay", "flying", "delivered"),
        ("Return to the last stop", True, "return", "diverting", "stopped-safe"),
        ("Land here", True, "land", "diverting", "landed-elsewhere"),
        ("Divert to", True, "divert jersey-city", "diverting", "asks"),
        (
            "Not handed over",
            True,
            "undelivered",
            "diverting",
            "stopped-safe",
        ),  # back where it came from, with the package
        ("Leave it alone", True, "leave", "left-to-itself", "left-to-itself"),
    ],
)
def test_an_order_is_given_once_and_carried_out(browser, site, tmp_path, button, held, word, on_the_way, end):
    planned(tmp_path, "jersey-city", "hoboken")
    with simulated("jersey-city", speedup=4.0) as simulation, person(browser, site.address, "/fly") as tab:
        departs(tab, simulation)
        tab.get_by_label("Your name").fill("Anna")
        tab.get_by_label("Your name").press("Tab")
        tab.get_by_role("button", name="Start: take off").click()
        tab.get_by_role("button", name="Hold it down: Start: take off").wait_for()  # a click alone starts nothing
        assert taken(the_journal(tmp_path)) == ["take"]
        hold(tab, "Hold it down: Start: take off")
        state(tab, "flying")
        tab.wait_for_function(UNDER_WAY)  # it would land on the pad that it left
        tab.get_by_role("button", name=button).first.wait_for()
        hold(tab, button) if held else tab.get_by_role("button", name=button).click()
        tab.get_by_label("What became of your orders").get_by_text("taken").last.wait_for()
        state(tab, on_the_way, *ENDS)
        if end == "asks":
            tab.wait_for_function("window.skywayFlights.flight.live.question !== null", timeout=300_000)
        else:
            state(tab, *ENDS)
            assert tab.inner_text(".flight .state") == end
    given = [one for one in (record.entry(Ordered) for record in the_journal(tmp_path)) if one is not None]
    assert taken(the_journal(tmp_path)) == ["take", "yes", word]
    assert [(one.name, one.done) for one in given if one.word == word] in (
        [("Anna", "taken")],
        [("Anna", "taken"), ("Anna", "done")],
    )
