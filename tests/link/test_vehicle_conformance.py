"""Both drivers do the same with a simulated vehicle on a socket."""

import contextlib
import socket

import pytest
from sim_serving import free_port, served
from wires import FAMILIES, a_mission

from link.mavlink_vehicle import MavlinkVehicle
from link.mission_words import MissionKind
from link.opening import open_connection
from models.errors import InputError, LinkError


@contextlib.contextmanager
def by_pymavlink(port, family):
    connection = open_connection(f"tcp:127.0.0.1:{port}", record=None)
    yield MavlinkVehicle(connection, autopilot=family)
    connection.close()


@contextlib.contextmanager
def by_mavsdk(port, family):
    pytest.importorskip("mavsdk")
    from link.mavsdk_vehicle import MavsdkVehicle

    craft = MavsdkVehicle(f"tcp:127.0.0.1:{port}", autopilot=family)
    yield craft
    craft.close()


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("driver", [by_pymavlink, by_mavsdk])
def test_both_drivers_identify_upload_verify_set_arm_and_clear(driver, family):
    port = free_port(socket.SOCK_STREAM)
    with served(tcp_port=port, autopilot=family) as there, driver(port, family) as craft:
        vehicle = there.world.vehicles[1]
        assert craft.system == 1
        assert craft.identify().version == ("1.16.0" if family == "px4" else "4.6.0")
        mission = a_mission(12)
        assert craft.upload(mission).verified
        assert len(vehicle.autopilot.stores[0]) == 12 + (family == "ardupilot")
        assert craft.verify(mission) == ()
        assert len(craft.download(MissionKind.MISSION)) == 12
        assert craft.verify(a_mission(12, height=99.0))
        name, value = ("MPC_XY_CRUISE", 9.0) if family == "px4" else ("WPNAV_SPEED", 900.0)
        assert craft.set_parameter(name, value).value == value
        assert vehicle.autopilot.parameters[name] == value
        craft.set_current(2)
        if family == "px4":
            craft.arm()
            assert vehicle.autopilot.armed
            craft.disarm()
            assert not vehicle.autopilot.armed
        craft.clear(MissionKind.MISSION)
        assert len(craft.download(MissionKind.MISSION)) == 0


def test_the_mavsdk_driver_refuses_a_signing_key_and_what_it_cannot_do():
    pytest.importorskip("mavsdk")
    from link.mavsdk_vehicle import MavsdkVehicle

    with pytest.raises(InputError, match="does not sign"):
        MavsdkVehicle("tcp:127.0.0.1:9", autopilot="px4", key=bytes(32))
    with pytest.raises(LinkError, match="no heartbeat"):
        MavsdkVehicle(f"udpin:127.0.0.1:{free_port()}", autopilot="px4", find_s=0.5)
