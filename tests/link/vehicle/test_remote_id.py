"""Remote ID on the wire: the module lacks what nobody sends, is ready once we send, and its silence is heard; on both autopilots."""

import pytest
from wires import FAMILIES, LAT, Scene

from skyway.link.vehicle.remote_id import RemoteIdSender, module_status
from skyway.link.vehicle.vehicle import Vehicle
from skyway.models.base.errors import CommandRefusedError
from skyway.models.scenario.remote_id import RemoteId
from skyway.sim_stub.faults import parse_fault

WHO = RemoteId(operator_id="FIN87astrdge12k8", self_id="parcels")
ENFORCED = {
    "px4": (("COM_ARM_ODID", 2.0),),
    "ardupilot": (("DID_ENABLE", 1.0), ("DID_OPTIONS", 1.0)),
}


def status(scene, peer):
    return module_status(peer, scene.connection.clock.now_s())


def sender(scene, who=WHO):
    vehicle = Vehicle(scene.connection, 1)
    vehicle.request_telemetry()
    found = RemoteIdSender(scene.connection, vehicle.peer, who)
    return vehicle, found


@pytest.mark.parametrize("family", FAMILIES)
def test_the_module_lacks_what_nobody_sends_and_is_ready_when_we_do(family):
    scene = Scene(family, remote_id=True)
    vehicle, sends = sender(scene)
    scene.connection.run_for(3.0)
    found = status(scene, vehicle.peer)
    assert (found.heard, found.ready) == (True, False)
    assert {"SELF_ID", "OP_ID", "SYS", "OP_LOC"} <= set(found.lacks.split())
    sends.begin()
    scene.connection.run_for(4.0)
    assert status(scene, vehicle.peer).ready, status(scene, vehicle.peer)
    told = scene.vehicle.remote_id.told
    assert told["OPEN_DRONE_ID_OPERATOR_ID"].operator_id == "FIN87astrdge12k8"
    assert told["OPEN_DRONE_ID_SELF_ID"].description == "parcels"
    system = told["OPEN_DRONE_ID_SYSTEM"]
    assert system.operator_location_type == 0
    assert system.operator_latitude * 1e-7 == pytest.approx(LAT, abs=1e-4)
    assert (
        system.timestamp == pytest.approx(scene.world.epoch_s + scene.vehicle.sim_s - 1_546_300_800, abs=5)
        or system.timestamp == 0
    )
    sends.end()
    scene.connection.run_for(6.0)
    assert "SYS" in status(scene, vehicle.peer).lacks


def test_a_fixed_place_of_the_operator_is_said_to_be_one():
    scene = Scene("px4", remote_id=True)
    _, sends = sender(scene, RemoteId(lat_deg=48.5, lon_deg=11.5))
    sends.begin()
    scene.connection.run_for(2.0)
    system = scene.vehicle.remote_id.told["OPEN_DRONE_ID_SYSTEM"]
    assert (system.operator_location_type, system.operator_latitude) == (2, 485_000_000)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_absent_module_and_one_that_falls_silent_are_told(family):
    scene = Scene(family)
    vehicle, _ = sender(scene)
    scene.connection.run_for(3.0)
    assert str(status(scene, vehicle.peer)) == "no Remote ID module is heard"
    scene = Scene(family, remote_id=True, faults=(parse_fault("remote-id-off@5s"),))
    vehicle, sends = sender(scene)
    sends.begin()
    scene.connection.run_for(4.0)
    assert status(scene, vehicle.peer).heard
    scene.connection.run_for(8.0)
    assert not status(scene, vehicle.peer).heard


@pytest.mark.parametrize("family", FAMILIES)
def test_an_autopilot_that_enforces_it_is_armed_only_while_who_flies_is_sent(family):
    scene = Scene(family, remote_id=True, parameters=ENFORCED[family])
    vehicle, sends = sender(scene)
    scene.connection.run_for(2.0)
    with pytest.raises(CommandRefusedError):
        vehicle.arm()
    sends.begin()
    scene.connection.run_for(4.0)
    vehicle.arm()
    assert vehicle.armed
