"""Files of orders and fleets: what is read, and everything that can be wrong with them, said at once."""

import json
from datetime import UTC, datetime

import pytest

from skyway.missions.examples import NEW_YORK
from skyway.models.base.errors import InputError
from skyway.models.orders.files import read_orders, read_vehicles
from skyway.models.orders.fitting import fit, read_work
from skyway.models.scenario.file import read_scenario

ORDERS = "id,from,to,mass_kg,kind,ready,due,priority,value\n"
GOOD = 'a,bellevue,jacobi,0.8,blood,2013-07-10T14:00-04:00,2013-07-10T16:00-04:00,2,90\nb,edison,"40.7,-73.9",0.3,,2013-07-10T18:10Z,2013-07-10T20:00Z,,\n'
FLEET = "id,type,home,at,charge_percent,available_from,available_to,battery_health_percent\n"


@pytest.fixture(scope="module")
def new_york():
    return read_scenario(NEW_YORK)


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def orders_of(tmp_path, text):
    return read_orders(written(tmp_path / "orders.csv", ORDERS + text))


def refusal(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    return str(caught.value)


def test_orders_are_read_from_csv(tmp_path):
    first, second = orders_of(tmp_path, GOOD)
    assert (first.id, first.origin, first.destination, first.mass_kg) == ("a", "bellevue", "jacobi", 0.8)
    assert (first.kind, first.priority, first.value) == ("blood", 2, 90.0)
    assert first.ready == datetime(2013, 7, 10, 18, tzinfo=UTC)
    assert (second.destination, second.priority, second.value) == ("40.7,-73.9", 0, None)


def test_orders_in_json_are_the_same(tmp_path):
    rows = [
        {"id": "a", "from": "bellevue", "to": "jacobi", "mass_kg": 0.8, "kind": "blood", "priority": 2, "value": 90,
         "ready": "2013-07-10T14:00-04:00", "due": "2013-07-10T16:00-04:00"},
        {"id": "b", "from": "edison", "to": [40.7, -73.9], "mass_kg": 0.3, "ready": "2013-07-10T18:10Z", "due": "2013-07-10T20:00Z"},
    ]  # fmt: skip
    document = {"schema": "skyway.orders/1", "orders": rows}
    path = written(tmp_path / "orders.json", json.dumps(document))
    assert read_orders(path) == orders_of(tmp_path, GOOD)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("a,x,y,0.5,,2013-07-10T14:00-04:00,2013-07-10T13:00-04:00,,", "orders.csv:2: due: is not after ready"),
        ("a,x,y,0.5,,2013-07-10T14:00,2013-07-10T16:00-04:00,,", "orders.csv:2: ready: the time has no UTC offset"),
        ("a,x,y,heavy,,2013-07-10T14:00Z,2013-07-10T16:00Z,,", "orders.csv:2: mass_kg: is not a number (got 'heavy')"),
        ("a,x,y,-1,,2013-07-10T14:00Z,2013-07-10T16:00Z,,", "orders.csv:2: mass_kg: out of range (got '-1')"),
        ("a,x,y,nan,,2013-07-10T14:00Z,2013-07-10T16:00Z,,", "orders.csv:2: mass_kg: is not a number"),
        ("a,x,y,1,,2013-07-10T14:00Z,2013-07-10T16:00Z,high,", "orders.csv:2: priority: is not a number"),
        ("a,x,y,1,,2013-07-10T14:00Z,2013-07-10T16:00Z,1.5,", "orders.csv:2: priority: must be a whole number"),
        ("a,x,x,1,,2013-07-10T14:00Z,2013-07-10T16:00Z,,", "orders.csv:2: to: is where the order comes from"),
        (",x,y,1,,2013-07-10T14:00Z,2013-07-10T16:00Z,,", "orders.csv:2: id: is missing"),
        ("a,x,y,1,,2013-07-10T14:00Z,2013-07-13T16:00Z,,", "orders.csv:2: due: is more than 48 h after ready"),
        ("a,x,y", "orders.csv:2: has 3 cells where the header has 9"),
    ],
)
def test_each_fault_names_its_line_field_value_and_remedy(tmp_path, row, said):
    assert said in refusal(orders_of, tmp_path, row + "\n")


def test_two_orders_with_one_id(tmp_path):
    said = refusal(orders_of, tmp_path, GOOD.replace("\nb,", "\na,"))
    assert said.endswith("orders.csv:3: id: two orders have the same id (got 'a'); it is already on line 2")


def test_a_misspelt_column_does_not_pass_for_a_default(tmp_path):
    text = (ORDERS + GOOD).replace("priority", "prority")
    said = refusal(read_orders, written(tmp_path / "orders.csv", text))
    assert "orders.csv:1: prority: is not a field here; did you mean priority?" in said


@pytest.mark.parametrize(
    "text", ["", "{", "[1]", '{"schema": "skyway.orders/2"}', '{"orders": 7}', "[" * 100_000, "[]"]
)
def test_what_is_no_list_of_orders_is_refused_in_one_line(tmp_path, text):
    said = refusal(read_orders, written(tmp_path / "orders.json", text))
    assert "orders.json" in said
    assert "\n" not in said


def test_a_file_full_of_faults_is_not_read_to_its_end(tmp_path):
    said = refusal(orders_of, tmp_path, "a,x,y,1,,soon,later,,\n" * 3000)
    assert "too many faults" in said
    assert len(said.splitlines()) < 250


def test_drones_are_read_with_their_defaults(tmp_path):
    text = FLEET + "d1,m200-v2,edison,,,,,\nd2,m200-v2,edison,jacobi,45,2013-07-10T12:00Z,2013-07-10T22:00Z,80\n"
    one, other = read_vehicles(written(tmp_path / "fleet.csv", text))
    assert (one.place, one.soc, one.available_from, one.battery_health) == ("edison", 1.0, None, 1.0)
    assert (other.place, other.soc, other.battery_health) == ("jacobi", 0.45, 0.8)
    assert other.available_to == datetime(2013, 7, 10, 22, tzinfo=UTC)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("d,m200-v2,edison,,0.9,,,", "fleet.csv:2: charge_percent: is probably a share: it is read as percent (got '0.9'); 90 for 90 %"),
        ("d,m200-v2,edison,,101,,,", "fleet.csv:2: charge_percent: out of range (got '101'); must be from 0 to 100 percent"),
        ("d,m200-v2,edison,,,,,5", "fleet.csv:2: battery_health_percent: out of range"),
        ("d,m200-v2,edison,,,2013-07-10T12:00Z,2013-07-10T11:00Z,", "fleet.csv:2: available_to: is not after available_from"),
        ("d,,edison,,,,,", "fleet.csv:2: type: is missing"),
        ("d,m200-v2,edison,,,,,\nd,m200-v2,edison,,,,,", "fleet.csv:3: id: two drones have the same id (got 'd')"),
    ],
)  # fmt: skip
def test_faults_of_a_fleet(tmp_path, row, said):
    assert said in refusal(read_vehicles, written(tmp_path / "fleet.csv", FLEET + row + "\n"))


def test_places_are_found_and_targets_join_the_network(tmp_path, new_york):
    fleet = read_vehicles(written(tmp_path / "fleet.csv", FLEET + "d,m200,Edison,,,,,\n"))
    work = fit(new_york, orders_of(tmp_path, GOOD), fleet)
    target = work.scenario.network.stations[work.scenario.network.index[work.orders[1].destination]]
    assert (target.lat, target.lon, target.pads) == (40.7, -73.9, 0)
    assert work.vehicles[0].home == "edison"


def test_what_does_not_fit_the_scenario_is_refused_at_once(tmp_path, new_york):
    rows = (
        "a,nowhere,jacobi,0.8,,2013-07-10T14:00Z,2013-07-10T16:00Z,,\n"
        "b,edison,jacobi,0.8,,2013-07-10T14:00Z,2013-07-10T16:00Z,,\n"
        'c,edison,"12,99",0.5,,2013-07-10T14:00Z,2013-07-10T16:00Z,,\n'
        "d,Jacobi,jacobi,0.5,,2013-07-10T14:00Z,2013-07-10T16:00Z,,\n"
    )
    fleet = read_vehicles(written(tmp_path / "fleet.csv", FLEET + "d,m200,edison,,,,,\ne,ufo,edison,,,,,\n"))
    lines = refusal(fit, new_york, orders_of(tmp_path, rows), fleet).splitlines()
    assert "fleet.csv:3: type: is not a drone of the scenario (got 'ufo')" in lines[0]
    assert "orders.csv:2: from: no such station (got 'nowhere')" in lines[1]
    assert "orders.csv:4: to: no segment leads there (got '12,99')" in lines[2]
    assert "orders.csv:5: to: is where the order comes from" in lines[3]
    assert len(lines) == 4


def test_all_faults_of_both_files_are_said_at_once(tmp_path, new_york):
    rows = "a,nowhere,jacobi,heavy,,2013-07-10T14:00Z,2013-07-10T13:00Z,,\nb,edison,,0.5,,2013-07-10T14:00Z,2013-07-10T16:00Z,,\n"
    orders = written(tmp_path / "orders.csv", ORDERS + rows)
    fleet = written(tmp_path / "fleet.csv", FLEET + "d,ufo,nowhere,,101,,,\ne,,edison,,,,,\n")
    lines = refusal(read_work, new_york, orders, fleet).splitlines()
    assert [
        line.split("orders.csv:")[-1].split("fleet.csv:")[-1].partition(" (")[0].partition(";")[0] for line in lines
    ] == [
        "2: due: is not after ready",
        "2: mass_kg: is not a number",
        "2: from: no such station",
        "3: to: is missing",
        "2: charge_percent: out of range",
        "2: type: is not a drone of the scenario",
        "2: home: no such station",
        "3: type: is missing",
    ]


def test_a_fleet_that_cannot_be_read_is_not_called_empty(tmp_path, new_york):
    orders = written(tmp_path / "orders.csv", ORDERS + "a,nowhere,jacobi,1,,2013-07-10T14:00Z,2013-07-10T15:00Z,,\n")
    lines = refusal(read_work, new_york, orders, tmp_path / "fleet.csv").splitlines()
    assert "orders.csv:2: from: no such station" in lines[0]
    assert "fleet.csv: no such file" in lines[1]
    assert len(lines) == 2
