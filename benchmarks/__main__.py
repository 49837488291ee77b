"""All benchmarks: ``python -m benchmarks [NAME …]``. Prints each figure beside its target; a missed target is no failure."""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.tables.figure import Figure, machine

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS: dict[str, tuple[str, list[str]]] = {
    "missions": ("link.bench_missions", []),
    "sim": ("link.bench_sim", ["--seconds", "3"]),
    "link": ("link.bench_link", []),
    "many": ("link.bench_many", []),
    "logs": ("link.bench_logs", []),
    "ledger": ("fleet.bench_ledger", []),
    "fleet-gap": ("fleet.bench_gap", []),
    "fleet-city": ("fleet.bench_city", []),
    "fleet-size": ("fleet.bench_size", []),
    "fleet-promises": ("fleet.bench_service_promises", ["--services", "3"]),
    "evrp": ("fleet.bench_evrp", []),
    "sydney": ("fleet.bench_sydney", []),
    "page": ("web.bench_page", ["--seconds", "30"]),
    "rolling": ("online.bench_rolling", ["--deliveries", "12"]),
    "why": ("online.rolling_why", ["--deliveries", "6"]),
    "risk": ("online.rolling_risk", ["--deliveries", "6", "--gusts", "200"]),
}
"""Benchmarks that print their own figures, each run as a process of its own."""
MEASURED = {
    "speed": "planners",
    "ies": "planners",
    "exact": "planners",
    "robust": "planners",
    "dense": "planners",
    "decisions": "online",
    "evaluate": "planners",
    "promises": "planners",
    "gap": "planners",
    "weather": "files",
    "airspace": "files",
    "terrain": "files",
    "recharge": "planners",
}
"""Benchmarks that return figures, and where they are."""


def measured(name: str) -> list[Figure]:
    """Run one benchmark that returns figures."""
    module = importlib.import_module(f"benchmarks.{MEASURED[name]}.bench_{name}")
    figures: list[Figure] = module.measure()
    return figures


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmarks named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join((*MEASURED, *SCRIPTS))}")
    parser.add_argument("--json", type=Path, help="write the figures to this file, too")
    options = parser.parse_args(arguments)
    names = options.names or [*MEASURED, *SCRIPTS]
    unknown = [name for name in names if name not in (*MEASURED, *SCRIPTS)]
    if unknown:
        parser.error(f"no such benchmark: {', '.join(unknown)}")
    facts = machine()
    for key, value in facts.items():
        print(f"{key}: {value}")
    figures: list[Figure] = []
    for name in names:
        print(f"\n{name}", flush=True)
        started = time.perf_counter()
        if name in SCRIPTS:
            _run_script(*SCRIPTS[name])
        else:
            found = measured(name)
            figures += found
            for figure in found:
                print(figure.line())
        print(f"  ({time.perf_counter() - started:.0f} s)", flush=True)
    if options.json is not None:
        document = {"schema": "skyway.figures/1", "machine": facts, "figures": [one.document() for one in figures]}
        options.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return 0


def _run_script(module: str, arguments: list[str]) -> None:
    command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    print("\n".join(f"  {line}" for line in done.stdout.splitlines()))
    if done.returncode:
        print("  failed: " + (done.stderr.strip().splitlines() or ["no word why"])[-1])


if __name__ == "__main__":
    sys.exit(main())
