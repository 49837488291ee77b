"""The desk on both stores: what lies there is changed under a lease alone, by who has seen the newest version, and never forgotten."""

from dataclasses import replace

import pytest
from ledgers import opened

from skyway.models.base.errors import InputError
from skyway.models.ledger.desk import Desk, Entry
from skyway.models.ledger.ledger import FencedError, LedgerError, VersionError


@pytest.fixture(params=["sqlite", "postgresql"])
def desk(request, tmp_path):
    with opened(request.param, tmp_path) as ledger:
        yield Desk(ledger, "d")


def entry(name="one", state="new", keeper="d", version=0, kind="flight"):
    return Entry(kind, name, version, state, keeper, "{}")


def test_entries_are_written_all_or_none(desk):
    lease = desk.ledger.acquire("d", "here")
    first, second = desk.put(lease, [entry("a"), entry("b", "flying")])
    assert (first.version, second.version) == (1, 1)
    with pytest.raises(VersionError):
        desk.put(lease, [replace(first, state="ended"), entry("b")])
    assert [one.state for one in desk.entries("flight")] == ["new", "flying"]
    assert [one.id for one in desk.entries("flight", ("flying", "ended"))] == ["b"]
    assert desk.keepers("flight", ("new", "flying", "ended")) == {"a": "d", "b": "d"}
    assert desk.keepers("flight", ("flying",)) == {"b": "d"}
    assert (desk.count("flight"), desk.count("flight", ("new",)), desk.count("order")) == (2, 1, 0)


def test_only_the_keeper_and_the_dispatcher_change_an_entry(desk):
    lease = desk.ledger.acquire("d", "here")
    (mine,) = desk.put(lease, [entry(keeper="d/worker 1")])
    worker, other = desk.ledger.acquire("d/worker 1", "there"), desk.ledger.acquire("d/worker 2", "elsewhere")
    with pytest.raises(FencedError, match="kept by d/worker 1"):
        desk.put(other, [replace(mine, state="flying")])
    (after,) = desk.put(worker, [replace(mine, state="flying")])
    desk.ledger.give_back(worker)
    with pytest.raises(FencedError):
        desk.put(worker, [replace(after, state="ended")])
    taken = desk.ledger.acquire("d/worker 1", "another")
    with pytest.raises(FencedError):
        desk.ledger.confirm(worker)
    desk.ledger.confirm(taken)
    assert desk.ledger.led("d/worker 1")
    assert desk.get("flight", "one").state == "flying"


def test_anybody_puts_new_things_down_once_and_the_history_stays(desk):
    desk.put_down("order", "o", "new", "{}")
    with pytest.raises(InputError, match="an order of this id already"):
        desk.put_down("order", "o", "new", "{}")
    with pytest.raises(InputError, match=r"an order of this id already \(got 'o'\)"):
        desk.put_down_all("order", "new", {"n": "{}", "o": "{}"})
    assert desk.get("order", "n") is None
    lease = desk.ledger.acquire("d", "here")
    desk.put(lease, [replace(desk.get("order", "o"), state="refused")])
    assert [one.state for _, _, one in desk.history("order", "o")] == ["new", "refused"]
    for sql in ("DELETE FROM desk", "DELETE FROM desk_history"):
        with pytest.raises(LedgerError), desk.ledger.transaction():
            desk.ledger.rows(sql)
