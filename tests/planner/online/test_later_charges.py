"""Charges that later legs are counted with: those that the check before their take-off asks for."""

from dataclasses import replace

import pytest
from bellevue_flights import DEPART, standing, wind

from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.online.departure_gate import DepartureGate
from skyway.planner.online.following import Step
from skyway.planner.online.hindsight import Hindsight
from skyway.planner.online.later_charges import LaterCharges
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.online.told_plan import segments_of
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.request import Request

SOON_S = 900.0
LANDS = 0.3


@pytest.fixture(scope="module")
def north(newyork):
    """From Montefiore to White Plains with a strong tail wind: by Lawrence, from where divert stations lie against the wind."""
    return OnlinePolicy(
        newyork, Request(state=State(DEPART, "montefiore"), destination="white-plains", payload_kg=0.8, drone="m200")
    )


@pytest.fixture(scope="module")
def known():
    belief = EnergyBelief(1.06, 0.02, 0.04)
    return standing(wind(10.0, 220.0), belief, "montefiore", 0.48, wind_measured_s=DEPART.timestamp())


def last_leg(policy, known, soc):
    p = policy.problem(known)
    return p, Step(segments_of(p.network, ["lawrence", "white-plains"]), soc, 1)


@pytest.mark.parametrize("soc", [0.25, 0.5])
def test_a_later_leg_requires_what_its_own_check_asks_for(north, known, soc):
    p, step = last_leg(north, known, 0.0)
    landed_s = DEPART.timestamp() + SOON_S
    share = LaterCharges(north, known, p).share(step, landed_s, soc)
    there = replace(known, station="lawrence", time_s=landed_s, soc=soc, wind_measured_s=landed_s)
    gated = DepartureGate(north, there, north.problem(there)).charged(step)
    assert p.reserve + share * gated.used_soc == pytest.approx(gated.soc, abs=0.03)


def test_an_arrival_counts_the_time_of_charging_for_the_check_of_a_later_leg(north, known):
    """Counted with what the flight takes, a stop at Lawrence seemed to save twenty minutes that it cost."""
    p, step = last_leg(north, known, 0.0)
    landed_s = DEPART.timestamp() + SOON_S
    later = LaterCharges(north, known, p)
    bare = Hindsight(p, USUAL_ERRORS, known.belief, watched=True)
    counted = Hindsight(p, USUAL_ERRORS, known.belief, watched=True, later=later)
    required = later.gated(step, landed_s, LANDS)
    node = p.network.index["lawrence"]
    needed_s = p.charge_time_s(node, LANDS, p.reserve + required.used_soc)
    more_s = p.charge_time_s(node, LANDS, required.soc) - needed_s
    gain_s = counted.arrival_s("lawrence", landed_s, LANDS) - bare.arrival_s("lawrence", landed_s, LANDS)
    assert 0.4 * more_s < gain_s <= more_s
    assert gain_s > 600.0


def test_where_a_charge_is_enough_already_nothing_is_added(north, known):
    p, _ = last_leg(north, known, 0.0)
    landed_s = DEPART.timestamp() + SOON_S
    bare = Hindsight(p, USUAL_ERRORS, known.belief, watched=True)
    counted = Hindsight(p, USUAL_ERRORS, known.belief, watched=True, later=LaterCharges(north, known, p))
    assert counted.arrival_s("lawrence", landed_s, 0.98) == bare.arrival_s("lawrence", landed_s, 0.98)
