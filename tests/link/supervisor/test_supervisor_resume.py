"""A supervisor that is killed is begun again from its journal, finds the vehicle where it is, and flies nothing twice."""

import random

import pytest

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal


class Killed(BaseException):
    """As kill -9: nothing of ours runs any more."""


def fly_and_kill(stage, moments):
    """Kill it at these instants of simulated time, each time tear the journal's end, and begin again 5 s later."""
    outcome, resume = None, False
    for number, moment in enumerate([*moments, None]):

        def reaper(_ctx, moment=moment):
            if moment is not None and stage.lockstep.now_s >= moment:
                raise Killed

        try:
            supervisor = stage.board(resume=resume, on_tick=reaper)
            outcome = supervisor.run()
            supervisor.context.journal.close()
            break
        except Killed:
            supervisor.context.journal.close()
            supervisor.context.vehicle.connection.close()
            tear(stage.journal_path, number)
        stage.lockstep.run_for(5.0)
        resume = True
    return outcome


def tear(path, number):
    """Lose a part of the last line, as where the power failed in writing it."""
    data = path.read_bytes()
    start = data[:-1].rfind(b"\n") + 1
    if b'"event":"track"' in data[start:]:  # only what is not forced to the disk can be lost
        path.write_bytes(data[: start + random.Random(number).randrange(0, len(data) - start)])


def check_told_once(stage, outcome):
    assert outcome is not None
    assert outcome.delivered, outcome
    assert stage.craft.body.payload_kg == 0.0
    assert not stage.craft.autopilot.crashed
    records = read_journal(stage.journal_path).records
    stands = stage.story.start
    for record in records:  # each leg begins where the vehicle stands: none is flown again, none is left out
        if record.event == "leg":
            assert record.data["origin"] == stands, record
        if record.event == "landed":
            stands = record.data["station"]
    taken_off = sum(event.text == "in the air" for event in stage.world.events)
    assert taken_off == sum(record.event == "landed" for record in records)
    assert records[-1].event == "end"


@pytest.mark.parametrize(
    ("autopilot", "moments"),
    [("px4", (40.0, 300.0)), pytest.param("ardupilot", (8.0, 150.0, 420.0), marks=pytest.mark.slow)],
)
def test_a_killed_supervisor_goes_on_where_the_vehicle_is(autopilot, moments, tmp_path):
    stage = Stage(Story(autopilot=autopilot, start="bellevue", to="yankee-stadium", soc=0.45, traffic=False), tmp_path)
    check_told_once(stage, fly_and_kill(stage, moments))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_killed_at_a_random_moment_nothing_is_lost_or_flown_twice(seed, tmp_path):
    generator = random.Random(f"kill/{seed}")
    autopilot = ("px4", "ardupilot")[seed % 2]
    story = Story(autopilot=autopilot, start="bellevue", to="white-plains", seed=seed, depart="2013-05-14T10:00-04:00")
    stage = Stage(story, tmp_path)
    moments = sorted(generator.uniform(2.0, 3600.0) for _ in range(1 + seed % 3))
    check_told_once(stage, fly_and_kill(stage, moments))
