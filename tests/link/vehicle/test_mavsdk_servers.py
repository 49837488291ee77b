"""Missions and parameters arrive at servers that somebody else wrote, through a radio that loses packets, at wall time."""

import time

import pytest
from hosted import PARAMETERS, WHOLE_PARAMETERS, aboard, hosted
from wires import FAMILIES, a_mission

from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.verified import UploadState, compare
from skyway.missions.autopilots.registry import family_named
from skyway.sim_stub.transports.channel import Impairment

pytest.importorskip("mavsdk")


def radio(loss):
    return Impairment(loss, 0.02, 0.005, 0.02, 0.02)


def wait_for(condition, longest_s=3.0):
    """The server tells its mission from a thread of its own."""
    end = time.monotonic() + longest_s
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def upload_and_compare(craft, there, mission, family):
    """Whether an upload was verified; in any case what is said must be so."""
    before = len(there.missions)
    outcome = craft.upload(mission)
    if outcome.verified:
        assert wait_for(lambda: len(there.missions) > before), "verified, and the server has nothing"
        assert wait_for(lambda: compare(mission, there.missions[-1], family_named(family)) == ()), outcome
    else:
        assert outcome.state is UploadState.UNKNOWN, outcome
        assert outcome.reason
    return outcome.verified


@pytest.mark.parametrize("family", ["ardupilot", pytest.param("px4", marks=pytest.mark.slow)])
def test_missions_and_parameters_arrive_at_mavsdks_servers(family):
    with hosted() as (relay, there), aboard(relay, family) as craft:
        assert upload_and_compare(craft, there, a_mission(20), family)
        assert craft.set_parameter("WPNAV_SPEED", 950.0).value == 950.0
        relay.set_impairment(radio(0.1))
        assert upload_and_compare(craft, there, a_mission(6, height=60.0), family)
        assert len(craft.download(MissionKind.MISSION)) == 6


@pytest.mark.slow
def test_parameters_are_read_and_set_at_mavsdks_server_though_the_radio_is_bad():
    with hosted() as (relay, _), aboard(relay, "px4") as craft:
        craft.identify()
        relay.set_impairment(radio(0.2))
        assert craft.parameter("MPC_XY_CRUISE").value == PARAMETERS["MPC_XY_CRUISE"]
        assert craft.parameter("COM_DLL_EXCEPT").value == WHOLE_PARAMETERS["COM_DLL_EXCEPT"]
        assert craft.set_parameter("MPC_XY_CRUISE", 9.5).value == 9.5
        assert craft.set_parameter("COM_DLL_EXCEPT", 3).value == 3
        assert set(craft.parameters()) == PARAMETERS.keys() | WHOLE_PARAMETERS.keys()


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_no_upload_to_mavsdks_server_is_silently_different(family, loss):
    with hosted(seed=int(100 * loss) + 7) as (relay, there), aboard(relay, family) as craft:
        relay.set_impairment(radio(loss))
        ends = [upload_and_compare(craft, there, a_mission(20, height=30.0 + n), family) for n in range(8)]
        ends.append(upload_and_compare(craft, there, a_mission(200), family))
    assert all(ends), ends


@pytest.mark.slow
@pytest.mark.parametrize("cut_s", [0.2, 0.6, 1.0])
def test_a_cut_of_the_link_to_mavsdks_server_is_waited_out_or_told(cut_s):
    import threading

    with hosted() as (relay, there), aboard(relay, "ardupilot") as craft:
        relay.set_impairment(radio(0.0))
        assert upload_and_compare(craft, there, a_mission(5), "ardupilot")
        timers = [
            threading.Timer(cut_s, relay.set_impairment, [radio(1.0)]),
            threading.Timer(cut_s + 3.0, relay.set_impairment, [radio(0.0)]),
        ]
        for timer in timers:
            timer.start()
        assert upload_and_compare(craft, there, a_mission(30, height=70.0), "ardupilot")
        for timer in timers:
            timer.join()
