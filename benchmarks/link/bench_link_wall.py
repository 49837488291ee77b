"""Uploads at wall time to MAVSDK's own server behind a lossy relay: ours, MAVSDK's client and a plain pymavlink one.

Each run uploads, reads back and compares. Clients run in processes of their own, several at a time: they mostly wait.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import astuple
from typing import TYPE_CHECKING, Any

from benchmarks.link.bench_link import LOSSES, MOST, bound_s, mission, p95, radio
from benchmarks.link.relay import Relay
from benchmarks.tables.figure import Figure
from skyway.sim_stub.transports.channel import Impairment

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CLIENTS = ("ours", "mavsdk", "plain")
SERVER_RETRY_S = 0.5
"""MAVSDK's server asks again after so long, five times."""
GIVE_UP_S = 30.0
_ASK_S = 1.5
_CLEAN = -1.0
_AT_ONCE = 4
_FAMILY = "ardupilot"  # no verdict is asked for: MAVSDK's server gives none


def serve(seed: int, told: Any) -> None:
    """MAVSDK's mission server behind a relay, in a process of its own; it is told of the radio, and of the end."""
    import mavsdk
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    with Relay(Impairment(), seed) as relay:
        sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.AUTOPILOT))
        sdk.add_any_connection(f"udpout://127.0.0.1:{relay.vehicle_port}")
        missions = MissionRawServer(sdk.server_component())
        missions.subscribe_incoming_mission(lambda *_: None)
        told.send(relay.ground_port)
        while (loss := told.recv()) is not None:
            relay.set_impairment(radio(loss))
        sdk.destroy()


@contextmanager
def server(seed: int) -> Iterator[tuple[int, Callable[[float], None]]]:
    """The port to speak to, and what makes the radio bad."""
    mine, its = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=serve, args=(seed, its), daemon=True)
    process.start()
    port = mine.recv()
    try:
        yield port, mine.send
    finally:
        mine.send(None)
        process.join(10.0)
        if process.is_alive():
            process.kill()


def _wire(items: int) -> Any:
    from skyway.link.protocol.verified import encode
    from skyway.missions.autopilots.registry import family_named

    return encode(mission(items - 1), family_named(_FAMILY))  # home is the first


@contextmanager
def ours(port: int) -> Iterator[Callable[[int], bool]]:
    """Our verified upload."""
    from skyway.link.protocol.opening import open_connection
    from skyway.link.vehicle.vehicle import Vehicle

    connection = open_connection(f"udpout:127.0.0.1:{port}", record=None)
    craft = Vehicle(connection, autopilot=_FAMILY)
    from skyway.link.protocol.download import Download
    from skyway.link.protocol.mission_words import MissionKind
    from skyway.link.protocol.upload import Upload

    target = craft.peer.target

    def run(items: int) -> bool:
        wire = _wire(items)
        found = []

        def steps() -> Any:
            for _ in range(6):
                yield Upload(target, wire, MissionKind.MISSION)
                down = Download(target, MissionKind.MISSION)
                yield down
                if down.items is not None and len(down.items) == len(wire):
                    found.append(down)
                    return

        connection.perform(steps())
        return bool(found)

    yield run
    connection.close()


@contextmanager
def by_mavsdk(port: int) -> Iterator[Callable[[int], bool]]:
    """MAVSDK's client: upload_mission, then download_mission."""
    import mavsdk
    from mavsdk import MavsdkError
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

    sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpout://127.0.0.1:{port}")
    found = sdk.first_autopilot(10.0)
    if found is None:
        raise RuntimeError("MAVSDK finds no vehicle")
    raw = MissionRaw(found)

    def run(items: int) -> bool:
        try:
            raw.upload_mission([MissionItem(*astuple(item)) for item in _wire(items)])
            return len(raw.download_mission()) == items
        except MavsdkError:
            return False

    yield run
    sdk.destroy()


@contextmanager
def plain(port: int) -> Iterator[Callable[[int], bool]]:
    """What most scripts do with pymavlink: answer requests, ask again for the count and what is read back."""
    from pymavlink import mavutil

    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255)
    beaten = time.monotonic()

    def beat() -> None:
        nonlocal beaten
        if time.monotonic() >= beaten:
            beaten = time.monotonic() + 1.0
            link.mav.heartbeat_send(6, 8, 0, 0, 4)

    end = time.monotonic() + 10.0
    while link.recv_match(type="HEARTBEAT", blocking=True, timeout=0.2) is None and time.monotonic() < end:
        beat()

    def heard(kinds: list[str], wait_s: float) -> Any:
        beat()
        return link.recv_match(type=kinds, blocking=True, timeout=wait_s)

    def run(items: int) -> bool:
        return _plain_upload(link, heard, _wire(items)) and _plain_download(link, heard) == items

    yield run
    link.close()


def _plain_upload(link: Any, heard: Any, wire: Any) -> bool:
    link.mav.mission_count_send(1, 1, len(wire), 0)
    last, asked = time.monotonic(), False
    while time.monotonic() < last + GIVE_UP_S:
        message = heard(["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], _ASK_S)
        if message is None:
            if not asked:
                link.mav.mission_count_send(1, 1, len(wire), 0)
            continue
        if message.get_type() == "MISSION_ACK":
            return bool(message.type == 0)
        asked, last = True, time.monotonic()
        item = wire[message.seq]
        place = (item.x, item.y, item.z, 0)
        params = (item.param1, item.param2, item.param3, item.param4)
        head = (item.seq, item.frame, item.command, item.current, item.autocontinue)
        link.mav.mission_item_int_send(1, 1, *head, *params, *place)
    return False


def _plain_download(link: Any, heard: Any) -> int:
    """Number of items read back."""
    count, got, last = None, 0, time.monotonic()
    while time.monotonic() < last + GIVE_UP_S and got != count:
        if count is None:
            link.mav.mission_request_list_send(1, 1, 0)
        else:
            link.mav.mission_request_int_send(1, 1, got, 0)
        message = heard(["MISSION_COUNT", "MISSION_ITEM_INT"], _ASK_S)
        if message is None:
            continue
        if message.get_type() == "MISSION_COUNT" and count is None:
            count, last = message.count, time.monotonic()
        elif message.get_type() == "MISSION_ITEM_INT" and message.seq == got:
            got, last = got + 1, time.monotonic()
    link.mav.mission_ack_send(1, 1, 0, 0)
    return got


def one(client: str, items: int, loss: float, runs: int) -> dict[str, Any]:
    """One client's runs: seconds of each, and how many failed."""
    opened = {"ours": ours, "mavsdk": by_mavsdk, "plain": plain}[client]
    seconds, failed = [], 0
    with server(seed=int(1000 * abs(loss)) + items) as (port, set_loss), opened(port) as run:
        if loss == _CLEAN:
            run(items)  # warm
        else:
            set_loss(loss)
        for _ in range(runs):
            begun = time.perf_counter()
            failed += not run(items)
            seconds.append(time.perf_counter() - begun)
    return {"seconds": seconds, "failed": failed}


def _in_process(client: str, items: int, loss: float, runs: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.link.bench_link_wall", client, str(items), str(loss), str(runs)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def run_all(runs: int) -> None:
    """Print each radio, with the three clients beside each other."""
    print(f"at wall time, to MAVSDK's server (asks again after {SERVER_RETRY_S} s), {runs} runs each:")
    for items in (20, 200):  # one after the other: these times are of the processor
        print(_line(items, _CLEAN, {client: _in_process(client, items, _CLEAN, 20) for client in CLIENTS}), flush=True)
    cases = [*((20, loss) for loss in LOSSES), (200, 0.1)]
    with concurrent.futures.ThreadPoolExecutor(_AT_ONCE) as pool:
        jobs = {
            (items, loss, client): pool.submit(_in_process, client, items, loss, runs)
            for items, loss in cases
            for client in CLIENTS
        }
        for items, loss in cases:
            print(_line(items, loss, {client: jobs[items, loss, client].result() for client in CLIENTS}), flush=True)


def _line(items: int, loss: float, found: dict[str, dict[str, Any]]) -> str:
    seconds = {client: f["seconds"] for client, f in found.items()}
    told = "; ".join(
        f"{client} least {min(seconds[client]):.4f} mean {statistics.mean(seconds[client]):.3f} "
        f"p95 {p95(seconds[client]):.3f} s ({f['failed']}/{len(seconds[client])} failed)"
        for client, f in found.items()
    )
    if loss == _CLEAN:
        ratio = min(seconds["ours"]) / min(seconds["mavsdk"])
        return Figure(f"{items} items, no delay, no loss", ratio, "of MAVSDK", None, told).line()
    bound = bound_s(items, loss, SERVER_RETRY_S)
    mean = statistics.mean(seconds["ours"])
    note = f"bound {bound:.2f} s; {told}"
    return Figure(f"{items} items, {100 * loss:.0f} % loss", mean / bound, "of bound", MOST, note).line()


def main() -> None:
    """One client alone, as `run_all` starts it; the answer is the last line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("client", choices=CLIENTS)
    parser.add_argument("items", type=int)
    parser.add_argument("loss", type=float)
    parser.add_argument("runs", type=int)
    options = parser.parse_args()
    found = one(options.client, options.items, options.loss, options.runs)
    print(json.dumps(found), flush=True)
    os._exit(0)  # MAVSDK's threads may outlive it


if __name__ == "__main__":
    main()
