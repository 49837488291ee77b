"""Charging: constant current, then constant voltage; concave, invertible, and never more than the pad delivers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from skyway.models.base.errors import InputError
from skyway.models.drones.charging import CC_END_SOC, CUT_OFF_RATIO, ChargingCurve
from skyway.models.drones.drone import M200_V2

FULL_S = 2.24 * 3600.0
CURVE = M200_V2.charging_curve()
SOC = st.floats(0.0, 1.0)
PADS = st.sampled_from([None, 10.0, 60.0, 120.0, 150.0, 200.0, 5000.0]) | st.floats(1.0, 400.0)


def test_an_empty_m200_is_full_after_two_hours_and_a_quarter():
    assert CURVE.total_s == pytest.approx(FULL_S, rel=1e-12)
    assert float(CURVE.soc(FULL_S)) == pytest.approx(1.0, abs=1e-12)


def test_80_percent_come_after_an_hour_and_a_quarter():
    assert float(CURVE.time_from_empty_s(0.8)) / 3600.0 == pytest.approx(1.28, abs=0.005)
    assert float(CURVE.soc(1.2808 * 3600.0)) == pytest.approx(0.8, abs=1e-4)


def test_the_share_of_time_until_80_percent_is_that_of_the_plain_law_cut_off_at_5_percent():
    # r t = 0.8, then ds/dt = r (1 - s) / 0.2 until the rate is 5 % of r: 0.2 ln 20 more
    share = CC_END_SOC / (CC_END_SOC + 0.2 * math.log(1.0 / CUT_OFF_RATIO))
    assert float(CURVE.time_from_empty_s(0.8)) / FULL_S == pytest.approx(share, rel=1e-12)


def test_the_last_fifth_takes_longer_than_the_first_two():
    assert float(CURVE.duration_s(0.8, 1.0)) > float(CURVE.duration_s(0.0, 0.4))


def test_the_rate_does_not_jump_where_the_voltage_becomes_constant():
    before, knee, after = (float(CURVE.soc(CURVE.knee_s + dt)) for dt in (-1.0, 0.0, 1.0))
    assert after - knee == pytest.approx(knee - before, rel=1e-3)


@given(PADS)
def test_charge_over_time_rises_ever_more_slowly(power):
    curve = M200_V2.charging_curve(power)
    soc = curve.soc(np.linspace(0.0, 1.2 * curve.total_s, 2001))
    step = np.diff(soc)
    assert soc[0] == 0.0
    assert soc[-1] == 1.0
    assert (step >= 0.0).all()
    assert (np.diff(step) <= 1e-12).all()


@given(PADS, SOC)
def test_the_time_to_a_charge_is_the_time_that_gives_it(power, soc):
    curve = M200_V2.charging_curve(power)
    assert float(curve.soc(curve.time_from_empty_s(soc))) == pytest.approx(soc, abs=1e-9)


@given(PADS, SOC, SOC, SOC)
def test_charging_in_two_stays_takes_as_long_as_in_one(power, a, b, c):
    low, middle, high = sorted((a, b, c))
    curve = M200_V2.charging_curve(power)
    parts = float(curve.duration_s(low, middle)) + float(curve.duration_s(middle, high))
    assert parts == pytest.approx(float(curve.duration_s(low, high)), abs=1e-6)
    assert float(curve.duration_s(low, high)) >= 0.0


@given(PADS)
def test_no_pad_charges_faster_than_its_power_nor_than_the_battery_takes(power):
    curve = M200_V2.charging_curve(power)
    time = np.linspace(0.0, curve.total_s, 2001)
    rate = np.diff(curve.soc(time)) / np.diff(time)
    assert rate.max() <= CURVE.battery_rate_per_s * (1.0 + 1e-9)
    if power is not None:
        assert rate.max() * M200_V2.battery_j <= power * (1.0 + 1e-9)
    assert (curve.soc(time) <= CURVE.soc(time) + 1e-12).all()


@pytest.mark.parametrize("power", [50.0, 120.0, 180.0])
def test_a_weak_pad_charges_with_its_power_until_the_battery_takes_less(power):
    pad = power / M200_V2.battery_j
    r = CURVE.battery_rate_per_s
    tail = brentq(lambda q: q * -math.expm1(-0.2 * math.log(20.0) / q) - 0.2, 0.2, 0.3)
    asymptote = CC_END_SOC + tail  # the plain law stretched so that 100 % is reached when it would be cut off

    def law(_, soc):
        taper = (asymptote - soc[0]) / (asymptote - CC_END_SOC)
        return [min(pad, r * min(1.0, taper))]

    curve = M200_V2.charging_curve(power)
    time = np.linspace(0.0, curve.total_s, 50)
    truth = solve_ivp(law, (0.0, curve.total_s), [0.0], t_eval=time, rtol=1e-9, atol=1e-12, max_step=30.0).y[0]
    assert curve.soc(time) == pytest.approx(truth, abs=1e-6)


def test_a_very_weak_pad_charges_evenly_to_the_end():
    curve = M200_V2.charging_curve(5.0)
    assert curve.knee_soc == 1.0
    assert curve.total_s == pytest.approx(M200_V2.battery_j / 5.0)
    assert curve.piecewise()[0].tolist() == [0.0, curve.total_s]


def test_a_strong_pad_is_no_faster_than_the_battery():
    assert M200_V2.charging_curve(10_000.0).total_s == CURVE.total_s


@given(PADS, st.integers(1, 60))
def test_straight_pieces_promise_no_charge_that_is_not_there(power, pieces):
    curve = M200_V2.charging_curve(power)
    time, soc = curve.piecewise(pieces)
    assert (time[0], soc[0]) == (0.0, 0.0)
    assert (time[-1], soc[-1]) == (curve.total_s, 1.0)
    assert (np.diff(time) > 0.0).all()
    assert (np.diff(soc) > 0.0).all()
    grid = np.linspace(0.0, curve.total_s, 1001)
    assert (np.interp(grid, time, soc) <= curve.soc(grid) + 1e-12).all()


def piecewise_error(curve, pieces=24):
    """Largest amount by which the pieces lie below the curve, as SoC."""
    time, soc = curve.piecewise(pieces)
    grid = np.linspace(0.0, curve.total_s, 20001)
    return float(np.max(curve.soc(grid) - np.interp(grid, time, soc)))


def test_24_pieces_are_good_to_the_stated_error():
    assert 0.0 < piecewise_error(CURVE) <= 0.00011
    assert piecewise_error(CURVE, 12) == pytest.approx(4.0 * piecewise_error(CURVE), rel=0.1)


@given(PADS)
def test_no_pad_makes_the_pieces_worse_than_stated(power):
    assert piecewise_error(M200_V2.charging_curve(power)) <= 0.00011


def test_charges_out_of_range_are_clipped():
    assert float(CURVE.soc(-5.0)) == 0.0
    assert float(CURVE.soc(1e9)) == 1.0
    assert float(CURVE.time_from_empty_s(1.5)) == CURVE.total_s
    assert float(CURVE.time_from_empty_s(-0.5)) == 0.0


@pytest.mark.parametrize(
    ("full", "rate"), [(0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (math.inf, 1.0), (8064.0, 0.0), (8064.0, math.nan)]
)
def test_a_charger_that_cannot_be_is_refused(full, rate):
    with pytest.raises(InputError, match="must be above 0"):
        ChargingCurve(full, rate)
