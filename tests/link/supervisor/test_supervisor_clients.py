"""A delivery beside other ground stations: what they may is told and answered as a pilot's, what they may not changes nothing."""

import os
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.forwarding.forwarder import Forwarder
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import ClientNote

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)


class Beside:
    """Another ground station, of pymavlink's, on the link of a delivery."""

    def __init__(self, stage):
        self.stage = stage
        stage.forwarder = Forwarder(("udpin:127.0.0.1:0",), own=(255, 195))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", stage.forwarder.endpoints[0].port))
        self.mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
        self.times = 0

    def say(self, message):
        self.socket.send(message.pack(self.mav))

    def beat(self):
        self.times += 1
        self.say(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def misbehave(self, context):
        """All at once, every second: a flood, garbage, a mission, the vehicle's and our own id."""
        self.beat()
        self.socket.send(os.urandom(1000))
        for system, component in ((1, 1), (255, 195)):
            other = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
            other.seq = 77
            self.socket.send(dialect.MAVLink_heartbeat_message(2, 12, 29, 0, 5, 3).pack(other))
        self.say(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
        self.say(dialect.MAVLink_param_set_message(1, 1, b"MPC_XY_VEL_MAX", 1.0, 9))
        for _ in range(20):
            self.say(dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0))

    def close(self):
        self.socket.close()
        self.stage.forwarder.close()


@pytest.fixture
def stage(tmp_path):
    made = Stage(STORY, tmp_path)
    made.operator = Scripted(
        lambda question, _: (3.0, "leave" if "leave" in question else "yes"), lambda: made.lockstep.now_s
    )
    return made


def notes(stage):
    return [ClientNote.read(r.data) for r in read_journal(stage.journal_path).records if r.event == "client"]


@pytest.mark.slow
def test_a_station_that_misbehaves_all_the_time_changes_nothing_about_a_delivery(stage):
    beside = Beside(stage)
    stage.forwarder.permission = type(stage.forwarder.permission).NONE
    outcome = stage.fly(on_tick=beside.misbehave)
    assert outcome.delivered, outcome
    told = [line for line in stage.operator.lines if "client" in line]
    kinds = {note.what for note in notes(stage)}
    assert {"joined", "refused", "impersonates"} <= kinds
    assert beside.times > 100
    assert len(told) <= 3 + 3 * (1 + beside.times / 5)
    beside.close()


def test_a_mode_that_another_station_switches_to_is_answered_as_a_pilots(stage):
    beside = Beside(stage)

    def switch(context):
        beside.beat()
        if context.state == "flying" and context.observed.sample.height_m > 30.0:
            beside.say(dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, 3, 0, 0, 0, 0, 0))

    outcome = stage.fly(on_tick=switch)
    assert outcome.state == "left-to-itself"
    passed = [note for note in notes(stage) if note.what == "passed"]
    assert [(note.system, note.component, note.order) for note in passed] == [(255, 190, "DO_SET_MODE")]
    assert any("switched the drone to mode position" in line for line in stage.operator.lines)
    beside.close()
