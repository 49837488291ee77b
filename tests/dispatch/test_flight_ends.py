"""What becomes of an order whose flight has ended otherwise than planned."""

from datetime import timedelta
from types import SimpleNamespace

import pytest
from fleet_runs import START

from skyway.dispatch.dispatcher.events import Events
from skyway.dispatch.dispatcher.promises import Promises
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.records import WITH_PACKAGE, DroneRecord, End, FlightRecord, OrderRecord, PlanStep, Progress
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order, Vehicle
from skyway.scenarios import load_scenario

DRONE = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue")
READY_S = 5 * 3600.0
"""Time until the package of a flight is ready, s."""
STEP = PlanStep(
    kind="fly", origin="bellevue", destination="jacobi", begin_s=START.timestamp() + READY_S, end_s=START.timestamp() + READY_S + 900.0,
    soc_begin=0.9, soc_end=0.5,
)  # fmt: skip


@pytest.mark.parametrize(
    ("station", "state", "aboard"), [("jacobi", "handed to a person", None), ("columbia", "aboard", "one")]
)
def test_a_package_that_was_landed_at_its_destination_and_not_released_is_a_persons(tmp_path, station, state, aboard):
    """Somebody else landed the drone there: it was planned for as one on its way, and the dispatcher ended with an IndexError, again and again."""
    due = START + timedelta(hours=2)
    order = Order(id="one", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=due)
    end = End(
        at_s=START.timestamp(),
        state="stopped-safe",
        reason="somebody else landed it",
        station=station,
        soc=0.5,
        arrived=False,
    )
    flight = FlightRecord(
        drone="d1", type="m200", system=1, order="one", phase=WITH_PACKAGE, mass_kg=0.3, composition={}, steps=(), not_before_s=0.0,
        journal="1.jsonl", end=end,
    )  # fmt: skip
    drone = DroneRecord(
        vehicle=DRONE,
        system=1,
        place="bellevue",
        soc=0.9,
        flight="1",
    )
    with open_ledger(str(tmp_path / "ledger.db")) as book:
        situation = Situation(Desk(book, "dispatch"))
        situation.orders["one"] = ("under way", OrderRecord(order=order, place="bellevue", drone="d1"))
        situation.drones["d1"] = ("flying", drone)
        situation.flights["1"] = ("ended", flight)
        promises = SimpleNamespace(
            hand_over=lambda name, record: situation.change_order(name, "handed to a person", record)
        )
        legs = SimpleNamespace(close=lambda *_: None)
        Events(situation, promises, legs, None, lambda _: None).take_ends(START.timestamp(), Reasons())
        assert situation.orders["one"][0] == state
        assert "somebody else landed it" in situation.orders["one"][1].reason
        assert situation.drones["d1"][0] == "standing"
        assert (situation.drones["d1"][1].place, situation.drones["d1"][1].aboard) == (station, aboard)


def _situation(book, state, **of_flight):
    """One drone whose flight with one order is in a state; at bellevue, with a package that is ready in five hours."""
    situation = Situation(Desk(book, "dispatch"))
    order = Order(
        id="one", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START + timedelta(seconds=READY_S),
        due=START + timedelta(hours=8),
    )  # fmt: skip
    flight = FlightRecord(
        drone="d1", type="m200", system=1, order="one", phase=WITH_PACKAGE, mass_kg=0.3, composition={}, steps=(STEP,),
        not_before_s=order.ready.timestamp(), journal="1.jsonl", **of_flight,
    )  # fmt: skip
    drone = DroneRecord(vehicle=DRONE, system=1, place="bellevue", soc=0.9, flight="1")
    situation.change_order("one", "under way", OrderRecord(order=order, place="bellevue", drone="d1"))
    situation.change_drone("d1", "flying", drone)
    situation.flights["1"] = (state, flight)
    return situation


def _events(situation, said=None, scenario=None):
    promises = Promises(situation, (said if said is not None else []).append)
    legs = SimpleNamespace(close=lambda *_: None)
    return Events(situation, promises, legs, scenario, (said if said is not None else []).append)


@pytest.mark.parametrize(("after_ready_s", "state"), [(-60.0, "flying"), (3600.0, "flying"), (7260.0, "lost")])
def test_a_drone_that_waits_for_its_package_is_not_held_up_before_that_is_ready(tmp_path, after_ready_s, state):
    """It was declared lost two hours after it had charged, hours before the package was ready, and its order was handed to a person."""
    progress = Progress(at_s=START.timestamp(), state="preparing", flights=0, since_s=START.timestamp())
    with open_ledger(str(tmp_path / "ledger.db")) as book:
        situation = _situation(book, "flying", progress=progress)
        _events(situation).take_delays(START.timestamp() + READY_S + after_ready_s, Reasons())
        assert situation.drones["d1"][0] == state
        assert situation.orders["one"][0] == ("handed to a person" if state == "lost" else "under way")


@pytest.mark.parametrize(
    ("arrived", "sure", "state"),
    [(True, True, "delivered"), (True, False, "handed to a person"), (False, True, "handed to a person")],
)
def test_an_order_in_the_hands_of_a_person_whose_drone_delivers_it_after_all_is_delivered(
    tmp_path, arrived, sure, state
):
    """It stayed a person's, with an alarm, although its drone had delivered it in time."""
    end = End(
        at_s=START.timestamp() + 6 * 3600.0, state="delivered" if arrived else "stopped-safe", reason="as told", station="jacobi",
        soc=0.5, arrived=arrived, sure=sure,
    )  # fmt: skip
    said = []
    with open_ledger(str(tmp_path / "ledger.db")) as book:
        situation = _situation(book, "ended", end=end)
        order = situation.orders["one"][1]
        order.reason = "d1: holding for 15 min"
        situation.change_order("one", "handed to a person", order)
        situation.write(book.acquire("dispatch", "a test"))
        flight = situation.flights["1"]
        situation.read()
        situation.flights["1"] = flight
        assert "one" not in situation.orders
        _events(situation, said).take_ends(end.at_s, Reasons())
        assert situation.orders["one"][0] == state
        assert situation.orders["one"][1].reason == ("" if state == "delivered" else "d1: holding for 15 min")
        assert any("one delivered at jacobi" in line for line in said) is (state == "delivered")


@pytest.mark.parametrize("field", ["from", "to"])
def test_an_order_at_a_place_without_pads_is_refused_before_a_drone_flies(tmp_path, field):
    """Its flight could not be supervised: the drone was declared lost at its pad, with the package on board."""
    places = {"from": "bellevue", "to": "jacobi"} | {field: "40.80,-73.90"}
    order = Order(
        id="two", origin=places["from"], destination=places["to"], mass_kg=0.3, ready=START, due=START + timedelta(hours=3)
    )  # fmt: skip
    with open_ledger(str(tmp_path / "ledger.db")) as book:
        situation = Situation(Desk(book, "dispatch"))
        situation.drones["d1"] = ("standing", DroneRecord(vehicle=DRONE, system=1, place="bellevue", soc=0.9))
        situation.change_order("two", "new", OrderRecord(order=order, place=order.origin))
        why = Reasons()
        _events(situation, scenario=load_scenario(None)).take_orders(why)
        state, record = situation.orders["two"]
        assert state == "refused"
        assert record.reason.startswith(f"{field} 40.80,-73.90: has no pads")
        assert not why
