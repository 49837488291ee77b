"""Calibration and health are one entry of the list before the first take-off of a day."""

import re
from dataclasses import replace
from zoneinfo import ZoneInfo

import pytest

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.vehicle.health_book import HealthBook
from skyway.sim_stub.faults import parse_fault

SHORT = {"start": "jersey-city", "to": "hoboken", "traffic": False}
DAY, LATER, NEXT_DAY = "2013-07-10T14:00-04:00", "2013-07-10T15:00-04:00", "2013-07-11T09:00-04:00"


class Hangar(Stage):
    """A delivery of which each vehicle is looked at once a day."""

    def __init__(self, folder, autopilot="px4", *, faults=(), depart=DAY, **vehicle):
        named = folder / str(len(list(folder.iterdir())))
        named.mkdir()
        faults = tuple(map(parse_fault, faults))
        super().__init__(Story(autopilot=autopilot, faults=faults, depart=depart, vehicle=vehicle, **SHORT), named)
        self.operator = Scripted(lambda _q, _n: (2.0, "no"), self.lockstep.clock.now_s)
        self.book = HealthBook(folder, ZoneInfo("America/New_York"))

    def job(self):
        return replace(super().job(), health=self.book)

    def checked(self):
        """How it ended, and what the list said of its health, first and last."""
        outcome = self.fly()
        records = read_journal(self.journal_path).records
        told = [one.data["said"] for one in records if one.event == "check" and one.data.get("name") == "health"]
        return outcome, told


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)])
def test_it_is_looked_at_once_a_day(autopilot, tmp_path):
    outcome, told = Hangar(tmp_path, autopilot).checked()
    assert "no" in outcome.reason or outcome.state == "stopped-safe"
    assert told[0].startswith("sensors, filter")
    assert "unknown: battery cells" in told[0]
    _, again = Hangar(tmp_path, autopilot, depart=LATER).checked()
    assert re.match(r"checked at [\d-]+ \d\d:\d\d EDT; ", again[0]), "the time was in UTC, as no other of the flight"
    assert "; now: sensors, filter, GPS; unknown: battery cells" in again[0]


def test_what_went_wrong_since_the_check_of_the_day_keeps_it_on_the_ground(tmp_path):
    Hangar(tmp_path).checked()
    outcome, told = Hangar(tmp_path, depart=LATER, faults=["sensor-ill=compass"]).checked()
    assert outcome.state == "stopped-safe"
    assert "sensors: not healthy: compass" in outcome.reason
    assert told[0] == "sensors: not healthy: compass"


@pytest.mark.slow
def test_another_day_is_looked_at_again(tmp_path):
    Hangar(tmp_path).checked()
    assert Hangar(tmp_path, depart=NEXT_DAY).checked()[1][0].startswith("sensors, filter")


@pytest.mark.slow
def test_what_is_ill_keeps_it_on_the_ground_and_is_named(tmp_path):
    outcome, told = Hangar(tmp_path, faults=["sensor-ill=compass"]).checked()
    assert outcome.state == "stopped-safe"
    assert "sensors: not healthy: compass" in outcome.reason
    assert "not healthy: compass" in told[0]


def test_what_comes_right_is_waited_for(tmp_path):
    _, told = Hangar(tmp_path, faults=["sensor-ill=barometer+60s"]).checked()
    assert "not healthy: barometer" in told[0]
    assert told[-1].startswith("sensors, filter")


@pytest.mark.slow
def test_without_a_book_nobody_looks(tmp_path):
    stage = Hangar(tmp_path, faults=["sensor-ill=compass"])
    stage.book = None
    assert stage.checked()[1] == []
