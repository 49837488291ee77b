"""What flights take is learnt from what the vehicle tells, and again from what a pad measures."""

import math
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
        self.true_soc = self.battery.told_soc = soc

    def fly(self, modelled, ratio=1.0, *, charged=True, seen=True):
        """A flight that takes `ratio` of what the model says, of a nameplate battery; its beginning is `seen`."""
        if seen:
            self.battery.begin_flight(charged=charged)
        begun = self.battery.soc
        self.true_soc -= ratio * modelled / self.share
        self.battery.told_soc -= ratio * modelled
        self.battery.soc -= self.battery.gauge * ratio * modelled
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
    assert delivery.battery.gauge == pytest.approx(1.0 / 0.9, abs=0.02)
    learnt = PRIOR.learnt(0.6 / 0.9, 0.6)
    assert delivery.energy.belief.mean_ratio == pytest.approx(learnt.mean_ratio)
    assert delivery.energy.belief.mean_ratio > 1.04
    assert "by the pad the flights since the last one used 67 % of charge, the model expected 60 %" in delivery.said


@given(st.floats(0.75, 1.0), st.integers(1, 3), st.integers(1, 4))
def test_after_pads_the_belief_is_that_of_flights_whose_charge_was_measured(share, flights, pads):
    delivery, measured = flown(share, flights=flights), PRIOR
    for _ in range(flights):
        measured = measured.learnt(0.6 / flights / share, 0.6 / flights)
    delivery.charge(1.0)
    assert delivery.energy.belief.mean_ratio == pytest.approx(measured.mean_ratio, abs=1e-9)
    for _ in range(pads):
        delivery.fly(0.5)
        delivery.charge(1.0)
        measured = measured.learnt(0.5 / share, 0.5)
        assert delivery.energy.belief.mean_ratio == pytest.approx(measured.mean_ratio, abs=1e-9)
        assert delivery.energy.belief.sd_between == pytest.approx(measured.sd_between)


@given(st.lists(st.floats(0.7, 1.5), min_size=1, max_size=6))
def test_the_gauge_lies_between_what_it_was_and_what_pads_measured(shares):
    delivery = flown(1.0 / shares[0])
    delivery.charge(1.0)
    for one in shares[1:]:
        before, delivery.share = delivery.battery.gauge, 1.0 / one
        delivery.fly(0.4)
        delivery.charge(1.0)
        assert min(before, one) - 1e-9 <= delivery.battery.gauge <= max(before, one) + 1e-9


def test_a_pad_tells_nothing_of_a_flight_whose_beginning_was_not_seen():
    delivery = Delivery(0.9)
    delivery.charge(1.0)
    delivery.fly(0.6, seen=False)
    delivery.charge(1.0)
    assert delivery.battery.gauge == 1.0
    assert delivery.energy.belief.mean_ratio == pytest.approx(1.0, abs=0.01)
