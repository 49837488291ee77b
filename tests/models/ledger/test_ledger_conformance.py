"""What every ledger promises, told to each store in turn: whole itineraries, leases, states, history."""

import threading
import time
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ledgers import START, name_of, opened, window

from skyway.models.base.errors import InputError
from skyway.models.ledger.audit import audit
from skyway.models.ledger.ledger import FencedError, TakenError, VersionError
from skyway.models.ledger.opening import open_ledger


@pytest.fixture(params=["sqlite", "postgresql"])
def store(request):
    return request.param


@pytest.fixture
def ledger(store, tmp_path):
    with opened(store, tmp_path) as one:
        yield one
        assert audit(one) == []


@pytest.fixture
def lease(ledger):
    return ledger.acquire("operator", "process 1")


def until_it_runs_out(ledger, lease, deadline_s=10.0):
    """Wait until the database's clock has passed the end of a lease."""
    end = time.monotonic() + deadline_s
    while ledger.now() <= lease.expires:
        assert time.monotonic() < end, "the clock of the database stands still"


def test_what_is_booked_is_held(ledger, lease):
    windows = [window("a", 2, 0), window("b", 1, 60, 15)]
    assert ledger.book(lease, "delivery 1", windows) == 1
    held = ledger.holds()
    assert [hold.window for hold in held] == windows
    assert {(hold.itinerary, hold.version, hold.state, hold.holder, hold.token) for hold in held} == {
        ("delivery 1", 1, "firm", "operator", 1)
    }
    assert ledger.holds(station="b") == held[1:]
    assert ledger.holds(end=windows[1].start) == held[:1]


def test_an_itinerary_is_booked_whole_or_not_at_all(ledger, lease):
    ledger.book(lease, "first", [window("b", 1, 60)])
    with pytest.raises(TakenError) as caught:
        ledger.book(lease, "second", [window("a", 1, 0), window("b", 1, 89)])
    assert [hold.itinerary for hold in caught.value.holds] == ["first"]
    assert "pad 1 of b is held by first from 2026-07-10T13:00:00Z to 2026-07-10T13:30:00Z" in str(caught.value)
    assert ledger.itinerary("second") == []
    assert {hold.itinerary for hold in ledger.holds()} == {"first"}


def test_a_pad_is_free_from_the_moment_that_it_is_left(ledger, lease):
    ledger.book(lease, "first", [window("a", 1, 0, 30)])
    ledger.book(lease, "second", [window("a", 1, 30, 30)])
    ledger.book(lease, "beside", [window("a", 2, 10, 30)])
    assert len(ledger.holds()) == 3


def test_a_new_version_replaces_the_old_one_or_leaves_it(ledger, lease):
    ledger.book(lease, "one", [window("a", 1, 0), window("b", 1, 60)])
    ledger.book(lease, "other", [window("c", 1, 0)])
    assert ledger.book(lease, "one", [window("a", 1, 10)], version=1) == 2  # over its own old window
    with pytest.raises(VersionError, match="has version 2, not 1"):
        ledger.book(lease, "one", [window("a", 1, 20)], version=1)
    with pytest.raises(TakenError):
        ledger.book(lease, "one", [window("c", 1, 0)])
    assert [(hold.version, hold.window) for hold in ledger.itinerary("one")] == [(2, window("a", 1, 10))]
    assert [hold.itinerary for hold in ledger.holds(station="b")] == []


def test_only_the_newest_token_counts(ledger, lease):
    ledger.book(lease, "one", [window()])
    with pytest.raises(FencedError, match="is with process 1 until"):
        ledger.acquire("operator", "process 2")
    short = ledger.renew(lease, 0.001)
    until_it_runs_out(ledger, short)
    with pytest.raises(FencedError, match="ran out"):
        ledger.mark(lease, "one", "in use")
    taken_over = ledger.acquire("operator", "process 2")
    assert taken_over.token == 2
    for call in (lambda: ledger.mark(lease, "one", "in use"), lambda: ledger.renew(lease), lambda: ledger.book(lease, "two", [window("b")])):  # fmt: skip
        with pytest.raises(FencedError, match="went to process 2"):
            call()
    assert ledger.mark(taken_over, "one", "in use") == 1


def test_another_holder_changes_nothing(ledger, lease):
    ledger.book(lease, "one", [window()])
    other = ledger.acquire("other operator", "process 9")
    with pytest.raises(FencedError, match="is booked by operator"):
        ledger.mark(other, "one", "released")
    with pytest.raises(FencedError, match="is booked by operator"):
        ledger.book(other, "one", [window("b")])


def test_states_follow_each_other_and_the_history_keeps_them(ledger, lease):
    ledger.book(lease, "one", [window("a"), window("b", 1, 60)], state="tentative")
    ledger.mark(lease, "one", "firm")
    ledger.mark(lease, "one", "in use", number=1)
    with pytest.raises(VersionError, match="is in use: it cannot become firm"):
        ledger.mark(lease, "one", "firm", number=1)
    ledger.mark(lease, "one", "late", number=1)
    ledger.mark(lease, "one", "released")
    with pytest.raises(VersionError, match="no such window"):
        ledger.mark(lease, "one", "released")
    first = [event.hold.state for event in ledger.history("one") if event.hold.number == 1]
    assert first == ["tentative", "firm", "in use", "late", "released"]
    events = ledger.history()
    assert ledger.history(after=events[3].seq) == events[4:]
    assert [event.at for event in events] == sorted(event.at for event in events)


def test_tentative_windows_end_with_the_lease_and_firm_ones_do_not(ledger):
    gone = ledger.acquire("gone", "process 1", 0.001)
    steady = ledger.acquire("steady", "process 2")
    ledger.book(steady, "kept", [window("b", 1)], state="tentative")
    for attempt in range(1000):  # a lease of a millisecond may end before it is used
        try:
            ledger.book(gone, "left", [window("a", 1)], state="tentative")
            ledger.book(gone, "firm", [window("a", 2)])
            break
        except FencedError:
            gone = ledger.acquire("gone", "process 1", 0.01 * (attempt + 1))
    until_it_runs_out(ledger, gone)
    ledger.book(steady, "new", [window("a", 1, 10)])
    assert [hold.state for hold in ledger.itinerary("left")] == ["released"]
    for taken in (window("a", 2), window("b", 1)):
        with pytest.raises(TakenError):
            ledger.book(steady, "newer", [taken])


def test_chance_windows_overlap_where_both_are_hardly_wanted_and_who_arrives_has_the_pad(ledger, lease):
    sure = {"start_sd_s": 300.0, "end_sd_s": 300.0, "epsilon": 0.05}
    ledger.book(lease, "one", [window("a", 1, 0, **sure)])
    with pytest.raises(TakenError):
        ledger.book(lease, "near", [window("a", 1, 33, **sure)])
    ledger.book(lease, "far", [window("a", 1, 42, **sure)])  # within the reach of the first, P(both) below 5 %
    with pytest.raises(TakenError):
        ledger.book(lease, "hard", [window("a", 1, 35, 5)])
    ledger.mark(lease, "far", "in use")
    with pytest.raises(TakenError):
        ledger.mark(lease, "one", "in use")
    ledger.mark(lease, "far", "released")
    ledger.mark(lease, "one", "in use")


@pytest.mark.parametrize(
    ("windows", "said"),
    [
        ([], "without windows"),
        ([window(length_min=0)], "is not after start"),
        ([window(pad=0)], "pad: out of range"),
        ([window(station="")], "must be the id of a station"),
        ([window(start_sd_s=10.0)], "a hard window has no standard deviations"),
        ([window(epsilon=0.9, start_sd_s=1.0)], "epsilon: out of range"),
        ([window(), window(begin_min=5)], "books the same pad twice"),
    ],
)
def test_windows_that_make_no_sense(tmp_path, windows, said):
    with opened("sqlite", tmp_path) as ledger, pytest.raises(InputError, match=said):
        ledger.book(ledger.acquire("operator", "process 1"), "one", windows)


BOOKINGS = st.lists(
    st.lists(
        st.tuples(st.sampled_from("ab"), st.integers(1, 2), st.integers(0, 12), st.integers(1, 4)), min_size=1, max_size=3
    ),
    max_size=8,
)  # fmt: skip


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(attempts=BOOKINGS)
def test_it_takes_what_fits_and_nothing_else(store, tmp_path_factory, attempts):
    held = []
    with opened(store, tmp_path_factory.mktemp("ledger")) as ledger:
        lease = ledger.acquire("operator", "process 1")
        for number, slots in enumerate(attempts):
            windows = [window(station, pad, 10 * begin, 10 * length) for station, pad, begin, length in slots]
            minutes = [{(s, p, m) for m in range(b, b + n)} for s, p, b, n in slots]
            if sum(map(len, minutes)) != len(set().union(*minutes)):
                with pytest.raises(InputError, match="twice"):
                    ledger.book(lease, str(number), windows)
            elif any(one & other for one in minutes for other in held):
                with pytest.raises(TakenError):
                    ledger.book(lease, str(number), windows)
            else:
                ledger.book(lease, str(number), windows)
                held += minutes
        assert audit(ledger) == []


def test_threads_that_want_the_same_pads_never_overlap(store, tmp_path):
    name = name_of(store, tmp_path)
    open_ledger(name).close()
    booked, errors = [], []

    def work(thread):
        with open_ledger(name) as mine:
            lease = mine.acquire(f"operator {thread}", "process")
            for attempt in range(12):
                at = (attempt * 7 + thread * 3) % 20
                windows = [window("ab"[stop], 1 + (at + stop) % 2, 10 * at + 40 * stop, 20) for stop in (0, 1)]
                try:
                    mine.book(lease, f"{thread}-{attempt}", windows)
                    booked.append(f"{thread}-{attempt}")
                except TakenError:
                    pass
                except Exception as error:  # noqa: BLE001  whatever a thread meets is a fault of the test
                    errors.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
    assert not errors
    with open_ledger(name) as ledger:
        assert audit(ledger) == []
        assert {hold.itinerary for hold in ledger.holds()} == set(booked)
        assert len(ledger.holds()) == 2 * len(booked)


@pytest.mark.parametrize("chance", [{}, {"start_sd_s": 60.0, "end_sd_s": 60.0, "epsilon": 0.01}])
def test_a_window_of_days_is_met_at_its_beginning_and_end_whatever_the_clocks_do(store, tmp_path, chance):
    name = name_of(store, tmp_path)
    if store == "postgresql":
        name += "%20-ctimezone%3DAmerica/New_York"  # 8 March has 23 hours
    days = 4 * 24 * 60
    first = (datetime(2026, 3, 7, tzinfo=UTC) - START) / timedelta(minutes=1)
    with open_ledger(name) as ledger:
        lease = ledger.acquire("operator", "process 1")
        ledger.book(lease, "days", [window(begin_min=first, length_min=days, **chance)])
        for begin_min in (first + 5, first + days / 2, first + days - 35):
            with pytest.raises(TakenError, match="days"):
                ledger.book(lease, "meets it", [window(begin_min=begin_min, **chance)])
        ledger.book(lease, "before", [window(begin_min=first - 60, **chance)])
        ledger.book(lease, "after", [window(begin_min=first + days + 30, **chance)])
        assert audit(ledger) == []
