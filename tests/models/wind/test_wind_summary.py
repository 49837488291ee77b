"""The wind in a few figures: speeds that are met, a direction where there is one, the same for every reader."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.summary import PREVAILS, Passage, summarise_wind, summary_of
from skyway.models.wind.triangle import vector

WINDS = st.lists(
    st.tuples(st.floats(0.5, 30.0), st.integers(0, 35999).map(lambda x: x / 100), st.floats(0.01, 1.0)),
    min_size=1,
    max_size=30,
)


def ensemble(speed, direction, *, sites=1, slot_s=3600.0) -> WindEnsemble:
    """Members by slots by sites of winds, all equally likely, from time 0, at 10 m."""
    speed, direction = np.asarray(speed, float), np.asarray(direction, float)
    north, east = vector(speed, direction)
    count = speed.shape[0]
    labels = tuple(str(number) for number in range(count))
    lat, lon = 40.0 + np.arange(sites), np.full(sites, -74.0)
    return WindEnsemble(lat, lon, 0.0, slot_s, north, east, np.full(count, 1.0 / count), labels, 10.0)


def of(*winds):
    speed, direction = zip(*winds, strict=True)
    return summary_of(*vector(speed, direction), np.full(len(winds), 1.0 / len(winds)))


def test_winds_from_all_sides_keep_their_speed_and_have_no_direction():
    found = of((8.0, 0.0), (8.0, 90.0), (8.0, 180.0), (8.0, 270.0))
    assert found.mean_mps == pytest.approx(8.0)
    assert math.hypot(found.north_mps, found.east_mps) == pytest.approx(0.0, abs=1e-9)
    assert found.from_deg is None
    assert str(found) == "8 (8 to 8) m/s, variable direction"


def test_winds_about_north_come_from_north():
    found = of((6.0, 350.0), (8.0, 10.0), (7.0, 0.0), (7.0, 180.0))
    assert found.from_deg % 360.0 == pytest.approx(0.0, abs=1e-6) or found.from_deg == pytest.approx(360.0)
    assert found.sector_share == pytest.approx(0.75)
    assert str(found) == "7 (6 to 8) m/s from 000°"


def test_two_opposite_winds_are_no_direction_and_not_the_one_between_them():
    assert of((9.0, 0.0), (9.0, 180.0)).from_deg is None
    assert of((9.0, 0.0), (9.0, 180.0), (5.0, 170.0)).from_deg == pytest.approx(175.0)


def test_one_wind_is_told_as_it_is():
    assert str(of((8.04, 273.2))) == "8.0 m/s from 273°"
    assert str(of((8.0, 359.7))) == "8.0 m/s from 000°"
    assert str(of((0.0, 0.0))) == "calm"


@given(WINDS, st.floats(0.0, 360.0))
@example([(5.0, 0.0, 1.0)], 360.0)
def test_a_turned_wind_is_the_same_wind_from_elsewhere(winds, turn):
    speed, direction, weight = (np.array(part) for part in zip(*winds, strict=True))
    here, there = (summary_of(*vector(speed, direction + by), weight) for by in (0.0, turn))
    assert there.mean_mps == pytest.approx(here.mean_mps)
    assert there.sector_share == pytest.approx(here.sector_share)
    assert (there.p10_mps, there.p90_mps) == pytest.approx((here.p10_mps, here.p90_mps))
    tail, cross = here.components(30.0)
    assert there.components(30.0 + turn) == pytest.approx((tail, cross), abs=1e-6)


@given(WINDS)
def test_the_prevailing_sector_holds_as_much_as_any(winds):
    """Against every sector that begins at a whole hundredth of a degree."""
    speed, direction, weight = (np.array(part) for part in zip(*winds, strict=True))
    found = summary_of(*vector(speed, direction), weight)
    starts = np.arange(0, 360, 0.25)
    inside = (direction[None] - starts[:, None]) % 360.0 <= 90.0 - 1e-9
    best = (inside * weight).sum(axis=1).max() / weight.sum()
    assert found.sector_share >= best - 1e-9
    assert found.p10_mps <= found.p90_mps
    assert speed.min() - 1e-9 <= found.mean_mps <= speed.max() + 1e-9
    if found.from_deg is not None:
        assert found.sector_share > PREVAILS
        off = np.abs((direction - found.from_deg + 180.0) % 360.0 - 180.0)
        assert weight[off <= 90.0 + 1e-6].sum() / weight.sum() >= found.sector_share - 1e-9


def test_winds_count_by_the_time_that_they_are_flown_in():
    wind = ensemble([[[4.0], [10.0]]], [[[90.0], [90.0]]])
    whole = summarise_wind(wind, [Passage(40.0, -74.0, 2700.0, 5400.0)], 10.0, 0.2)
    assert whole.mean_mps == pytest.approx((900 * 4.0 + 1800 * 10.0) / 2700)
    assert (whole.p10_mps, whole.p90_mps) == (4.0, 10.0)
    assert summarise_wind(wind, [Passage(40.0, -74.0, 100.0, 100.0)], 10.0, 0.2).mean_mps == pytest.approx(4.0)
    assert summarise_wind(wind, [Passage(40.0, -74.0, 1e6, 1e6 + 60)], 10.0, 0.2).mean_mps == pytest.approx(10.0)
    assert summarise_wind(wind, [Passage(40.0, -74.0, -500.0, -50)], 10.0, 0.2).mean_mps == pytest.approx(4.0)


def test_winds_count_where_and_how_high_they_are_flown():
    wind = ensemble([[[4.0, 10.0]]], [[[90.0, 90.0]]], sites=2)
    here, there = (summarise_wind(wind, [Passage(lat, -74.0, 0, 60)], 10.0, 0.2) for lat in (40.0, 41.0))
    assert (here.mean_mps, there.mean_mps) == pytest.approx((4.0, 10.0))
    both = summarise_wind(wind, [Passage(40.0, -74.0, 0, 60), Passage(41.0, -74.0, 60, 240)], 10.0, 0.2)
    assert both.mean_mps == pytest.approx((4.0 + 3 * 10.0) / 4)
    high = summarise_wind(wind, [Passage(40.0, -74.0, 0, 60)], 60.0, 0.2)
    assert high.mean_mps == pytest.approx(4.0 * 6**0.2)
