"""A simulated drone with its pads, in a process of its own, and what it was told."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.web.conftest import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator

DEPART = "2013-07-10T14:00-04:00"
LOOKED_S = 0.2


@dataclass
class Simulated:
    """Addresses of a simulated drone and of its pads, and the events that its simulation has told."""

    drone: str
    pads: str
    lines: list[str] = field(default_factory=list)

    def count(self, pattern: str) -> int:
        """How many events there were of a kind."""
        return sum(bool(re.search(pattern, line)) for line in self.lines)


def free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@contextmanager
def simulated(at: str, *, speedup: float = 20.0, pad_speedup: float = 40.0, **more: str) -> Iterator[Simulated]:
    """Simulate a drone that stands at a station, in a light wind; nobody else is at the pads."""
    drone, pads = free_port(), free_port()
    words = [
        sys.executable, "-m", "skyway", "sim", "--at", at, "--tcp", str(drone), "--pads", f"tcp:127.0.0.1:{pads}", "--wind", "3@250",
        "--depart", DEPART, "--payload", "0.8", "--warm", "--no-traffic", "--speedup", str(speedup), "--pad-speedup", str(pad_speedup),
        *(word for name, value in more.items() for word in (f"--{name}", value)),
    ]  # fmt: skip
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    printed = process.stdout
    found = Simulated(f"tcp:127.0.0.1:{drone}", f"tcp:127.0.0.1:{pads}")
    ready = threading.Event()

    def read() -> None:
        for line in printed:
            found.lines.append(line.rstrip())
            if line.startswith("pads"):
                ready.set()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        assert ready.wait(60.0), found.lines
        yield found
    finally:
        process.terminate()
        process.wait(20.0)
        reader.join(5.0)
        printed.close()
