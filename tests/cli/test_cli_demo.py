"""``skyway demo --calibration-flight``: a flight to calibrate with, for whoever has no drone."""

import json
import re
from pathlib import Path

import pytest
from docs_pages import ROOT

from skyway.demo import DemoOptions, run_demo, tell_end
from skyway.link.supervisor import read_journal
from skyway.models.composition.file import from_json, load


def test_a_calibration_flight_tells_the_drag(skyway):
    answer = skyway("demo", "--calibration-flight", "square.tlog", "--payload", "0.7")
    assert answer.code == 0, answer.err
    assert answer.out.startswith("wrote square.tlog")
    found = skyway("calibrate", "wind", "square.tlog", "-o", "drag.toml")
    assert found.code == 0, found
    assert Path("drag.toml").exists()


@pytest.mark.parametrize("payload", ["1.5", "-0.1", "nan", "inf"])
def test_a_calibration_flight_carries_what_the_drone_lifts(refused, payload):
    assert "--payload" in refused("demo", "--calibration-flight", "square.tlog", f"--payload={payload}")


def test_the_demonstration_itself_takes_no_payload(refused):
    assert "--calibration-flight" in refused("demo", "--payload", "0.7")


def test_a_calibration_flight_overwrites_nothing(refused):
    Path("square.tlog").write_text("mine")
    assert "exists already" in refused("demo", "--calibration-flight", "square.tlog")
    assert Path("square.tlog").read_text() == "mine"


def test_a_calibration_flight_is_recorded_under_the_ending_of_its_form(refused):
    assert "name it FILE.tlog" in refused("demo", "--calibration-flight", "square.csv")
    assert not Path("square.csv").exists()


@pytest.mark.parametrize("words", ["scenario check newyork", "wind newyork --hours 1", "network newyork"])
def test_the_built_in_scenario_has_its_name_in_every_command(skyway, words):
    answer = skyway(*words.split())
    assert answer.code == 0, answer.err


NUMBERS = ("no", "one", "two", "three", "four", "five", "six")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The demonstration: its folder, and what it printed."""
    lines = []
    options = DemoOptions(folder=tmp_path_factory.mktemp("demo"))
    outcome = run_demo(options, lines.append)
    return options.folder, [*lines, *tell_end(options, outcome)]


def test_readme_tells_what_the_demonstration_gives(flown):
    """README told three recharges and 11 minutes early where two recharges and 12 minutes late were flown."""
    folder, _ = flown
    records, planned = read_journal(folder / "journal.jsonl").records, load(folder / "plan.json")
    charging = {r.reason.rpartition(" at ")[2] for r in records if r.event == "pad" and r.data["answer"] == "charging"}
    recharges = len(charging), sum(stop.recharge_s > 0.0 for stop in planned.stops)
    delivered_s = next(r.time_s for r in records if r.event == "landed" and r.reason and "white-plains" in r.reason)
    late_min = round((delivered_s - planned.depart.timestamp() - planned.delivery_time_s) / 60.0)
    text = " ".join((ROOT / "README.md").read_text().split())
    assert f"{NUMBERS[recharges[0]]} recharges are enough instead of {NUMBERS[recharges[1]]}" in text, recharges
    word = "later than in the typical schedule" if late_min > 0 else "earlier than in the typical schedule"
    assert f"arrives {abs(late_min)} minutes {word}" in text, late_min


def test_every_told_arrival_of_the_demonstration_has_a_spread_that_holds_what_came(flown):
    """It was told 15:53:45 on average, by half and by 95 %, and arrived at 17:00:55."""
    folder, lines = flown
    records = read_journal(folder / "journal.jsonl").records
    delivered_s = next(r.time_s for r in records if r.event == "landed" and r.reason and "white-plains" in r.reason)
    plans = [from_json(json.dumps(r.data["plan"])) for r in records if r.event == "plan" and r.data["plan"]]
    online = [one for one in plans if one.planner == "online"]
    assert len(online) > 5
    for one in online:
        assert one.arrival.p50 <= one.arrival.p95
        assert delivered_s <= one.arrival.p95.timestamp() + 60.0, one
    assert sum("to the delivery" in line for line in lines) > 5


def test_the_closing_list_of_the_demonstration_has_the_times_of_its_lines(flown):
    """Lines with 14:08:31 EDT were followed by a list with 18:08:31."""
    _, lines = flown
    begin = next(number for number, line in enumerate(lines) if line.startswith("replanned "))
    listed = [line.strip() for line in lines[begin + 1 :] if line.startswith("  ")]
    assert len(listed) > 1
    assert all(re.match(r"\d\d:\d\d:\d\d EDT  ", line) for line in listed)
    on_ground = [line for line in listed if " to the delivery" in line]
    assert on_ground
    assert all(line in lines for line in on_ground)


def test_what_the_drone_reports_of_the_mission_of_the_last_leg_is_explained(flown):
    """Every upload began with a geofence violation, on flights without any."""
    _, lines = flown
    told = [line for line in lines if "the drone reports: " in line and ("waypoint" in line or "Geofence" in line)]
    assert told, "nothing was reported: the test proves nothing"
    assert all("the mission of the last one, on board until the next one is uploaded" in line for line in told)
