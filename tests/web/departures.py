"""Departures from the page, as a person begins them, and what their journals tell."""

from __future__ import annotations

import time
from collections import Counter

from skyway.cli.main import main
from skyway.link.supervisor import read_journal
from tests.web.browsing import FLIGHT_MS
from tests.web.simulated import DEPART

DRAG = "drag.toml"
ENDS = ("delivered", "stopped-safe", "left-to-itself", "landed-elsewhere", "crashed")


def planned(folder, start, target, **more):
    words = [word for name, value in more.items() for word in (f"--{name}", value)]
    assert main(["plan", "--from", start, "--to", target, "--payload", "0.8", "--drone", "m200", "--depart", DEPART, "--wind", "3@250",
                 "-o", str(folder / "plan.json"), *words]) == 0  # fmt: skip


def calibrated(folder):
    """Write what the wind is told by, which lets a flight be sure of its way on: `DRAG`."""
    from skyway.calibration_flight import drag_of
    from skyway.models.drones.drag_file import drag_file
    from skyway.scenarios import load_scenario

    (folder / DRAG).write_text(drag_file(drag_of(load_scenario(None).drone("m200"), 0.8)))


def departs(tab, simulation, plan="plan.json", *, pads=True):
    """Fill the form and start; the flight's tab is open then. Without pads people charge."""
    tab.wait_for_function(
        "(plan) => [...document.querySelectorAll('option')].some((one) => one.value === plan)", arg=plan
    )
    tab.get_by_label("Plan", exact=True).select_option(plan)
    if tab.locator(f"option[value='{DRAG}']").count():
        tab.get_by_label("Drag of the drone").select_option(DRAG)
    for label, words in (
        ("Connection to the drone", simulation.drone),
        ("Pads", simulation.pads if pads else "manual"),
    ):
        tab.get_by_label(label).fill(words)
        tab.get_by_label(label).press("Tab")
    told = "--pads tcp:" if pads else "--pads manual"
    tab.wait_for_function("(told) => document.querySelector('#fly-command').textContent.includes(told)", arg=told)
    tab.get_by_role("button", name="Connect and check").click()
    tab.wait_for_selector(".flight")


def the_journal(folder):
    (path,) = folder.glob("*.jsonl")
    return read_journal(path).records


def taken(records):
    return [r.data["word"] for r in records if r.event == "order" and r.data["done"] == "taken"]


def answered(tab, folder, word, count):
    """Wait until so many orders of a word were taken or refused."""
    deadline_s = time.monotonic() + FLIGHT_MS / 1000.0
    while True:
        said = [r for r in the_journal(folder) if r.event == "order" and r.data["word"].split(" ")[0] == word]
        if sum(r.data["done"] in {"taken", "refused"} for r in said) >= count:
            return
        assert time.monotonic() < deadline_s, f"order {count} of {word} is not answered"
        tab.wait_for_timeout(200)


def no_flight_twice(records, simulation):
    """No leg was begun again but where it was turned, and every order taken once; each take-off was one arming."""
    ids = Counter(
        r.data["id"]
        for r in records
        if r.event == "order" and r.data["done"] in {"taken", "refused"} and r.data.get("id")
    )
    assert set(ids.values()) <= {1}
    legs = [r for r in records if r.event == "leg"]
    turned = {r.flight for r in records if r.event == "turn"}
    ended = [(r.data["origin"], r.data["destination"]) for r in legs if r.flight not in turned]
    assert len(set(ended)) == len(ended)
    assert simulation.count(r" armed \(") == len(legs)
