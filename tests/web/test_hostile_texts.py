"""Scripts in texts of others, in a real browser: names of stations, zones and files, what an autopilot says, and what is typed. None may run or become an element."""

from __future__ import annotations

import json
import os
import time
from urllib.parse import quote

import msgspec
import pytest

from skyway.cli.main import main
from skyway.flights.live import Live
from tests.web.browsing import chromium, person
from tests.web.conftest import ended, served

pytestmark = pytest.mark.slow
EVIL = "<img src=x onerror=window.hacked=1><script>window.hacked=2</script>"
NAME = "2026-01-01-a-b"
FOUND = "[window.hacked === undefined, document.querySelectorAll('img, .work script, .panel script').length]"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A page whose scenario, files and flights are all named by an attacker."""
    hills, folder = tmp_path_factory.mktemp("scenario") / "hills", tmp_path_factory.mktemp("work")
    assert main(["scenario", "init", str(hills), "--example", "hills"]) == 0
    head, *rows = (hills / "stations.csv").read_text().splitlines()
    column = head.split(",").index("name")
    cells = [row.split(",") for row in rows]
    (hills / "stations.csv").write_text(
        "\n".join([head, *(",".join([*row[:column], EVIL, *row[column + 1 :]]) for row in cells)]) + "\n"
    )
    zones = json.loads((hills / "airspace.json").read_text())
    for zone in zones["features"]:
        zone["name"] = zone["message"] = EVIL
    (hills / "airspace.json").write_text(json.dumps(zones))
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": EVIL,
        "mission": {"version": 2, "items": [], "plannedHomePosition": [45, -30, 0]},
    }
    (folder / "<img src=x onerror=window.hacked=1>.plan").write_text(json.dumps(plan))
    (folder / "<img src=x onerror=window.hacked=1>.tlog").write_bytes(b"\xfe")
    live = Live(pid=os.getpid(), words=["fly", EVIL], journal=f"{NAME}.jsonl", wall_s=time.time(), state="flying", doing=EVIL, problem=EVIL,
                vehicle={"lat": 45.0, "lon": -30.0, "mode": EVIL}, origin=EVIL, destination=EVIL)  # fmt: skip
    (folder / f"{NAME}.live").write_bytes(msgspec.json.encode(live))
    records = [
        ("text", {"severity": "critical", "text": EVIL}),
        ("decision", {"action": EVIL}),
        ("order", {"word": EVIL, "done": "refused"}),
    ]
    (folder / f"{NAME}.jsonl").write_text(
        "".join(
            json.dumps({"n": n, "time": f"2026-01-01T00:00:{n:02d}Z", "state": "flying", "event": event, "reason": EVIL, "data": data}) + "\n"
            for n, (event, data) in enumerate(records, start=1)
        )
    )  # fmt: skip
    page = served(folder, str(hills))
    yield page
    ended(page)


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("/?start=depot&to=midvale&depart=2026-06-01T10%3A00Z&wind=6%40250", ".figures"),
        (f"/?start={quote(EVIL)}&to=midvale&planner={quote(EVIL)}", ".status.wrong"),
        ("/missions?file=" + quote("<img src=x onerror=window.hacked=1>.plan"), ".answer .status, .answer .big"),
        ("/replay?log=" + quote("<img src=x onerror=window.hacked=1>.tlog"), ".status.wrong"),
        (f"/fly?flight={NAME}", ".flight"),
        ("/history", ".panel"),
    ],
)
def test_no_text_of_others_becomes_a_script_or_an_element(site, path, shown):
    with chromium() as browser, person(browser, site.address, path, minds=False) as tab:
        tab.wait_for_selector(shown)
        tab.wait_for_timeout(1500)
        assert tab.evaluate(FOUND) == [True, 0]


def test_what_an_attacker_says_is_shown_as_he_wrote_it(site):
    with chromium() as browser, person(browser, site.address, f"/fly?flight={NAME}") as tab:
        tab.wait_for_selector(".flight .alarms")
        assert EVIL in tab.inner_text(".flight")
        tab.get_by_text("Messages of the autopilot").click()
        assert EVIL in tab.locator("ol.events").first.inner_text()
        assert tab.evaluate(FOUND) == [True, 0]


def test_a_menu_and_a_tip_of_the_map_show_names_as_text(site):
    with chromium() as browser, person(browser, site.address, "/") as tab:
        tab.wait_for_function(
            "window.skywayMap?.state.region && window.skywayMap.state.actions && window.skywayMap.view.width > 1"
        )
        tab.locator(".map canvas").focus()
        tab.keyboard.press("n")
        tab.keyboard.press("Enter")
        assert tab.inner_text(".map-menu-title") == EVIL
        tab.evaluate("window.skywayMap.hover(...window.skywayMap.view.toScreen(45.0, -30.15))")
        assert EVIL in tab.inner_text(".map-tip")
        assert tab.evaluate(FOUND) == [True, 0]
