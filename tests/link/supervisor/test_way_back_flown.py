"""After the hand-over the drone flies its way back: from the street to a pad, journaled, resumed, and told."""

import dataclasses

import pytest

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import LegBegun, WentOn
from skyway.planner.online.policy import OnlinePolicy
from skyway.report.document import flight_report
from skyway.sim_stub.faults import parse_fault

STREET = Story(
    start="bellevue", target=(40.7480, -73.9500), traffic=False, still=True, soc=0.9, asked={"dwell_s": 40.0}
)


def legs(records):
    return [begun for record in records if (begun := record.entry(LegBegun)) is not None]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_from_a_target_without_pads_it_flies_on_to_the_pad_that_was_planned(autopilot, tmp_path):
    stage = Stage(dataclasses.replace(STREET, autopilot=autopilot), tmp_path)
    back = stage.composition.way_back
    outcome = stage.fly()
    assert (outcome.state, outcome.station, outcome.delivered) == ("delivered", back.station, True), outcome
    assert outcome.proof == "delivered", outcome.proof_reason
    assert outcome.flights == 2
    records = read_journal(stage.journal_path).records
    went = next(entry for record in records if (entry := record.entry(WentOn)) is not None)
    assert (went.destination, went.loaded, went.delivered) == (back.station, False, True)
    out, on = legs(records)
    assert (out.last, on.last) == (True, False)
    landed = next(record.time_s for record in records if record.event == "landed")
    off = next(record.time_s for record in records if record.event == "leg" and record.entry(LegBegun) == on)
    assert off >= landed + 40.0
    assert stage.craft.battery.soc >= 0.2
    document = flight_report(records)
    assert document.outcome.station == back.station


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_package_that_is_not_released_goes_back_where_that_was_asked_for(autopilot, tmp_path):
    story = dataclasses.replace(
        STREET, autopilot=autopilot, faults=(parse_fault("gripper-silent"),), asked={"undelivered_to": "back"}
    )
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert (outcome.state, outcome.station, outcome.delivered, outcome.exit_code) == (
        "stopped-safe",
        "bellevue",
        False,
        1,
    )
    assert outcome.proof in ("not delivered", "unsure")


@pytest.mark.slow
def test_where_the_nearest_pads_are_taken_it_goes_to_the_next_that_is_free(tmp_path):
    planned = Stage(STREET, tmp_path / "plan").composition.way_back.station
    story = dataclasses.replace(STREET, faults=(parse_fault(f"pads-taken={planned}"),))
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.state == "delivered", outcome
    assert outcome.station != planned
    went = [entry for record in read_journal(stage.journal_path).records if (entry := record.entry(WentOn)) is not None]
    assert [one.destination for one in went] == [planned, outcome.station]


@pytest.mark.slow
def test_nobody_arms_it_in_the_street_without_a_word(tmp_path):
    asked = []

    def answers(question, _):
        asked.append(question)
        return (1.0, "yes") if "take off" in question else None

    stage = Stage(STREET, tmp_path)
    stage.operator = Scripted(answers, stage.lockstep.clock.now_s)
    outcome = stage.fly()
    assert outcome.state == "delivered", outcome
    assert len([one for one in asked if "take off" in one]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["onward", "flying-back"])
def test_after_a_crash_of_the_program_it_goes_on_from_the_target(moment, tmp_path):
    class KilledError(Exception):
        pass

    stage = Stage(STREET, tmp_path)

    def kill(ctx):
        onward = ctx.delivery.onward
        if onward is not None and (moment == "onward" or (ctx.in_air and ctx.observed.sample.height_m > 30.0)):
            raise KilledError

    with pytest.raises(KilledError):
        stage.fly(on_tick=kill)
    outcome = stage.fly(resume=True)
    assert (outcome.state, outcome.station) == ("delivered", stage.composition.way_back.station), outcome
    assert outcome.flights == 2


def called_off(context):
    """Say that nobody is there as soon as the drone has left the place where it took off behind."""
    operator, sample = context.operator, context.observed.sample
    far = context.state == "flying" and sample is not None and context.now_s > context.delivery.leg.start_s + 100.0
    if far and not operator.said:
        operator.said = True
        operator.say("undelivered")


class Caller(Scripted):
    """An operator who says one word more, at any time."""

    said = False

    def say(self, word):
        self._due.append((self.now_s(), word))


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(("asked", "goal"), [({"undelivered_to": "back"}, "bellevue"), ({}, "bellevue")])
def test_a_place_that_is_blocked_is_told_in_the_air_and_the_package_goes_back(asked, goal, autopilot, tmp_path):
    stage = Stage(dataclasses.replace(STREET, autopilot=autopilot, asked=asked), tmp_path)
    stage.operator = Caller(lambda *_: (1.0, "yes"), lambda: stage.lockstep.now_s)
    outcome = stage.fly(on_tick=called_off)
    assert (outcome.state, outcome.station, outcome.delivered) == ("stopped-safe", goal, False), outcome
    assert "could not be handed over" in outcome.reason
    records = read_journal(stage.journal_path).records
    (went,) = [entry for record in records if (entry := record.entry(WentOn)) is not None]
    assert (went.destination, went.loaded, went.delivered) == (goal, True, False)
    assert stage.craft.body.payload_kg == STREET.payload_kg
    assert stage.craft.battery.soc >= 0.2
    assert not any(begun.destination == stage.request.destination for begun in legs(records)[1:])


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_where_no_other_station_is_in_reach_it_lands_with_the_package_and_goes_back_from_there(
    autopilot, tmp_path, monkeypatch
):
    monkeypatch.setattr(OnlinePolicy, "refuges", lambda *_: [])
    asked = {"undelivered_to": "back"}
    stage = Stage(dataclasses.replace(STREET, autopilot=autopilot, asked=asked), tmp_path)
    stage.operator = Caller(lambda *_: (1.0, "yes"), lambda: stage.lockstep.now_s)
    outcome = stage.fly(on_tick=called_off)
    assert (outcome.state, outcome.station, outcome.flights) == ("stopped-safe", "bellevue", 2), outcome
    assert stage.craft.body.payload_kg == STREET.payload_kg
    assert stage.craft.battery.soc >= 0.2


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_package_called_off_in_the_air_still_goes_back_after_a_crash_of_the_program(autopilot, tmp_path):
    class Killed(Exception):  # noqa: N818
        pass

    stage = Stage(dataclasses.replace(STREET, autopilot=autopilot), tmp_path)
    stage.operator = Caller(lambda *_: (1.0, "yes"), lambda: stage.lockstep.now_s)

    def kill(context):
        called_off(context)
        if context.state == "diverting" and context.divert.turned:
            raise Killed

    with pytest.raises(Killed):
        stage.fly(on_tick=kill)
    outcome = stage.fly(resume=True)
    assert (outcome.state, outcome.station) == ("stopped-safe", "bellevue"), outcome
