"""Orders that an operator cancels: asked for on the desk, decided by the dispatcher's next step."""

import json
from datetime import timedelta
from functools import partial
from types import SimpleNamespace

import msgspec
import pytest
from fleet_runs import START, FleetRun, flying, nothing_is_forgotten, order_line
from test_fleet_api import Client, ledger  # noqa: F401  a fixture

from skyway.cli.main import main
from skyway.dispatch.dispatcher.events import Events
from skyway.dispatch.dispatcher.fleet_planner import available
from skyway.dispatch.dispatcher.promises import Promises
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.dispatcher.windows import committed
from skyway.dispatch.records import (
    TO_PACKAGE,
    WITH_PACKAGE,
    Board,
    End,
    FlightRecord,
    OrderRecord,
    PlanStep,
    Progress,
    Promise,
    read,
)
from skyway.dispatch.requests import put_order
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order

AT_S = START.timestamp() + 60.0
BLOOD = Order(
    id="blood", origin="jacobi", destination="bellevue", mass_kg=0.3, ready=START, due=START + timedelta(hours=3)
)
STEP = PlanStep(
    kind="fly", origin="bellevue", destination="jacobi", begin_s=AT_S, end_s=AT_S + 900.0, soc_begin=0.6, soc_end=0.4
)


@pytest.fixture
def place(ledger):  # noqa: F811
    """A desk with one order, and its ledger's name."""
    with open_ledger(ledger) as book:
        desk = Desk(book, "dispatch")
        put_order(desk, BLOOD)
        yield desk, ledger


def step(desk, change=lambda _: None):
    """What the dispatcher does with requests in a step, after a change of its state; returns that state and the reasons to replan."""
    lease = desk.ledger.acquire("dispatch", "a test")
    situation, why = Situation(desk), Reasons()
    situation.read()
    change(situation)
    events = Events(situation, Promises(situation, lambda _: None), SimpleNamespace(), None, lambda _: None)
    events.take_cancellations(AT_S, why)
    situation.write(lease)
    desk.ledger.give_back(lease)
    return situation, why


def fly(phase):
    def change(situation):
        flight = FlightRecord(
            drone="d1", type="m200", system=1, order="blood", phase=phase, mass_kg=0.3, composition={}, steps=(STEP,), not_before_s=0.0,
            journal="1.jsonl",
        )  # fmt: skip
        situation.begin_flight(1, "d1", flight, "dispatch")
        order = situation.orders["blood"][1]
        order.drone = "d1"
        order.promise = order.first = Promise(drone="d1", fetched_s=AT_S, delivered_s=AT_S + 900.0)
        situation.change_order("blood", "under way", order)

    return change


def close(state):
    return lambda situation: situation.change_order("blood", state, situation.orders["blood"][1])


def cancel(ledger, name="blood"):  # noqa: F811
    return main(["dispatch", "cancel", name, "--ledger", ledger])


def document(ledger, capsys):  # noqa: F811
    assert main(["orders", "list", "--ledger", ledger, "--json"]) == 0
    return json.loads(capsys.readouterr().out)[0]


def test_an_order_is_cancelled_by_the_next_step_and_once(place, capsys, monkeypatch):
    monkeypatch.setattr("getpass.getuser", lambda: "ana")
    desk, name = place
    assert cancel(name) == 0
    assert "no dispatcher runs" in capsys.readouterr().out
    assert cancel(name) == 0
    capsys.readouterr()
    _, why = step(desk)
    assert why.general == ["order blood was cancelled"]
    told = document(name, capsys)
    assert (told["state"], told["cancelled_by"], told["reason"]) == ("cancelled", "ana", "cancelled by ana")
    assert told["cancelled"] == "2013-07-10T18:01:00Z"
    assert cancel(name) == 0
    assert capsys.readouterr().out == "blood was already cancelled\n"
    assert not step(desk)[1]
    assert main(["dispatch", "status", "--ledger", name]) == 0
    assert "1 cancelled" in capsys.readouterr().out


def test_a_drone_that_flies_to_a_cancelled_package_goes_on_to_its_landing_and_is_free(place, capsys):
    desk, name = place
    step(desk, fly(TO_PACKAGE))
    assert cancel(name) == 0
    situation, why = step(desk)
    assert situation.orders["blood"][0] == "cancelled"
    assert why
    (flight,) = situation.flights.values()
    assert (flight[0], flight[1].steps) == ("ordered", (STEP,))
    assert available(situation, AT_S)["d1"].place == "jacobi"
    capsys.readouterr()
    told = document(name, capsys)
    assert (told["promised"], told["drone"]) == (None, None)


def test_an_order_whose_package_is_aboard_is_refused_with_what_can_be_done(place, capsys):
    desk, name = place
    step(desk, fly(WITH_PACKAGE))
    assert cancel(name) == 2
    error = capsys.readouterr().err
    assert "its package is aboard d1 and will be delivered; give a new order from bellevue to jacobi" in error
    assert desk.get("cancel", "blood") is None


def test_an_order_that_is_picked_up_between_the_request_and_the_step_is_not_cancelled(place, capsys):
    desk, name = place
    assert cancel(name) == 0
    situation, why = step(desk, fly(WITH_PACKAGE))
    assert situation.orders["blood"][0] == "under way"
    assert not why
    step(desk, close("delivered"))
    capsys.readouterr()
    assert Client(name).send("/orders/blood/cancel", None)[0] == 409
    assert cancel(name) == 2
    assert "it is delivered already" in capsys.readouterr().err
    assert "aboard d1" in desk.get("cancel", "blood").document


@pytest.mark.parametrize("state", ["delivered", "refused", "handed to a person"])
def test_a_closed_order_is_not_cancelled_before_or_after_the_request(place, capsys, state):
    desk, name = place
    assert cancel(name) == 0
    step(desk, close(state))
    assert desk.get("order", "blood").state == state
    assert desk.get("cancel", "blood").state == "refused"
    assert cancel(name) == 2
    assert f"blood cannot be cancelled: it is {state} already" in capsys.readouterr().err


def test_an_unknown_order_names_the_nearest(place, capsys):
    assert cancel(place[1], "blod") == 2
    assert "did you mean blood?" in capsys.readouterr().err
    status, text = Client(place[1]).send("/orders/blod/cancel", None)
    assert (status, "did you mean blood?" in text) == (404, True)


def test_over_http_it_is_accepted_then_done_or_in_conflict(place):
    desk, name = place
    client = Client(name)
    assert client.send("/orders/blood/cancel", None)[0] == 202
    step(desk)
    status, text = client.send("/orders/blood/cancel", None)
    assert (status, json.loads(text)["state"]) == (200, "cancelled")
    assert json.loads(client.get("/orders/blood")[1])["cancelled_by"] == "HTTP API"
    put_order(
        desk,
        Order(
            **{field: getattr(BLOOD, field) for field in ("origin", "destination", "mass_kg", "ready", "due")},
            id="swab",
        ),
    )
    client.send("/orders/swab/cancel", None)
    step(desk, lambda one: one.change_order("swab", "refused", one.orders["swab"][1]))
    status, text = client.send("/orders/swab/cancel", None)
    assert (status, "it is refused already" in text) == (409, True)


def test_an_order_handed_to_a_person_keeps_no_promise(place, capsys):
    desk, name = place

    def hand_over(situation):
        fly(WITH_PACKAGE)(situation)
        Promises(situation, lambda _: None).hand_over("blood", situation.orders["blood"][1])

    step(desk, hand_over)
    told = document(name, capsys)
    assert (told["state"], told["promised"], told["p95"], told["drone"]) == ("handed to a person", None, None, "d1")
    assert read(desk.get("order", "blood"), OrderRecord).first is not None
    assert json.loads(Client(name).get("/orders/blood")[1])["promised"] is None


def test_a_closed_pad_is_opened_again_and_closed_again(place, capsys):
    desk, name = place
    closing = ["dispatch", "close", "bellevue", "1", "--ledger", name, "--until", "2013-07-10T18:00-04:00"]
    opening = ["dispatch", "open", "bellevue", "--ledger", name]
    for _ in range(2):
        assert main(closing) == 0
        assert len(step(desk)[0].pads) == 1
        capsys.readouterr()
        assert main(opening) == 0
        assert capsys.readouterr().out == "pad 1 of bellevue is open again\n"
        assert step(desk)[0].pads == {}
        assert json.loads(Client(name).get("/status")[1])["out_of_order"] == []
    assert main([*opening, "1"]) == 0
    assert capsys.readouterr().out == "pad 1 of bellevue is not out of order\n"


def test_the_dispatcher_hears_that_a_pad_was_opened(place):
    desk, name = place
    assert main(["dispatch", "close", "bellevue", "1", "--ledger", name, "--until", "2013-07-10T18:00-04:00"]) == 0
    situation, why = Situation(desk), Reasons()
    situation.read()
    events = Events(situation, None, None, None, None)
    events.take_pads(AT_S, Reasons())
    assert main(["dispatch", "open", "bellevue", "1", "--ledger", name]) == 0
    situation.read()
    events.take_pads(AT_S, why)
    assert why.general == ["pad bellevue 1 is back"]


@pytest.mark.slow
def test_a_drone_whose_order_is_cancelled_on_its_way_to_the_package_lands_there_and_comes_home(tmp_path):
    run = FleetRun(tmp_path, [order_line("one", "jacobi", "bellevue")], ["d1,m200,bellevue,60\n"])
    try:
        run.start()
        run.look(lambda desk: flying(desk, "to the package"))
        assert cancel(run.ledger) == 2  # no such order
        assert cancel(run.ledger, "one") == 0
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert [state for state, _ in status.orders.values()] == ["cancelled"]
    assert [(state, one.place) for state, one in status.drones.values()] == [("standing", "bellevue")]


@pytest.mark.slow
def test_a_drone_that_charges_to_fly_to_a_cancelled_package_stays_where_it_is(tmp_path):
    run = FleetRun(tmp_path, [order_line("one", "jacobi", "bellevue")], ["d1,m200,bellevue,25\n"])
    try:
        run.start()
        run.look(charging)
        assert cancel(run.ledger, "one") == 0
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert [state for state, _ in status.orders.values()] == ["cancelled"]
    with open_ledger(run.ledger) as book:
        (flight,) = Board(Desk(book, "dispatch")).read("flight", FlightRecord).values()
    end = flight[1].end
    assert (end.station, end.state, end.arrived) == ("bellevue", "stopped-safe", False)
    assert end.at_s < flight[1].steps[0].end_s


def charging(desk):
    """Flights whose drone charges."""
    found = Board(desk).read("flight", FlightRecord, ("flying",))
    return [name for name, (_, one) in found.items() if one.progress is not None and one.progress.state == "charging"]


def flies_by_a_stop(progress):
    """Let the drone fly to the package by a stop, with a charge before each of two legs."""

    def change(situation):
        fly(TO_PACKAGE)(situation)
        ((name, (state, flight)),) = situation.flights.items()
        charge = partial(PlanStep, kind="charge", pad=1, soc_begin=0.3, soc_end=0.8)
        flight.steps = (
            charge(origin="bellevue", destination="bellevue", begin_s=AT_S, end_s=AT_S + 900.0),
            msgspec.structs.replace(STEP, destination="nyp-queens", begin_s=AT_S + 900.0, end_s=AT_S + 1800.0),
            charge(origin="nyp-queens", destination="nyp-queens", begin_s=AT_S + 1800.0, end_s=AT_S + 2700.0),
            msgspec.structs.replace(STEP, origin="nyp-queens", begin_s=AT_S + 2700.0, end_s=AT_S + 3600.0),
        )
        flight.progress = progress
        situation.board.change("flight", name, state, flight)

    return change


@pytest.mark.parametrize(
    ("progress", "booked", "ends"),
    [
        (None, ["bellevue", "nyp-queens"], ("jacobi", 3600.0)),
        (Progress(at_s=AT_S, state="charging", flights=0, station="bellevue", soc=0.35), ["bellevue"], ("bellevue", 0.0)),
        (Progress(at_s=AT_S, state="flying", flights=1), ["bellevue"], ("nyp-queens", 1800.0)),
        (Progress(at_s=AT_S, state="charging", flights=1, station="nyp-queens", soc=0.4), ["bellevue", "nyp-queens"], ("nyp-queens", 0.0)),
        (Progress(at_s=AT_S, state="flying", flights=2), ["bellevue", "nyp-queens"], ("jacobi", 3600.0)),
    ],
    ids=["not begun as far as is known", "at its first stop", "on its first leg", "at its second stop", "on its last leg"],
)  # fmt: skip
def test_the_drone_of_a_cancelled_order_keeps_the_pads_up_to_its_next_landing_alone(place, progress, booked, ends):
    desk, name = place
    situation, _ = step(desk, flies_by_a_stop(progress))
    assert [one.station for one in committed(situation, AT_S)["blood"]] == ["bellevue", "nyp-queens"]
    assert cancel(name) == 0
    situation, _ = step(desk)
    for _ in range(2):
        assert [one.station for one in committed(situation, AT_S)["blood"]] == booked
        free = available(situation, AT_S)["d1"]
        assert (free.place, free.available_from.timestamp()) == (ends[0], pytest.approx(AT_S + ends[1], abs=60.0))
        situation.read()  # as the next step finds it


def test_a_drone_that_stays_for_a_cancelled_order_closes_no_leg_for_others(place):
    desk, name = place
    step(desk, flies_by_a_stop(Progress(at_s=AT_S, state="charging", station="bellevue", soc=0.35)))
    assert cancel(name) == 0
    step(desk)

    def end(situation):
        ((name, (_, flight)),) = situation.flights.items()
        flight.end = End(at_s=AT_S, state="stopped-safe", reason="", station="bellevue", soc=0.4, arrived=False)
        situation.board.change("flight", name, "ended", flight)

    step(desk, end)
    situation, closed = Situation(desk), []
    situation.read()
    legs = SimpleNamespace(close=lambda *leg: closed.append(leg))
    Events(situation, None, legs, None, None).take_ends(AT_S, Reasons())
    assert closed == []
    assert situation.drones["d1"][0] == "standing"
    assert (situation.drones["d1"][1].place, situation.drones["d1"][1].soc) == ("bellevue", 0.4)
