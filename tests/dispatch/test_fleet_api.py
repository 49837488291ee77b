"""The HTTP API, the desk commands and the figures of a service, without a dispatcher: everything is on the desk."""

import json
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from fleet_runs import START

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
        data = json.dumps(document).encode()
        return self._ask(urllib.request.Request(self.address + path, data, {"content-type": kind}))

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


def test_the_api_describes_itself_and_tells_figures(client):
    described = json.loads(client.get("/openapi.json")[1])
    assert {"/orders", "/orders/{order_id}", "/status", "/metrics"} <= set(described["paths"])
    assert "NewOrder" in described["components"]["schemas"]
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
