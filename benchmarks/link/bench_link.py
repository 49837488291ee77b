"""How fast uploads are on clean and bad radios, beside other clients and beside what the vehicle's retry timers allow.

First in virtual time against simulated PX4 and ArduPilot, so that the times are those of the protocol alone; then at
wall time against MAVSDK's own server behind a lossy relay, beside MAVSDK's client and a plain pymavlink one
(`bench_link_wall`). Every figure is an upload and its read-back together, unless it says otherwise.

The bound is what an ideal client needs that answers in no time and leaves repetitions to the vehicle. A question or an
item is lost with q = 1 - (1 - p)^2, and then the vehicle asks again after R (PX4 0.25 s, ArduPilot 1 s): an item takes
RTT + R q / (1 - q). What the client must ask for itself (the count, and every item that it reads back) it repeats after
exactly one round trip: RTT / (1 - p)^2. The "least" is the same client repeating everything by itself after exactly one
round trip, as if it were told of each loss.
"""

from __future__ import annotations

import argparse
import math
import statistics
from typing import TYPE_CHECKING

from benchmarks.tables.figure import Figure
from skyway.link.protocol.connection import Connection
from skyway.link.protocol.download import Download
from skyway.link.protocol.exchange import Target
from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.upload import Upload, UploadEnd
from skyway.link.protocol.verified import UploadJob, encode, upload_verified
from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.sim_stub.autopilot.ardupilot.mission_server import RETRY_S as ARDUPILOT_RETRY_S
from skyway.sim_stub.autopilot.px4.mission_server import RETRY_S as PX4_RETRY_S
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import Exchange, Steps
    from skyway.missions.autopilots.wire import WireItem

HEARTBEAT = 0
"""Id of the message."""
LOSSES = (0.0, 0.05, 0.1, 0.2, 0.3)
RETRY_S = {"px4": PX4_RETRY_S, "ardupilot": ARDUPILOT_RETRY_S}
DELAY_S, JITTER_S, DOUBLED, REORDERED = 0.02, 0.005, 0.02, 0.02
ROUND_TRIP_S = 2.0 * (DELAY_S + JITTER_S / 2.0 + REORDERED * (DELAY_S + JITTER_S + 0.01))
"""Mean: a reordered packet is held back by another delay, the jitter and 10 ms."""
MOST = 1.15
"""Aim: at most the bound and 15 %."""
PLAIN_GIVE_UP_S = 30.0


def mission(items: int) -> Mission:
    """So many waypoints."""
    return Mission(
        tuple(
            MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, x=407400000 + n * 100, y=-739700000, z=50.0)
            for n in range(items)
        )
    )


def radio(loss: float) -> Impairment:
    """20 ms each way, some packets doubled and reordered."""
    return Impairment(loss, DELAY_S, JITTER_S, DOUBLED, REORDERED)


def bound_s(items: int, loss: float, retry_s: float) -> float:
    """Upload and read-back by an ideal client that leaves repetitions to the vehicle where it asks."""
    passes = (1.0 - loss) ** 2
    upload = (items + 1) * ROUND_TRIP_S + items * retry_s * (1.0 - passes) / passes
    return upload + ROUND_TRIP_S * loss / (1.0 - loss) + (items + 1) * ROUND_TRIP_S / passes


def least_s(items: int, loss: float) -> float:
    """Upload and read-back by one that is told of each loss and repeats after exactly one round trip."""
    return 2.0 * (items + 1) * ROUND_TRIP_S / (1.0 - loss) ** 2


class Plain(Upload):
    """A plain client: the count again every 1.5 s until it is asked, then only answers."""

    def _wait(self, now_s: float) -> None:
        super()._wait(now_s)
        self.next_s = now_s + 1.5

    def tick(self, now_s: float) -> None:
        """Ask again only at the beginning."""
        if self.asked < 0:
            self._count(now_s)
        elif now_s >= self.heard_s + PLAIN_GIVE_UP_S:
            self.finish()
        else:
            self.next_s = now_s + 1.5

    def _asked(self, number: int, now_s: float) -> None:
        self.heard_s, self.asked, self._tries = now_s, number, 0
        self._item(number)
        self._wait(now_s)


def scene(family: str, loss: float, seed: int) -> Connection:
    """A vehicle without telemetry, and our connection to it."""
    world = World()
    vehicle = world.add(VehicleConfig(lat=40.74, lon=-73.97, autopilot=family, seed=seed, warm=True))
    lockstep = Lockstep(world)
    connection = Connection(lockstep.connect(vehicle, radio(loss), seed=seed), lockstep.clock)
    connection.wait(lambda: 1 in connection.peers, 20.0)
    for port in vehicle.radio.ports:
        port.streams = {k: s for k, s in port.streams.items() if k == HEARTBEAT}
    return connection


def took(connection: Connection, *exchanges: Exchange) -> float:
    """Virtual seconds of exchanges, one after the other."""

    def steps() -> Steps[None]:
        yield from exchanges

    begun = connection.clock.now_s()
    connection.perform(steps())
    return connection.clock.now_s() - begun


def ours_s(family: str, wire: tuple[WireItem, ...], loss: float, seed: int) -> float:
    """Upload and read-back."""
    connection = scene(family, loss, seed)
    target = connection.peers[1].target
    up = Upload(target, wire, MissionKind.MISSION)
    down = Download(target, MissionKind.MISSION)
    passed = took(connection, up, down)
    if down.items is None or len(down.items) != len(wire):
        raise RuntimeError(f"{family}, {loss:.0%} loss, seed {seed}: {up.end.value}, {down.problem}")
    return passed


def verified_s(family: str, items: int, loss: float, seed: int) -> float:
    """All of a verified upload: what is there is read first, and PX4 is asked for its verdict."""
    connection = scene(family, loss, seed)
    peer = connection.peers[1]
    job = UploadJob(peer.target, family_named(family), mission(items), may_roll_back=lambda: True)
    begun = connection.clock.now_s()
    outcome = connection.perform(upload_verified(job))
    if not outcome.verified:
        raise RuntimeError(str(outcome))
    return connection.clock.now_s() - begun


def plain_s(family: str, wire: tuple[WireItem, ...], loss: float, seed: int) -> tuple[float, bool]:
    """A plain client's upload, and a read-back like ours; whether it was accepted."""
    connection = scene(family, loss, seed)
    other = Plain(Target(1), wire, MissionKind.MISSION)
    passed = took(connection, other)
    down = Download(connection.peers[1].target, MissionKind.MISSION)
    return passed + took(connection, down), other.end is UploadEnd.ACCEPTED


def compare(family: str, items: int, loss: float, runs: int) -> Figure:
    """Ours beside the plain client's and the bounds."""
    wire = encode(mission(items), family_named(family))
    seeds = range(1, runs + 1)
    ours = [ours_s(family, wire, loss, seed) for seed in seeds]
    whole = [verified_s(family, items, loss, seed) for seed in seeds]
    plain = [plain_s(family, wire, loss, seed) for seed in seeds]
    failed = sum(not accepted for _, accepted in plain)
    bound = bound_s(len(wire), loss, RETRY_S[family])
    mean = statistics.mean(ours)
    note = (
        f"ours mean {mean:.2f} p95 {p95(ours):.2f} s, bound {bound:.2f} s, {mean / least_s(len(wire), loss):.2f} of the "
        f"least; verified in all {statistics.mean(whole):.2f} s; plain mean {statistics.mean(s for s, _ in plain):.2f} "
        f"p95 {p95([s for s, _ in plain]):.2f} s, {failed}/{runs} failed"
    )
    return Figure(f"{family}, {items} items, {100 * loss:.0f} % loss", mean / bound, "of bound", MOST, note)


def p95(values: list[float]) -> float:
    """95th percentile."""
    return sorted(values)[min(len(values) - 1, math.ceil(0.95 * len(values)) - 1)]


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="in virtual time, of 20 items; a tenth of 200 items")
    parser.add_argument("--wall-runs", type=int, default=5, help="at wall time; 0 leaves them out")
    options = parser.parse_args()
    for family in RETRY_S:
        for items in (20, 200):
            for loss in LOSSES:
                runs = options.runs if items == 20 else max(3, options.runs // 10)
                print(compare(family, items, loss, runs).line(), flush=True)
    if options.wall_runs:
        from benchmarks.link.bench_link_wall import run_all

        run_all(options.wall_runs)


if __name__ == "__main__":
    main()
