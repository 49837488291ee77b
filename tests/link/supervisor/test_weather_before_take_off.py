"""The weather that closes flights is looked at again before a take-off, by the forecast that the flight has then."""

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.models.drones.weather_limits import WeatherLimits
from skyway.models.wind.ensemble import HourlyWeather

CLOSED_S = 600.0


@pytest.mark.slow
def test_a_take_off_waits_for_the_gusts_to_end(tmp_path, monkeypatch):
    stage = Stage(Story(autopilot="px4", start="bellevue", to="city-hall", traffic=False), tmp_path)
    depart_s = stage.composition.services[0].depart.timestamp()
    gusts = np.array([19.0, *[6.0] * 100])
    stage.forecast = replace(stage.forecast, weather=HourlyWeather(depart_s, CLOSED_S, {"gust": gusts}))
    planned = Stage.job

    def limited(self):
        job = planned(self)
        return replace(
            job, scenario=replace(job.scenario, rules=replace(job.scenario.rules, limits=WeatherLimits(gust_mps=12.0)))
        )

    monkeypatch.setattr(Stage, "job", limited)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    records = read_journal(stage.journal_path).records
    (wait, *_) = [record for record in records if record.event == "decision"]
    assert (wait.data["action"], wait.data["where"]) == ("wait", "ground")
    (leaves, *_) = [record for record in records if record.event == "state" and record.data["after"] == "flying"]
    assert datetime.fromisoformat(leaves.time).timestamp() >= depart_s + CLOSED_S
