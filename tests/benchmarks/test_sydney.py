"""The rebuilt Sydney set: its queues by a case that is worked out by hand, and our plans against the study's rule."""

import numpy as np
import pytest

from benchmarks.fleet.bench_sydney import planned, searched
from benchmarks.fleet.sydney import (
    BATTERY_WH,
    FINALS,
    HOVER_W,
    MOST_HOVERED,
    SOURCES,
    TAU_S,
    City,
    Flown,
    Request,
    alone,
    charging_s,
    city,
    queued,
    requests,
)
from benchmarks.fleet.sydney_bound import most_quality


def first_come(waits, _):
    return -waits


def two_roofs():
    """One roof and one block of flats with one pad and one waiting pad, 600 s and half a battery apart."""
    count = SOURCES + 1
    time_s, need = np.full((count, count), np.inf), np.full((count, count), np.inf)
    time_s[0, SOURCES], need[0, SOURCES] = 600.0, 0.5
    before = np.full((count, count), -9999)
    before[0, SOURCES] = 0
    return City(time_s, need, before, np.ones(count, dtype=np.int64))


def test_who_comes_second_waits_and_who_comes_later_hovers():
    town = two_roofs()
    asked = [Request(0, SOURCES, 0.0, 0.6) for _ in range(4)]
    flown, congested_min = queued(town, asked, first_come)
    charge_s = charging_s(0.5, FINALS[0.6])
    assert charge_s == pytest.approx(TAU_S * np.log(0.5 / 0.23))
    assert alone(town, asked[0]) == pytest.approx((600.0 + charge_s, 0.5))
    once = (
        HOVER_W * charge_s / 3600.0 / BATTERY_WH
    )  # until the waiting pad is free; the fourth one hovers while the third one charges, too
    longer_s = charging_s(0.5 - once, FINALS[0.6])
    assert [one.extra for one in flown] == pytest.approx([0.0, 0.0, once, min(2.0 * once, MOST_HOVERED)])
    assert [one.late_s for one in flown[:3]] == pytest.approx([0.0, charge_s, charge_s + longer_s])
    assert [one.served for one in flown] == [True, True, False, False]
    assert flown[0].quality == 1.0
    assert congested_min * 60.0 * len(town.pads) == pytest.approx(2.0 * charge_s + longer_s)


def test_quality_is_half_time_and_half_charge():
    assert Flown(1000.0, 0.4, 500.0, 0.0, 0.0).quality == pytest.approx(0.75)
    assert Flown(1000.0, 0.4, 0.0, 0.2, 0.0).quality == pytest.approx(0.75)
    assert Flown(1000.0, 0.4, 9000.0, 0.0, 0.0).quality == 0.0


def test_plans_beat_the_rule_of_the_study_and_leave_nobody_unserved():
    town, asked = city(3), requests(3, 12)
    rule, _ = queued(town, asked, lambda waits, charges: waits**1.2 + charges)
    ours, _ = planned(town, asked, searched(town, asked, 60.0, iterations=10))
    assert np.mean([one.quality for one in ours]) > np.mean([one.quality for one in rule])
    assert np.mean([not one.served for one in ours]) <= 0.02
    quality = float(np.mean([one.quality for one in ours]))
    assert quality <= most_quality(town, asked, quality, iterations=30) <= 1.0


def test_the_bound_of_one_pad_is_who_has_it_first():
    """Two drones want the only pad for the same time: one waits that long, and no prices say that less is lost."""
    town = two_roofs()
    asked = [Request(0, SOURCES, 0.0, 0.6) for _ in range(2)]
    expected_s, _ = alone(town, asked[0])
    lost = 0.5 * charging_s(0.5, FINALS[0.6]) / expected_s / 2
    assert most_quality(town, asked, 1.0 - lost, iterations=400) == pytest.approx(1.0 - lost, abs=0.1 * lost)
    assert most_quality(town, asked, 1.0 - lost, iterations=400) >= 1.0 - lost - 1e-9
