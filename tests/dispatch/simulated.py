"""Simulated worlds for tests, in a thread."""

import threading
from contextlib import contextmanager

from skyway.scenarios import load_scenario
from skyway.sim_stub.fleet import FleetOptions, build_world
from skyway.sim_stub.transports.lockstep_client import LockstepClient
from skyway.sim_stub.transports.shared_lockstep import SharedLockstep


@contextmanager
def world_of(vehicles=1):
    """Serve a world with some vehicles; yields its address."""
    stations = load_scenario(None).network.stations
    shared = SharedLockstep(
        build_world(FleetOptions(stations=stations, places=stations[:1], vehicles=vehicles, warm=True))
    )
    thread = threading.Thread(target=shared.serve, daemon=True)
    thread.start()
    address = "{}:{}".format(*shared.address)
    try:
        yield address
    finally:
        client = LockstepClient(address, "end")
        client.order("end")
        client.close()
        thread.join(10.0)
