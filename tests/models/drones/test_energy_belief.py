"""What is believed of the energy of flights: its quantiles, what flights teach, and that the data say so."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import stdtr, stdtrit

from skyway.models.base.errors import InputError
from skyway.models.drones.energy_belief import (
    AIRSPEED_LEG_SD,
    AIRSPEED_SD,
    DEGREES_OF_FREEDOM,
    EXACT,
    FLIGHT_SD,
    LEG_SD,
    PART_SD,
    PUBLISHED_LEG_SD,
    PUBLISHED_SD,
    EnergyBelief,
)


@given(st.floats(1e-4, 1.0 - 1e-4), st.floats(0.0, 0.2), st.floats(0.001, 0.1), st.floats(8.0, 100.0))
def test_quantiles_and_probabilities_are_those_of_students_distribution(share, between, within, freedom):
    belief = EnergyBelief(1.02, between, within, freedom)
    ratio = belief.quantile(share)
    sigmas = float(stdtrit(freedom, share))
    assert ratio == pytest.approx(
        1.02 + sigmas * math.hypot(between, within), abs=0.015 * belief.leg_sd * max(abs(sigmas), 1.0)
    )
    assert float(belief.p_at_most(ratio)) == pytest.approx(share, abs=1e-9)
    assert float(belief.p_at_most(ratio)) == pytest.approx(
        float(stdtr(freedom, (ratio - 1.02) / belief.leg_sd)), abs=1e-3
    )


@given(st.lists(st.floats(0.7, 1.4), min_size=1, max_size=8))
def test_flights_teach_the_part_that_persists_as_one_batch_of_them_would(ratios):
    belief = EnergyBelief()
    learnt = belief
    for ratio in ratios:
        learnt = learnt.learnt(ratio, 1.0, 0.0)
    variance = 1.0 / (1.0 / belief.sd_between**2 + len(ratios) / belief.sd_within**2)
    mean = variance * (belief.mean_ratio / belief.sd_between**2 + sum(ratios) / belief.sd_within**2)
    assert learnt.mean_ratio == pytest.approx(mean)
    assert learnt.sd_between == pytest.approx(math.sqrt(variance))
    assert learnt.sd_within == belief.sd_within  # what is fresh on each leg is not learnt


def test_what_is_not_measured_teaches_nothing_and_a_coarse_charge_teaches_little():
    belief = EnergyBelief()
    assert belief.learnt(0.1, 0.0) == belief
    assert belief.learnt(math.nan, 0.3) == belief
    assert EXACT.learnt(0.4, 0.3, 0.0) == EXACT
    short, long = belief.learnt(0.024, 0.02), belief.learnt(0.6, 0.5)
    assert belief.mean_ratio < short.mean_ratio < long.mean_ratio < 1.2


def test_the_flight_under_way_tells_more_of_its_rest_than_of_the_next_one():
    belief = EnergyBelief.calibrated([0.01] * 5)
    rest, after = belief.in_flight(0.36, 0.30), belief.learnt(0.36, 0.30)
    assert rest.mean_ratio > after.mean_ratio > belief.mean_ratio


def test_its_own_flights_make_a_drone_surer_and_bad_ones_less():
    assert EnergyBelief.calibrated([0.01] * 5).leg_sd < 0.4 * EnergyBelief().leg_sd
    assert EnergyBelief.calibrated([math.nan]).sd_between > EnergyBelief.calibrated([0.01] * 5).sd_between
    assert EnergyBelief.calibrated([0.1, -0.1, 0.08]).sd_between > 2.0 * FLIGHT_SD
    counting = EnergyBelief().counting_airspeed()
    assert (counting.sd_between, counting.sd_within) == (AIRSPEED_SD, AIRSPEED_LEG_SD)
    assert EnergyBelief.calibrated([0.01] * 5).counting_airspeed() == EnergyBelief.calibrated([0.01] * 5)


def test_drawn_ratios_share_what_persists_and_more_begin_with_the_same_ones():
    belief = EnergyBelief(1.0, 0.05, 0.02)
    drawn = belief.sampled(np.random.default_rng(1), 4000, 3)
    assert np.array_equal(belief.sampled(np.random.default_rng(1), 10, 3), drawn[:10])
    spread = math.sqrt(DEGREES_OF_FREEDOM / (DEGREES_OF_FREEDOM - 2.0))
    assert np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1] == pytest.approx(0.05**2 / (0.05**2 + 0.02**2), abs=0.03)
    assert drawn.std() == pytest.approx(spread * belief.leg_sd, rel=0.05)
    assert (EXACT.sampled(np.random.default_rng(1), 5, 2) == 1.0).all()


@pytest.mark.parametrize("wrong", [{"mean_ratio": 0.0}, {"sd_between": math.nan}, {"degrees_of_freedom": 2.0}])
def test_beliefs_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        EnergyBelief(**wrong)


def test_the_defaults_are_what_the_flights_say(shared_data):
    from benchmarks.tables.energy_error import fit, flights

    folder = shared_data / "power"
    if not folder.exists():
        pytest.skip("the flights are not here")
    found = fit(flights(folder))
    told = {
        "flight_sd": FLIGHT_SD,
        "leg_sd": LEG_SD,
        "part_sd": PART_SD,
        "published_sd": PUBLISHED_SD,
        "published_leg_sd": PUBLISHED_LEG_SD,
        "airspeed_leg_sd": AIRSPEED_LEG_SD,
        "airspeed_sd": AIRSPEED_SD,
    }
    for name, value in told.items():
        assert value == pytest.approx(getattr(found, name), abs=0.003), name
    assert found.legs - found.flights == DEGREES_OF_FREEDOM
    assert found.kurtosis < 3.0
