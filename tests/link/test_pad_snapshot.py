"""One look at all pads over TCP: what a service answers, half answers, or does not."""

import contextlib
import socket
import threading
import time

import pytest

from skyway.link.pads import snapshot
from skyway.models.base.errors import InputError
from skyway.models.queues.pad_service import PadAnswer, PadServiceError, StationStatus, decode_request, encode


@contextlib.contextmanager
def served(answer):
    """Serve one connection with `answer(request) -> bytes`."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve():
        with contextlib.suppress(OSError):
            peer, _ = listener.accept()
            with peer, peer.makefile("rb") as lines:
                for line in lines:
                    peer.sendall(answer(decode_request(line)))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"tcp:127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.close()
        thread.join(2.0)


def status(request):
    if request.station == "gone":
        return encode(PadAnswer(ok=False, error="no station 'gone' here"))
    one = StationStatus(
        station=request.station,
        posix_s=1.0,
        pads=5,
        busy=2,
        remaining_s=(60.0,),
        waiting=0,
        holding_spots=2,
        holding_free=2,
    )
    return encode(PadAnswer(ok=True, station=one))


def test_every_station_is_asked_once_and_an_unknown_one_is_told():
    with served(status) as address:
        found, notes = snapshot(address, ["a", "gone", "b"])
    assert [(one.station, one.busy) for one in found] == [("a", 2), ("b", 2)]
    assert notes == [f"the pad service at {address} reported 2 of 3 stations: no station 'gone' here"]


def test_a_service_that_dawdles_is_left_at_the_deadline():
    def slowly(request):
        time.sleep(0.06)
        return status(request)

    with served(slowly) as address:
        found, notes = snapshot(address, [str(number) for number in range(50)], within_s=0.15)
    assert 1 <= len(found) < 50
    assert f"reported {len(found)} of 50 stations within 0.15 s" in notes[0]


@pytest.mark.parametrize("reply", [b"", b"{}\n", b"[" * 100_000 + b"\n", b"\xff\n", b"null\n"])
def test_nonsense_is_one_clear_error(reply):
    with served(lambda _request: reply or b"x" * 300_000) as address, pytest.raises(PadServiceError):
        snapshot(address, ["a", "b"])


def test_no_service_and_another_kind_of_address_are_refused():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(PadServiceError, match="failed"):
        snapshot(f"tcp:127.0.0.1:{port}", ["a"])
    with pytest.raises(InputError, match="not an address of pads"):
        snapshot("udpin:127.0.0.1:5790", ["a"])
