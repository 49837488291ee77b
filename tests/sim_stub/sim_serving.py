"""A world served on sockets from a thread, for peers that live at wall time."""

import contextlib
import socket
import threading

from sim_station import LAT, LON

from skyway.models.network.station import Station as Place
from skyway.sim_stub.fleet import FleetOptions, build_world, serve
from skyway.sim_stub.transports.urls import parse_address

HERE = Place("here", "Here", LAT, LON, 5.0, 2, 2)


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Served:
    """The running loop, and where it listens."""

    def __init__(self, world, loop, told):
        self.world, self.loop, self.told = world, loop, told
        self.errors = []
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        try:
            self.loop.run()
        except BaseException as error:
            self.errors.append(error)
            raise

    def where(self, number=0):
        """HOST, PORT of the listener told as `number`."""
        host, port = self.told[number].rsplit(" ", 1)[1].split(":")[1:]
        return host, int(port)


@contextlib.contextmanager
def served(*, connect=(), tcp_port=None, pads=None, speedup=1.0, impairment=None, **options):
    options.setdefault("warm", True)
    world = build_world(FleetOptions(stations=(HERE,), places=(HERE,), **options))
    loop, told = serve(
        world,
        connect=tuple(parse_address(text, option="--connect") for text in connect),
        tcp_port=tcp_port,
        pads=None if pads is None else parse_address(pads, option="--pads", kinds=("tcp",)),
        impairment=impairment,
        speedup=speedup,
    )
    running = Served(world, loop, told)
    try:
        yield running
    finally:
        loop.stop()
        running.thread.join(10.0)
        assert not running.thread.is_alive()
        assert not running.errors, running.errors
