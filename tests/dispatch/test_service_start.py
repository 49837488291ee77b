"""How a service begins: who leads it, and what it leaves when it is refused."""

import pytest
from fleet_runs import START

from skyway.dispatch.service import Options, Service
from skyway.models.base.errors import InputError
from skyway.models.ledger.opening import open_ledger


def test_a_dispatcher_says_once_that_another_one_leads_and_leaves_no_lease_when_it_is_refused(tmp_path):
    name = str(tmp_path / "ledger.db")
    said = []
    with open_ledger(name) as book:
        lease = book.acquire("dispatch", "another process", 3600.0)

        def say(line):
            said.append(line)
            assert book.led("dispatch")
            book.give_back(lease)

        with pytest.raises(InputError, match="a service without drones"):
            Service(Options(ledger=name, dispatcher="dispatch", folder=tmp_path, begin_s=START.timestamp(), say=say))
        assert not book.led("dispatch")
    assert len(said) == 1
    assert said[0].startswith("another process leads this service")
