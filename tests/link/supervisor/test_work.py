"""A cut mission is flown battery by battery on both autopilots, replanned with what is measured; what goes wrong ends in a named safe state."""

import math
from dataclasses import replace
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from benchmarks.link.deliveries import Scripted
from benchmarks.link.work import PLACE, Stage, Story, pad, survey, whole
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Decided, LegBegun, Uploaded, WorkBegun, WorkStands, WorkTurned
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import RecordedWind


class KilledError(Exception):
    """The program ends here."""


SMALL = {"mission": survey(lines=2, length_m=900.0), "soc": 0.37, "pads": (pad("west", PLACE, -80.0, 400.0, 12.0),)}


def entries(stage, kind):
    return [entry for record in read_journal(stage.journal_path).records if (entry := record.entry(kind)) is not None]


def apart_m(pictures, others):
    assert len(pictures) == len(others)
    return max(math.hypot(*offset_m(*one, *other)) for one, other in zip(pictures, others, strict=True))


def fired_as_undivided(stage, story, tmp_path):
    """Compare the pictures with those of the mission flown undivided, and with those that are drawn."""
    undivided = whole(story, tmp_path)
    drawn = [(one.lat, one.lon) for one in stage.found.problem.work.pictures][-len(undivided) :]
    off, own = apart_m(stage.camera.pictures, undivided), apart_m(undivided, drawn)
    print(
        f"{story.autopilot}: {len(undivided)} pictures, at most {off:.2f} m from those of the undivided flight, which is {own:.2f} m off itself"
    )
    assert off <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_survey_is_flown_battery_by_battery(autopilot, tmp_path):
    story = Story(autopilot=autopilot, **SMALL)
    stage = Stage(story, tmp_path)
    assert len(stage.found.plan.stops) == 1
    outcome = stage.fly()
    assert outcome.done, outcome
    assert outcome.exit_code == 0
    assert outcome.flights >= 2
    assert not stage.craft.autopilot.armed
    assert min(stage.landings) >= 0.2
    lists = [one for one in entries(stage, Uploaded) if one.part == "mission"]
    assert len(lists) >= 2
    assert all(one.verified for one in lists)
    stands = entries(stage, WorkStands)
    assert [one.finished for one in stands] == [False] * (len(stands) - 1) + [True]
    assert stands[0].pad == "west"
    assert entries(stage, WorkBegun)[1].begin_point == stands[0].point
    fired_as_undivided(stage, story, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_flight_that_takes_too_much_leaves_the_work_earlier_and_goes_on_exactly(autopilot, tmp_path):
    story = Story(
        autopilot=autopilot, mission=survey(lines=5), soc=0.9, faults=(parse_fault("battery-drop=0.25@T+200s"),)
    )
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.done, outcome
    turned = [one for one in entries(stage, WorkTurned) if one.begun is False]
    assert turned
    assert min(stage.landings) >= 0.2
    fired_as_undivided(stage, story, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_work_goes_on_after_the_program_was_killed_in_the_air_and_on_a_pad(autopilot, tmp_path):
    story = Story(autopilot=autopilot, mission=survey(lines=3), soc=0.5)
    stage = Stage(story, tmp_path)
    pictures = []

    def in_flight(ctx):
        if str(ctx.state) == "flying" and len(stage.camera.pictures) >= pictures[-1] + 5:
            raise KilledError

    def on_the_pad(ctx):
        pictures.append(len(stage.camera.pictures))
        if str(ctx.state) == "charging":
            raise KilledError

    with pytest.raises(KilledError):
        stage.fly(on_tick=on_the_pad)
    with pytest.raises(KilledError):
        stage.fly(resume=True, on_tick=in_flight)
    outcome = stage.fly(resume=True)
    assert outcome.done, outcome
    assert len(stage.camera.pictures) == len(stage.found.problem.work.pictures) - (autopilot == "ardupilot")
    assert len(entries(stage, LegBegun)) == outcome.flights


@pytest.mark.slow
def test_an_operator_who_says_no_leaves_it_on_the_ground(tmp_path):
    stage = Stage(Story(**SMALL), tmp_path, operator=Scripted(lambda *_: (1.0, "no"), lambda: 0.0))
    stage.operator.now_s = lambda: stage.lockstep.now_s
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert outcome.flights == 0
    assert "said no" in outcome.reason


@pytest.mark.slow
def test_a_link_that_is_lost_for_a_while_costs_no_picture(tmp_path):
    story = replace(Story(**SMALL), faults=(parse_fault("link-loss@T+60s+40s"),))
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.done, outcome
    assert len(stage.camera.pictures) == len(stage.found.problem.work.pictures)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_drone_that_is_sent_to_the_pad_by_a_person_goes_on_from_where_it_left(autopilot, tmp_path):
    story = Story(autopilot=autopilot, **SMALL)
    stage = Stage(story, tmp_path, operator=Scripted(lambda *_: (1.0, "yes"), lambda: 0.0))
    stage.operator.now_s = lambda: stage.lockstep.now_s
    before, sent, way = [], [], []

    def order(ctx):
        if str(ctx.state) == "diverting":
            way.append((stage.lockstep.now_s, ctx.place))
        if str(ctx.state) != "flying" or ctx.delivery.leg.destination != "home" or sent:
            return
        taken = len(stage.camera.pictures)
        before.append(taken)
        if taken >= before[0] + 8:
            sent.append(taken)
            stage.operator._due.append((0.0, "divert west"))

    outcome = stage.fly(on_tick=order)
    assert sent
    assert outcome.done, outcome
    assert outcome.flights == 3
    assert outcome.station == "home"
    expected = len(stage.found.problem.work.pictures)
    assert expected <= len(stage.camera.pictures) <= expected + 5  # up to 15 s of the work are flown again
    stands = [one for one in entries(stage, WorkStands) if not one.finished]
    assert [one.pad for one in stands] == ["west", "west"]
    fastest = max(
        math.hypot(*offset_m(*a, *b)) / (later - now)
        for (now, a), (later, b) in zip(way, way[10:], strict=False)
        if later > now + 5.0
    )
    assert fastest == pytest.approx(story.transit_mps, rel=0.1)  # as fast as its charge was reckoned with
    assert stands[1].point > stands[0].point


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.usefixtures("shared_data")
def test_the_reserve_is_kept_in_the_wind_of_a_day_that_the_forecast_leaves_out(autopilot, tmp_path):
    """Melbourne, 20 July 2023: the windiest afternoon of its week was not looked for; nothing is tuned on it."""
    from benchmarks.cases.melbourne import SITE, melbourne

    place, region = (SITE.lat, SITE.lon), melbourne()
    depart = datetime(2023, 7, 20, 12, 0, tzinfo=ZoneInfo(region.timezone))
    story = Story(
        autopilot=autopilot,
        mission=survey(place, lines=5),
        pads=(pad("west", place, -150.0, 700.0, 12.0), pad("east", place, 620.0, 1500.0, 31.0)),
        soc=0.8,
        power_error=None,
        forecast=region.forecast(depart, 24, truth=depart.date()),
        truth=RecordedWind(region.truth(depart.date(), depart, 24)),
        depart=depart,
    )
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.done, outcome
    plans = [one.figures for one in entries(stage, Decided) if one.where == "ground"]
    took_s = stage.lockstep.clock.posix_s() - depart.timestamp()
    print(
        f"{autopilot}: landed with {min(stage.landings):.3f} at least, promised {plans[0]['p_reserve']:.4f} to keep 0.2; took {took_s:.0f} s,"
        f" promised half by {plans[0]['end_p50_s']:.0f} s, 95 % by {plans[0]['end_p95_s']:.0f} s; {outcome.flights} flights"
    )
    assert min(stage.landings) >= 0.2
    fired_as_undivided(stage, story, tmp_path)
