"""Proof of delivery: what was weighed goes before what a gripper says; judged by the simulator's own physics."""

import dataclasses

import pytest

from benchmarks.link.deliveries import Stage, Story
from benchmarks.link.proof import FAILURES, deliver
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Proved
from skyway.link.supervisor.proof.evidence import Evidence, Verdict, judge
from skyway.link.supervisor.proof.weighing import Weight
from skyway.report.document import flight_report
from skyway.sim_stub.faults import parse_fault

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)
D, N, U = Verdict.DELIVERED, Verdict.NOT_DELIVERED, Verdict.UNSURE
LIGHT, HEAVY, HALF, VAGUE = Weight(0.02, 0.1, 12), Weight(0.97, 0.1, 12), Weight(0.5, 0.1, 12), Weight(0.1, 0.6, 12)


@pytest.mark.parametrize(
    ("evidence", "verdict", "word"),
    [
        (Evidence(), U, "nothing was acknowledged"),
        (Evidence(True), D, "not weighed"),
        (Evidence(True, by_person=True), D, "a person took it off"),
        (Evidence(False), N, "not acknowledged"),
        (Evidence(True, weight=LIGHT), D, "lighter"),
        (Evidence(True, weight=HEAVY), N, "still aboard"),
        (Evidence(True, by_person=True, weight=HEAVY), N, "a person took it off, but"),
        (Evidence(True, weight=HALF), N, "in part"),
        (Evidence(True, weight=VAGUE), U, "too light to be weighed"),
        (Evidence(True, weight=Weight(0.33, 0.1, 12)), U, "weighed"),
        (Evidence(True, lost_s=5.0), N, "on the way"),
        (Evidence(True, lost_s=5.0, weight=LIGHT), N, "on the way"),
    ],
)
def test_evidence_is_judged_together(evidence, verdict, word):
    found, reason = judge(dataclasses.replace(evidence, package_kg=0.8))
    assert found == verdict
    assert word in reason


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("failure", ["", "stuck", "half", "early"])
def test_a_gripper_that_lies_is_found_out_within_twenty_seconds_of_the_take_off(failure, autopilot):
    run = deliver(70, autopilot, failure)
    assert run.verdict == (N if failure else D), run.reason
    assert run.after_s < 20.0


@pytest.mark.slow
def test_no_failure_is_missed_and_no_good_delivery_is_doubted():
    runs = [deliver(seed, ("px4", "ardupilot")[seed % 2], ("", *FAILURES)[seed % 5]) for seed in range(500, 560)]
    assert not [run for run in runs if (run.verdict == D) == bool(run.failure)]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("fault", "state", "verdict", "exit_code"),
    [("", "delivered", "delivered", 0), ("package-lost@T+60s", "stopped-safe", "not delivered", 1)],
)
def test_a_delivery_tells_what_became_of_the_package(fault, state, verdict, exit_code, autopilot, tmp_path):
    faults = (parse_fault(fault),) if fault else ()
    stage = Stage(dataclasses.replace(STORY, autopilot=autopilot, faults=faults), tmp_path)
    outcome = stage.fly()
    assert (outcome.state, outcome.proof, outcome.exit_code) == (state, verdict, exit_code), outcome
    records = read_journal(stage.journal_path).records
    assert next(r.entry(Proved).gain_w for r in records if r.event == "proof") is not None
    document = flight_report(records)
    assert (document.outcome.proof, document.outcome.proof_reason) == (verdict, outcome.proof_reason)
