"""Who takes the place of a process that was killed, and pads that another operator still uses."""

import threading
import time
from datetime import UTC, datetime, timedelta

from simulated import world_of

from skyway.dispatch.dispatcher.bookings import Bookings
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window
from skyway.sim_stub.transports.lockstep_client import LockstepClient

DEADLINE_S = 10.0
NOON = datetime(2026, 7, 10, 12, tzinfo=UTC)


def killed(client):
    """End a connection without leaving, as a killed process does."""
    client._socket.close()


def test_a_held_world_wakes_who_can_take_the_place_of_a_killed_process():
    with world_of() as address:
        first = LockstepClient(address, "worker 1", grace_s=0.0)
        stand_in = LockstepClient(address, "worker 1", grace_s=0.0)
        tries = []

        def wait():
            while len(tries) < 2:  # it fails to take over at first
                stand_in.sleep_until(1000.0)
                tries.append(stand_in.now_s())
            LockstepClient(address, "worker 1").close()  # takes the place
            stand_in.sleep_until(1000.0)
            tries.append(stand_in.now_s())

        thread = threading.Thread(target=wait)
        begun_s = time.monotonic()
        thread.start()
        first.sleep_until(1.0)
        killed(first)
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        assert time.monotonic() - begun_s < DEADLINE_S
        assert tries[0] == tries[1] < 1000.0 <= tries[2]
        stand_in.close()


def window(begin_min, end_min):
    return Window(station="a", pad=1, start=NOON + timedelta(minutes=begin_min), end=NOON + timedelta(minutes=end_min))


def test_a_pad_that_another_operator_still_uses_is_marked_when_it_is_free(tmp_path):
    with open_ledger(str(tmp_path / "ledger.db")) as ledger:
        other = ledger.acquire("other", "a process")
        ledger.book(other, "late", [window(0, 30)])
        ledger.mark(other, "late", "in use")
        lease = ledger.acquire("ours", "another process")
        bookings = Bookings(ledger, "ours", lambda: lease, {"a": 1})
        at_s = (NOON + timedelta(minutes=31)).timestamp()
        bookings.bring_up_to_date({"one": [window(30, 60)]}, at_s)
        assert [one.state for one in ledger.holds() if one.holder == "ours"] == ["firm"]
        ledger.mark(other, "late", "released")
        bookings.bring_up_to_date({"one": [window(30, 60)]}, at_s)
        assert [one.state for one in ledger.holds() if one.holder == "ours"] == ["in use"]


def test_a_window_of_another_operator_that_is_over_and_not_released_loses_no_booking(tmp_path):
    with open_ledger(str(tmp_path / "ledger.db")) as ledger:
        other = ledger.acquire("other", "a process")
        ledger.book(other, "late", [window(0, 30)])
        lease = ledger.acquire("ours", "another process")
        bookings = Bookings(ledger, "ours", lambda: lease, {"a": 1})

        def ours(now_min):
            """Bring the bookings up to date at an instant; our drone has been on its pad since 12:20."""
            bookings.bring_up_to_date({"one": [window(20, 60)]}, (NOON + timedelta(minutes=now_min)).timestamp())
            return [one.window for one in ledger.holds() if one.holder == "ours"]

        behind = ours(25)
        assert behind == [window(30, 70)]
        assert ours(31) == behind  # the other operator's next step releases its own
        ledger.mark(other, "late", "released")
        assert ours(32) == [window(20, 60)]
