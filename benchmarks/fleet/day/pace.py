"""The same time for several simulated worlds: none runs ahead of another, so that the operators of a day compete for the same pads at the same time."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError
from skyway.sim_stub.transports.lockstep_client import LockstepClient

if TYPE_CHECKING:
    from collections.abc import Callable

AHEAD_S, STEP_S = 60.0, 20.0
"""By how much a world may be ahead of the slowest, and how often it is compared, in simulated time."""
LOOK_WALL_S = 0.02
"""How often, in wall time, a world that waits looks whether it may go on."""


class Pace:
    """Takes part in some worlds and holds those that are ahead.

    Parameters
    ----------
    addresses : dict
        By operator, a function that returns the address of its world, or raises an `OSError` before there is one.
    """

    def __init__(self, addresses: dict[str, Callable[[], str]]) -> None:
        self._now_s = dict.fromkeys(addresses, 0.0)
        self._end = threading.Event()
        self._threads = [threading.Thread(target=self._keep, args=one, daemon=True) for one in addresses.items()]

    def start(self) -> None:
        """Begin: a world waits for those that have not begun yet."""
        for one in self._threads:
            one.start()

    def stop(self) -> None:
        """Let all worlds go on."""
        self._end.set()
        for one in self._threads:
            one.join(5.0)

    def _keep(self, name: str, address: Callable[[], str]) -> None:
        while not self._end.wait(LOOK_WALL_S):
            with (
                contextlib.suppress(OSError, SkywayError),
                contextlib.closing(LockstepClient(address(), "pace")) as world,
            ):
                try:
                    self._follow(name, world)
                finally:
                    self._now_s[name] = math.inf  # its world has ended: nobody waits for it

    def _follow(self, name: str, world: LockstepClient) -> None:
        while not self._end.is_set():
            self._now_s[name] = world.now_s()
            while world.now_s() > min(self._now_s.values()) + AHEAD_S and not self._end.is_set():
                time.sleep(LOOK_WALL_S)
            world.sleep_until(world.now_s() + STEP_S)
