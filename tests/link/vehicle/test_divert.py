"""A vehicle whose new mission is not verified in flight is held, or brought to a refuge and landed there."""

import math

import pytest
from wires import FAMILIES, LAT, LON, Scene, a_mission, bad_radio

from skyway.link.protocol.verified import UploadState
from skyway.link.vehicle.divert import Diversion, DivertState, Refuge
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.missions.items.mission import Mission
from skyway.models.base.errors import CommandRefusedError, InputError, UploadMismatchError
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.physics import offset_m

REFUGE = Refuge(LAT + 0.0012, LON - 0.0009, 35.0)


def in_flight(family, **how):
    scene = Scene(family, **how)
    scene.craft = Vehicle(scene.connection)
    scene.craft.request_telemetry()
    assert scene.craft.upload(a_mission(6, height=30.0)).verified
    scene.craft.start(patience_s=60.0)
    assert scene.connection.wait(lambda: scene.craft.live.latest("height_m") > 25.0, 120.0)
    return scene


def lose_item_four(_number, message, frame, up):
    return b"" if up and message and message.name == "MISSION_ITEM_INT" and message["seq"] == 4 else frame


def divert(craft, refuge):
    """Fly to a refuge and land there."""
    list(craft.samples(0.05))  # what it told while nobody asked is not of now
    diversion = Diversion(craft, refuge)
    diversion.begin()
    for sample in craft.samples():
        if diversion.hear(sample).over:
            return diversion
    raise AssertionError("nothing is heard of the vehicle")


def change_or_divert(craft, mission, current, refuge=None):
    """Change the mission in flight; where that is not verified, divert to a refuge, or stay in hold."""
    outcome = craft.change_in_flight(mission, current)
    return outcome, None if outcome.verified or refuge is None else divert(craft, refuge)


def from_refuge_m(scene):
    body = scene.vehicle.body
    return math.hypot(*offset_m(REFUGE.lat_deg, REFUGE.lon_deg, body.lat, body.lon))


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_an_unverified_change_in_flight_is_diverted_and_landed_at_the_refuge(family, loss):
    scene = in_flight(family, impairment=bad_radio(loss))
    scene.link.spoil = lose_item_four
    outcome, diversion = change_or_divert(scene.craft, a_mission(8, height=45.0), 3, REFUGE)
    assert outcome.state is UploadState.UNKNOWN
    assert diversion.state is DivertState.LANDED, diversion.reason
    assert scene.vehicle.body.grounded
    assert not scene.vehicle.autopilot.armed
    assert from_refuge_m(scene) < 3.0
    with pytest.raises(UploadMismatchError, match="start blocked"):
        scene.craft.start()


def test_a_change_that_px4_takes_and_will_not_fly_is_diverted_too():
    scene = in_flight("px4")
    items = a_mission(8, height=45.0).items
    wrong = Mission((*items[:3], items[0], *items[3:]))
    outcome, diversion = change_or_divert(scene.craft, wrong, 3, REFUGE)
    assert outcome.state is UploadState.REFUSED
    assert outcome.infeasible
    assert "takeoff is not the first" in outcome.reason
    assert diversion.state is DivertState.LANDED
    assert from_refuge_m(scene) < 3.0


@pytest.mark.parametrize("family", FAMILIES)
def test_a_verified_change_goes_on_and_one_without_a_refuge_holds(family):
    scene = in_flight(family)
    outcome, diversion = change_or_divert(scene.craft, a_mission(8, height=45.0), 3, REFUGE)
    assert outcome.verified
    assert diversion is None
    assert scene.craft.mode == "mission"
    scene.link.spoil = lose_item_four
    outcome, diversion = change_or_divert(scene.craft, a_mission(8, height=60.0), 3)
    assert outcome.state is UploadState.UNKNOWN
    assert diversion is None
    scene.connection.run_for(20.0)
    assert scene.craft.mode == "hold"
    assert scene.vehicle.autopilot.armed


@pytest.mark.parametrize("when", [3.0, 45.0], ids=["on the way", "while it lands"])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_pilot_who_takes_over_is_left_in_command(family, when):
    scene = in_flight(family)
    far = Refuge(REFUGE.lat_deg, REFUGE.lon_deg, 60.0) if when > 40.0 else REFUGE
    scene.world.inject(Fault("pilot", when, word="position"))
    diversion = divert(scene.craft, far)
    assert diversion.state is DivertState.TAKEN
    assert (from_refuge_m(scene) > 20.0) == (when < 10.0)
    assert "position" in diversion.reason
    scene.connection.run_for(5.0)
    assert scene.craft.mode == "position"
    assert scene.vehicle.autopilot.armed


def test_one_that_does_not_come_closer_is_told_again_and_then_given_up():
    scene = in_flight("px4")
    ordered = []

    def spoil(_number, message, frame, up):
        if up and message and message.name == "COMMAND_INT":
            ordered.append(message)
            here = scene.vehicle.body
            writer_fields = message.fields | {"x": round(here.lat * 1e7), "y": round(here.lon * 1e7)}
            return FrameWriter(message.system, message.component).frame("COMMAND_INT", writer_fields)
        return frame

    scene.link.spoil = spoil
    diversion = divert(scene.craft, REFUGE)
    assert diversion.state is DivertState.OVERDUE
    assert "sent there 4 times" in diversion.reason
    assert len(ordered) == 4
    assert scene.craft.mode == "hold"


def test_ardupilot_refuses_a_refuge_beyond_its_fence():
    """PX4 accepts, and stays where it is."""
    fence = (("FENCE_ENABLE", 1), ("FENCE_TYPE", 2), ("FENCE_RADIUS", 60))
    scene = Scene("ardupilot", parameters=fence)
    with pytest.raises(CommandRefusedError, match="go there"):
        divert(Vehicle(scene.connection), REFUGE)


def test_a_refuge_is_a_place_on_earth():
    with pytest.raises(InputError, match="no"):
        Refuge(91.0, 0.0, 30.0)
