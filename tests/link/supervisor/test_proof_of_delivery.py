"""Proof of delivery: what was weighed goes before what a gripper says; judged by the simulator's own physics."""

import dataclasses
import math
import re
from functools import cache
from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.link.deliveries import Stage, Story
from benchmarks.link.proof.cases import FAILURES, deliver
from benchmarks.link.proof.run import Judged
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Proved
from skyway.link.supervisor.proof.evidence import Evidence, Verdict, judge
from skyway.link.supervisor.proof.tilt_airspeed import TiltAirspeed
from skyway.link.supervisor.proof.weighing import Scale, Weight
from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.models.drones.drag import DragModel
from skyway.models.drones.telemetry import TelemetrySample
from skyway.report.document import flight_report
from skyway.sim_stub.faults import parse_fault

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)
flown = cache(deliver)
D, N, U = Verdict.DELIVERED, Verdict.NOT_DELIVERED, Verdict.UNSURE
LIGHT, HEAVY, HALF, VAGUE = Weight(0.02, 0.1, 12), Weight(0.97, 0.1, 12), Weight(0.5, 0.1, 12), Weight(0.1, 0.6, 12)


@pytest.mark.parametrize(
    ("evidence", "verdict", "word"),
    [
        (Evidence(), U, "no acknowledgement"),
        (Evidence(True), D, "not weighed"),
        (Evidence(True, by_person=True), D, "a person took it off"),
        (Evidence(False), N, "not acknowledged"),
        (Evidence(False, how="3.0 m of line"), N, "3.0 m of line"),
        (Evidence(how="the winch reported nothing"), U, "not weighed"),
        (Evidence(how="the winch reported nothing", weight=LIGHT), D, "lighter"),
        (Evidence(how="the winch reported nothing", weight=HEAVY), N, "still on board"),
        (Evidence(True, how="16.0 m of line", weight=HEAVY), N, "16.0 m of line, but"),
        (Evidence(True, weight=LIGHT), D, "lighter"),
        (Evidence(True, weight=HEAVY), N, "still on board"),
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


def fly_level(scale, begin_s, seconds, airspeed_mps, power_w, lean_rad):
    for k in range(2 * seconds):
        sample = TelemetrySample(
            time_s=begin_s + 0.5 * k, vel_north_mps=airspeed_mps, vel_east_mps=0.0, vel_down_mps=0.0, roll_rad=0.0,
            pitch_rad=-lean_rad, power_w=power_w + 0.5 * (k % 2),
        )  # fmt: skip
        scale.hear(sample, (0.0, 0.0))


@pytest.mark.parametrize(
    ("before", "lost"),
    [(None, True), (Weight(1.05, 0.2, 12), False), (Weight(0.1, 0.2, 12), True), (Weight(0.6, 0.2, 12), True)],
)
def test_what_is_weighed_before_the_release_goes_before_a_fall_of_the_power_on_the_way(before, lost):
    """The onset of a gust from behind looks like a package that falls off; the package is still there when it is weighed."""
    known = Evidence(acknowledged=True, lost_s=100.0, before=before, package_kg=0.8)
    assert known.lost is lost
    assert judge(known)[0] is (Verdict.NOT_DELIVERED if lost else Verdict.DELIVERED)


@pytest.mark.parametrize(
    ("airspeed_mps", "lean_rad", "noticed"),
    [(15.0, 0.25, True), (13.0, 0.185, True), (2.0, 0.02, False), (15.0, 0.12, False), (9.0, 0.2, False)],
)
def test_power_that_falls_in_level_flight_is_a_package_lost_unless_it_brakes_or_is_pushed_by_a_gust(
    airspeed_mps, lean_rad, noticed
):
    scale = Scale(4.7, 1.2)
    scale.take_off(0.0)
    fly_level(scale, 30.0, 8, 15.0, 900.0, 0.2)
    fly_level(scale, 38.0, 9, airspeed_mps, 620.0, lean_rad)
    lost_s = scale.lost()
    assert (lost_s is not None) is noticed
    if noticed:
        assert lost_s == pytest.approx(38.0, abs=3.0)


DRAG = DragModel(linear_per_s=0.04, quadratic_per_m=0.005)


def cruise(scale, package_kg, seconds, *, speed_mps=8.0, gust_mps=0.0, gust_s=math.inf, lost_s=math.inf):
    """Level flight over ground, in trim; the gust is from ahead, and nobody is told of it. Returns when an alarm came."""
    load = AirspeedLoad(DRAG)
    for k in range(2 * seconds):
        time_s = 30.0 + 0.5 * k
        mass_kg = 4.7 + (0.0 if time_s >= lost_s else package_kg)
        airspeed = speed_mps + (gust_mps if time_s >= gust_s else 0.0)
        held_mps2 = airspeed * (0.04 + 0.005 * abs(airspeed)) * (4.7 + package_kg) / mass_kg
        lean = math.atan(held_mps2 / GRAVITY_MPS2)
        power_w = 500.0 * (mass_kg / 4.7 / math.cos(lean)) ** 1.6 * float(load.factor(airspeed))
        scale.hear(
            TelemetrySample(
                time_s=time_s, vel_north_mps=speed_mps + 0.01 * (k % 2), vel_east_mps=0.0, vel_down_mps=0.0,
                roll_rad=0.0, pitch_rad=-lean - 1e-4 * (k % 2),
                yaw_rad=0.0, height_m=45.0, armed=1.0, landed=0.0, power_w=power_w + 0.5 * (k % 2),
            ),
            (0.0, 0.0),
        )  # fmt: skip
        if scale.lost() is not None:
            return time_s
    return None


def a_scale(package_kg):
    scale = Scale(4.7, package_kg, load=AirspeedLoad(DRAG), tilt=TiltAirspeed(DRAG))
    scale.take_off(0.0)
    return scale


@settings(max_examples=15)
@given(st.floats(0.3, 1.2), st.floats(2.0, 13.0), st.floats(-16.0, 8.0))
@example(0.35, 4.0, 4.0)
def test_a_gust_that_begins_at_once_is_no_package_that_is_lost(package_kg, speed_mps, gust_mps):
    """The wind that is believed knows nothing of it; the lean does."""
    flown = {"speed_mps": speed_mps, "gust_mps": gust_mps, "gust_s": 42.0}
    assert cruise(a_scale(package_kg), package_kg, 25, **flown) is None


def test_by_the_wind_that_is_believed_such_a_gust_would_be_one():
    blind = Scale(4.7, 0.35, load=AirspeedLoad(DRAG))
    blind.take_off(0.0)
    assert cruise(blind, 0.35, 25, speed_mps=4.0, gust_mps=4.0, gust_s=42.0) is not None


@settings(max_examples=15)
@given(st.floats(0.35, 1.2), st.floats(41.0, 60.0))
def test_a_package_that_is_lost_in_steady_flight_is_noticed_within_eight_seconds(package_kg, lost_s):
    found_s = cruise(a_scale(package_kg), package_kg, 45, lost_s=lost_s)
    assert found_s is not None
    assert lost_s + 4.0 < found_s < lost_s + 8.0


@pytest.mark.parametrize(("aboard_kg", "lost"), [(1.2, False), (0.0, True), (0.1, True)])
def test_before_the_release_it_is_weighed_by_the_last_seconds_of_its_descent(aboard_kg, lost):
    assert Scale(4.7, 1.2).before_release() is None  # nothing is known of the drone yet
    scale = Scale(4.7, 1.2)
    scale.take_off(0.0)
    fly_level(scale, 0.0, 20, 0.5, 900.0, 0.0)
    power_w = 900.0 * ((4.7 + aboard_kg) / 5.9) ** scale.kappa
    for begin_s, seconds, watts in ((40.0, 15, power_w), (55.0, 2, 90.0)):  # and then it idles on the ground
        for k in range(2 * seconds):
            sample = TelemetrySample(
                time_s=begin_s + 0.5 * k, vel_north_mps=0.0, vel_east_mps=0.0, vel_down_mps=0.5, roll_rad=0.0,
                pitch_rad=0.0, power_w=watts + 0.5 * (k % 2),
            )  # fmt: skip
            scale.hear(sample, (0.0, 0.0))
    found = scale.before_release()
    assert found.share == pytest.approx(aboard_kg / 1.2, abs=0.1)
    assert abs(found.share - aboard_kg / 1.2) < 2.0 * found.sigma
    evidence = Evidence(acknowledged=True, before=found, package_kg=1.2)
    assert evidence.lost is lost
    assert (judge(evidence)[0] is N) is lost


def fly(scale, begin_s, seconds, power, *, airspeed_mps, climb_mps):
    """Fly on at one airspeed and climb, drawing what `power` says of them."""
    for k in range(2 * seconds):
        sample = TelemetrySample(
            time_s=begin_s + 0.5 * k, vel_north_mps=airspeed_mps, vel_east_mps=0.0, vel_down_mps=-climb_mps,
            roll_rad=0.0, pitch_rad=0.0, power_w=power(airspeed_mps, climb_mps) + 0.1 * (k % 2),
        )  # fmt: skip
        scale.hear(sample, (0.0, 0.0))


@settings(max_examples=25)
@given(st.floats(0.5, 1.2), st.floats(0.6, 1.4), st.floats(0.6, 1.4), st.floats(0.0, 1.0))
@example(0.8, 0.6, 1.4, 0.5)
def test_what_airspeed_and_climb_take_of_this_drone_is_learnt_under_its_package(package_kg, dip, climbing, aboard):
    """It climbs under the package, flies away level and fast; and what is aboard after the release is weighed where it flies otherwise."""
    load, base = AirspeedLoad(DRAG), 4.7

    def power(mass_kg):
        def drawn_w(airspeed_mps, climb_mps):
            lift = mass_kg / base
            level = lift**1.6 * (1.0 + dip * (float(load.factor(airspeed_mps)) - 1.0))
            return 520.0 * (level + 0.107 * climbing * climb_mps * lift)

        return drawn_w

    scale = Scale(base, package_kg, load=load)
    scale.take_off(0.0)
    full = power(base + package_kg)
    fly(scale, 1.0, 20, full, airspeed_mps=1.0, climb_mps=2.0)
    assert scale.gain() is not None
    for begin_s, airspeed in ((30.0, 3.0), (60.0, 6.0), (90.0, 9.0), (120.0, 12.0)):
        fly(scale, begin_s, 25, full, airspeed_mps=airspeed, climb_mps=0.0)
    scale.may_be_empty()
    scale.take_off(200.0)
    fly(scale, 201.0, 8, power(base + aboard * package_kg), airspeed_mps=5.0, climb_mps=2.0)
    fly(scale, 209.0, 11, power(base + aboard * package_kg), airspeed_mps=9.0, climb_mps=0.0)
    found = scale.weigh()
    assert found.share == pytest.approx(aboard, abs=0.08)
    assert abs(found.share - aboard) < 2.0 * found.sigma


def test_a_drone_that_has_shown_nothing_but_its_gain_is_weighed_less_surely():
    """After a crash of the program the journal tells the gain of its take-offs, and no more."""
    weights = []
    for remembers in (False, True):
        scale = Scale(4.7, 0.8, load=AirspeedLoad(DRAG))
        scale.take_off(0.0)
        fly(scale, 1.0, 20, lambda *_: 800.0, airspeed_mps=1.0, climb_mps=1.0)
        gain = scale.gain()
        if remembers:
            scale = Scale(4.7, 0.8, load=AirspeedLoad(DRAG))
            scale.remember([gain])
        scale.may_be_empty()
        scale.take_off(200.0)
        fly(scale, 201.0, 20, lambda *_: 800.0, airspeed_mps=1.0, climb_mps=1.0)
        weights.append(scale.weigh())
    known, told = weights
    assert known.share == pytest.approx(1.0, abs=0.1)
    assert told.share == pytest.approx(1.0, abs=0.1)
    assert told.sigma > 1.5 * known.sigma


@pytest.mark.parametrize("aboard", [0.0, 0.5, 1.0])
def test_a_hover_before_and_after_a_winch_weighs_what_is_left_before_it_flies_on(aboard):
    scale = Scale(4.7, 0.8)
    scale.take_off(0.0)
    fly(scale, 1.0, 20, lambda *_: 800.0, airspeed_mps=1.0, climb_mps=1.0)
    fly(scale, 40.0, 12, lambda *_: 700.0, airspeed_mps=0.5, climb_mps=0.0)
    assert scale.before_release() is not None
    scale.may_be_empty()
    left_w = 700.0 * ((4.7 + 0.8 * aboard) / 5.5) ** scale.kappa
    fly(scale, 60.0, 40, lambda *_: left_w, airspeed_mps=0.5, climb_mps=0.0)
    scale.leave(100.0, hovered=True)
    found = scale.weigh()
    assert found.share == pytest.approx(aboard, abs=0.05)
    assert found.sigma < 0.1
    assert judge(Evidence(how="the winch", weight=found, package_kg=0.8))[0] is (N if aboard else D)


@pytest.mark.parametrize(
    ("autopilot", "failure"), [("px4", ""), ("ardupilot", "stuck"), ("px4", "half"), ("ardupilot", "early")]
)
def test_a_gripper_that_lies_is_found_out_within_twenty_seconds_of_the_take_off(failure, autopilot):
    run, _ = flown(70, autopilot, failure)
    assert run.verdict == (N if failure else D), run.reason
    assert run.after_s < 20.0


@pytest.mark.parametrize(("autopilot", "failure"), [("px4", ""), ("ardupilot", "stuck")])
def test_a_program_that_is_begun_again_after_the_release_weighs_all_the_same(autopilot, failure):
    """The journal tells the gain of the take-off under the package, and that the release was acknowledged."""
    _, heard = flown(70, autopilot, failure)
    notes, first = [], Judged(heard)
    first.context.note = lambda entry, _: notes.append(entry)
    released = [what for what, *_ in heard.events].index("released")
    again = dataclasses.replace(heard, events=heard.events[released + 1 :])
    first.heard = dataclasses.replace(heard, events=heard.events[: released + 1])
    first.again()
    second = Judged(again)
    second.proof.restore([SimpleNamespace(entry=lambda _, one=note: one) for note in notes], heard.package_kg)
    run = second.again()
    assert run.verdict == (N if failure else D), run.reason
    assert "by the power after take-off" in run.reason


@pytest.mark.slow
def test_no_good_delivery_is_doubted_and_no_gripper_believed_that_lies():
    runs = [deliver(seed, ("px4", "ardupilot")[seed % 2], ("", *FAILURES)[seed % 6])[0] for seed in range(500, 560)]
    assert not [run for run in runs if run.verdict != D and not run.failure]
    assert not [run for run in runs if run.verdict == D and run.failure]


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
    assert not fault or re.search(r" at \d\d:\d\d:\d\d EDT$", outcome.proof_reason), (
        "the time was in UTC, as no other of the flight"
    )
