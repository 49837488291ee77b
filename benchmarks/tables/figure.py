"""One measured figure beside its target, and the machine that it was measured on."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.compute.spreading import processors

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class Figure:
    """A measured figure.

    Attributes
    ----------
    what : str
        What was measured.
    value : float
        In `unit`.
    unit : str
        For people.
    target : float or None
        At most this much is wanted; None: nothing was promised.
    note : str
        What a reader must know to judge it.
    """

    what: str
    value: float
    unit: str = "s"
    target: float | None = None
    note: str = ""

    @property
    def verdict(self) -> str:
        """``met``, ``missed by …`` or nothing where there is no target."""
        if self.target is None:
            return ""
        if self.value <= self.target:
            return "met"
        return f"missed by {self.value - self.target:.3g} {self.unit} ({self.value / self.target - 1.0:.0%})"

    def line(self) -> str:
        """The figure on one line."""
        target = "" if self.target is None else f"target {self.target:g} {self.unit}"
        tail = "  ".join(part for part in (self.verdict, self.note) if part)
        return f"  {self.what:<58} {self.value:>10.4g} {self.unit:<9} {target:<18} {tail}".rstrip()

    def document(self) -> dict[str, object]:
        """The figure for a JSON file."""
        return {
            "what": self.what,
            "value": self.value,
            "unit": self.unit,
            "target": self.target,
            "verdict": self.verdict or None,
            "note": self.note or None,
        }


def commit() -> str:
    """Return the commit of the source that runs, and whether it was changed since; ``unknown`` outside a repository."""
    root = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(root), *words], check=False, capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        found = git("rev-parse", "--short=10", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no")
    except OSError:
        return "unknown"
    return (found or "unknown") + (", changed since" if changed else "")


def machine() -> dict[str, str]:
    """Return what the figures were measured on: processor, cores, load, versions."""
    import numba
    import numpy as np

    facts = {
        "processor": _processor(),
        "cores": f"{processors()} usable of {os.cpu_count()}",
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }
    if hasattr(os, "getloadavg"):
        facts["load"] = f"{os.getloadavg()[0]:.1f} processes over the last minute, ours included"
    return facts


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def best_s(work: Callable[[], object], runs: int = 5) -> float:
    """Shortest wall time of several runs."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)
