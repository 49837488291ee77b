"""How fast logs are scanned and winds filtered, against the targets and against pymavlink, in one run.

Run it with ``python benchmarks/link/bench_logs.py [LOG.tlog]``. Without a log it makes one of two systems with both MAVLink
versions. The memory test scans a log of 1 GB (``--memory-gb 4`` for the whole of the target) in a process of its own.
"""

from __future__ import annotations

import argparse
import io
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.tables.figure import best_s

SCAN_TARGET_PER_S = 1e6
PYMAVLINK_TARGET = 10.0
FILTER_TARGET_PER_S = 1e3
MEMORY_TARGET_MB = 300.0
SCAN_SCRIPT = """
import sys
from pathlib import Path
from benchmarks.tables.memory import peak_memory_mb
from skyway.link.logs.tlog.tlog import scan
index = scan(Path(sys.argv[1]))
print(index.messages, peak_memory_mb())
"""


def made_log(count: int) -> bytes:
    """A log of `count` messages: attitude, position, heartbeat and status in turn, versions 1 and 2, two systems."""
    from pymavlink.dialects.v20 import all as dialect

    out = io.BytesIO()
    links = [dialect.MAVLink(io.BytesIO(), srcSystem=system, srcComponent=1) for system in (1, 2)]
    for number in range(count):
        link = links[number % 2]
        message = [
            dialect.MAVLink_attitude_message(number, 0.1, -0.05, 1.0, 0.0, 0.0, 0.0),
            dialect.MAVLink_global_position_int_message(number, 470000000, 80000000, 500000, 60000, 900, -40, 0, 0),
            dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3),
            dialect.MAVLink_sys_status_message(0, 0, 0, 500, 22000, 1500, 70, 0, 0, 0, 0, 0, 0),
        ][number % 4]
        out.write(struct.pack(">Q", 1_700_000_000_000_000 + 10_000 * number))
        out.write(message.pack(link, force_mavlink1=number % 3 == 0))
        link.seq = (link.seq + 1) % 256
    return out.getvalue()


def bench_scan(path: Path) -> bool:
    """Messages a second, and the ratio to pymavlink on the same log."""
    from pymavlink import mavutil

    from skyway.link.logs.tlog.tlog import scan

    index = scan(path)
    seconds = best_s(lambda: scan(path))
    counts: dict[str, int] = {}

    def with_pymavlink() -> None:
        counts.clear()
        log = mavutil.mavlink_connection(str(path), dialect="all")
        while (message := log.recv_msg()) is not None:
            counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
        log.close()

    theirs = best_s(with_pymavlink, 1)
    counts.pop("BAD_DATA", None)
    rate, ratio = index.messages / seconds, theirs / seconds
    same = counts == index.by_type
    print(f"scan {path.name}: {index.messages} messages, {rate / 1e6:.2f} M/s (target {SCAN_TARGET_PER_S / 1e6:g})")
    print(
        f"  pymavlink {index.messages / theirs / 1e3:.0f} k/s: {ratio:.0f} x (target {PYMAVLINK_TARGET:g}), same: {same}"
    )
    return same and rate >= SCAN_TARGET_PER_S and ratio >= PYMAVLINK_TARGET


def bench_memory(unit: bytes, gigabytes: float) -> bool:
    """Peak memory of a scan of a large log, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.tlog"
        with path.open("wb") as stream:
            for _ in range(int(gigabytes * 1e9 / len(unit))):
                stream.write(unit)
        start = time.perf_counter()
        answer = subprocess.run(
            [sys.executable, "-c", SCAN_SCRIPT, str(path)], check=True, capture_output=True, text=True
        )
        seconds = time.perf_counter() - start
    messages, peak_mb = (float(value) for value in answer.stdout.split())
    print(f"scan of {gigabytes:g} GB: {messages / 1e6:.0f} M messages, {seconds:.0f} s, peak {peak_mb:.0f} MB")
    return peak_mb < MEMORY_TARGET_MB


def bench_filter() -> bool:
    """Updates of the wind filter of one vehicle a second."""
    from skyway.models.wind.estimation.filter import WindFilter

    wind = np.random.default_rng(0).normal(0.0, 2.0, (2000, 2)).tolist()
    live = WindFilter(0.0, 0.0, 0.0)
    matrix = np.array([[0.5, 0.1], [0.1, 0.5]])

    def one_by_one() -> None:
        for north, east in wind:
            live.advance(live.time_s + 1.0)
            live.update((north, east), matrix)

    rate = len(wind) / best_s(one_by_one, 3)
    print(f"filter: {rate / 1e3:.1f} k updates/s (target {FILTER_TARGET_PER_S / 1e3:g}: a drone gives one)")
    return rate >= FILTER_TARGET_PER_S


def main() -> int:
    """Print every figure; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--memory-gb", type=float, default=1.0)
    given = parser.parse_args()
    unit = made_log(100_000)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made.tlog"
        made.write_bytes(unit * 2)
        met = [bench_scan(path) for path in (made, *given.logs)]
    met += [bench_filter(), bench_memory(unit, given.memory_gb)]
    print("all targets met" if all(met) else "a target is missed")
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
