"""Lockstep: vehicle and ground side in one thread, in virtual time.

Time passes only while somebody waits: `LockstepTransport.read` and `VirtualClock.sleep_until` advance the simulation
to the next thing that happens, so a run is as fast as the machine and the same, bit for bit, from the same seed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.sim_stub.transports.channel import Impairment, Lane

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.world import World


class VirtualClock:
    """The time of a lockstep run; satisfies `models.base.clock.Clock`."""

    def __init__(self, lockstep: Lockstep) -> None:
        self._lockstep = lockstep

    def now_s(self) -> float:
        """Seconds since the start of the run."""
        return self._lockstep.now_s

    def posix_s(self) -> float:
        """POSIX seconds of the simulated instant."""
        return self._lockstep.world.epoch_s + self._lockstep.now_s

    def sleep_until(self, instant_s: float) -> None:
        """Let the simulation run until an instant."""
        self._lockstep.run_until(instant_s)


class LockstepTransport(Lane):
    """The ground side's end of an in-process link of a lockstep run to one vehicle."""

    def __init__(self, lockstep: Lockstep, vehicle: Vehicle, impairment: Impairment, seed: int) -> None:
        super().__init__(vehicle, impairment, str(seed), datagrams=True)
        self._lockstep = lockstep

    def write(self, data: bytes) -> None:
        """Send bytes to the vehicle."""
        self.up.put(self._lockstep.now_s, data)

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Bytes from the vehicle; lets time pass until there are some or the time-out is over (then empty)."""
        if not self.inbox:
            self._lockstep.run_until(self._lockstep.now_s + timeout_s, lambda: bool(self.inbox))
        data = b"".join(self.inbox)
        self.inbox.clear()
        return data

    def close(self) -> None:
        """Cut the link."""
        super().close()
        self._lockstep.drop(self)


class Lockstep:
    """A run of a world in virtual time."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.now_s = world.sim_s
        self.clock = VirtualClock(self)
        self._links: list[LockstepTransport] = []

    def connect(self, vehicle: Vehicle, impairment: Impairment | None = None, *, seed: int = 1) -> LockstepTransport:
        """Open a link to a vehicle."""
        link = LockstepTransport(self, vehicle, impairment or Impairment(), seed)
        self._links.append(link)
        return link

    def drop(self, link: LockstepTransport) -> None:
        """Forget a link."""
        if link in self._links:
            self._links.remove(link)

    def run_until(self, instant_s: float, stop: Callable[[], bool] | None = None) -> None:
        """Advance the time until an instant, or until `stop` returns true after an event."""
        world, links = self.world, self._links
        while True:
            due = min(instant_s, world.next_due_s(), world.next_wall_s())
            for link in links:
                due = min(due, link.next_s())
            now = self.now_s = max(self.now_s, due)
            world.advance(now, now)
            for link in links:
                if link.next_s() <= now:
                    link.deliver(now)
            if world.next_wall_s() <= now:
                world.advance(now, now)
            if stop is not None and stop():
                return
            if now >= instant_s and not any(link.next_s() <= now for link in links):
                return

    def run_for(self, duration_s: float) -> None:
        """Advance the time."""
        self.run_until(self.now_s + duration_s)
