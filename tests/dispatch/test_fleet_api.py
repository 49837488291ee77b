"""The HTTP API, the desk commands and the figures of a service, without a dispatcher: everything is on the desk."""

import json
import sqlite3
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
from fleet_runs import START

from skyway.cli.main import main
from skyway.dispatch.http_api import serve_in_background
from skyway.dispatch.records import DroneRecord, ServiceRecord, written
from skyway.models.base.errors import InputError
from skyway.models.ledger.desk import Desk, Entry
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Vehicle

ORDER = {
    "id": "serum", "from": "bellevue", "to": "jacobi", "mass_kg": 0.4, "ready": "2013-07-10T14:00-04:00", "due": "2013-07-10T16:00-04:00",
}  # fmt: skip


@pytest.fixture
def ledger(tmp_path):
    """A ledger with a service of one drone that nobody runs."""
    name = str(tmp_path / "ledger.db")
    vehicle = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue", soc=0.6)
    service = ServiceRecord(begin_s=START.timestamp(), folder=str(tmp_path), ledger=name)
    drone = DroneRecord(vehicle=vehicle, system=1, place="bellevue", soc=0.6)
    with open_ledger(name) as book:
        lease = book.acquire("dispatch", "test")
        entries = [
            Entry("drone", "d1", 0, "standing", "dispatch", written(drone)),
            Entry("service", "service", 0, "running", "dispatch", written(service)),
        ]
        Desk(book, "dispatch").put(lease, entries)
        book.give_back(lease)
    return name


class Client:
    """Asks a server; answers are status and text."""

    def __init__(self, ledger):
        self.address = serve_in_background(ledger, "dispatch", "127.0.0.1:0")

    def get(self, path, **headers):
        return self._ask(urllib.request.Request(self.address + path, headers=headers))

    def post(self, path, document, kind="application/json"):
        return self.send(path, json.dumps(document).encode(), kind)

    def send(self, path, data, kind="application/json", method="POST"):
        return self._ask(urllib.request.Request(self.address + path, data, {"content-type": kind}, method=method))

    @staticmethod
    def _ask(request):
        try:
            with urllib.request.urlopen(request, timeout=10.0) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read().decode()


@pytest.fixture
def client(ledger, monkeypatch):
    monkeypatch.delenv("SKYWAY_TOKEN", raising=False)
    return Client(ledger)


def test_an_order_for_a_service_that_has_ended_is_refused(ledger, client):
    """Nobody would serve it, and it would stay new for ever."""
    with open_ledger(ledger) as book:
        desk, lease = Desk(book, "dispatch"), book.acquire("dispatch", "test")
        found = desk.get("service", "service")
        desk.put(lease, [Entry("service", "service", found.version, "ended", "dispatch", found.document)])
    status, text = client.post("/orders", ORDER)
    assert status == 422
    assert "has ended" in text
    with open_ledger(ledger) as book:
        assert Desk(book, "dispatch").get("order", "serum") is None


def test_an_order_is_taken_once_and_told(client):
    assert client.post("/orders", ORDER)[0] == 201
    status, problem = client.post("/orders", ORDER)
    assert (status, "of this id already" in problem) == (422, True)
    told = json.loads(client.get("/orders/serum")[1])
    assert (told["state"], told["from"], told["promised"]) == ("new", "bellevue", None)
    assert [one["id"] for one in json.loads(client.get("/orders")[1])] == ["serum"]
    assert client.get("/orders/nothing")[0] == 404


def test_faults_of_an_order_are_named(client):
    status, problem = client.post("/orders", {**ORDER, "due": "2013-07-10T13:00-04:00"})
    assert (status, "is not after ready" in problem) == (422, True)
    assert client.post("/orders", {**ORDER, "colour": "red"})[0] == 422
    assert client.post("/orders", ORDER, "text/plain")[0] == 415
    assert json.loads(client.get("/orders")[1]) == []


LONG = "x" * 90_000
WRONG = {
    "nothing": b"", "no JSON": b"{", "no UTF-8": b'{"id": "\xff"}', "null": b"null", "a list": json.dumps([ORDER] * 9).encode(), "a text": json.dumps(LONG).encode(),
    "deep": b"[" * 90_000, "a long number": b'{"id": ' + b"9" * 9_000 + b"}", "no fields": b"{}",
    **{f"{name} is {value!r:.9}": json.dumps({**ORDER, name: value}).encode() for name, value in (
        ("mass_kg", True), ("mass_kg", "much"), ("mass_kg", LONG), ("mass_kg", [LONG]), ("id", LONG), ("id", ["a"]), ("ready", 7), ("due", LONG), ("from", {"lat": LONG}),
        ("priority", 1.5), ("value", False), ("kind", [1]), (LONG, 1),
    )},
}  # fmt: skip


@pytest.mark.parametrize("body", WRONG.values(), ids=WRONG)
def test_whatever_is_sent_that_is_no_order_has_its_faults_named_in_short(client, body):
    status, text = client.send("/orders", body)
    assert status == 422
    told = json.loads(text)
    assert set(told) == {"problems"}
    assert told["problems"]
    assert all(isinstance(one, str) and one.startswith("order") and len(one) < 400 for one in told["problems"])
    assert json.loads(client.get("/orders")[1]) == []


@pytest.mark.parametrize(
    ("method", "path", "kind", "size", "status"),
    [
        ("DELETE", "/orders/serum", "application/json", 0, 405),
        ("DELETE", "/orders/serum", "text/plain", 0, 405),
        ("PUT", "/status", "text/plain", 10, 405),
        ("GET", "/nothing", "text/plain", 0, 404),
        ("GET", "/orders/" + "y" * 9_000, "text/plain", 0, 404),
        ("POST", "/orders", "text/plain", 10, 415),
        ("POST", "/orders", "application/json", 200_000, 413),
    ],
)
def test_every_refusal_has_one_shape(client, method, path, kind, size, status):
    answer = client.send(path, b" " * size if size else None, kind, method)
    assert answer[0] == status
    told = json.loads(answer[1])
    assert list(told) == ["problems"]
    assert all(isinstance(one, str) and len(one) < 400 for one in told["problems"])


@pytest.mark.parametrize("name", ["serum 7", "a?b#c%2f", "Bänke", "...", 7])
def test_an_id_that_is_taken_can_be_asked_for(client, name):
    assert client.post("/orders", {**ORDER, "id": name})[0] == 201
    assert json.loads(client.get("/orders/" + urllib.parse.quote(str(name), safe=""))[1])["id"] == str(name)


@pytest.mark.parametrize("name", ["../x", "a/b", ".", ".."])
def test_an_id_that_no_path_can_name_is_refused_wherever_it_comes_from(client, ledger, tmp_path, capsys, name):
    status, text = client.post("/orders", {**ORDER, "id": name})
    assert (status, "order: id: cannot be asked for in a path" in text) == (422, True)
    file = tmp_path / "orders.csv"
    file.write_text(",".join(ORDER) + "\n" + ",".join(map(str, {**ORDER, "id": name}.values())) + "\n")
    typed = [f"--{option}={ORDER[field]}" for option, field in (("from", "from"), ("to", "to"), ("mass", "mass_kg"), ("ready", "ready"), ("due", "due"))]  # fmt: skip
    for order in ([str(file)], [f"--id={name}", *typed]):
        assert main(["orders", "add", *order, "--ledger", ledger]) == 2
        assert "id: cannot be asked for in a path" in capsys.readouterr().err


def test_the_api_describes_itself_and_tells_figures(client):
    described = json.loads(client.get("/openapi.json")[1])
    assert {"/orders", "/orders/{order_id}", "/status", "/metrics"} <= set(described["paths"])
    assert set(ORDER) < set(described["components"]["schemas"]["NewOrder"]["properties"])
    body = described["paths"]["/orders"]["post"]["requestBody"]["content"]["application/json"]["schema"]
    assert body == {"$ref": "#/components/schemas/NewOrder"}
    figures = client.get("/metrics")[1]
    assert 'skyway_drones{state="standing"} 1' in figures
    assert "skyway_dispatcher_up 0" in figures
    assert json.loads(client.get("/status")[1])["drones"][0]["charge_percent"] == pytest.approx(60.0)


def test_only_this_machine_or_who_has_the_token_is_served(ledger, client, monkeypatch):
    assert client.get("/orders", host="attacker.example")[0] == 403
    with pytest.raises(InputError, match="anyone on the network"):
        serve_in_background(ledger, "dispatch", "0.0.0.0:0")
    monkeypatch.setenv("SKYWAY_TOKEN", "secret")
    guarded = Client(ledger)
    assert guarded.get("/orders")[0] == 401
    assert guarded.get("/orders", authorization="Bearer secret")[0] == 200


def test_the_reference_has_every_path_and_every_field_of_the_api(client):
    page = (Path(__file__).parents[2] / "docs" / "reference" / "fleet-api.md").read_text()
    described = json.loads(client.get("/openapi.json")[1])
    for path, methods in described["paths"].items():
        assert all(f"`{method.upper()} {path}`" in page for method in methods), path
    for name in ("NewOrder", "OrderStatus"):
        fields = described["components"]["schemas"][name]["properties"]
        assert not [one for one in fields if f"`{one}`" not in page], name


def test_of_a_locked_ledger_the_status_is_told_and_an_order_is_refused_in_time(client, ledger, monkeypatch):
    """A backup, or a program that was stopped in the middle, may hold the file for hours."""
    monkeypatch.setattr("skyway.dispatch.http_api.LEDGER_WAIT_S", 0.05)
    other = sqlite3.connect(ledger, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        assert client.get("/status")[0] == client.get("/metrics")[0] == 200
        status, problem = client.post("/orders", ORDER)
        assert (status, "is locked: another process has been writing to it" in problem) == (503, True)
    finally:
        other.close()
    assert client.post("/orders", ORDER)[0] == 201
