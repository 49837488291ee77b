"""Judge a planner in independent worlds: ``python -m benchmarks.independent --worlds ours,field --requests 10 --days 10``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.independent.product import planning
from benchmarks.independent.study import PLANNERS, Study, append_line, digest, fly_order, orders, read_lines
from benchmarks.independent.told_arrivals import told_arrivals
from benchmarks.independent.verdict import told_and_met, verdict
from benchmarks.independent.worlds import worlds

MOST_DAYS = 12
LEAST = {"requests": 1, "days": 1, "runs": 1, "flown_runs": 0, "seed": 0}
"""Least numbers on the command line."""


def main(argv: list[str] | None = None) -> int:
    """Fly order by order, each in all worlds; lines are kept as they come, so that a run that was stopped goes on."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.independent", description=__doc__)
    parser.add_argument("--city", choices=sorted(planning.CITIES), default="new-york")
    parser.add_argument("--worlds", default="all-of-them", help="names with commas between; default: every one")
    parser.add_argument("--requests", type=int, default=10)
    parser.add_argument("--order", default="", help="instead: one, as bellevue,jacobi,2013-07-10T14:00-04:00,0.8")
    parser.add_argument("--days", type=int, default=10, help="held-out days of each request")
    parser.add_argument("--runs", type=int, default=5, help="deliveries a day")
    parser.add_argument("--planner", choices=sorted(PLANNERS), default="robust")
    parser.add_argument("--now", action="store_true", help="plan each day with what was reported by the departure")
    parser.add_argument(
        "--flown-runs", type=int, default=0, help="promise what so many deliveries say, simulated as fly decides"
    )
    parser.add_argument(
        "--share",
        type=float,
        default=1.0,
        help="fly so many of the deliveries whose fixed route stays clear of the reserve, all of the others",
    )
    parser.add_argument("--any-drone", action="store_true", help="plans choose who flies, of the fleet of the region")
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument(
        "--out", type=Path, help="JSON lines, one for each request and world; what is there is not flown again"
    )
    parser.add_argument(
        "--merge",
        type=Path,
        nargs="+",
        default=[],
        help="fly nothing: sum up what was flown with --out, such as with several seeds",
    )
    parser.add_argument("--summary", type=Path, help="JSON, one object for each world")
    options = parser.parse_args(argv)
    if options.merge:
        return _merged(options.merge)
    _refuse_out_of_range(parser, options)
    known = worlds(tuple(site.id for site in planning.city(options.city).sites))
    names = list(known) if options.worlds == "all-of-them" else options.worlds.split(",")
    unknown = [name for name in names if name not in known]
    if unknown:
        parser.error(f"no such world: {', '.join(unknown)}; there are {', '.join(known)}")
    count = 1 if options.order else options.requests
    study = Study(
        options.city,
        options.planner,
        count,
        options.days,
        options.runs,
        options.seed,
        options.order,
        options.now,
        options.flown_runs,
        options.share,
        options.any_drone,
    )
    started = time.perf_counter()
    found = read_lines(options.out, study) if options.out is not None else []
    flown = Counter((one["world"], one["order"]["seed"]) for one in found)
    done = {key for key, count in flown.items() if count == study.documents}
    found = [one for one in found if (one["world"], one["order"]["seed"]) in done]
    for order in orders(study):
        missing = [known[name] for name in names if (name, order.seed) not in done]
        for document in fly_order(study, order, missing) if missing else ():
            found.append(document)
            if options.out is not None:
                append_line(options.out, study, document)
    verdicts = []
    for name in names:
        mine = sorted((one for one in found if one["world"] == name), key=lambda one: int(one["order"]["seed"]))
        if any(one["planned"] for one in mine):
            verdicts.append((verdict(mine), digest(mine)))
            print(verdicts[-1][0].line())
            for arrivals in told_arrivals(mine):
                print(arrivals.line())
        else:
            print(f"{name:<20} no order has a plan")
    if options.summary is not None:
        documents = [
            asdict(one) | {"counted_on": known[one.world].counted_on, "deviations": sorted(known[one.world].deviations), "digest": sum_}
            for one, sum_ in verdicts
        ]  # fmt: skip
        options.summary.write_text(
            json.dumps({"study": asdict(study), "worlds": documents}, indent=1), encoding="utf-8"
        )
    print(f"{len(found)} requests in worlds, {time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


def _refuse_out_of_range(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    for name, least in LEAST.items():
        if getattr(options, name) < least:
            parser.error(f"--{name.replace('_', '-')} is {least} or more")
    if not 0.0 <= options.share <= 1.0:
        parser.error("--share is from 0 to 1")
    if options.days > MOST_DAYS:
        parser.error(
            f"--days is 1 to {MOST_DAYS}: of more held-out days, two days apart, nothing is left to forecast a season from"
        )


def _merged(paths: list[Path]) -> int:
    """Print what is in files of the same study with other seeds: each world, all of them together, and fixed routes by what is told of them."""
    found: list[dict[str, Any]] = []
    for path in paths:
        study = Study(**json.loads(path.read_text(encoding="utf-8").splitlines()[0]))
        found += read_lines(path, study)
    names = list(dict.fromkeys(one["world"] for one in found))
    for name in (*names, ""):
        mine = [one for one in found if not name or one["world"] == name]
        if any(one["planned"] for one in mine):
            said = verdict(mine)
            print((said if name else replace(said, world="all of these")).line())
            for told in told_and_met(mine):
                print(told.line())
            for arrivals in told_arrivals(mine):
                print(arrivals.line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
