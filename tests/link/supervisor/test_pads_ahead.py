"""Pads of the stations ahead are asked for when a decision wants to know, and a service that fails is left alone for a while."""

import pytest

from skyway.link.supervisor.flight.pads_ahead import ASK_EVERY_S, SILENT_S, PadsAhead
from skyway.models.queues.pad_service import PadServiceError, StationStatus


class Pads:
    """A pad service that counts what it is asked."""

    def __init__(self):
        self.asked, self.fails = [], False

    def status(self, station):
        self.asked.append(station)
        if self.fails:
            raise PadServiceError("gone")
        return StationStatus(
            station=station, posix_s=0.0, pads=2, busy=2, remaining_s=(), waiting=1, holding_spots=2, holding_free=1
        )


def test_a_station_is_asked_once_and_again_when_that_is_old():
    service, now = Pads(), [0.0]
    ahead = PadsAhead(service, lambda: now[0])
    assert service.asked == []
    assert (ahead["here"], ahead.get("here"), ahead["there"]) == (3, 3, 3)
    assert service.asked == ["here", "there"]
    now[0] = ASK_EVERY_S
    assert ahead["here"] == 3
    assert service.asked == ["here", "there", "here"]
    assert sorted(ahead) == ["here", "there"]
    assert len(ahead) == 2


def test_a_service_that_fails_is_not_asked_again_for_a_while_and_nothing_is_known():
    service, now = Pads(), [0.0]
    ahead = PadsAhead(service, lambda: now[0])
    service.fails = True
    assert ahead.get("here") is None
    assert ahead.get("there") is None
    assert service.asked == ["here"]
    with pytest.raises(KeyError):
        ahead["there"]
    service.fails, now[0] = False, SILENT_S
    assert ahead["there"] == 3
