"""What the status of a service says: its time, and what its drones do."""

from dataclasses import replace

import pytest
from fleet_runs import START

from skyway.cli.main import main
from skyway.dispatch.records import DroneRecord, ServiceRecord, written
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Vehicle

BEGIN_S = START.timestamp()
D1 = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue")


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


def test_a_pad_of_a_service_that_has_ended_is_not_closed(desk, tmp_path, capsys):
    put_service(desk, tmp_path, "ended")
    words = ["dispatch", "close", "bellevue", "2", "--ledger", str(tmp_path / "ledger.db"), "--until", "2013-07-10T18:00-04:00"]  # fmt: skip
    assert main(words) == 2
    assert "--holder: the service of this name has ended (got 'dispatch')" in capsys.readouterr().err
    assert desk.count("pad") == 0
