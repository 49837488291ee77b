"""Other aircraft in a delivery: told, held for, or landed for, and flown on when it is clear; on both simulated autopilots."""

import dataclasses
import math

import pytest

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.flight.give_way import OnTraffic, TrafficRule
from skyway.link.supervisor.journal.entries import GaveWay, RadioMeasured, RemoteIdNote
from skyway.link.telemetry.traffic import TrafficLimits
from skyway.models.scenario.remote_id import RemoteId
from skyway.report.document import flight_report
from skyway.report.page import page
from skyway.sim_stub.faults import parse_fault

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)
WHO = RemoteId(operator_id="FIN87astrdge12k8", self_id="parcels")


def staged(tmp_path, action, *faults, autopilot="px4", limits=None, who=None, **vehicle):
    told = tuple(parse_fault(one) for one in faults)
    stage = Stage(dataclasses.replace(STORY, autopilot=autopilot, faults=told, vehicle=vehicle), tmp_path)
    job = stage.job()
    rule = TrafficRule(OnTraffic(action), limits or TrafficLimits())
    stage.job = lambda: dataclasses.replace(job, traffic=rule, remote_id=who or job.remote_id)
    return stage


def entries(stage, kind):
    return [entry for r in read_journal(stage.journal_path).records if (entry := r.entry(kind)) is not None]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_it_holds_until_it_is_clear_and_flies_on(autopilot, tmp_path):
    stage = staged(tmp_path, "hold", "aircraft=800@T+45s+40s", autopilot=autopilot)
    still = []

    def watch(context):
        if context.give_way.holds:
            still.append(context.observed.sample.ground_speed_mps)

    outcome = stage.fly(on_tick=watch)
    assert outcome.delivered, outcome
    assert outcome.flights == 1
    assert [one.action for one in entries(stage, GaveWay)] == ["hold", "go"]
    assert max(still[15:]) < 1.0
    assert entries(stage, GaveWay)[-1].waited_s > 40.0


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_it_lands_at_the_nearest_station_and_takes_off_again_only_when_it_is_clear(autopilot, tmp_path):
    stage = staged(tmp_path, "land", "aircraft=800@T+45s+300s", autopilot=autopilot)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    assert outcome.flights == 2
    records = read_journal(stage.journal_path).records
    first = next(r for r in records if r.event == "give-way")
    again = [r for r in records if r.event == "leg"][1]
    assert first.data["station"] == "jersey-city"
    assert again.time_s - first.time_s > 250.0
    assert any("traffic: NOT OK" in (r.reason or "") for r in records if r.event == "waits")


@pytest.mark.slow
def test_a_person_has_it_fly_on_though_an_aircraft_is_near(tmp_path):
    stage = staged(tmp_path, "hold", "aircraft=800@T+45s+600s")
    stage.operator = Scripted(lambda question, _: (1.0, "yes"), lambda: stage.lockstep.now_s)
    said = []

    def go(context):
        if context.give_way.holds and not said:
            said.append(stage.lockstep.now_s)
            stage.operator._due.append((stage.lockstep.now_s + 5.0, "go"))

    outcome = stage.fly(on_tick=go)
    assert outcome.delivered, outcome
    assert [one.action for one in entries(stage, GaveWay)] == ["hold"]


@pytest.mark.parametrize(
    ("action", "faults", "limits"),
    [
        ("tell", "aircraft=800@T+45s+40s", None),
        ("hold", "aircraft=800@T+45s+40s", TrafficLimits(500.0, 300.0)),
        ("hold", "aircraft=100@T+45s+40s", TrafficLimits(3000.0, 50.0)),
    ],
)
def test_what_is_only_told_or_beyond_the_limits_changes_nothing(action, faults, limits, tmp_path):
    stage = staged(tmp_path, action, faults, limits=limits, who=WHO, remote_id=True)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    assert entries(stage, GaveWay) == []
    told = entries(stage, RemoteIdNote)
    assert [(one.ready, one.operator) for one in told] == [(True, "FIN87astrdge12k8")]
    radios = entries(stage, RadioMeasured)
    assert sum(one.received for one in radios) > 1000
    document = flight_report(read_journal(stage.journal_path).records)
    (radio,) = document.radios
    assert (radio.lost, radio.used_share) == (0, 1.0)
    assert bool(document.aircraft) == (action == "tell")
    text = page(document, None)
    assert "Remote ID: FIN87astrdge12k8, parcels" in text
    assert "0.0 %" in text or "0 %" in text


def test_who_flies_is_asked_for_and_no_module_is_there_so_it_does_not_take_off(tmp_path):
    stage = staged(tmp_path, "tell", who=WHO)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert "no Remote ID module is heard" in outcome.reason
    assert outcome.flights == 0


def test_an_aircraft_of_unknown_height_is_held_for():
    from skyway.link.telemetry.traffic import Aircraft

    one = Aircraft("X", 0.0, 0.0, math.nan, 0.0, 500.0, math.nan)
    assert TrafficLimits().hold(one)
    assert not TrafficLimits(400.0).hold(one)
