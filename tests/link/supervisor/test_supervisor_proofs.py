"""Seeded deliveries through faults: delivered, or safe on a station with a reason; none stranded, none crashed."""

import random

import pytest

from benchmarks.link.deliveries import Stage, Story
from benchmarks.link.supervision import tell
from skyway.sim_stub.faults import parse_fault


def check(seed, tmp_path):
    told = tell(seed, tmp_path, supervised=True)
    if told is None:
        pytest.skip("no plan for this request")
    assert not told.failed, told
    assert told.state in ("delivered", "stopped-safe"), told
    assert told.reason
    assert told.lowest_soc > 0.1, told


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(300))
def test_seeded_deliveries_end_safely(seed, tmp_path):
    check(seed, tmp_path)


def flown_with(autopilot, to, faults, tmp_path):
    told = tuple(parse_fault(text) for text in faults)
    stage = Stage(Story(autopilot=autopilot, start="bellevue", to=to, faults=told, traffic=False), tmp_path)
    return stage.fly(), stage.craft


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("seed", range(6))
def test_a_pack_that_fails_in_flight_is_noticed_and_lands_on_a_station(autopilot, seed, tmp_path):
    """One autopilot reads its charge from the voltage and sees it; the other counts, and does not."""
    luck = random.Random(f"drop/{seed}")
    drop = f"battery-drop={luck.uniform(0.35, 0.55):.2f}@{luck.uniform(60.0, 420.0):.0f}s"
    outcome, craft = flown_with(autopilot, ("jacobi", "white-plains", "yankee-stadium")[seed % 3], [drop], tmp_path)
    assert not craft.autopilot.crashed, outcome
    assert outcome.state in ("delivered", "stopped-safe"), outcome
    assert craft.station() == outcome.station is not None


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_where_two_packs_fail_and_no_station_can_be_reached_it_lands_where_it_is(autopilot, tmp_path):
    faults = ["battery-drop=0.52@129s", "battery-drop=0.33@169s"]
    outcome, craft = flown_with(autopilot, "jacobi", faults, tmp_path)
    assert outcome.state == "landed-elsewhere", outcome
    assert not craft.autopilot.crashed
    assert not craft.autopilot.armed
