"""A package released in the air: lowered by a winch, or placed; the drone does not land, flies back under the same mission, and is weighed."""

import dataclasses

import pytest

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Proved, WentOn
from skyway.report.document import flight_report
from skyway.sim_stub.faults import parse_fault

STREET = Story(start="bellevue", target=(40.7480, -73.9500), traffic=False, still=True, soc=0.9)
DAIWA = {"parameters": (("WINCH_TYPE", 2.0),)}
D, N = "delivered", "not delivered"


def story(autopilot, release, fault="", vehicle=None):
    faults = (parse_fault(fault),) if fault else ()
    return dataclasses.replace(
        STREET, autopilot=autopilot, asked={"release": release}, faults=faults, vehicle=vehicle or {}
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("autopilot", "release", "fault", "vehicle", "proof", "word"),
    [
        ("px4", "winch", "", {}, D, "reported nothing, and the drone is lighter"),
        ("ardupilot", "winch", "", DAIWA, D, "m of line, and the drone is lighter"),
        ("ardupilot", "place", "", {}, D, "was placed"),
        ("px4", "winch", "winch-jammed", {}, N, "still on board"),
        ("ardupilot", "winch", "winch-jammed", DAIWA, N, "3.0 m of line"),
        ("ardupilot", "winch", "winch-jammed", {}, N, "still on board"),
        ("px4", "winch", "gripper-stuck=0.5", {}, N, "in part still on board"),
        ("ardupilot", "place", "place-blind", {}, N, "maximum descent"),
        ("ardupilot", "place", "gripper-stuck", {}, N, "still on board"),
    ],
)
def test_what_became_of_a_package_that_is_released_in_the_air(
    autopilot, release, fault, vehicle, proof, word, tmp_path
):
    stage = Stage(story(autopilot, release, fault, vehicle), tmp_path)
    back = stage.composition.way_back
    outcome = stage.fly()
    assert (outcome.proof, outcome.station, outcome.flights) == (proof, back.station, 1), outcome
    assert word in outcome.proof_reason
    assert outcome.exit_code == (0 if proof == D else 1)
    assert outcome.delivered is (proof != N)
    assert stage.craft.battery.soc >= 0.2
    records = read_journal(stage.journal_path).records
    went = next(entry for record in records if (entry := record.entry(WentOn)) is not None)
    assert went.loaded
    assert went.destination == back.station
    proofs = [(record.time_s, entry) for record in records if (entry := record.entry(Proved)) is not None]
    left_s = next(time_s for time_s, entry in proofs if entry.how)
    told_s = next(time_s for time_s, entry in proofs if entry.verdict == proof)
    assert told_s - left_s < 20.0
    assert flight_report(records).outcome.proof == proof


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["over-target", "flying-back"])
def test_after_a_crash_of_the_program_the_flight_is_taken_up_where_it_is(moment, tmp_path):
    class KilledError(Exception):
        pass

    stage = Stage(story("ardupilot", "winch", vehicle=DAIWA), tmp_path)
    seen = []

    def kill(ctx):
        onward = ctx.delivery.onward
        over = stage.craft.winch.line_m > 5.0
        if over and not seen:
            seen.append(ctx.now_s)
        if (onward is not None and onward.delivered) if moment == "flying-back" else over:
            raise KilledError

    with pytest.raises(KilledError):
        stage.fly(on_tick=kill)
    outcome = stage.fly(resume=True)
    assert (outcome.state, outcome.station) == (D, stage.composition.way_back.station), outcome
    assert outcome.flights == 1
    assert stage.craft.body.payload_kg == 0.0
