"""What processes hold in memory: a server, and a browser with all that it has started.

The proportional share (PSS) of a browser changes when another Chromium ends whose pages it shared, so memory of its own (USS: private pages) is told
beside it. What scripts hold is asked of the browser itself after a collection of garbage: that number alone tells a leak of ours from memory that a
browser keeps for later.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import tempfile
import time
import urllib.request
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.web.browsing import FLAGS, installed

if TYPE_CHECKING:
    from collections.abc import Iterator

STARTS_S = 30.0
"""A browser has opened its port for questions after so long."""


def rss_mb(pid: int) -> float:
    """Resident memory."""
    return _kilobytes(Path(f"/proc/{pid}/status"), "VmRSS") / 1024.0


def _kilobytes(path: Path, *names: str) -> int:
    lines = [line.split() for line in path.read_text().splitlines()]
    return sum(int(words[1]) for words in lines if words and words[0].rstrip(":") in names)


def _tree(pid: int) -> set[int]:
    """A process and all that it has started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rsplit(")", 1)[1].split()[1])
    found, grown = {pid}, True
    while grown:
        more = {one for one, parent in parents.items() if parent in found} - found
        found |= more
        grown = bool(more)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """What one browser holds."""

    pss_mb: float
    """Of all of its processes, pages shared with others counted in part."""
    own_mb: float
    """Private pages of all of its processes."""
    page_mb: float
    """Private pages of the processes that draw pages and run their scripts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What the page in a browser still refers to after a collection of garbage."""

    scripts_mb: float
    nodes: float
    listeners: float

    def __str__(self) -> str:
        return f"scripts {self.scripts_mb:.2f} MB, {self.nodes:.0f} nodes, {self.listeners:.0f} listeners"


@dataclass(frozen=True, slots=True)
class Unwatched:
    """A browser of its own that nobody looks into, but for moments: tools that automate a browser keep all that it was sent."""

    pid: int
    profile: Path

    def held(self) -> Held:
        """Look from outside, at the kernel's figures."""
        sums = dict.fromkeys((one.name for one in fields(Held)), 0.0)
        for pid in _tree(self.pid):
            with contextlib.suppress(OSError):
                told = Path(f"/proc/{pid}/smaps_rollup")
                own = _kilobytes(told, "Private_Clean", "Private_Dirty") / 1024.0
                sums["pss_mb"] += _kilobytes(told, "Pss") / 1024.0
                sums["own_mb"] += own
                if b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    sums["page_mb"] += own
        return Held(**sums)

    def kept(self) -> Kept:
        """Collect garbage, and ask what is left."""
        from websockets.sync.client import connect

        port = int(self._port().read_text().split()[0])
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=STARTS_S) as answer:
            where = next(one["webSocketDebuggerUrl"] for one in json.load(answer) if one["type"] == "page")
        with connect(where, max_size=None) as wire:
            for word in ("HeapProfiler.collectGarbage", "HeapProfiler.collectGarbage", "Performance.enable"):
                _asked(wire, word)
            told = {one["name"]: one["value"] for one in _asked(wire, "Performance.getMetrics")["metrics"]}
        return Kept(scripts_mb=told["JSHeapUsedSize"] / 2**20, nodes=told["Nodes"], listeners=told["JSEventListeners"])

    def _port(self) -> Path:
        found = self.profile / "DevToolsActivePort"
        until = time.monotonic() + STARTS_S
        while not found.exists() and time.monotonic() < until:
            time.sleep(0.1)
        return found


def _asked(wire: Any, word: str) -> dict[str, Any]:
    wire.send(json.dumps({"id": 1, "method": word}))
    while (answer := json.loads(wire.recv(STARTS_S))).get("id") != 1:
        pass
    found: dict[str, Any] = answer["result"]
    return found


@contextlib.contextmanager
def unwatched(address: str) -> Iterator[Unwatched]:
    """Open an address in a browser of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [
            installed(),
            "--headless",
            *FLAGS,
            f"--user-data-dir={profile}",
            "--remote-debugging-port=0",
            "--window-size=1280,900",
            address,
        ]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield Unwatched(process.pid, Path(profile))
        finally:
            process.terminate()
            process.wait(30.0)
