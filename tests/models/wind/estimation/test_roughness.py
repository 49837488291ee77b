"""What a drone felt on its way tells how rough the air is."""

import numpy as np
import pytest

from skyway.models.base.geodesy import direct
from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.estimation.roughness import roughness
from skyway.models.wind.field_error import FieldError
from skyway.models.wind.gusts import GUST_TIME_S

FIELD = FieldError(1.0)
STEP_S, SPEED_MPS, VARIANCE = 150.0, 15.0, 1.2
FINE = 8
"""Places in a slot at which the wind is drawn."""


def observations(generator, slots, scale, *, begin_s=0.0):
    """Winds of 8 m/s along a straight flight, means over slots, with gusts and the error between the sites; the variance of both is scaled."""
    places = [direct(40.7, -74.0, 30.0, SPEED_MPS * STEP_S * k) for k in range(slots)]
    apart_m = SPEED_MPS * STEP_S * np.abs(np.subtract.outer(np.arange(slots), np.arange(slots)))
    fine = SPEED_MPS * STEP_S * (np.arange(FINE * slots) + 0.5) / FINE
    between = (FIELD.gamma(1e7) - FIELD.gamma(np.abs(np.subtract.outer(fine, fine)))) * FIELD.in_wind(8.0)
    error = between.reshape(slots, FINE, slots, FINE).mean(axis=(1, 3))
    gusts = VARIANCE * np.exp(-apart_m / SPEED_MPS / GUST_TIME_S - apart_m / 5000.0)
    root = np.linalg.cholesky(scale * (error + gusts) + 1e-12 * np.eye(slots))
    drawn = root @ generator.standard_normal((slots, 2))
    drawn -= drawn.mean(axis=0)
    return [
        WindObservation(begin_s + STEP_S * k, *places[k], 8.0 + float(drawn[k, 0]), float(drawn[k, 1]), VARIANCE)
        for k in range(slots)
    ]


def test_nothing_measured_is_what_is_usual():
    assert roughness([], FIELD) == 1.0
    assert roughness(observations(np.random.default_rng(0), 1, 1.0), FIELD) == 1.0


@pytest.mark.parametrize("scale", [0.2, 1.0, 3.0])
def test_many_slots_tell_how_rough_the_air_is(scale):
    generator = np.random.default_rng(3)
    found = np.mean([roughness(observations(generator, 60, scale), FIELD) for _ in range(12)])
    assert found == pytest.approx((6.0 + 118.0 * scale) / 124.0, rel=0.15)


def test_calm_air_is_believed_slowly_and_flights_hours_apart_say_nothing_of_each_other():
    generator = np.random.default_rng(4)
    smooth = observations(generator, 4, 1e-6)
    assert roughness(smooth, FIELD) == pytest.approx(6.0 / 12.0, rel=0.01)
    apart = [*smooth[:1], *observations(generator, 1, 1.0, begin_s=9000.0)]
    assert roughness(apart, FIELD) == 1.0
