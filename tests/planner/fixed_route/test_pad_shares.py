"""Pads divided among drones: whatever a drone does within its windows, it is never on a pad of another one."""

import itertools
import math

from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.planner.fixed_route.pad_shares import shares_of
from skyway.planner.fixed_route.sharing import APART_S, Stay

GAP_S = st.floats(APART_S, 500.0)


@st.composite
def bookings(draw):
    """Stays of up to four drones on up to three stations, those on one pad `APART_S` apart."""
    drones = draw(st.integers(1, 4))
    counts = draw(st.lists(st.integers(0, 2), min_size=1, max_size=3))
    stays = [[] for _ in range(drones)]
    for pad, count in enumerate(counts):
        for number in range(count):
            clock = draw(st.floats(0.0, 100.0))
            for _ in range(draw(st.integers(0, 4))):
                until = clock + draw(st.floats(1.0, 900.0))
                stays[draw(st.integers(0, drones - 1))].append(Stay(pad, number, clock, until))
                clock = until + draw(GAP_S)
    return counts, stays


@settings(max_examples=60)
@given(bookings())
def test_no_two_drones_ever_have_one_pad_and_each_has_its_stays(case):
    counts, stays = case
    shares = shares_of(counts, stays)
    pads = {(pad, number): [] for pad, count in enumerate(counts) for number in range(count)}
    for drone, own in enumerate(shares):
        for pad, windows in enumerate(own):
            for (first, last), number in windows:
                pads[pad, number].append((first, last, drone))
        for stay in stays[drone]:
            assert any(
                number == stay.number and first <= stay.from_s + 1e-6 and stay.until_s <= last + 1e-6
                for (first, last), number in own[stay.pad]
            )
    for windows in pads.values():
        windows.sort()
        assert windows[0][0] == -math.inf
        assert windows[-1][1] == math.inf
        for before, after in itertools.pairwise(windows):
            assert after[0] - before[1] >= APART_S - 1e-6
            assert before[2] != after[2]
