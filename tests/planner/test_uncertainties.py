"""What a promise rests on: sizes against plain arithmetic, gains of what is certain already, and the order of the rest."""

from copy import copy
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EXACT, EnergyBelief
from skyway.models.queues.load import PadLoad
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from skyway.planner.uncertainties import (
    ENERGY,
    GUSTS,
    NOT_COUNTED,
    PADS,
    WIND,
    not_counted,
    uncertainties,
    waiting_s,
    wind_sd_mps,
)

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


def planned(scenario, forecast=None, planner="robust"):
    request = Request(state=State(DEPART, "nyp-queens"), destination="white-plains", payload_kg=0.8, drone="m200")
    return plan(scenario, request, planner=planner, forecast=forecast)


@pytest.fixture(scope="module")
def result(newyork):
    return planned(newyork)


@pytest.fixture(scope="module")
def found(result):
    return uncertainties(result)


def test_it_names_wind_gusts_energy_and_pads_with_their_data(found):
    by_name = {one.name: one for one in found}
    assert set(by_name) == {WIND, GUSTS, ENERGY, PADS}
    assert by_name[WIND].source == "30 days of the record"
    assert by_name[ENERGY].size == EnergyBelief().leg_sd
    assert "was not measured" in by_name[ENERGY].source
    assert all(one.gain is not None for one in found)


def test_what_gains_for_sure_stands_first_and_more_before_less(found):
    sure = [one.gain.low > 0.0 for one in found]
    assert sure == sorted(sure, reverse=True)
    for kind in (True, False):
        gains = [one.gain.value for one, clear in zip(found, sure, strict=True) if clear is kind]
        assert gains == sorted(gains, reverse=True)


def test_the_size_of_the_wind_is_the_plain_standard_deviation_of_a_component(result):
    problem = result.robust.policy.problem
    wind, slots = problem.ensemble, []
    hours = int((result.outcome.mean_s - wind.start_s) // wind.slot_s)
    for slot in range(int((problem.depart_s - wind.start_s) // wind.slot_s), hours + 1):
        for site in range(len(wind.site_lat)):
            slots += [np.var(part[:, slot, site]) for part in (wind.north, wind.east)]
    factor = (problem.rules.cruise_height_m / wind.height_m) ** problem.rules.wind_profile_exponent
    assert np.ptp(wind.probability) < 1e-9  # so that the plain variance is the weighted one
    assert wind_sd_mps(result.robust) == pytest.approx(factor * np.sqrt(np.mean(slots)))


def test_what_is_not_counted_is_the_wind_between_places_only_where_it_is_of_no_record(result):
    assert not_counted(result) == list(NOT_COUNTED)
    alone = replace(result, problem=copy(result.problem))
    alone.problem.ensemble = replace(result.problem.ensemble, labels=("a member",) * len(result.problem.ensemble))
    assert len(not_counted(alone)) == 1 + len(NOT_COUNTED)


def test_half_of_what_is_certain_gains_nothing(newyork):
    drones = tuple(replace(one, energy_belief=EXACT) for one in newyork.drones)
    alone = replace(newyork, drones=drones, load=PadLoad.none(len(newyork.network), newyork.timezone))
    result = planned(alone, constant_wind(6.0, 200.0, DEPART, 48, 40.8, -73.9, 60.0))
    by_name = {one.name: one for one in uncertainties(result)}
    for name in (WIND, ENERGY, PADS):
        assert by_name[name].size == pytest.approx(0.0, abs=1e-9)
        assert by_name[name].gain.value == pytest.approx(0.0, abs=1e-6)
    assert waiting_s(result.robust) == 0.0


def test_plans_of_other_planners_have_nothing_to_tell(newyork):
    assert uncertainties(planned(newyork, planner="shortest")) == []
