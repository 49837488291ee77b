"""Fifty vehicles on one UDP port at fifty messages a second each: how much of a core that takes, all told, and forwarded.

Everything is real: packets come over the loopback from another process, each vehicle from an address of its own, every
packet is recorded, checked, and made into telemetry by a `VehicleMonitor` of its own. What counts is the time of this process on
the processor, the kernel's on its behalf included. Forwarded, all of it also goes to a ground station, which counts what it gets.
"""

from __future__ import annotations

import argparse
import multiprocessing
import socket
import tempfile
import time
from pathlib import Path

from skyway.link.protocol.opening import open_connection
from skyway.link.telemetry.vehicle_monitor import VehicleMonitor
from skyway.link.wire.frames import FrameReader, FrameWriter

WANTED_CORE = 0.5
"""Share of a core that 50 vehicles may take at most."""
WANTED_FORWARDED = 0.25
"""The same where they are only checked, recorded and forwarded."""
VEHICLES, RATE_HZ = 50, 50.0
_MIX = ("ATTITUDE",) * 5 + ("GLOBAL_POSITION_INT",) * 3 + ("VFR_HUD", "SYS_STATUS")
_TICK_S = 0.02
_SETTLE_S = 1.5


def fleet(port: int, vehicles: int, seconds: float) -> None:
    """Speak as so many vehicles, each from a socket of its own, in the mix that telemetry is made of."""
    speakers = []
    for system in range(1, vehicles + 1):
        there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        there.connect(("127.0.0.1", port))
        speakers.append((there, FrameWriter(system, 1)))
    begun = time.monotonic()
    for tick in range(round(seconds / _TICK_S)):
        boot_ms = round(1e3 * tick * _TICK_S)
        for number, (there, writer) in enumerate(speakers):
            name = _MIX[(tick + number) % len(_MIX)]
            there.send(writer.frame(name, _words(name, boot_ms)))
            if tick % 50 == number:
                beat = {"type": 2, "autopilot": 12, "base_mode": 209, "mavlink_version": 3}
                there.send(writer.frame("HEARTBEAT", beat))
        time.sleep(max(0.0, begun + (tick + 1) * _TICK_S - time.monotonic()))


def _words(name: str, boot_ms: int) -> dict[str, float]:
    if name == "ATTITUDE":
        return {"time_boot_ms": boot_ms, "roll": 0.1, "pitch": -0.05, "yaw": 1.0}
    if name == "GLOBAL_POSITION_INT":
        place = {"lat": 407_400_000 + boot_ms // 100, "lon": -739_700_000, "alt": 80_000, "relative_alt": 60_000}
        return {"time_boot_ms": boot_ms, "vx": 900, **place}
    if name == "VFR_HUD":
        return {"airspeed": 9.1, "groundspeed": 9.0, "throttle": 55}
    return {"voltage_battery": 45_600, "current_battery": 1200, "battery_remaining": 80}


def measure(
    vehicles: int = VEHICLES, seconds: float = 10.0, *, watched: bool = True, forward: bool = False
) -> tuple[float, int, int]:
    """Return the share of a core, the messages taken, and the samples made, or the messages that a client got."""
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    client.bind(("127.0.0.1", 0))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
    client.settimeout(0.0)
    there = (f"udpout:127.0.0.1:{client.getsockname()[1]}",) if forward else ()
    with tempfile.TemporaryDirectory() as folder, client:
        connection = open_connection("udpin:127.0.0.1:0", record=Path(folder), forward=there)
        port = connection.transport.port  # type: ignore[attr-defined]
        other = multiprocessing.get_context("spawn").Process(
            target=fleet, args=(port, vehicles, seconds + 3 * _SETTLE_S)
        )
        other.start()
        connection.wait(lambda: len(connection.peers) == vehicles, 30.0)
        seen = [VehicleMonitor(connection, system) for system in list(connection.peers)] if watched else []
        connection.run_for(_SETTLE_S)
        peers = list(connection.peers.values())
        before = sum(one.received for one in peers)
        _waiting(client)
        came: list[bytes] = []
        for one in seen:
            one.take_samples()
        used, begun = time.process_time(), time.monotonic()
        samples = 0
        while time.monotonic() < begun + seconds:
            connection.run_for(0.1)
            samples += sum(len(one.take_samples()) for one in seen)
            came += _waiting(client)
        share = (time.process_time() - used) / (time.monotonic() - begun)
        taken = sum(one.received for one in peers) - before
        if forward:
            reader = FrameReader(datagrams=True)
            samples = sum(1 for data in came for _ in reader.feed(data))
        other.terminate()
        other.join()
        connection.close()
    return share, taken, samples


def _waiting(client: socket.socket) -> list[bytes]:
    """Datagrams that have come to a client."""
    found = []
    while True:
        try:
            found.append(client.recv(65536))
        except BlockingIOError:
            return found


def main() -> None:
    """Measure, and say how it stands beside what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=VEHICLES)
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    share, taken, samples = measure(given.vehicles, given.seconds)
    print(
        f"{given.vehicles} vehicles: {taken / given.seconds:.0f} messages/s, {samples / given.seconds:.0f} samples/s, "
        f"{100 * share:.0f} % of a core; wanted < {100 * WANTED_CORE:.0f} %   {WANTED_CORE / share:.2f} x what is asked for"
    )
    share, taken, came = measure(given.vehicles, given.seconds, watched=False, forward=True)
    print(
        f"{given.vehicles} vehicles forwarded: {taken / given.seconds:.0f} messages/s, {100 * came / taken:.1f} % of them came, "
        f"{100 * share:.0f} % of a core; wanted < {100 * WANTED_FORWARDED:.0f} %   {WANTED_FORWARDED / share:.2f} x what is asked for"
    )


if __name__ == "__main__":
    main()
