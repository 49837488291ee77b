"""The loop that runs a world in real time or faster."""

from __future__ import annotations

import selectors
import time
from typing import TYPE_CHECKING, TypeAlias

from skyway.models.base.errors import InputError
from skyway.models.base.ranges import range_faults

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.transports.tcp import TcpListener, VehiclePeer
    from skyway.sim_stub.transports.udp import UdpEndpoint
    from skyway.sim_stub.world import World

Endpoint: TypeAlias = "TcpListener | VehiclePeer | UdpEndpoint"
"""Something with a socket in the loop; never blocking, closed on any error."""
MAX_SPEEDUP = 20.0
"""In the air: beyond it no ground station keeps up."""
MAX_PAD_SPEEDUP = 2000.0
_TICK_S = 0.01
_MAX_CATCH_UP_S = 0.25


class SocketLoop:
    """Runs a world in real time, `speedup` simulated seconds to the second.

    That is 0.1 to 20 while anybody flies or has the motors on; while everybody stands it is `pad_speedup`, up to 2,000;
    an `InputError` refuses others. Protocol timers run at wall time, everything else at simulated time. When the
    machine cannot keep up, simulated time falls behind rather than jump.
    """

    def __init__(self, world: World, *, speedup: float = 1.0, pad_speedup: float | None = None) -> None:
        faults = range_faults("--speedup", speedup, 0.1, MAX_SPEEDUP, f"0.1 to {MAX_SPEEDUP:g} in the air")
        if pad_speedup is not None:
            faults += range_faults("--pad-speedup", pad_speedup, 0.1, MAX_PAD_SPEEDUP, f"0.1 to {MAX_PAD_SPEEDUP:g}")
        if faults:
            raise InputError(faults)
        self.world = world
        self.speedup = speedup
        self.pad_speedup = speedup if pad_speedup is None else pad_speedup
        self.selector = selectors.DefaultSelector()
        self.endpoints: list[Endpoint] = []
        self._start = time.monotonic() - world.wall_s
        self.stopping = False

    def add(self, endpoint: Endpoint) -> None:
        """Serve a socket."""
        self.endpoints.append(endpoint)

    def stop(self) -> None:
        """End `run` at the next turn; may be called from a signal handler or another thread."""
        self.stopping = True

    def run(self, until: Callable[[], bool] | None = None) -> None:
        """Run until `stop`, or until the condition holds; closes every socket in the end."""
        try:
            while not self.stopping and (until is None or not until()):
                self.turn(_TICK_S)
        finally:
            self.close()

    def turn(self, longest_s: float) -> None:
        """Read what has arrived, let time pass, send what is waiting."""
        world = self.world
        begun = time.monotonic()
        rate = self.speedup if world.anyone_active else self.pad_speedup
        wait = self._wait_s(begun - self._start, rate, longest_s)
        for key, _ in self.selector.select(wait):
            key.data.readable()
        wall = time.monotonic() - self._start
        passed = min(max(wall - world.wall_s, 0.0), _MAX_CATCH_UP_S)
        world.advance(world.sim_s + passed * rate, wall)
        for endpoint in self.endpoints:
            endpoint.flush(wall)
        left = _TICK_S / 2.0 - (time.monotonic() - begun)
        if left > 0.0:
            time.sleep(left)  # gather packets rather than turn at each one

    def _wait_s(self, wall: float, rate: float, longest_s: float) -> float:
        world = self.world
        due = min((world.next_due_s() - world.sim_s) / rate, world.next_wall_s() - wall)
        due = min([due, *(endpoint.next_s() - wall for endpoint in self.endpoints)])
        return min(max(due, 0.0), longest_s)

    def close(self) -> None:
        """Close every socket."""
        for endpoint in self.endpoints:
            endpoint.close()
        self.endpoints.clear()
        self.selector.close()
