"""A vehicle that has crashed ends a delivery with that word, wherever it is found out; what it cannot fly with is told before the question."""

import math
from copy import copy

import pytest
from wrong_values import staged

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.sim_stub.faults import parse_fault

LYING = {"ATTITUDE": {"roll": math.pi}, "ATTITUDE_QUATERNION": {"q1": 0.0, "q2": 1.0, "q3": 0.0, "q4": 0.0}}
AUTOPILOTS = ("px4", "ardupilot")
SHORT = {"start": "jersey-city", "to": "hoboken", "traffic": False}


def checks(stage):
    """Every entry of every checklist."""
    records = read_journal(stage.journal_path).records
    return [check for record in records if record.event == "preflight" for check in record.data["checks"]]


def states(stage):
    """The states that were entered."""
    return [r.data["after"] for r in read_journal(stage.journal_path).records if r.event == "state"]


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_vehicle_that_refuses_to_arm_because_it_has_crashed_is_not_said_to_be_safe(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, **SHORT), tmp_path)
    stage.craft.autopilot.crashed = True
    outcome = stage.fly()
    assert outcome.state == "crashed", outcome
    assert "has crashed" in outcome.reason
    assert outcome.exit_code == 3


def lying(seconds):
    """Say for some time that it lies on its back, from the first packet on."""

    def tamper(stage, _port):
        def told(message):
            lies = LYING.get(message.get_type())
            if lies is None or stage.lockstep.now_s > seconds:
                return message
            false = copy(message)
            for name, value in lies.items():
                setattr(false, name, value)
            return false

        return told

    return tamper


def test_a_vehicle_that_lies_on_its_back_is_not_asked_to_fly(tmp_path):
    stage = staged(Story(**SHORT), tmp_path, None, lying(math.inf))
    outcome = stage.fly()
    assert outcome.state == "crashed", outcome
    assert "leans 180" in outcome.reason
    assert "arming" not in states(stage)


@pytest.mark.slow
def test_an_attitude_that_is_wrong_for_a_while_ends_nothing(tmp_path):
    stage = staged(Story(**SHORT), tmp_path, None, lying(60.0))
    outcome = stage.fly()
    assert outcome.delivered, outcome


def test_a_vehicle_that_falls_is_said_to_have_crashed_and_where(tmp_path):
    stage = Stage(Story(faults=(parse_fault("battery-drop=1@T+60s"),), **SHORT), tmp_path)
    outcome = stage.fly()
    assert stage.craft.autopilot.crashed
    assert outcome.state == "crashed", outcome
    assert "at no station" in outcome.reason


@pytest.mark.parametrize("autopilot", ["ardupilot"])
def test_a_receiver_without_a_fix_is_told_by_the_checklist_and_not_by_the_refusal_to_arm(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, faults=(parse_fault("gps@10s"),), soc=0.38, **SHORT), tmp_path)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe", outcome
    assert "position" in outcome.reason
    assert "arming" not in states(stage)
    assert any(check["name"] == "position" and check["verdict"] == "no" for check in checks(stage))
