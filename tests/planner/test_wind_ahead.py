"""How well the wind ahead is known from that here, and what a stronger one costs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.wind.field_error import FieldError
from skyway.planner.reach.wind_ahead import WindAhead, drifted_s, slower_s

AHEAD = WindAhead(FieldError(1.0), 0.15, 180.0)


def sd(away_m, speed_mps, flight_s=600.0):
    return float(AHEAD.sd_mps(np.zeros(1), np.array([away_m]), np.array([[speed_mps]]), np.array([flight_s]))[0, 0])


@given(away_m=st.floats(10.0, 30_000.0), speed=st.floats(0.0, 20.0), more=st.floats(1.01, 3.0))
@settings(max_examples=60)
def test_the_wind_is_known_the_less_the_further_away_the_stronger_and_the_shorter_the_flight(away_m, speed, more):
    assert sd(away_m * more, speed) > sd(away_m, speed)
    assert sd(away_m, speed * more + 0.01) > sd(away_m, speed)
    assert sd(away_m, speed + 0.1, 600.0 * more) < sd(away_m, speed + 0.1, 600.0)


def test_gusts_of_a_flight_are_those_of_a_sampled_process():
    """Judge: the mean of an autoregressive process, drawn."""
    generator, step_s, flight_s = np.random.default_rng(2), 5.0, 400.0
    fade, gust = np.exp(-step_s / 180.0), generator.standard_normal(4000)
    total = np.zeros(4000)
    for _ in range(int(flight_s / step_s)):
        gust = fade * gust + np.sqrt(1.0 - fade**2) * generator.standard_normal(4000)
        total += gust
    drawn = 0.15 * 10.0 * float((total / (flight_s / step_s)).std())
    calm = np.sqrt(sd(1e-6, 10.0, flight_s) ** 2 - 0.5**2)
    assert calm == pytest.approx(drawn, rel=0.04)


@given(along=st.floats(-12.0, 12.0), across=st.floats(-8.0, 8.0), length_m=st.floats(500.0, 20_000.0))
@settings(max_examples=60)
def test_a_wind_more_against_a_flight_never_makes_it_faster(along, across, length_m):
    def cost(sd_mps):
        wind = np.array([[along]]), np.array([[across]])
        return float(slower_s(np.array([length_m]), wind, 15.0, 17.0, np.array([[sd_mps]]))[0, 0])

    assert 0.0 == cost(0.0) <= cost(0.5) <= cost(1.5)


def test_two_standard_deviations_cost_what_the_flight_then_takes_longer():
    wind = np.array([[-6.0]]), np.array([[3.0]])
    forward = -6.0 + np.sqrt(15.0**2 - 3.0**2)
    found = slower_s(np.array([6000.0]), wind, 15.0, 17.0, np.array([[1.2]]))
    assert 2.0 * float(found[0, 0]) == pytest.approx(6000.0 / (forward - 2.4) - 6000.0 / forward)
    aside = -6.0 + np.sqrt(15.0**2 - 5.4**2)
    found = drifted_s(np.array([6000.0]), wind, 15.0, 17.0, np.array([[1.2]]))
    assert 2.0 * float(found[0, 0]) == pytest.approx(6000.0 / aside - 6000.0 / forward)


def test_an_error_of_the_wind_across_counts_as_it_does_in_drawn_winds():
    """Judge: flights in drawn winds. Near the airspeed the wind across makes the most of the spread, which that along alone misses."""
    generator, sd_mps = np.random.default_rng(3), 0.8
    drawn = 3000.0 / (
        2.0 + generator.normal(0.0, sd_mps, 20_000) + np.sqrt(20.0**2 - generator.normal(14.5, sd_mps, 20_000) ** 2)
    )
    wind = np.array([[2.0]]), np.array([[14.5]])
    given = np.array([3000.0]), wind, 20.0, 20.0, np.array([[sd_mps]])
    along, across = (float(one(*given)[0, 0]) for one in (slower_s, drifted_s))
    assert across > along
    assert np.hypot(along, across) == pytest.approx(drawn.std(), rel=0.2)
