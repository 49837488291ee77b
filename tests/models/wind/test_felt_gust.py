"""What of a gust that was felt a flight still meets."""

import math

import numpy as np
import pytest

from skyway.models.base.geodesy import direct
from skyway.models.wind.felt_gust import FeltGust
from skyway.models.wind.gusts import GUST_LENGTH_M, GUST_TIME_S

NOW_S, HERE = 1_700_000_000.0, (40.6, -73.8)
GUST = FeltGust(NOW_S, *HERE, 3.0, -4.0)


def share(length_m, flight_s, begin_s=NOW_S, start=HERE):
    lat, lon = (np.array([one]) for one in start)
    return float(GUST.share_of((lat, lon), np.array([length_m]), np.array([begin_s]), np.array([flight_s]))[0])


@pytest.mark.parametrize(
    ("length_m", "flight_s", "later_s", "away_m"), [(3200.0, 320.0, 0.0, 0.0), (900.0, 60.0, 45.0, 700.0)]
)
def test_the_share_is_the_mean_of_the_correlation_along_the_flight(length_m, flight_s, later_s, away_m):
    """Judge: the correlation of the observations' gusts, summed along the way in small steps."""
    gone = (np.arange(10_000) + 0.5) / 10_000
    kept = np.exp(-(later_s + gone * flight_s) / GUST_TIME_S - (away_m + gone * length_m) / GUST_LENGTH_M)
    start = direct(*HERE, 30.0, away_m)
    assert share(length_m, flight_s, NOW_S + later_s, start) == pytest.approx(kept.mean(), rel=1e-3)


def test_all_of_it_is_met_at_once_and_nothing_after_an_hour():
    assert share(0.0, 0.0) == pytest.approx(1.0)
    assert share(1000.0, 60.0, NOW_S + 3600.0) < 1e-8


def test_at_another_height_it_is_stronger_as_the_wind_is():
    assert math.hypot(GUST.times(1.2).north_mps, GUST.times(1.2).east_mps) == pytest.approx(6.0)
