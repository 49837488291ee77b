"""What flights take is learnt from what the vehicle tells, and again from what a pad measures."""

import math
from dataclasses import asdict
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.link.supervisor.soc.energy_learning import EnergyLearning
from skyway.link.supervisor.soc.soc_estimator import SocEstimator
from skyway.models.drones.energy_belief import EnergyBelief

PRIOR = EnergyBelief()


class Delivery:
    """Flights of one vehicle whose battery really holds a share of its nameplate, between pads that measure."""

    def __init__(self, share):
        self.share = share
        self.energy, self.battery, self.said = EnergyLearning(PRIOR), SocEstimator(), []
        self.ctx = SimpleNamespace(
            energy=self.energy, battery=self.battery, note=lambda entry, why: self.said.append(why)
        )

    def charge(self, soc):
        """On a pad."""
        self.battery.compare(self.ctx, self.true_soc if self.said else math.nan)
        self.battery.measured(soc)
        self.true_soc = self.battery.reported_soc = soc

    def fly(self, modelled, ratio=1.0, *, charged=True, seen=True):
        """A flight that takes `ratio` of what the model says, of a nameplate battery; its beginning is `seen`."""
        if seen:
            self.battery.begin_flight(charged=charged)
        begun = self.battery.soc
        self.true_soc -= ratio * modelled / self.share
        self.battery.reported_soc -= ratio * modelled
        self.battery.soc -= self.energy.gauge * ratio * modelled
        leg = SimpleNamespace(soc_start=begun, modelled=SimpleNamespace(total=modelled, per_s=0.001))
        self.energy.learn(self.ctx, leg)


def flown(share, *, flights=1):
    delivery = Delivery(share)
    delivery.charge(1.0)
    for number in range(flights):
        delivery.fly(0.6 / flights, charged=number == 0)
    return delivery


def test_a_battery_that_holds_less_is_known_after_its_first_pad():
    delivery = flown(0.9)
    assert delivery.energy.belief.mean_ratio == pytest.approx(1.0, abs=0.01)
    delivery.charge(1.0)
    assert delivery.energy.gauge == pytest.approx(1.0 / 0.9, abs=0.02)
    assert delivery.energy.belief.mean_ratio == pytest.approx(1.0 / 0.9, abs=0.02)


@given(st.floats(0.75, 1.0), st.integers(1, 3), st.integers(1, 4))
def test_the_belief_is_that_of_counted_charge_times_what_the_battery_takes_for_it(share, flights, pads):
    delivery, counted = flown(share, flights=flights), PRIOR
    for _ in range(flights):
        counted = counted.learnt(0.6 / flights, 0.6 / flights)
    delivery.charge(1.0)
    for _ in range(pads):
        delivery.fly(0.5, 1.03)
        delivery.charge(1.0)
        counted = counted.learnt(1.03 * 0.5, 0.5)
    takes = max(delivery.energy.gauge, 1.0)
    assert delivery.energy.belief.mean_ratio == pytest.approx(takes * counted.mean_ratio)
    assert delivery.energy.belief.sd_between == pytest.approx(takes * counted.sd_between)


def test_a_battery_that_seems_to_take_less_than_is_counted_is_not_trusted_to():
    delivery = flown(1.1)
    before = delivery.energy.belief.mean_ratio
    delivery.charge(1.0)
    assert delivery.energy.gauge < 0.95
    assert delivery.energy.belief.mean_ratio == before


def test_a_journal_brings_back_what_was_known():
    delivery, later = flown(0.9), EnergyLearning(PRIOR)
    delivery.charge(1.0)
    delivery.fly(0.4)
    later.restore(asdict(delivery.energy.belief), delivery.energy.gauge)
    assert asdict(later.belief) == pytest.approx(asdict(delivery.energy.belief))
    assert asdict(later.counted) == pytest.approx(asdict(delivery.energy.counted))


@given(st.lists(st.floats(0.7, 1.5), min_size=1, max_size=6))
def test_the_gauge_lies_between_what_it_was_and_what_pads_measured(shares):
    delivery = flown(1.0 / shares[0])
    delivery.charge(1.0)
    for one in shares[1:]:
        before, delivery.share = delivery.energy.gauge, 1.0 / one
        delivery.fly(0.4)
        delivery.charge(1.0)
        assert min(before, one) - 1e-9 <= delivery.energy.gauge <= max(before, one) + 1e-9


def test_a_pad_tells_nothing_of_a_flight_whose_beginning_was_not_seen():
    delivery = Delivery(0.9)
    delivery.charge(1.0)
    delivery.fly(0.6, seen=False)
    delivery.charge(1.0)
    assert delivery.energy.gauge == 1.0
    assert delivery.energy.belief.mean_ratio == pytest.approx(1.0, abs=0.01)
