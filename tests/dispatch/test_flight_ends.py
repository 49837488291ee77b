"""What becomes of an order whose flight has ended otherwise than planned."""

from datetime import timedelta
from types import SimpleNamespace

import pytest
from fleet_runs import START

from skyway.dispatch.dispatcher.events import Events
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.records import WITH_PACKAGE, DroneRecord, End, FlightRecord, OrderRecord
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order, Vehicle


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
        vehicle=Vehicle(id="d1", type="m200", home="bellevue", place="bellevue"),
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
