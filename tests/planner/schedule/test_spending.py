"""What deliveries spend, against sums over small steps of time."""

from dataclasses import replace
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from skyway.models.scenario.tariff import Tariff
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.spending import spending
from tests.planner.worlds import make_request, make_wind, make_world


def test_cost_is_the_sum_of_small_steps():
    """Energy minute by minute at the price on the local clock, fees, refill, wear: independent of the vectorised sums."""
    rng = np.random.default_rng(11)
    scenario = make_world(rng, 6, utilisation=0.3)
    count = len(scenario.network)
    tariff = Tariff("EUR", rng.uniform(0.1, 1.0, (count, 168)), rng.uniform(0.1, 2.0, count), 0.25, "Europe/Berlin")
    drone = replace(scenario.drones[0], wear_per_flight_h=3.0, wear_per_cycle=1.5)
    scenario = replace(scenario, tariff=tariff, drones=(drone,))
    problem = Problem(scenario, make_request(scenario, rng), drone, make_wind(rng, members=3, mean_mps=4.0))
    found = RobustSearch(problem).candidates()[0]
    runs, itinerary = found.out_of_sample.schedule, found.policy.itinerary
    told = spending(problem, itinerary, runs)
    kwh = drone.battery_j / 3.6e6
    stops = [int(problem.network.tail[leg.segments[0]]) for leg in itinerary]
    charged_once = False
    for run in range(0, len(runs), 17):
        soc, energy, fees, wear = problem.soc, 0.0, 0.0, 0.0
        for leg, node in enumerate(stops):
            pad, off, down, leaves, lands = runs[run, leg, :5]
            if leaves > soc + 1e-9:
                charged_once = True
                fees += tariff.pad_fee[node]
                curve_s, curve_soc = problem.curve(node)
                empty = np.interp(soc, curve_soc, curve_s)
                edges = np.linspace(pad, off, 2001)
                level = np.minimum(np.interp(empty + edges - pad, curve_s, curve_soc), leaves)
                for middle, gained in zip(0.5 * (edges[1:] + edges[:-1]), np.diff(level), strict=True):
                    local = datetime.fromtimestamp(middle, UTC).astimezone(ZoneInfo("Europe/Berlin"))
                    energy += tariff.energy_per_kwh[node, 24 * local.weekday() + local.hour] * kwh * gained
            wear += 3.0 * (down - off) / 3600.0 + 1.5 * (leaves - lands)
            soc = lands
        refill = 0.25 * kwh * max(problem.soc - soc, 0.0)
        assert told.energy[run] == pytest.approx(energy, rel=2e-3, abs=1e-9)
        assert told.fees[run] == pytest.approx(fees)
        assert told.refill[run] == pytest.approx(refill)
        assert told.wear[run] == pytest.approx(wear)
        assert told.cost[run] == pytest.approx(energy + fees + refill + wear, rel=1e-3)
    assert charged_once


def test_flown_energy_is_bought_or_lacking():
    """All energy that is flown was charged on the way, bought afterwards, or in the battery before: with one price for all."""
    rng = np.random.default_rng(12)
    scenario = make_world(rng, 6, utilisation=0.3)
    count = len(scenario.network)
    tariff = Tariff("EUR", np.full((count, 168), 0.4), np.zeros(count), 0.4, "UTC")
    scenario = replace(scenario, tariff=tariff)
    problem = Problem(
        scenario, make_request(scenario, rng), scenario.drones[0], make_wind(rng, members=3, mean_mps=4.0)
    )
    found = RobustSearch(problem).candidates()[0]
    runs = found.out_of_sample.schedule
    told = spending(problem, found.policy.itinerary, runs)
    lacks = runs[:, -1, 4] <= problem.soc
    assert lacks.any()
    assert told.cost[lacks] == pytest.approx(0.4 * told.energy_j[lacks] / 3.6e6)
