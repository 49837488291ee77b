"""How fast uploads are on clean and bad radios, beside a plain client and the vehicle's own retries; many vehicles.

Uploads run in virtual time against simulated vehicles, so that their times are those of the protocol alone. Each
figure is the transfer itself; reading back is told apart. The plain client answers requests and leaves every
repetition to the vehicle, as most do: that is the bound that the vehicle's retry timers allow.
"""

from __future__ import annotations

import argparse
import math
import resource
import statistics
import time
from typing import TYPE_CHECKING

from link.connection import Connection
from link.download import Download
from link.exchange import Target
from link.frames import FrameWriter
from link.live import LiveTelemetry
from link.mission_words import MissionKind
from link.upload import Upload
from link.verified import encode
from missions.commands import Command, Frame
from missions.mission import Mission, MissionItem
from sim_stub.config import VehicleConfig
from sim_stub.transports.channel import Impairment
from sim_stub.transports.lockstep import Lockstep
from sim_stub.world import World

if TYPE_CHECKING:
    from link.exchange import Exchange, Steps
    from link.frames import Message
    from link.verified import WireItem

LOSSES = (0.0, 0.05, 0.1, 0.2, 0.3)
WANTED_CORE = 0.5
PLAIN_GIVE_UP_S = 30.0


def mission(items: int) -> Mission:
    """So many waypoints."""
    return Mission(
        tuple(
            MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, x=407400000 + n * 1000, y=-739700000, z=50.0)
            for n in range(items)
        )
    )


class Plain(Upload):
    """A plain client: the count again every 1.5 s until it is asked, then only answers."""

    def _wait(self, now_s: float) -> None:
        super()._wait(now_s)
        self.next_s = now_s + 1.5

    def tick(self, now_s: float) -> None:
        """Ask again only at the beginning."""
        if self.asked < 0:
            self._count(now_s)
        elif now_s >= self._heard_s + PLAIN_GIVE_UP_S:
            self.finish()
        else:
            self.next_s = now_s + 1.5

    def _asked(self, number: int, now_s: float) -> None:
        self._heard_s, self.asked, self._tries = now_s, number, 0
        self._item(number)
        self._wait(now_s)


def scene(family: str, loss: float | None, seed: int) -> Connection:
    """A vehicle without telemetry, and our connection to it."""
    world = World()
    vehicle = world.add(VehicleConfig(lat=40.74, lon=-73.97, autopilot=family, seed=seed, warm=True))
    lockstep = Lockstep(world)
    how = Impairment() if loss is None else Impairment(loss, 0.02, 0.005, 0.02, 0.02)
    connection = Connection(lockstep.connect(vehicle, how, seed=seed), lockstep.clock)
    connection.wait(lambda: 1 in connection.peers, 20.0)
    for port in vehicle.ports:
        port.streams = {k: s for k, s in port.streams.items() if s.message.name == "HEARTBEAT"}
    return connection


def took(connection: Connection, exchange: Exchange) -> float:
    """Virtual seconds of one exchange."""

    def steps() -> Steps[None]:
        yield exchange

    begun = connection.clock.now_s()
    connection.perform(steps())
    return connection.clock.now_s() - begun


def uploads(family: str, items: int, loss: float | None, runs: int) -> None:
    """Ours beside the plain client's."""
    wire: tuple[WireItem, ...] = encode(mission(items), family)
    ours, plain, back, failed = [], [], [], 0
    for seed in range(1, runs + 1):
        connection = scene(family, loss, seed)
        trip = connection.peers[1].round_trip
        ours.append(took(connection, Upload(Target(1), wire, MissionKind.MISSION, round_trip=trip)))
        down = Download(Target(1), MissionKind.MISSION, round_trip=trip)
        back.append(took(connection, down))
        connection = scene(family, loss, seed)
        other = Plain(Target(1), wire, MissionKind.MISSION)
        plain.append(took(connection, other))
        failed += other.end.value != "accepted"
    label = "clean" if loss is None else f"{100 * loss:.0f} % loss, 20 ms"
    mean, bound = statistics.mean(ours), statistics.mean(plain)
    print(
        f"{family:<10}{items:>4} items, {label:<18} ours mean {mean:6.2f} p95 {p95(ours):6.2f} s   plain mean {bound:6.2f} "
        f"p95 {p95(plain):6.2f} s ({failed}/{runs} failed)   ratio {mean / bound if bound else math.nan:5.2f}   "
        f"read back {statistics.mean(back):6.2f} s"
    )


def p95(values: list[float]) -> float:
    """95th percentile."""
    return sorted(values)[min(len(values) - 1, math.ceil(0.95 * len(values)) - 1)]


class Canned:
    """A transport that holds what 50 vehicles say."""

    def __init__(self, packets: list[bytes]) -> None:
        self.packets = iter(packets)

    def read(self, timeout_s: float = 0.0) -> bytes:  # noqa: ARG002
        """The next packet."""
        return next(self.packets, b"")

    def write(self, data: bytes) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class Still:
    """A clock that stands."""

    def now_s(self) -> float:
        """Now."""
        return 0.0

    def posix_s(self) -> float:
        """Now."""
        return 1_373_464_800.0

    def sleep_until(self, instant_s: float) -> None:
        """Nothing."""


def many_vehicles(seconds: int = 10) -> None:
    """50 vehicles on one connection at 50 messages a second each: share of one core."""
    writers = [FrameWriter(n, 1) for n in range(1, 51)]
    packets = [w.frame("HEARTBEAT", {"type": 2, "autopilot": 12}) for w in writers]
    for tick in range(seconds * 25):
        stamp = {"time_boot_ms": tick * 40}
        for writer in writers:
            packets.append(writer.frame("ATTITUDE", {"roll": 0.1, **stamp}))
            packets.append(writer.frame("GLOBAL_POSITION_INT", {"lat": 407400000, "lon": -739700000, **stamp}))
    connection = Connection(Canned(packets), Still())
    live = {n: LiveTelemetry(n) for n in range(1, 51)}
    samples = 0

    def hear(peer: object, message: Message) -> None:  # noqa: ARG001
        nonlocal samples
        samples += live[message.system].hear(message, message.fields.get("time_boot_ms", 0) * 1e-3) is not None

    connection.listeners.append(hear)
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    wall = time.perf_counter()
    for _ in packets:
        connection.pump(0.0)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime - begun
    share = used / seconds
    print(
        f"50 vehicles, 50 messages a second each: {100 * share:.0f} % of a core ({samples} samples, "
        f"{len(packets) / (time.perf_counter() - wall):.0f} messages/s)   {WANTED_CORE / share:.2f} x what is asked for"
    )


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    for family in ("px4", "ardupilot"):
        for items in (20, 200):
            for loss in (None, *LOSSES):
                uploads(family, items, loss, runs if items == 20 else max(3, runs // 10))
    many_vehicles()


if __name__ == "__main__":
    main()
