"""Charge that is lost without being counted shows in the voltage; gusts, climbs and a flat battery do not look like it."""

import math
import random

import pytest

from skyway.link.supervisor.soc.voltage import VoltageWatch, open_voltage, soc_of

CELLS, OHM = 6, 0.025


def flight(watch, seconds, *, soc=1.0, rate=0.0008, drop=0.0, at=120.0, told_falls=False, noise=0.02, ohm=OHM, seed=1):
    """Rest, then fly; returns what was found lost, in the end the true charge, and the charge told."""
    luck = random.Random(seed)
    found, told = 0.0, soc
    for second in range(-30, seconds):
        flies = second >= 0
        if flies:
            soc, told = soc - rate, told - rate
        if second == at:
            soc -= drop
            told -= drop if told_falls else 0.0
        amperes = luck.uniform(24.0, 40.0) if flies else 0.6
        volts = CELLS * open_voltage(max(soc, 0.0)) - amperes * ohm + luck.gauss(0.0, noise)
        found += watch.hear(1000.0 + second, volts, amperes, told)
    return found, soc, told


def test_the_curve_of_a_cell_goes_both_ways():
    for percent in range(0, 101, 5):
        assert soc_of(open_voltage(percent / 100.0)) == pytest.approx(percent / 100.0, abs=1e-9)
    assert soc_of(2.0) == 0.0
    assert soc_of(5.0) == 1.0


@pytest.mark.parametrize("seed", range(5))
def test_a_whole_flight_with_gusts_loses_nothing(seed):
    watch = VoltageWatch()
    found, soc, _ = flight(watch, 1200, seed=seed)
    assert soc < 0.05
    assert found == 0.0
    assert watch.ohm == pytest.approx(OHM, rel=0.2)


@pytest.mark.parametrize("drop", [0.35, 0.45, 0.55])
@pytest.mark.parametrize("soc", [1.0, 0.8])
def test_a_pack_that_fails_is_found_in_seconds_and_about_as_large_as_it_is(drop, soc):
    watch = VoltageWatch()
    found, left, told = flight(watch, 135, soc=soc, drop=drop)
    assert found == pytest.approx(drop, abs=0.15)
    assert watch.lost == found
    assert told - watch.lost == pytest.approx(left, abs=0.15)


def test_what_the_vehicle_noticed_itself_is_not_counted_twice():
    watch = VoltageWatch()
    found, left, told = flight(watch, 200, drop=0.4, told_falls=True)
    assert told == pytest.approx(left)
    assert found == 0.0


def test_after_a_charge_it_begins_anew():
    watch = VoltageWatch()
    assert flight(watch, 200, drop=0.4)[0] > 0.2
    watch.forget()
    assert watch.lost == 0.0
    assert flight(watch, 400)[0] == 0.0


def test_what_is_not_told_is_not_judged():
    watch = VoltageWatch()
    for second in range(200):
        assert watch.hear(float(second), math.nan, 30.0, 0.8) == 0.0
        assert watch.hear(second + 0.2, 22.0, math.nan, 0.8) == 0.0
