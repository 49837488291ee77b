"""Where nothing deviates, the independent world and the product's own evaluation say the same, though they share no code."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.independent import build, delivery, study, worlds
from benchmarks.independent.information import HERE, Aloft, Piece
from benchmarks.independent.product import planning, policies
from benchmarks.independent.product.in_air import InAir
from skyway.models.queues.load import PadLoad
from skyway.planner.evaluation.evaluate import fly_charging, sample_realizations
from skyway.planner.online.options import along_way
from skyway.planner.problem.error_model import NO_ERRORS

STUDY = study.Study("new-york", "robust", 1, 2, 1, 18)


class NoGusts:
    def step(self, path_m, mean_mps, dt_s):
        return np.zeros((len(path_m), 2))


@pytest.mark.slow
def test_without_deviations_deliveries_are_those_of_the_product(monkeypatch):
    city = planning.city("new-york")
    base = planning.scenario_of("new-york")
    calm = replace(base, load=PadLoad.none(len(base.network), base.load.timezone))
    monkeypatch.setattr(planning, "scenario_of", lambda _: calm)
    planning.told_scenario.cache_clear()
    many = 0
    for order in study.orders(study.Study("new-york", "robust", 4, 4, 1, 5)):
        days = planning.days_for("new-york", order, 4, 5)
        plan = planning.planned("new-york", order, days)
        if plan is None:
            continue
        shift = np.array([planning.shift_s("new-york", order, day) for day in days])
        setting = build.setting_for(worlds.OURS, city, order, shift, [(1, k) for k in range(len(days))])
        empty = replace(city.ground, arrivals_per_s=np.zeros_like(city.ground.arrivals_per_s))
        setting = replace(
            setting,
            gusts=lambda _: NoGusts(),
            vehicle=np.ones(len(days)),
            stations=[build.Stations(empty, (1,), order.depart_s, 40)] * len(days),
        )
        runs = delivery.deliver(setting, order, policies.Robust(plan))
        truths = sample_realizations(calm, plan.request, days, runs=len(days), errors=NO_ERRORS)
        theirs = fly_charging(truths, plan.result.problem.drone.id, plan.result.robust.policy)
        ours_s = np.array([run.time_s - order.depart_s for run in runs])
        assert ours_s == pytest.approx(theirs.delivery_s, abs=60.0)
        assert [min(run.landings) for run in runs] == pytest.approx(theirs.lowest_soc, abs=0.005)
        many += len(runs)
    assert many >= 12
    planning.told_scenario.cache_clear()


class AFlight:
    """What a drone on its way from the first to the second segment's end of a plan knows: wind, charge and where it is are given."""

    def __init__(self, planned):
        leg = planned.result.itinerary[0]
        self.segments, self.time_s = leg.segments, planned.request.state.time.timestamp()
        network, first = planned.scenario.network, leg.segments[0]
        self.way = [(network.lat[k], network.lon[k]) for k in (network.tail[first], network.head[first])]
        self.length_m = network.distance_m[first]
        self.reports = {one.id: (self.time_s, 1.0, 0.0) for one in planned.scenario.wind_sites}

    def seen(self, told, wind, share=0.5):
        ways = [along_way(self.way, share * k / 5 * self.length_m) for k in range(6)]
        pieces = tuple(Piece(self.time_s + 15.0 * k, place, wind) for k, place in enumerate(ways[:-1]))
        return Aloft(
            0, self.time_s + 75.0, told, self.reports, lambda _: 0, (), 0, self.time_s, told + 0.05, self.segments,
            self.segments[0], share, None, ways[-1], pieces,
        )  # fmt: skip


@pytest.mark.slow
def test_the_product_turns_back_where_the_charge_is_not_enough_and_flies_on_where_it_is():
    order = next(iter(study.orders(STUDY)))
    planned = planning.planned("new-york", order, planning.days_for("new-york", order, 2, 1))
    flight, air = AFlight(planned), InAir(planned.result.robust.policy.problem)
    home = int(planned.scenario.network.tail[flight.segments[0]])
    calm = 0.0, 0.0
    assert air.turns(flight.seen(0.9, calm), (home,)) is None
    air.forget()
    back = flight.seen(0.24, calm, share=0.1)
    assert air.turns(back, (home,)) == home
    assert air.turns(replace(back, turned=home, time_s=back.time_s + 20.0), (home,)) is None
    empty = replace(back, turned=home, time_s=back.time_s + 200.0, told=0.001)
    assert air.turns(empty, (home,)) == HERE


@pytest.mark.slow
def test_what_fly_does_delivers_in_a_world_that_is_as_plans_count_on():
    few = study.Study("new-york", "fly", 1, 2, 1, 18)
    (order,) = study.orders(few)
    (found,) = study.fly_order(few, order, [worlds.OURS])
    assert found["ending"] == ["delivered"] * 2
    assert min(min(one) for one in found["landings"]) >= 0.2
