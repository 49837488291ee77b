"""What the status of a service says: its time, and what its drones do."""

import json
from dataclasses import replace
from datetime import timedelta

import pytest
from fleet_runs import START
from msgspec import structs

from skyway.cli.main import main
from skyway.dispatch.dispatcher.promises import Promises
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.records import (
    HOME,
    TO_PACKAGE,
    WITH_PACKAGE,
    DroneRecord,
    End,
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
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order, Vehicle
from skyway.planner.dispatch.result import Answer
from skyway.web.work.dispatched import told as told_on_the_page

BEGIN_S = START.timestamp()
D1 = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue")

STEP = PlanStep(kind="fly", origin="bellevue", destination="jacobi", begin_s=BEGIN_S, end_s=BEGIN_S + 600.0, soc_begin=0.9, soc_end=0.5)  # fmt: skip
FLIGHT = FlightRecord(
    drone="d1", type="m200", system=1, order=None, phase=HOME, mass_kg=0.0, composition={}, steps=(STEP,), not_before_s=BEGIN_S,
    journal="a.jsonl", progress=Progress(at_s=BEGIN_S + 600.0, state="charging", station="jacobi"),
)  # fmt: skip


def put_service(desk, folder, state="running"):
    service = ServiceRecord(begin_s=BEGIN_S, folder=str(folder), ledger=str(folder / "ledger.db"))
    desk.put_down("service", "service", state, written(service))


@pytest.fixture
def desk(tmp_path):
    with open_ledger(str(tmp_path / "ledger.db")) as book:
        yield Desk(book, "dispatch")


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """Tables of a wide terminal."""
    monkeypatch.setenv("COLUMNS", "250")


def shown(tmp_path, capsys):
    assert main(["dispatch", "status", "--ledger", str(tmp_path / "ledger.db")]) == 0
    return capsys.readouterr().out


def test_the_time_is_that_of_the_last_landing_and_names_its_zone(desk, tmp_path, capsys):
    put_service(desk, tmp_path, "ended")
    for number, landed_min in ((1, 31), (2, 65)):
        one = DroneRecord(vehicle=replace(D1, id=f"d{number}"), system=number, place="bellevue", soc=0.5, measured_s=BEGIN_S + 60.0 * landed_min)  # fmt: skip
        desk.put_down("drone", f"d{number}", "standing", written(one))
    assert shown(tmp_path, capsys).startswith("dispatch, ended, 2013-07-10 15:05 EDT: ")
    end = End(at_s=BEGIN_S + 4200.0, state="delivered", reason="", station="jacobi", soc=0.5, arrived=True)
    desk.put_down("flight", "f1", "ended", written(structs.replace(FLIGHT, end=end)))
    assert shown(tmp_path, capsys).startswith("dispatch, ended, 2013-07-10 15:10 EDT: ")


def test_a_pad_of_a_service_that_has_ended_is_not_closed(desk, tmp_path, capsys):
    put_service(desk, tmp_path, "ended")
    words = ["dispatch", "close", "bellevue", "2", "--ledger", str(tmp_path / "ledger.db"), "--until", "2013-07-10T18:00-04:00"]  # fmt: skip
    assert main(words) == 2
    assert "--holder: the service of this name has ended (got 'dispatch')" in capsys.readouterr().err
    assert desk.count("pad") == 0


def test_a_closure_that_is_over_or_has_not_begun_is_no_pad_out_of_order(desk, tmp_path, capsys):
    put_service(desk, tmp_path)
    for pad, from_min, until_min in ((1, -60, -1), (2, -60, 60), (2, -30, 30), (3, 30, 60)):
        closed = PadRecord(
            station="bellevue", pad=pad, from_s=BEGIN_S + 60.0 * from_min, until_s=BEGIN_S + 60.0 * until_min
        )
        desk.put_down("pad", f"bellevue {pad} {until_min}", "out", written(closed))
    assert main(["dispatch", "status", "--ledger", str(tmp_path / "ledger.db"), "--prometheus"]) == 0
    assert "\nskyway_pads_out_of_order 1\n" in capsys.readouterr().out
    assert main(["dispatch", "status", "--ledger", str(tmp_path / "ledger.db"), "--json"]) == 0
    assert sorted(one["pad"] for one in json.loads(capsys.readouterr().out)["out_of_order"]) == [2, 2, 3]


def test_a_drone_that_charges_does_not_fly_and_what_it_does_next_tells_pick_up_from_delivery(desk, tmp_path, capsys):
    route = tuple(
        PlannedPart(order=order, phase=phase, steps=(STEP,))
        for order, phase in (("s1", WITH_PACKAGE), ("x", TO_PACKAGE), ("x", WITH_PACKAGE), (None, HOME))
    )
    put_service(desk, tmp_path)
    desk.put_down("flight", "f1", "flying", written(FLIGHT))
    desk.put_down("drone", "d1", "flying", written(DroneRecord(vehicle=D1, system=1, place="bellevue", soc=0.9, flight="f1", route=route)))  # fmt: skip
    words = " ".join(shown(tmp_path, capsys).split())
    assert "0 orders (none); 1 flight of 1 drone" in words
    assert "d1 under way jacobi 90 % home: charging" in words
    assert "deliver s1, fetch x, deliver x, home" in words


def put_order(desk, name, state, *, due_min, delivered_min=None, first_min=None, reason="", drone="d1"):
    order = Order(id=name, origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=START + timedelta(minutes=due_min))  # fmt: skip
    promise, first = (
        None if one is None else Promise(drone=drone, fetched_s=BEGIN_S, delivered_s=BEGIN_S + 60.0 * one)
        for one in (delivered_min, delivered_min if first_min is None else first_min)
    )
    desk.put_down("order", name, state, written(OrderRecord(order=order, place="bellevue", promise=promise, first=first, reason=reason)))  # fmt: skip


def fly(begin_min, end_min):
    return structs.replace(STEP, begin_s=BEGIN_S + 60.0 * begin_min, end_s=BEGIN_S + 60.0 * end_min)


def test_table_and_page_tell_which_orders_are_late_or_will_be_and_each_share_of_the_delay(desk, tmp_path, capsys):
    put_service(desk, tmp_path)
    put_order(
        desk, "o1", "under way", due_min=19, delivered_min=40
    )  # promised late from the start, and its drone is late
    put_order(desk, "o2", "promised", due_min=62, delivered_min=60)  # in time, were the same drone not late
    put_order(desk, "o3", "promised", due_min=99, delivered_min=100)  # the drone waits long enough before
    put_order(desk, "o4", "aboard", due_min=23, delivered_min=60, first_min=20, reason="at jacobi: the wind is above the limit", drone="d2")  # fmt: skip
    put_order(desk, "o5", "new", due_min=90, first_min=50, reason="no drone is available")
    put_order(desk, "o6", "new", due_min=5)  # no promise yet: it will have one, or is refused
    put_order(desk, "o7", "delivered", due_min=5, delivered_min=30)  # nothing is left to do
    progress = structs.replace(FLIGHT.progress, at_s=BEGIN_S + 600.0, state="flying", late_s=300.0)
    flight = structs.replace(FLIGHT, order="o1", phase=WITH_PACKAGE, steps=(fly(0, 40),), progress=progress)
    route = tuple(
        PlannedPart(order=order, phase=phase, steps=(fly(*when),))
        for order, phase, when in (
            ("o2", TO_PACKAGE, (41, 45)), ("o2", WITH_PACKAGE, (45, 60)), ("o3", WITH_PACKAGE, (85, 100)),
        )
    )  # fmt: skip
    desk.put_down("flight", "f1", "flying", written(flight))
    for name, of in (("d1", {"flight": "f1", "route": route}), ("d2", {"aboard": "o4"})):
        one = DroneRecord(vehicle=replace(D1, id=name), system=1, place="jacobi", soc=0.9, **of)
        desk.put_down("drone", name, "flying" if name == "d1" else "standing", written(one))
    wanted = [
        "no dispatcher runs: start skyway dispatch run again with the same ledger",
        "dispatch/worker 1 does not run",
        "o4 is expected 37 min after its due time: at jacobi: the wind is above the limit",
        "o1 is expected 26 min after its due time: its plan is 21 min late already (promised 21 min late from the start), and d1 is 5 min behind that plan",
        "o2 is expected 2 min after its due time: d1 is 4 min behind its plan, which had 2 min to spare",
        "o3 is expected 1 min after its due time: promised 1 min late from the start",
        "o5 is no longer promised: no drone is available",
    ]  # fmt: skip
    words = " ".join(shown(tmp_path, capsys).split())
    assert " ".join(["1 flight of 2 drones", *(f"! {one}" for one in wanted), "order state"]) in words
    assert told_on_the_page(str(tmp_path / "ledger.db"), "dispatch")["alarms"] == wanted


def test_a_reason_is_told_once():
    """The promise was with one drone, and stays with it."""
    why = Reasons(of_drone={"d1": "d1 is 5 min late", "d2": "d2 is 3.3 min late"})
    assert why.why(["d2", "d2"]) == "d2 is 3.3 min late"
    assert why.why(["d2", "d1"]) == "d2 is 3.3 min late; d1 is 5 min late"


def test_numbers_in_names_are_sorted_as_numbers_on_page_and_table(desk, tmp_path, capsys):
    put_service(desk, tmp_path)
    for number in (10, 1, 2):
        put_order(desk, f"order-{number}", "new", due_min=90)
        one = DroneRecord(vehicle=replace(D1, id=f"drone-{number}"), system=number, place="bellevue", soc=0.5)
        desk.put_down("drone", f"drone-{number}", "standing", written(one))
    words = shown(tmp_path, capsys).split()
    page = told_on_the_page(str(tmp_path / "ledger.db"), "dispatch")
    for kind in ("order", "drone"):
        names = [f"{kind}-{number}" for number in (1, 2, 10)]
        assert [word for word in words if word in names] == names
        assert [one["id"] for one in page[f"{kind}s"]] == names
    assert [one["name"] for one in page["doing"]] == ["drone-1", "drone-2", "drone-10"]


@pytest.mark.parametrize(
    ("planned_min", "why", "told"),
    [
        (24, Reasons(of_drone={"d1": "d1 is 3.3 min late"}, delays_s={"d1": 198.0}),
         "19 min later: d1 is 3.3 min late; 4 min of that was in the plan already; planning the fleet again around it adds 12 min"),
        (20, Reasons(of_drone={"d2": "d2 is 3.3 min late"}, delays_s={"d2": 198.0}),
         "19 min later: d2 is 3.3 min late; planning the fleet again around it adds 19 min"),
        (20, Reasons(of_drone={"d1": "d1 is 19 min late"}, delays_s={"d1": 1140.0}), "19 min later: d1 is 19 min late"),
        (20, Reasons(general=["pad jacobi 1 is out of order"]), "19 min later: pad jacobi 1 is out of order"),
    ],
)  # fmt: skip
def test_a_changed_promise_tells_the_shares_that_its_reason_does_not_explain(desk, planned_min, why, told):
    situation, said = Situation(desk), []
    order = Order(id="o1", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=START + timedelta(hours=2))  # fmt: skip
    before = Promise(drone="d1", fetched_s=BEGIN_S, delivered_s=BEGIN_S + 1200.0)
    situation.orders["o1"] = ("promised", OrderRecord(order=order, place="bellevue", promise=before, first=before))
    later = Answer(order="o1", status="served", drone="d1", fetched=START, delivered=START + timedelta(minutes=39))
    Promises(situation, said.append).answer(BEGIN_S, "o1", later, why, BEGIN_S + 60.0 * planned_min)
    assert said == [f"o1: {told}"]


def test_of_too_many_orders_and_drones_those_that_matter_now_are_shown(desk, tmp_path, capsys):
    put_service(desk, tmp_path)
    for number in range(100):
        due = START + timedelta(minutes=number)
        order = Order(id=f"o{number}", ready=START, due=due, origin="bellevue", destination="jacobi", mass_kg=0.5)
        record = OrderRecord(order=order, place="bellevue", delivered_s=due.timestamp() - 60.0 if number < 90 else None)
        desk.put_down("order", order.id, "delivered" if number < 90 else "new", written(record))
        drone = DroneRecord(vehicle=replace(D1, id=f"d{number}"), system=number, place="bellevue", soc=0.5, measured_s=BEGIN_S)  # fmt: skip
        desk.put_down("drone", f"d{number}", "standing", written(drone))
    lines = shown(tmp_path, capsys).splitlines()
    orders = [line.split()[0] for line in lines if line.startswith("o") and line[1].isdigit()]
    assert orders == [f"o{number}" for number in range(60, 100)]
    assert "… and 60 more orders: --json has them all" in lines
    assert "… and 60 more drones: --json has them all" in lines
