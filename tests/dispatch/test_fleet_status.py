"""What the status of a service says: its time, and what its drones do."""

from dataclasses import replace

import pytest
from fleet_runs import START
from msgspec import structs

from skyway.cli.main import main
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.records import (
    HOME,
    TO_PACKAGE,
    WITH_PACKAGE,
    DroneRecord,
    End,
    FlightRecord,
    PlannedPart,
    PlanStep,
    Progress,
    ServiceRecord,
    written,
)
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Vehicle

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


def test_a_drone_that_charges_does_not_fly_and_what_it_does_next_tells_pick_up_from_delivery(desk, tmp_path, capsys):
    route = tuple(
        PlannedPart(order=order, phase=phase, steps=(STEP,))
        for order, phase in (("s1", WITH_PACKAGE), ("x", TO_PACKAGE), ("x", WITH_PACKAGE), (None, HOME))
    )
    put_service(desk, tmp_path)
    desk.put_down("flight", "f1", "flying", written(FLIGHT))
    desk.put_down("drone", "d1", "flying", written(DroneRecord(vehicle=D1, system=1, place="bellevue", soc=0.9, flight="f1", route=route)))  # fmt: skip
    words = " ".join(shown(tmp_path, capsys).split())
    assert "d1 under way jacobi 90 % home: charging" in words
    assert "deliver s1, fetch x, deliver x, home" in words


def test_a_reason_is_told_once():
    """The promise was with one drone, and stays with it."""
    why = Reasons(of_drone={"d1": "d1 is 5 min late", "d2": "d2 is 3.3 min late"})
    assert why.why(["d2", "d2"]) == "d2 is 3.3 min late"
    assert why.why(["d2", "d1"]) == "d2 is 3.3 min late; d1 is 5 min late"
