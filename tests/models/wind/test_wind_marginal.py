"""The wind of one slot and place in bins: nothing is lost, and the mean wind is not changed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.marginal import marginal, rose
from skyway.models.wind.triangle import speed_from, vector

COMPONENTS = st.floats(-40.0, 40.0)


def ensemble(north, east, probability=None) -> WindEnsemble:
    """Make an ensemble of one site and one slot."""
    count = len(north)
    chance = np.full(count, 1.0 / count) if probability is None else np.asarray(probability)
    shape = (count, 1, 1)
    return WindEnsemble(
        np.array([40.0]),
        np.array([-74.0]),
        0.0,
        3600.0,
        np.asarray(north, dtype=float).reshape(shape),
        np.asarray(east, dtype=float).reshape(shape),
        chance,
        tuple(str(number) for number in range(count)),
        10.0,
    )


def of_winds(*winds, probability=None) -> WindEnsemble:
    speed, direction = zip(*winds, strict=True)
    return ensemble(*vector(speed, direction), probability)


@given(
    winds=arrays.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(2)), elements=COMPONENTS),
    seed=st.integers(0, 1000),
)
def test_probability_and_mean_wind_are_conserved(winds, seed):
    chance = np.random.default_rng(seed).dirichlet(np.ones(len(winds)))
    result = marginal(ensemble(winds[:, 0], winds[:, 1], chance), 0, 40.5, -74.5)
    assert result.probability.sum() == pytest.approx(1.0)
    assert np.all(result.probability > 0.0)
    assert result.probability @ result.north == pytest.approx(chance @ winds[:, 0], abs=1e-9)
    assert result.probability @ result.east == pytest.approx(chance @ winds[:, 1], abs=1e-9)
    assert len(result.probability) <= len(winds)


@given(north=COMPONENTS, east=COMPONENTS)
def test_one_member_gives_exactly_its_vector(north, east):
    result = marginal(ensemble([north], [east]), 0, 40.5, -74.5)
    assert (result.probability.tolist(), result.north.tolist(), result.east.tolist()) == (
        [1.0],
        [north],
        [east],
    )


def test_winds_either_side_of_north_share_the_northern_sector():
    assert len(marginal(of_winds((5.0, 352.0), (5.0, 8.0)), 0, 40.0, -74.0).probability) == 1
    assert len(marginal(of_winds((5.0, 352.0), (5.0, 12.0)), 0, 40.0, -74.0).probability) == 2


def test_a_bin_of_speed_holds_its_lower_edge_and_the_last_holds_every_storm():
    assert len(marginal(of_winds((4.0, 90.0), (5.9, 90.0)), 0, 40.0, -74.0).probability) == 1
    assert len(marginal(of_winds((3.9, 90.0), (4.0, 90.0)), 0, 40.0, -74.0).probability) == 2
    assert len(marginal(of_winds((21.0, 90.0), (70.0, 90.0)), 0, 40.0, -74.0).probability) == 1


def test_calm_is_in_the_first_bin_of_speed():
    result = marginal(of_winds((0.0, 90.0), (0.0, 200.0), (1.0, 0.0)), 0, 40.0, -74.0)
    assert len(result.probability) == 1
    assert result.north == pytest.approx([-1 / 3])


def test_impossible_members_take_no_part():
    result = marginal(of_winds((5.0, 90.0), (9.0, 180.0), probability=[1.0, 0.0]), 0, 40.0, -74.0)
    assert result.probability.tolist() == [1.0]


@given(
    winds=arrays.arrays(np.float64, st.tuples(st.integers(1, 50), st.just(2)), elements=COMPONENTS),
)
def test_a_rose_and_its_calm_sum_to_1(winds):
    table = rose(winds[:, 0], winds[:, 1], np.ones(len(winds)))
    assert table.probability.sum() + table.calm == pytest.approx(1.0)
    assert table.probability.shape == (16, 9)


def test_a_rose_shows_where_the_wind_comes_from_by_the_weights_of_the_winds():
    north, east = vector([5.0, 5.0, 13.0, 0.0], [270.0, 272.0, 90.0, 0.0])
    table = rose(north, east, np.array([1.0, 2.0, 3.0, 2.0]))
    assert table.probability[12, 2] == pytest.approx(3 / 8)
    assert table.probability[4, 6] == pytest.approx(3 / 8)
    assert table.calm == pytest.approx(2 / 8)


@given(speed=st.floats(0.01, 40.0), direction=st.floats(0.0, 360.0))
def test_the_vector_of_a_bin_lies_in_its_sector_and_speed(speed, direction):
    result = marginal(of_winds((speed, direction)), 0, 40.0, -74.0)
    back, from_deg = speed_from(result.north, result.east)
    assert back == pytest.approx(speed)
    assert math.cos(math.radians(float(from_deg[0]) - direction)) == pytest.approx(1.0)
