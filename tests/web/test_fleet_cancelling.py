"""Orders of a fleet that are cancelled on the fleet page: held, asked of the dispatcher as by the command, and the answer told."""

from __future__ import annotations

import json
import sqlite3
from datetime import UTC, datetime, timedelta

import pytest

from skyway.dispatch.records import (
    WITH_PACKAGE,
    CancelRecord,
    FlightRecord,
    OrderRecord,
    PlanStep,
    ServiceRecord,
    read,
    written,
)
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.ledger import LedgerError
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order
from skyway.web.guard import BROWSER
from skyway.web.pages.fleet_answer import cancellable
from skyway.web.preferences import Preferences
from skyway.web.work import dispatched
from skyway.web.work.dispatched import told
from tests.web.browsing import chromium, hold, person
from tests.web.conftest import ended, served

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
STEP = PlanStep(kind="fly", origin="bellevue", destination="jacobi", begin_s=START.timestamp(), end_s=START.timestamp() + 900.0, soc_begin=0.9, soc_end=0.5)  # fmt: skip
NAME = "cancelled.db"


def fleet(folder, state="running", name=NAME):
    """A ledger without a dispatcher: two orders wait, one is in flight, one is aboard a drone on its way, one is closed."""
    path = folder / name
    path.unlink(missing_ok=True)
    with open_ledger(str(path)) as book:
        desk = Desk(book, "dispatch")
        service = ServiceRecord(begin_s=START.timestamp(), folder=str(folder), ledger=str(path))
        desk.put_down("service", "service", state, written(service))
        for order, its in (
            ("o1", "new"),
            ("o2", "under way"),
            ("o3", "aboard"),
            ("o4", "delivered"),
            ("o5", "promised"),
        ):
            one = Order(
                id=order,
                origin="bellevue",
                destination="jacobi",
                mass_kg=0.3,
                ready=START,
                due=START + timedelta(hours=1),
            )
            desk.put_down("order", order, its, written(OrderRecord(order=one, place="bellevue")))
        flown = FlightRecord(
            drone="d1", type="m200", system=1, order="o2", phase=WITH_PACKAGE, mass_kg=0.3, composition={}, steps=(STEP,), not_before_s=0.0,
            journal="1.jsonl",
        )  # fmt: skip
        desk.put_down("flight", "f1", "flying", written(flown))
    return path


def request_of(path, order):
    """What the desk has of the request to cancel an order: its state, and who asked."""
    with open_ledger(str(path)) as book:
        entry = Desk(book, "dispatch").get("cancel", order)
        return None if entry is None else (entry.state, read(entry, CancelRecord).by)


def decide(path, order, state, reason=""):
    """Decide as the dispatcher does: a request to cancel an order is done or refused."""
    with open_ledger(str(path)) as book:
        desk = Desk(book, "dispatch")
        lease = book.acquire("dispatch", "a test")
        entry = desk.get("cancel", order)
        answer = CancelRecord(by=read(entry, CancelRecord).by, reason=reason)
        changed = [type(entry)("cancel", order, entry.version, state, entry.keeper, written(answer))]
        if state == "done":
            found = desk.get("order", order)
            changed.append(type(entry)("order", order, found.version, "cancelled", found.keeper, found.document))
        desk.put(lease, changed)
        book.give_back(lease)


def test_orders_that_can_be_cancelled_are_listed_and_those_that_were_asked_for_say_so(tmp_path):
    path = fleet(tmp_path)
    with open_ledger(str(path)) as book:
        Desk(book, "dispatch").put_down("cancel", "o5", "asked", written(CancelRecord(by="ana")))
    assert [one["words"] for one in cancellable(told(str(path), "dispatch"), Preferences())] == [
        "o1: bellevue > jacobi, due 15:00, new",
        "o5: bellevue > jacobi, due 15:00, cancellation asked",
    ]
    assert cancellable(told(str(fleet(tmp_path, "ended")), "dispatch"), Preferences()) == []


def test_a_locked_ledger_holds_no_process_of_the_page_for_long(tmp_path, monkeypatch):
    monkeypatch.setattr("skyway.web.work.dispatched.LEDGER_WAIT_S", 0.05)
    path = fleet(tmp_path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        assert len(told(str(path), "dispatch")["orders"]) == 5
        with pytest.raises(LedgerError, match="is locked: another process has been writing to it"):
            dispatched.cancel(str(path), "dispatch", "o1", "ana")
    finally:
        other.close()
    assert dispatched.cancel(str(path), "dispatch", "o1", "ana")["told"].startswith("o1: cancellation asked")


def test_a_cancellation_is_taken_only_from_a_browser_that_has_opened_the_page(page):
    path = fleet(page.folder)
    own = {"Origin": page.address, "Cookie": f"{BROWSER}={'x' * 32}"}
    asked = {"ledger": NAME, "holder": "dispatch", "order": "o1", "name": "Ana\u202e"}

    def sent(body, **headers):
        status, _, answer = page.ask("/api/dispatch/cancel", "POST", json.dumps(body).encode(), **headers)
        return status, answer

    for status, body, headers in [
        (403, asked, {"Origin": page.address}),
        (403, asked, {"Cookie": own["Cookie"]}),
        (403, asked, {"Cookie": own["Cookie"], "Origin": "http://evil.example"}),
        (422, [asked], own), (422, {**asked, "by": "b"}, own), (422, {**asked, "order": ""}, own), (422, {**asked, "name": "x" * 41}, own),
        (409, {**asked, "ledger": "../cancelled.db"}, own), (409, {**asked, "ledger": "orders.csv"}, own),
        (409, {**asked, "holder": "another"}, own), (409, {**asked, "order": "o9"}, own),
        (409, {**asked, "order": "o2"}, own), (409, {**asked, "order": "o3"}, own), (409, {**asked, "order": "o4"}, own),
    ]:  # fmt: skip
        assert sent(body, **headers)[0] == status, (body, headers)
    assert page.ask("/api/dispatch/cancel", Cookie=own["Cookie"])[0] in {404, 405}
    assert [request_of(path, f"o{number}") for number in range(1, 6)] == [None] * 5
    assert "its package is aboard d1" in sent({**asked, "order": "o2"}, **own)[1]

    status, answer = sent(asked, **own)
    assert (status, json.loads(answer)["told"]) == (
        200,
        "o1: cancellation asked; no dispatcher runs, the next skyway dispatch run decides",
    )
    assert request_of(path, "o1") == ("asked", "Ana")
    decide(path, "o1", "done")
    assert json.loads(sent(asked, **own)[1])["told"] == "o1 was already cancelled"
    assert sent({**asked, "order": "o5", "name": " "}, **own)[0] == 200
    assert request_of(path, "o5")[1].startswith("operator ")
    decide(path, "o5", "refused", "its package is aboard d2 and will be delivered")
    status, answer = sent({**asked, "order": "o5"}, **own)
    assert status == 409
    assert "o5 cannot be cancelled: its package is aboard d2" in answer


@pytest.mark.slow
def test_an_order_is_cancelled_by_holding_and_never_another_in_its_place(tmp_path):
    path = fleet(tmp_path)
    page = served(tmp_path)
    try:
        with chromium() as browser, person(browser, page.address, f"/fleet?ledger={NAME}") as tab:
            chosen = tab.locator("#cancel-order")
            chosen.wait_for()
            assert tab.get_by_role("button", name="Cancel the order").is_disabled()
            chosen.select_option("o5")
            tab.get_by_role("button", name="Cancel o5").click()
            tab.get_by_text("Hold it down: Cancel o5").wait_for()
            assert request_of(path, "o5") is None
            with open_ledger(str(path)) as book:  # it is picked up while it is chosen
                desk = Desk(book, "dispatch")
                lease = book.acquire("dispatch", "a test")
                entry = desk.get("order", "o5")
                desk.put(lease, [type(entry)("order", "o5", entry.version, "aboard", entry.keeper, entry.document)])
                book.give_back(lease)
            tab.get_by_text("o5 can no longer be cancelled", exact=False).wait_for()
            assert chosen.input_value() == ""
            assert tab.get_by_role("button", name="Cancel the order").is_disabled()
            tab.fill("#my-name", "Ana")
            chosen.select_option("o1")
            hold(tab, "Cancel o1")
            tab.get_by_text("o1: cancellation asked; no dispatcher runs", exact=False).wait_for()
            assert request_of(path, "o1") == ("asked", "Ana")
            tab.wait_for_function("document.querySelector('#cancel-order').textContent.includes('cancellation asked')")
        decide(path, "o1", "refused", "it was fetched before")
        with chromium() as browser, person(browser, page.address, f"/fleet?ledger={NAME}", minds=False) as tab:
            tab.wait_for_selector("#cancel-order")
            tab.focus("#cancel-order")
            tab.select_option("#cancel-order", "o1")
            tab.keyboard.press("Tab")
            tab.keyboard.press("Tab")
            tab.keyboard.down("Enter")
            tab.get_by_text("o1 cannot be cancelled: it was fetched before", exact=False).wait_for()
            tab.keyboard.up("Enter")
            tab.wait_for_function("document.activeElement.matches('.cancelling *')")
    finally:
        ended(page)
