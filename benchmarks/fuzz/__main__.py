"""Fuzzing the planners: random requests end in a plan whose every figure is finite, or in an error of ours; nothing else.

``python -m benchmarks.fuzz --requests 20000``. Each request is planned; one in `ONLINE_EVERY` is carried on, too: evaluated, replanned on the ground
and in the air, decided at every stop (`benchmarks.fuzz.online`; ``--online``: all, and only that). With ``NUMBA_BOUNDSCHECK=1`` a kernel that reads or writes beyond an array is an
`IndexError`, and so a finding. A child process answers, so that a crash or a request without an end is a finding, too. ``--only N``
tries one request again and shows the trace.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import queue
import re
import subprocess
import sys
import threading
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from benchmarks.fuzz.cases import Case, draw
from benchmarks.fuzz.online import carry_on, draw_online
from skyway.models.base.errors import InfeasibleError, InputError
from skyway.models.composition.file import from_json, to_json
from skyway.planner.plan import plan
from skyway.planner.registry import CLAIRVOYANT_PLANNERS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.planner.result import PlanResult

CHILD = [sys.executable, "-X", "faulthandler", "-m", "benchmarks.fuzz", "--child"]
"""Command of the process that answers; it is given the first number and the one to stop before."""
LONGEST_S = 600.0
"""A request that takes longer hangs."""
SEARCH_S = {"ies": 0.2, "exact": 120.0}
"""Seconds that clairvoyant planners may search, for each drone."""
ONLINE_EVERY = 5
"""One request in so many is carried on after it was planned."""
PROGRESS_EVERY = 500
NOT_A_NUMBER = re.compile(r"(?<![a-z])[-+]?(nan|inf|infinity)(?![a-z])", re.IGNORECASE)


class FindingError(Exception):
    """Something that must not be."""


def judge(case: Case) -> str:
    """Answer a request and look at every figure; returns ``plan`` or what binds.

    Raises
    ------
    FindingError
        A figure that is not finite, or JSON that cannot be read again.
    """
    truth = case.wind
    if case.planner in CLAIRVOYANT_PLANNERS and len(truth.probability) > 1:
        truth = truth.only(0) if hasattr(truth, "only") else _first(truth)
    try:
        result = plan(
            case.scenario,
            case.request,
            planner=case.planner,
            forecast=truth if case.planner in CLAIRVOYANT_PLANNERS else case.wind,
            time_limit_s=SEARCH_S.get(case.planner, math.inf),
        )
    except (InfeasibleError, InputError) as error:
        _no_nan(str(error), "error")
        return getattr(error, "constraint", "input")
    for where, value in figures(result):
        if not math.isfinite(value):
            raise FindingError(f"{where} is {value}")
    document = json.dumps(to_json(result.composition), allow_nan=False)
    from_json(document)
    if case.number % 4 == 0:
        _no_nan(shown(result), "table")
    return "plan"


def judge_online(case: Case) -> str:
    """Carry a request on and look at every figure; returns how, and ``done`` or what binds.

    Raises
    ------
    FindingError
        A figure that is not finite.
    """
    online = draw_online(case)
    try:
        for where, value in carry_on(online):
            if not math.isfinite(value):
                raise FindingError(f"{online.way}: {where} is {value}")
    except (InfeasibleError, InputError) as error:
        _no_nan(str(error), "error")
        return f"{online.way}: {getattr(error, 'constraint', 'input')}"
    return f"{online.way}: done"


def _first(wind: Any) -> Any:
    return replace(wind, north=wind.north[:1], east=wind.east[:1], probability=np.ones(1), labels=wind.labels[:1])


def figures(result: PlanResult) -> Iterator[tuple[str, float]]:
    """Every number of an answer, with its name."""
    outcome = result.outcome
    yield from (("mean_s", outcome.mean_s), ("p95", outcome.quantile_s(0.95)), ("p50", outcome.quantile_s(0.5)))
    yield from (("p_success", outcome.p_success), ("p_arrive", outcome.p_arrive))
    yield from ((f"p_reserve[{k}]", float(value)) for k, value in enumerate(outcome.p_reserve))
    yield from ((f"p_hold[{k}]", float(value)) for k, value in enumerate(outcome.p_hold))
    yield from _numbers(to_json(result.composition), "composition")


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _numbers(one, f"{where}.{key}")
    elif isinstance(value, (list, tuple)):
        for number, one in enumerate(value):
            yield from _numbers(one, f"{where}[{number}]")
    elif isinstance(value, float):
        yield where, value


def shown(result: PlanResult) -> str:
    """What a person is shown of an answer, with the GeoJSON."""
    from contextlib import redirect_stdout
    from io import StringIO

    from skyway.cli.views.plan import print_plan
    from skyway.planner.report import plan_report
    from skyway.route_geojson import route_geojson

    with redirect_stdout(StringIO()) as out:
        print_plan(plan_report(result))
    return out.getvalue() + json.dumps(route_geojson(result.composition), allow_nan=False)


def _no_nan(text: str, where: str) -> None:
    found = NOT_A_NUMBER.search(text)
    if found is not None:
        raise FindingError(f"{where} shows {found.group()}: …{text[max(found.start() - 60, 0) : found.end() + 20]}…")


def _answer(numbers: range, *, online_only: bool) -> None:
    """In the child: a line for the beginning and one for the end of each request."""
    for number in numbers:
        print(json.dumps({"begin": number}), flush=True)
        started = time.perf_counter()
        row: dict[str, Any] = {"end": number}
        try:
            case = draw(number)
            row["planner"] = case.planner
            if not online_only:
                row["ended"] = judge(case)
            if online_only or number % ONLINE_EVERY == 0:
                row["online"] = judge_online(case)
        except Exception as error:  # noqa: BLE001  whatever it is, it is a finding
            where = traceback.extract_tb(error.__traceback__)[-1]
            row |= {
                "finding": f"{type(error).__name__}: {error}",
                "where": f"{Path(where.filename).name}:{where.lineno}",
            }
        print(json.dumps(row | {"s": round(time.perf_counter() - started, 3)}), flush=True)


@dataclass
class Tally:
    """What became of the requests: how many were answered, how they ended, and what must not be."""

    answered: int = 0
    ended: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)
    slowest: tuple[float, int] = (0.0, -1)

    def add(self, row: dict[str, Any]) -> None:
        """Count one."""
        self.slowest = max(self.slowest, (row["s"], row["end"]))
        if "finding" in row:
            self.find(row["end"], f"{row['finding']} ({row.get('planner')}, {row['where']})")
            return
        self.answered += 1
        if "ended" in row:
            self.ended[f"{row['planner']}: {row['ended']}"] += 1
        if "online" in row:
            self.ended[f"under way, {row['online']}"] += 1
        if self.answered % PROGRESS_EVERY == 0:
            print(f"{self.answered} answered, the last is #{row['end']}", file=sys.stderr, flush=True)

    def find(self, number: int, what: str) -> None:
        """Keep and print a finding."""
        self.findings.append(f"#{number} {what}")
        print(f"FOUND #{number} {what}", flush=True)


def run(first: int, count: int, seconds: float = math.inf, *, online_only: bool = False) -> Tally:
    """Answer so many requests, or as many as there is time for."""
    tally, until, number = Tally(), time.monotonic() + seconds, first
    while number < first + count and time.monotonic() < until:
        command = [*CHILD, str(number), str(first + count), *(["--online"] if online_only else [])]
        number = _one_child(command, number, first + count, until, tally)
    return tally


def _one_child(command: list[str], number: int, stop: int, until: float, tally: Tally) -> int:
    """Let a child answer until it ends, dies or hangs, or time is over; returns the number to go on with.

    What it is at when time is over, be that compiling, counts as neither answered nor found.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        assert child.stdout is not None
        threading.Thread(target=_hand_on, args=(child.stdout, lines), daemon=True).start()
        begun = number
        while True:
            left = until - time.monotonic()
            try:
                line = lines.get(timeout=max(min(LONGEST_S, left), 0.0))
            except queue.Empty:
                child.kill()
                if left > LONGEST_S:
                    tally.find(begun, f"no end within {LONGEST_S:g} s")
                return begun + 1
            if not line:
                if child.wait() != 0:
                    tally.find(begun, f"the process died: {child.returncode}")
                    return begun + 1
                return stop
            row = json.loads(line)
            if "begin" in row:
                begun = row["begin"]
            else:
                tally.add(row)


def _hand_on(out: IO[str], lines: queue.SimpleQueue[str]) -> None:
    """Each line as it comes, then an empty one."""
    for line in out:
        lines.put(line)
    lines.put("")


def main(arguments: list[str] | None = None) -> int:
    """Fuzz; the exit code tells of indices beyond arrays and crashes, with ``--strict`` of any finding."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--requests", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first request")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after so long")
    parser.add_argument("--only", type=int, help="answer one request here and show what it is")
    parser.add_argument("--strict", action="store_true", help="fail at any finding, not only at an index or a crash")
    parser.add_argument(
        "--online", action="store_true", help="carry every request on under way, and plan none beforehand"
    )
    parser.add_argument("--child", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child is not None:
        _answer(range(*options.child), online_only=options.online)
        return 0
    if options.only is not None:
        case = draw(options.only)
        print(case)
        print(judge_online(case) if options.online else judge(case))
        return 0
    started = time.monotonic()
    tally = run(options.first, options.requests, options.seconds, online_only=options.online)
    checked = "with" if os.environ.get("NUMBA_BOUNDSCHECK", "0") not in ("", "0") else "WITHOUT"
    for name, count in sorted(tally.ended.items()):
        print(f"{count:>7}  {name}")
    print(
        f"{tally.answered + len(tally.findings)} of {options.requests} requests answered {checked} bounds checks in "
        f"{time.monotonic() - started:.0f} s, slowest {tally.slowest[0]:.1f} s (#{tally.slowest[1]}); {len(tally.findings)} findings"
    )
    if not tally.answered:
        print(
            "no request was answered: that proves nothing; give it more time (--seconds), the first compiles the kernels"
        )
        return 1
    memory = [one for one in tally.findings if "IndexError" in one or "process died" in one]
    return 1 if memory or (options.strict and tally.findings) else 0


if __name__ == "__main__":
    sys.exit(main())
