"""Where nothing deviates, the independent world and the product's own evaluation say the same, though they share no code."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.independent import build, delivery, study, worlds
from benchmarks.independent.product import planning, policies
from skyway.models.queues.load import PadLoad
from skyway.planner.evaluation.evaluate import fly_charging, sample_realizations
from skyway.planner.problem.error_model import NO_ERRORS


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
