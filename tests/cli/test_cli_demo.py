"""``skyway demo --calibration-flight``: a flight to calibrate with, for whoever has no drone."""

from pathlib import Path

import pytest


def test_a_calibration_flight_tells_the_drag(skyway):
    answer = skyway("demo", "--calibration-flight", "square.tlog", "--payload", "0.7")
    assert answer.code == 0, answer.err
    assert answer.out.startswith("wrote square.tlog")
    found = skyway("calibrate", "wind", "square.tlog", "-o", "drag.toml")
    assert found.code == 0, found
    assert Path("drag.toml").exists()


@pytest.mark.parametrize("payload", ["1.5", "-0.1", "nan", "inf"])
def test_a_calibration_flight_carries_what_the_drone_lifts(refused, payload):
    assert "--payload" in refused("demo", "--calibration-flight", "square.tlog", f"--payload={payload}")


def test_the_demonstration_itself_takes_no_payload(refused):
    assert "--calibration-flight" in refused("demo", "--payload", "0.7")


def test_a_calibration_flight_overwrites_nothing(refused):
    Path("square.tlog").write_text("mine")
    assert "exists already" in refused("demo", "--calibration-flight", "square.tlog")
    assert Path("square.tlog").read_text() == "mine"


@pytest.mark.parametrize("words", ["scenario check newyork", "wind newyork --hours 1", "network newyork"])
def test_the_built_in_scenario_has_its_name_in_every_command(skyway, words):
    answer = skyway(*words.split())
    assert answer.code == 0, answer.err
