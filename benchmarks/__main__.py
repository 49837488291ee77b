"""All benchmarks: ``python -m benchmarks [NAME …]``. Prints each figure beside its target; a missed target is no failure.

Exit code 1: a benchmark could not be completed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.tables.figure import Figure, commit, machine
from skyway.models.base.errors import InputError
from skyway.models.base.files import write_atomically

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
    parser.add_argument(
        "--json",
        type=Path,
        help="write the figures to this file, too; those of benchmarks that print their own are not in it",
    )
    options = parser.parse_args(arguments)
    names = options.names or [*MEASURED, *SCRIPTS]
    unknown = [name for name in names if name not in (*MEASURED, *SCRIPTS)]
    if unknown:
        parser.error(f"no such benchmark: {', '.join(unknown)}")
    facts = {"commit": commit()} | machine()
    figures: list[Figure] = []
    try:
        _write(options.json, facts, figures)
    except InputError as error:
        parser.error(f"--json: {error}")
    for key, value in facts.items():
        print(f"{key}: {value}")
    whole = True
    for name in names:
        print(f"\n{name}", flush=True)
        started = time.perf_counter()
        if name in SCRIPTS:
            whole &= _run_script(*SCRIPTS[name])
        else:
            found = measured(name)
            figures += found
            for figure in found:
                print(figure.line())
            _write(options.json, facts, figures)
        print(f"  ({time.perf_counter() - started:.0f} s)", flush=True)
    return 0 if whole else 1


def _write(file: Path | None, facts: dict[str, str], figures: list[Figure]) -> None:
    """Write the figures so far, so that those of a run that is broken off are not lost."""
    if file is not None:
        document = {"schema": "skyway.figures/1", "machine": facts, "figures": [one.document() for one in figures]}
        write_atomically(file, json.dumps(document, indent=1) + "\n", force=True)


def _run_script(module: str, arguments: list[str]) -> bool:
    """Run a benchmark that prints its own figures; returns whether it was completed."""
    command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    print("\n".join(f"  {line}" for line in done.stdout.splitlines()))
    if done.returncode:
        print("  failed: " + (done.stderr.strip().splitlines() or ["no word why"])[-1])
    return done.returncode == 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted")
