"""The page under load: vehicles at 1 Hz on one map, in several browsers at once. ``python -m benchmarks.web.bench_page [--vehicles 500] [--seconds 60]``.

Frames per second while one browser zooms and drags, time from a packet to the frame that shows it, processor of the server, growth of memory, and how
long a page takes until it can be used. It needs Chromium and the package playwright; without them it says so.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import socket
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from benchmarks.web.memory import rss_mb, unwatched
from tests.web.browsing import chromium
from tests.web.conftest import ended, served
from tests.web.simulated import free_port

EACH = 125
"""Vehicles on one connection."""
LOOKS = 24
"""Times that memory is looked at in a run of up to `LONGEST_S` between them."""
LONGEST_S = 60.0
"""Between two looks at memory."""
SETTLE_S = 120.0
"""Browsers have loaded and laid out everything after so long."""
STAMP = 10_000_000
"""The last digits of a latitude, 1e-7 degrees, tell the milliseconds of the packet, up to this."""
BASE = 407_000_000

FRAMES = """async () => {
  const map = window.skywayMap, box = map.canvas.getBoundingClientRect();
  let frames = 0, worst = 0, last = performance.now(); const begun = last;
  while (performance.now() - begun < 6000) {
    await new Promise(requestAnimationFrame);
    const now = performance.now(); worst = Math.max(worst, now - last); last = now; frames++;
    map.view.zoomAt(box.width / 2, box.height / 2, 0.02 * Math.sin(now / 400)); map.view.pan(3 * Math.sin(now / 300), 2 * Math.cos(now / 500)); map.changed();
  }
  return [frames / ((performance.now() - begun) / 1000), worst];
}"""

DELAYS = """async (id) => {
  const found = []; let before = null; const begun = performance.now();
  while (performance.now() - begun < 12000) {
    await new Promise(requestAnimationFrame);
    const one = window.skywayMap.state.vehicles.find((v) => v.id === id); if (!one) continue;
    const stamp = Math.round(one.lat * 1e7) - 407000000;
    if (stamp !== before && before !== null) found.push(((Date.now() % 10000000) - stamp + 10000000) % 10000000);
    before = stamp;
  }
  return found;
}"""


class Traffic:
    """Vehicles that tell where they are once a second, evenly over the second."""

    def __init__(self, ports: list[int], count: int) -> None:
        self.count, self.ports = count, ports
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._going = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        links = [mavlink.MAVLink(None, srcSystem=1 + n % EACH, srcComponent=1) for n in range(self.count)]
        begun = time.monotonic()
        at = 0
        while self._going:
            n = at % self.count
            wait = begun + at / self.count - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            boot_ms = int(1000.0 * (time.monotonic() - begun))
            link, where = links[n], ("127.0.0.1", self.ports[n // EACH])
            lon = -739_000_000 + 60_000 * (n % 40)
            row = 0 if n % EACH == 0 else 100_000 * (n // 40)
            lat = BASE + row + int(1000.0 * time.time()) % STAMP  # 11.13 m/s northwards
            beat = link.heartbeat_encode(2, 12, 209, 4 << 16 | 4 << 24, 4)
            attitude = link.attitude_encode(boot_ms, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0)
            place = link.global_position_int_encode(boot_ms, lat, lon, 70_000, 60_000, 1113, 0, 0, 0)
            for message in (beat, attitude, place):
                self.socket.sendto(message.pack(link), where)
            at += 1

    def stop(self) -> None:
        self._going = False
        self._thread.join(5.0)


def cpu_s(pid: int) -> float:
    """Processor seconds of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory(page: Any, seconds: float, browsers: int) -> None:
    """Watch how the server and browsers grow, after they have settled.

    Garbage is collected in the first browser alone, each time; the others are left as an operator's are, but at the beginning and at the end.
    """
    with contextlib.ExitStack() as stack:
        opened = [stack.enter_context(unwatched(f"{page.address}/fly")) for _ in range(browsers)]
        time.sleep(SETTLE_S)
        kept = [one.kept() for one in opened]
        first = rss_mb(page.process.pid), [one.held() for one in opened]
        moves = json.loads(page.ask("/api/positions?since=0")[2])["version"]
        begun, used = time.monotonic(), cpu_s(page.process.pid)
        last = first
        every_s = min(LONGEST_S, seconds / LOOKS)
        seen: list[tuple[float, ...]] = []
        while (left := begun + seconds - time.monotonic()) > 0.0:
            time.sleep(min(every_s, left))
            last = rss_mb(page.process.pid), [one.held() for one in opened]
            seen.append(((time.monotonic() - begun) / 3600.0, last[0], *(one.own_mb for one in last[1])))
            own = ", ".join(f"{one.own_mb:.1f} ({one.page_mb:.1f} page, {one.pss_mb:.1f} PSS)" for one in last[1])
            minutes = (time.monotonic() - begun) / 60.0
            print(
                f"  {minutes:5.1f} min: server {last[0]:.1f} MB; browsers {own} MB; first: {opened[0].kept()}",
                flush=True,
            )
        moves = json.loads(page.ask("/api/positions?since=0")[2])["version"] - moves
        heard = len(json.loads(page.ask("/api/fleet")[2])["vehicles"])
        told(f"moves heard of {heard} vehicles", moves / (time.monotonic() - begun), "1/s", "")
        share = 100.0 * (cpu_s(page.process.pid) - used) / (time.monotonic() - begun)
        for before, one in zip(kept, opened, strict=True):
            print(f"  kept by scripts: {before} -> {one.kept()}", flush=True)
    told(f"server with {browsers} browsers", share, "% of a core", "<= 60")
    told(f"growth of the server in {seconds:.0f} s", last[0] - first[0], "MB", "<= 50 in 2 h")
    for number, slope in enumerate(slopes(seen)):
        who = f"browser {number}" if number else "the server"
        told(f"growth of {who}, fitted to the second half", slope, "MB/h", "<= 25")
    for name in ("own_mb", "page_mb", "pss_mb"):
        most = max(getattr(b, name) - getattr(a, name) for a, b in zip(first[1], last[1], strict=True))
        told(f"growth of a browser in {seconds:.0f} s, {name}", most, "MB", "<= 50 in 2 h")


def slopes(seen: list[tuple[float, ...]]) -> list[float]:
    """Growth an hour of each column, by a straight line through the second half of the rows; the first column is the time in hours."""
    rows = np.array(seen[len(seen) // 2 :])
    return [float(np.polyfit(rows[:, 0], column, 1)[0]) for column in rows[:, 1:].T] if len(rows) > 2 else []


def measure(vehicles: int, seconds: float, browsers: int) -> None:
    ports = [free_port() for _ in range(math.ceil(vehicles / EACH))]
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        page = served(Path(folder))
        traffic = Traffic(ports, vehicles)
        try:
            _measure(browser, page, ports, (vehicles, browsers))
            memory(page, seconds, browsers)
        finally:
            traffic.stop()
            ended(page)


def _measure(browser: Any, page: Any, ports: list[int], how: tuple[int, int]) -> None:
    vehicles, browsers = how
    time.sleep(5.0)
    contexts = [browser.new_context(viewport={"width": 1280, "height": 900}) for _ in range(browsers)]
    tabs = [context.new_page() for context in contexts]
    begun = time.monotonic()
    tabs[0].goto(f"{page.address}/fly")
    tabs[0].wait_for_function("window.skywayMap?.state.region && document.querySelector('.tabs')")
    told("page usable after", time.monotonic() - begun, "s", "<= 2")
    for port in ports:
        tabs[0].get_by_label("Connection", exact=True).fill(f"udpin:127.0.0.1:{port}")
        tabs[0].get_by_label("Connection", exact=True).press("Tab")
        tabs[0].get_by_role("button", name="Watch").click()
        tabs[0].get_by_role("button", name=f"udpin:127.0.0.1:{port}").wait_for()
    for tab in tabs[1:]:
        tab.goto(f"{page.address}/fly")
    for tab in tabs:
        tab.bring_to_front()
        tab.wait_for_function(f"window.skywayMap?.state.vehicles.length >= {vehicles}", timeout=90_000)
    tabs[0].bring_to_front()
    time.sleep(5.0)
    delays = sorted(tabs[0].evaluate(DELAYS, f"udpin:127.0.0.1:{ports[0]} 1"))
    told("packet to screen, median", delays[len(delays) // 2], "ms", "<= 300")
    told("packet to screen, slowest of 10", delays[int(0.9 * (len(delays) - 1))], "ms", "<= 300")
    frames, worst = tabs[0].evaluate(FRAMES)
    told("frames while zooming and dragging", frames, "1/s", ">= 30")
    told("longest frame", worst, "ms", "")
    for context in contexts:
        context.close()


def told(name: str, value: float, unit: str, target: str) -> None:
    print(f"{name:44} {value:8.1f} {unit:12} {target}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--browsers", type=int, default=3)
    given = parser.parse_args()
    try:
        measure(given.vehicles, given.seconds, given.browsers)
    except BaseException as error:
        if type(error).__name__ != "Skipped":
            raise
        print(f"not measured: {error}")


if __name__ == "__main__":
    main()
