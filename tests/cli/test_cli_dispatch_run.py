"""The command line of a service, without its processes: everything that it refuses before it flies."""

import pytest

from skyway.dispatch.records import ServiceRecord, written
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger

RUN = ("dispatch", "run", "--simulate", "--ledger", "new.db", "--fleet", "fleet.csv", "--depart", "2013-07-10T14:00-04:00", "--wind", "4@270")  # fmt: skip


@pytest.fixture
def fleet(tmp_path):
    (tmp_path / "fleet.csv").write_text("id,type,home,charge_percent\nd1,m200,bellevue,60\n")
    return tmp_path


def test_a_new_service_refuses_the_folder_of_another_one(skyway, fleet):
    """Flights are numbered in each ledger from one on: it resumed the journals of the other's."""
    folder = fleet / "flights"
    folder.mkdir()
    (folder / "world.log").write_text("")
    (folder / "000001.jsonl").write_text("the other's\n")
    done = skyway(*RUN)
    assert done.code == 2
    assert done.err.splitlines()[-1].endswith(
        "--folder: has the journals of another service (got 'flights'); "
        "name a new folder; a service is resumed with its own ledger and holder"
    )
    assert (folder / "000001.jsonl").read_text() == "the other's\n"
    with open_ledger(str(fleet / "new.db")) as book:
        assert Desk(book, "dispatch").get("service", "service") is None


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--hours", "nan", "--hours: out of range (got 'nan')"),
        ("--hours", "-1", "--hours: out of range (got '-1'); 0.01 or more"),
        ("--hours", "inf", "--hours: out of range (got 'inf')"),
        ("--notice", "inf", "--notice: out of range (got 'inf')"),
        ("--time-limit", "0", "--time-limit: out of range (got '0'); 0.01 or more"),
        ("--time-limit", "nan", "--time-limit: out of range (got 'nan')"),
        ("--lease", "nan", "--lease: out of range (got 'nan')"),
    ],
)
def test_times_that_would_never_end_or_never_begin_are_refused(refused, fleet, option, value, said):
    assert said in refused(*RUN, option, value)


def test_a_service_whose_world_has_ended_says_what_to_do(skyway, fleet):
    service = ServiceRecord(begin_s=0.0, folder=str(fleet), ledger="new.db", world="127.0.0.1:1")
    with open_ledger(str(fleet / "new.db")) as book:
        Desk(book, "dispatch").put_down("service", "service", "running", written(service))
        done = skyway(*RUN)
        assert done.code == 3
        assert "the simulated world at 127.0.0.1:1 cannot be reached" in done.err
        assert done.err.splitlines()[-1].endswith("start a new service, with another --ledger and --folder")
        assert not book.led("dispatch")
