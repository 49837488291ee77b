"""Orders that no dispatcher could serve are refused when they are given, by command and over HTTP."""

import pytest
from test_fleet_api import ORDER, Client, ledger  # noqa: F401  a fixture

from skyway.cli.main import main
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger

WRONG = {
    "unknown": ({"to": "jacoby"}, ["to", "no such station", "did you mean jacobi"]),
    "without pads": ({"from": "40.7400,-73.9750"}, ["from: has no pads", "the nearest are bellevue"]),
    "due has passed": ({"ready": "2013-07-10T12:00-04:00", "due": "2013-07-10T13:00-04:00"}, ["due: has passed", "18:00:00Z, the time of the service"]),
}  # fmt: skip


@pytest.mark.parametrize(("change", "words"), WRONG.values(), ids=WRONG)
def test_an_order_that_cannot_be_served_is_refused_at_once(ledger, capsys, change, words):  # noqa: F811
    order = {**ORDER, **change}
    options = (("id", "id"), ("from", "from"), ("to", "to"), ("mass", "mass_kg"), ("ready", "ready"), ("due", "due"))
    typed = [f"--{option}={order[field]}" for option, field in options]
    assert main(["orders", "add", *typed, "--ledger", ledger]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    status, text = Client(ledger).post("/orders", order)
    assert status == 422
    for one in words:
        assert one in error
        assert one in text
    with open_ledger(ledger) as book:
        assert Desk(book, "dispatch").entries("order") == []


def test_a_file_with_one_such_order_gives_none(ledger, tmp_path, capsys):  # noqa: F811
    file = tmp_path / "late.csv"
    rows = [ORDER, {**ORDER, "id": "far", "from": "40.7400,-73.9750"}]
    file.write_text(
        ",".join(ORDER) + "\n" + "".join(",".join(f'"{value}"' for value in one.values()) + "\n" for one in rows)
    )
    assert main(["orders", "add", str(file), "--ledger", ledger]) == 2
    assert f"{file}:3: from: has no pads" in capsys.readouterr().err
    with open_ledger(ledger) as book:
        assert Desk(book, "dispatch").entries("order") == []
