"""The command line of the dispatcher: a plan, its bookings, and everything that it refuses in one clear line."""

import json

import pytest

from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger

ORDERS = """id,from,to,mass_kg,ready,due,priority
blood,bellevue,jacobi,0.5,2013-07-10T14:00-04:00,2013-07-10T16:00-04:00,1
swab,jacobi,bellevue,0.2,2013-07-10T15:00-04:00,2013-07-10T17:00-04:00,0
far,edison,white-plains,0.5,2013-07-10T14:00-04:00,2013-07-10T14:20-04:00,0
"""
FLEET = "id,type,home,charge_percent\nd1,m200,bellevue,60\nd2,m200,jacobi,40\n"
PLAN = ("dispatch", "plan", "--orders", "orders.csv", "--fleet", "fleet.csv", "--depart", "2013-07-10T14:00-04:00", "--wind", "4@270", "--iterations", "10")  # fmt: skip


@pytest.fixture
def files(tmp_path):
    (tmp_path / "orders.csv").write_text(ORDERS)
    (tmp_path / "fleet.csv").write_text(FLEET)
    return tmp_path


def test_a_plan_is_printed_written_and_booked(skyway, files):
    done = skyway(*PLAN, "--ledger", "ledger.db", "-o", "day.json")
    assert done.code == 0, done.err
    assert "2 of 3 orders served" in done.out
    assert "even without other orders it would be" in " ".join(done.out.split())  # a narrow terminal wraps it
    document = json.loads((files / "day.json").read_text())
    assert document["schema"] == "skyway.dispatch/1"
    assert [one["status"] for one in document["orders"]] == ["served", "served", "refused"]
    charges = [step for drone in document["drones"] for step in drone["steps"] if step["kind"] == "charge"]
    with open_ledger(str(files / "ledger.db")) as ledger:
        held = ledger.holds()
        assert {(one.window.station, one.window.pad) for one in held} == {(one["from"], one["pad"]) for one in charges}
        assert len(held) == len(charges)
    again = skyway(*PLAN, "--ledger", "ledger.db", "--json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["orders"] == document["orders"]
    with open_ledger(str(files / "ledger.db")) as ledger:
        assert len(ledger.holds()) == len(charges)
        assert audit(ledger) == []


def test_promises_have_a_probability_that_pads_of_now_change(skyway, files):
    (files / "pads.jsonl").write_text(
        '{"station": "jacobi", "busy": 5, "waiting": 9}\n{"station": "belvedere", "busy": 5, "waiting": 9}\n'
    )
    usual, full = (json.loads(skyway(*PLAN, "--json", *more).out) for more in ((), ("--pads", "pads.jsonl")))
    assert all(0.0 <= one["chance"] <= 1.0 and one["p50"] <= one["p95"] for one in usual["orders"] if one["status"] == "served")  # fmt: skip
    assert full["cost_s"] > usual["cost_s"]
    assert usual["below_reserve"] < 0.005
    none = json.loads(skyway(*PLAN, "--json", "--set", "planner.dispatch.worlds=0").out)
    assert {one["chance"] for one in none["orders"]} == {None}


def test_another_operator_plans_around_what_is_booked(skyway, files):
    assert skyway(*PLAN, "--ledger", "ledger.db").code == 0
    done = skyway(*PLAN, "--ledger", "ledger.db", "--holder", "other operator")  # with orders of the same ids
    assert done.code == 0, done.err
    with open_ledger(str(files / "ledger.db")) as ledger:
        assert {one.holder for one in ledger.holds()} == {"dispatch", "other operator"}
        assert audit(ledger) == []


def test_an_order_whose_drone_stands_on_a_pad_is_not_planned_anew(skyway, files):
    assert skyway(*PLAN, "--ledger", "ledger.db").code == 0
    with open_ledger(str(files / "ledger.db")) as ledger:
        holder = ledger.holds()[0]
        lease = ledger.acquire("dispatch", "another process")  # the command has given its lease back
        ledger.mark(lease, holder.itinerary, "in use", number=holder.number)
        ledger.give_back(lease)
    done = skyway(*PLAN, "--ledger", "ledger.db")
    assert done.code == 2
    assert f"id: is under way (got {holder.name!r})" in done.err
    with open_ledger(str(files / "ledger.db")) as ledger:
        assert "in use" in {one.state for one in ledger.holds()}


@pytest.mark.parametrize("command", ["plan", "tours"])
def test_an_order_that_is_too_heavy_is_refused_and_the_others_are_served(skyway, files, command):
    (files / "orders.csv").write_text(ORDERS.replace("edison,white-plains,0.5", "bellevue,jacobi,3"))
    done = skyway("dispatch", command, *PLAN[2:], "--json")
    assert done.code == 0, done.err
    blood, _, heavy = json.loads(done.out)["orders"]
    assert blood["status"] == "served"
    assert (heavy["status"], heavy["reason"]) == (
        "refused",
        "its 3 kg are more than any drone of the fleet carries (up to 1.45 kg)",
    )


def test_a_wind_above_the_limit_of_the_drones_is_named_where_it_is_the_reason(skyway, files):
    words = [{"4@270": "40@270"}.get(one, one) for one in PLAN]
    done = skyway(*words, "--json")
    assert done.code == 1
    blood, _, far = json.loads(done.out)["orders"]
    said = "throughout the forecast the wind on every way from {} is 40.0 m/s or more, above the limit of m200 (12 m/s)"
    assert blood["reason"] == said.format("bellevue to jacobi")
    assert far["reason"] == said.format("bellevue to edison")  # where the first drone would have to fetch it
    empty = FLEET.replace(",60", ",0").replace(",40", ",0").replace("bellevue", "edison")
    (files / "fleet.csv").write_text(empty.replace("d2,m200,jacobi", "d2,m200,edison"))
    (files / "orders.csv").write_text("\n".join(ORDERS.splitlines()[:2]) + "\n")
    done = skyway(*PLAN, "--json")
    assert "wind" not in json.loads(done.out)["orders"][0]["reason"]


def test_nothing_served_is_no(skyway, files):
    (files / "orders.csv").write_text(
        "\n".join(line for line in ORDERS.splitlines() if line[:2] in ("id", "fa")) + "\n"
    )
    done = skyway(*PLAN)
    assert done.code == 1
    assert "0 of 1 orders served" in done.out


def test_orders_that_were_due_before_are_refused_and_targets_keep_their_names(skyway, files):
    (files / "orders.csv").write_text(ORDERS.replace("bellevue,jacobi", 'bellevue,"40.75,-73.95"'))
    served = skyway(*PLAN, "--json")
    steps = [step for drone in json.loads(served.out)["drones"] for step in drone["steps"]]
    assert "40.75,-73.95" in {step["to"] for step in steps}
    late = skyway(*[one.replace("2013-07-10T14:00", "2013-07-12T14:00") for one in PLAN])
    assert late.code == 1, late.err
    assert "0 of 3 orders served" in late.out
    assert " ".join(late.out.split()).count("even without other orders it would be") == 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("orders.csv", "bellevue,jacobi", "nowhere,jacobi"), "orders.csv:2: from: no such station (got 'nowhere')"),
        (("orders.csv", "16:00-04:00", "13:00-04:00"), "orders.csv:2: due: is not after ready"),
        (("fleet.csv", "d2", "d1"), "fleet.csv:3: id: two drones have the same id"),
        (("fleet.csv", "m200", "ufo"), "fleet.csv:2: type: is not a drone of the scenario (got 'ufo')"),
    ],
)
def test_bad_input_is_refused_line_by_line(skyway, files, change, said):
    name, old, new = change
    path = files / name
    path.write_text(path.read_text().replace(old, new, 1))
    done = skyway(*PLAN, "--ledger", "ledger.db")
    assert done.code == 2
    assert said in done.err
    assert not (files / "ledger.db").exists()


def test_options_that_do_not_fit(skyway, files):
    for more, said in {
        ("--actual-wind", "2013-07-10"): "a fleet is not planned with perfect information",
        ("--time-limit", "0"): "--time-limit: must be above 0",
        ("--ledger", "mysql://host/db"): "is not a ledger",
    }.items():
        done = skyway(*PLAN, *more)
        assert done.code == 2
        assert said in done.err


TOURS = ("dispatch", "tours", "--orders", "round.csv", "--fleet", "home.csv", "--depart", "2013-07-10T14:00-04:00", "--wind", "4@270", "--iterations", "50")  # fmt: skip


@pytest.fixture
def round_(tmp_path):
    rows = [f"{name},bellevue,{to},0.3,2013-07-10T14:00-04:00,2013-07-10T16:30-04:00,0" for name, to in (("a", "jacobi"), ("b", "yankee-stadium"))]  # fmt: skip
    (tmp_path / "round.csv").write_text("\n".join(("id,from,to,mass_kg,ready,due,priority", *rows)) + "\n")
    (tmp_path / "home.csv").write_text("id,type,home,charge_percent\nd1,m200,bellevue,90\n")
    return tmp_path


def test_tours_are_printed_written_and_booked(skyway, round_):
    done = skyway(*TOURS, "--ledger", "ledger.db", "-o", "tours.json")
    assert done.code == 0, done.err
    assert "2 of 2 orders served" in done.out
    document = json.loads((round_ / "tours.json").read_text())
    assert len(document["drones"]) == 1
    assert sorted(document["drones"][0]["orders"]) == ["a", "b"]
    charges = [step for step in document["drones"][0]["steps"] if step["kind"] == "charge"]
    with open_ledger(str(round_ / "ledger.db")) as ledger:
        assert sorted((one.window.station, one.window.pad) for one in ledger.holds()) == sorted(
            (one["from"], one["pad"]) for one in charges
        )


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("--actual-wind", "8@270"), "a fleet is not planned with perfect information"),
        (("--time-limit", "0"), "must be above 0"),
        (("--reserve", "95"), "--reserve"),
    ],
)
def test_tours_refuse_what_is_wrong_in_one_line(skyway, round_, wrong, said):
    done = skyway(*TOURS, *wrong)
    assert done.code == 2
    assert said in done.err
    assert "Traceback" not in done.err


def test_where_no_tour_serves_anything_the_exit_code_says_so(skyway, round_):
    (round_ / "home.csv").write_text("id,type,home,charge_percent\nd1,m200,jacobi,90\n")
    done = skyway(*TOURS)
    assert done.code == 1
    assert "no drone of the fleet stands at its station" in " ".join(done.out.split())
