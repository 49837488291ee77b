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


def test_a_flight_of_a_fleet_ends_at_its_station_when_it_has_waited_too_long(tmp_path, monkeypatch):
    """Its dispatcher called it lost after two hours, a person was to look at it, and the drone took off when the wind fell."""
    stage = Stage(Story(autopilot="px4", start="bellevue", to="city-hall", traffic=False, dispatched=True), tmp_path)
    planned, forecast = Stage.job, stage.forecast
    behind = np.full_like(forecast.north, -10.0)  # 14 m/s from behind; the drone's limit is 12 m/s
    stage.forecast = replace(forecast, north=behind, east=behind)
    monkeypatch.setattr(Stage, "job", lambda self: replace(planned(self), longest_wait_s=3600.0))
    begin_s = stage.lockstep.clock.now_s()
    outcome = stage.fly()
    assert (outcome.state, outcome.station, outcome.flights) == ("stopped-safe", "bellevue", 0)
    assert outcome.reason.startswith("waited for 1 h")
    assert 3600.0 <= stage.lockstep.clock.now_s() - begin_s < 2.0 * 3600.0
