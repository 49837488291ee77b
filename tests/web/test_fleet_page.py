"""The fleet page: what needs a person first, what drones and pads do when, and texts of others as texts."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

import pytest

from skyway.cli.main import main
from skyway.dispatch.records import (
    WITH_PACKAGE,
    ChangeRecord,
    DroneRecord,
    FlightRecord,
    OrderRecord,
    PadRecord,
    PlannedPart,
    PlanStep,
    Progress,
    Promise,
    ServiceRecord,
    written,
)
from skyway.models.base.errors import InputError
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order, Vehicle
from skyway.web.pages.fleet_answer import parts
from skyway.web.preferences import Preferences
from skyway.web.work.dispatched import told
from tests.web.browsing import chromium, person

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
BEGIN_S = START.timestamp()
SCRIPT = "<img src=x onerror=alert(1)>"


def step(kind, begin_min, end_min, origin="bellevue", destination="jacobi"):
    begin, end = (BEGIN_S + 60.0 * one for one in (begin_min, end_min))
    return PlanStep(
        kind=kind, origin=origin, destination=destination, begin_s=begin, end_s=end, soc_begin=0.9, soc_end=0.5
    )


@pytest.fixture
def ledger(tmp_path):
    """A fleet of two: one flies and is late, one is lost; a pad is out of order, and a promise was changed."""
    name = tmp_path / "ledger.db"
    with open_ledger(str(name)) as book:
        desk = Desk(book, "dispatch")
        desk.put_down(
            "service",
            "service",
            "running",
            written(ServiceRecord(begin_s=BEGIN_S, folder=str(tmp_path), ledger=str(name))),
        )
        order = Order(
            id="o1",
            origin="bellevue",
            destination="jacobi",
            mass_kg=0.3,
            ready=START,
            due=START + timedelta(minutes=22),
        )
        first, then = (Promise(drone="d1", fetched_s=BEGIN_S, delivered_s=BEGIN_S + 60.0 * one) for one in (40, 55))
        record = OrderRecord(order=order, place="bellevue", drone="d1", promise=then, first=first, changes=1)
        desk.put_down("order", "o1", "under way", written(record))
        lost = OrderRecord(
            order=order, place="nowhere", reason=f"its drone {SCRIPT} " + "stands where nobody can reach it; " * 12
        )
        desk.put_down("order", "o2", "handed to a person", written(lost))
        flown = FlightRecord(
            drone="d1", type="m200", system=1, order="o1", phase=WITH_PACKAGE, mass_kg=0.3, composition={}, steps=(step("fly", 0, 20),), not_before_s=BEGIN_S,
            journal="a.jsonl", progress=Progress(at_s=BEGIN_S + 600.0, state="flying", soc=0.7, late_s=300.0, lat=40.8, lon=-73.9),
        )  # fmt: skip
        desk.put_down("flight", "f1", "flying", written(flown))
        vehicle = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue", soc=1.0)
        route = (
            PlannedPart(
                order=None,
                phase="home",
                steps=(step("charge", 20, 40, "jacobi"), step("fly", 40, 60, "jacobi", "bellevue")),
            ),
        )
        desk.put_down(
            "drone",
            "d1",
            "flying",
            written(DroneRecord(vehicle=vehicle, system=1, place="bellevue", soc=0.9, flight="f1", route=route)),
        )
        desk.put_down(
            "drone",
            "d2",
            "lost",
            written(DroneRecord(vehicle=vehicle, system=2, place="jacobi", soc=0.2, reason="silent")),
        )
        out = PadRecord(station="jacobi", pad=1, from_s=BEGIN_S, until_s=BEGIN_S + 7200.0, reason=SCRIPT)
        desk.put_down("pad", "jacobi 1", "out", written(out))
        change = ChangeRecord(
            order="o1", before=first, after=then, at_s=BEGIN_S + 500.0, why="the pad at jacobi is out of order"
        )
        desk.put_down("change", "c1", "told", written(change))
    return name


def test_what_needs_a_person_comes_first_and_bars_are_those_of_the_ledger(ledger):
    found = told(str(ledger), "dispatch")
    alarms = found["alarms"]
    assert alarms[0].startswith("no dispatcher runs")
    assert alarms[1].startswith("d2 is lost")
    assert alarms[2].startswith("o2 needs a person")
    assert "pad 1 of jacobi" in alarms[-2]
    assert (
        alarms[-1] == "o1 is expected 3 min after its due time: d1 is 5 min behind its plan, which had 2 min to spare"
    )
    bars = {row["name"]: [(bar["kind"], bar["state"]) for bar in row["bars"]] for row in found["doing"]}
    assert bars == {"d1": [("fly", "now"), ("charge", "planned"), ("fly", "planned")], "d2": []}
    assert [row["name"] for row in found["booked"]] == ["jacobi 1"]
    places = {one["id"]: (one["lat"], one["lon"]) for one in found["drones"]}
    assert places["d1"] == (40.8, -73.9)
    assert places["d2"] == pytest.approx((40.857, -73.846), abs=0.01)
    assert {one["id"]: one["place"] for one in found["drones"]} == {"d1": "in the air", "d2": "jacobi"}
    assert "<td>in the air</td>" in parts(found, Preferences())["drones"]
    with pytest.raises(InputError, match="no service of this name"):
        told(str(ledger), "another")


def test_the_parts_tell_times_in_the_zone_that_is_preferred_and_no_text_is_a_script(ledger):
    found = told(str(ledger), "dispatch")
    local, utc = parts(found, Preferences()), parts(found, Preferences(time="utc"))
    assert "18:55" in utc["orders"]
    assert "(first 18:40)" in utc["orders"]
    assert "14:55" in local["orders"]
    assert "out of order" in utc["changes"]
    assert "<svg" in utc["drones-when"]
    assert "<svg" in utc["pads-when"]
    assert not any("<img" in words for words in utc.values())


def orders_of(ledger, preferences=None):
    """The cells of the table of orders, by id."""
    table = parts(told(str(ledger), "dispatch"), preferences or Preferences())["orders"]
    rows = [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr[^>]*>(.*?)</tr>", table)]
    return {cells[0]: cells[1:] for cells in rows if cells}


def test_an_order_without_a_promise_shows_none_not_its_first_one(ledger):
    with open_ledger(str(ledger)) as book:
        desk = Desk(book, "dispatch")
        order = Order(id="o3", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=START)
        first = Promise(drone="d1", fetched_s=BEGIN_S, delivered_s=BEGIN_S + 2400.0)
        for name, state in (("o3", "handed to a person"), ("o4", "new")):
            desk.put_down("order", name, state, written(OrderRecord(order=order, place="bellevue", first=first)))
    promised = {name: cells[3] for name, cells in orders_of(ledger).items()}
    assert promised == {"o1": "14:55 (first 14:40)", "o2": "", "o3": "", "o4": ""}


def test_after_midnight_times_of_orders_are_those_of_the_command_line(ledger, capsys):
    with open_ledger(str(ledger)) as book:
        later = DroneRecord(
            vehicle=Vehicle(id="d3", type="m200", home="bellevue", place="bellevue", soc=1.0), system=3, place="bellevue",
            soc=0.9, measured_s=BEGIN_S + 20.0 * 3600.0,
        )  # fmt: skip
        desk = Desk(book, "dispatch")
        desk.put_down("drone", "d3", "standing", written(later))
        next_day = START + timedelta(hours=12)
        order = Order(id="o3", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=next_day)
        desk.put_down("order", "o3", "new", written(OrderRecord(order=order, place="bellevue")))
    shown = orders_of(ledger)
    assert "2013-07-11" in parts(told(str(ledger), "dispatch"), Preferences())["head"]
    assert shown["o1"][2:4] == ["14:22", "14:55 (first 14:40)"]
    assert shown["o3"][2] == "02:00 +1d"
    assert main(["orders", "list", "--ledger", str(ledger)]) == 0
    listed = capsys.readouterr().out
    assert "14:22" in listed
    assert "02:00 +1d" in listed


def test_a_name_that_is_too_long_for_a_chart_keeps_its_number(ledger):
    found = told(str(ledger), "dispatch")
    bars = found["booked"][0]["bars"]
    names = ("hackensack 1", "hackensack 12", "jacobi 1", "courier-drone-117", "yankee-stadium-north")
    found["booked"] = [{"name": name, "bars": bars, "wrong": False} for name in names]
    shown = re.findall(r"</title>([^<]*)</text>", parts(found, Preferences())["pads-when"])
    assert shown == ["hackensa… 1", "hackens… 12", "jacobi 1", "courie…-117", "yankee-sta…"]
    assert all(len(name) <= 11 for name in shown)


@pytest.mark.slow
def test_the_page_shows_the_fleet_and_reads_no_file_outside_of_its_folder(ledger, tmp_path):
    from tests.web.conftest import ended, served

    page = served(tmp_path)
    try:
        for name in ("../ledger.db", "/etc/passwd", "a.txt", str(ledger)):
            assert page.ask(f"/api/dispatch?ledger={name}&holder=dispatch")[0] == 422
        with chromium() as browser, person(browser, page.address, "/fleet") as tab:
            tab.get_by_text("d2 is lost").wait_for()
            assert tab.get_by_text("d1 is 5 min behind its plan", exact=False).count() == 1
            assert tab.locator(".fleet img").count() == 0
            tab.set_viewport_size({"width": 390, "height": 800})
            tab.locator(".below").first.scroll_into_view_if_needed()
            heights, right = tab.evaluate("""() => [
                [...document.querySelectorAll(".fleet tbody tr:not(:has(.below))")].map((one) => one.getBoundingClientRect().height),
                Math.max(...[...document.querySelectorAll(".below")].map((one) => one.getBoundingClientRect().right))]""")
            assert max(heights) < 75.0  # four lines: a place, a time with the first promise
            assert right <= 390.0
            tab.wait_for_function("window.skywayMap.state.vehicles.length === 2")
            assert "--ledger ledger.db" in tab.inner_text("#fleet-command")
    finally:
        ended(page)


@pytest.mark.slow
def test_old_data_are_called_old_and_those_of_one_ledger_are_not_shown_for_another(ledger, tmp_path):
    from tests.web.conftest import ended, served

    (tmp_path / "junk.db").write_bytes(b"not a database" * 100)
    page = served(tmp_path)
    try:
        with chromium() as browser, person(browser, page.address, "/fleet?ledger=ledger.db", minds=False) as tab:
            tab.get_by_text("d2 is lost").wait_for()
            tab.get_by_role("combobox", name="Ledger").select_option("junk.db")
            tab.get_by_text("junk.db: cannot be used as a ledger", exact=False).wait_for()
            assert tab.get_by_text("d2 is lost").count() == 0
            tab.get_by_role("combobox", name="Ledger").select_option("ledger.db")
            tab.get_by_text("d2 is lost").wait_for()
            page.kill()
            tab.get_by_text("The page's server does not answer: the data shown are old.").wait_for()
            assert tab.evaluate("window.skywayMap.state.vehicles.every((one) => one.stale)")
            assert tab.get_by_text("d2 is lost").count() == 1
    finally:
        ended(page)
