"""Entries of a journal are the same after they were written and read, and reading never fails, whatever a file holds."""

from __future__ import annotations

import json
import math
import random

import msgspec
import pytest

from skyway.link.supervisor.journal import entries
from skyway.link.supervisor.journal.entry import Entry, Part
from skyway.link.supervisor.journal.file import Journal
from skyway.models.base.errors import InputError

KINDS = [one for one in vars(entries).values() if isinstance(one, type) and issubclass(one, Entry) and one is not Entry]


def nonsense(rng, depth=2):
    """Any JSON value."""
    kind = rng.randrange(9 if depth else 6)
    if kind < 6:
        return (None, True, rng.gauss(0.0, 1.0), 10.0 ** rng.randrange(-5, 300), rng.randrange(-3, 10), rng.choice(("", "a", "no")))[kind]  # fmt: skip
    if kind == 6:
        return [nonsense(rng, depth - 1) for _ in range(rng.randrange(3))]
    return {rng.choice(("name", "lat_deg", "members", "x")): nonsense(rng, depth - 1) for _ in range(rng.randrange(3))}


def test_every_kind_of_entry_has_a_name_of_its_own():
    assert len(KINDS) > 25
    assert all(kind.event() for kind in KINDS)
    assert (
        len({kind.event() for kind in KINDS if kind is not entries.StartNote}) == len(KINDS) - 1
    )  # both begin a delivery


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_whatever_a_file_holds_is_read_as_typed_values_that_are_written_as_they_were_read(kind):
    rng = random.Random(kind.__name__)
    keys = [*(one.name for one in msgspec.structs.fields(kind)), "station", "belief", "forecast_mean_mps", "left_s"]
    for _ in range(60):
        told = kind.read({key: nonsense(rng) for key in keys if rng.random() < 0.8})
        assert kind.read(json.loads(json.dumps(told.to_json(), allow_nan=False))) == told
        for one in msgspec.structs.fields(kind):
            value = getattr(told, one.name)
            assert value is None or isinstance(value, (bool, int, float, str, tuple, dict, Part))
            assert not isinstance(value, float) or math.isfinite(value)


def test_what_is_unknown_and_always_told_is_null_and_the_rest_is_left_out():
    assert entries.CounterSet(soc=0.5, reported=None).to_json() == {"soc": 0.5, "reported": None}
    assert entries.Turned(destination="a").to_json() == {"destination": "a"}


def test_two_flights_of_the_same_second_have_a_journal_each(tmp_path):
    books = [Journal.beside_others(tmp_path / "a-b.jsonl", lambda: 1e9) for _ in range(3)]
    for book in books:
        book.close()
    assert [book.path.name for book in books] == ["a-b.jsonl", "a-b-2.jsonl", "a-b-3.jsonl"]
    with pytest.raises(InputError, match="cannot be written"):
        Journal.beside_others(tmp_path / "missing" / "a-b.jsonl", lambda: 1e9)
