"""A vehicle that is not ours: MAVSDK's mission and parameter servers, behind a bad radio, at wall time."""

import contextlib

from benchmarks.link.relay import Relay
from skyway.link.protocol.opening import open_connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.autopilots.wire import WireItem
from skyway.sim_stub.transports.channel import Impairment

PARAMETERS = {"MPC_XY_CRUISE": 5.0, "WPNAV_SPEED": 500.0, "RTL_RETURN_ALT": 60.0}
WHOLE_PARAMETERS = {"COM_DLL_EXCEPT": 1, "FS_OPTIONS": 8}


class Hosted:
    """What the servers have received."""

    def __init__(self):
        self.missions = []

    def take(self, result, plan, _):
        """Remember a mission that has come in whole."""
        self.missions.append([_wire(item) for item in plan.mission_items])


def _wire(item):
    fields = (
        "seq",
        "frame",
        "command",
        "current",
        "autocontinue",
        "param1",
        "param2",
        "param3",
        "param4",
        "x",
        "y",
        "z",
    )
    return WireItem(*(getattr(item, name) for name in fields))


@contextlib.contextmanager
def hosted(seed=1):
    """A relay without losses as yet, and the vehicle behind it."""
    import mavsdk
    from mavsdk.plugins.mission_raw_server import MissionRawServer
    from mavsdk.plugins.param_server import ParamServer

    there = Hosted()
    with Relay(Impairment(), seed) as relay:
        sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.AUTOPILOT))
        try:
            sdk.add_any_connection(f"udpout://127.0.0.1:{relay.vehicle_port}")
            missions = MissionRawServer(sdk.server_component())
            parameters = ParamServer(sdk.server_component())
            for name, value in PARAMETERS.items():
                parameters.provide_param_float(name, value)
            for name, value in WHOLE_PARAMETERS.items():
                parameters.provide_param_int(name, value)
            missions.subscribe_incoming_mission(there.take)
            yield relay, there
        finally:
            sdk.destroy()


@contextlib.contextmanager
def aboard(relay, family):
    """Our driver at the other end of the relay."""
    connection = open_connection(f"udpout:127.0.0.1:{relay.ground_port}", record=None)
    try:
        yield Vehicle(connection, autopilot=family)
    finally:
        connection.close()
