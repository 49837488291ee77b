"""Command of the evaluation: see `benchmarks.link.proof`."""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import json
import pickle
import random
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.link import proof
from benchmarks.link.proof.cases import FAILURES, WINCH_EVERY, deliver, way
from benchmarks.link.proof.far import far
from benchmarks.link.proof.run import Heard, Judged, Run
from benchmarks.link.proof.summary import summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def _way(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    return way(*case[:3])


def _far(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    return far(*case[:3])


def _one(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    seed, autopilot, failure, winch, gusts = case
    return deliver(seed, autopilot, failure, winch=winch, gusts=gusts)


def _again(file: Path) -> Iterator[tuple[Run, Heard]]:
    with gzip.open(file) as stream:
        while True:
            try:
                heard = pickle.load(stream)
            except EOFError:
                return
            yield Judged(heard).again(), heard


def main() -> None:
    """Fly all deliveries, and print the summary."""
    parser = argparse.ArgumentParser(description=proof.__doc__)
    parser.add_argument("--good", type=int, default=100)
    parser.add_argument("--bad", type=int, default=40)
    parser.add_argument("--first", type=int, default=10_000)
    parser.add_argument("--gusts", action="store_true", help="with a sudden gust")
    parser.add_argument("--ways", type=int, default=0, help="number of long legs instead, half of them with a loss")
    parser.add_argument("--far", type=int, default=0, help="number of far deliveries instead, half of them fail")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--output", type=Path, default=Path("out/proof.jsonl"), help="each run, as soon as it is judged"
    )
    parser.add_argument("--heard", type=Path, help="store the inputs of the proofs in this file")
    parser.add_argument("--again", type=Path, nargs="+", help="evaluate such files again, without a simulation")
    given = parser.parse_args()
    pilots = ("px4", "ardupilot")
    cases = [(given.first + n, pilots[n % 2], "", n // 2 % WINCH_EVERY == 0, given.gusts) for n in range(given.good)]
    cases += [
        (
            given.first + n,
            pilots[n % 2],
            failure,
            failure in ("early", "half") and n // 10 % WINCH_EVERY == 0,
            given.gusts,
        )
        for n in range(given.bad)
        for failure in [FAILURES[n // 2 % len(FAILURES)]]
    ]
    if given.ways:
        cases = [(given.first + n, pilots[n % 2], ("", "early")[n // 2 % 2], False, False) for n in range(given.ways)]
    if given.far:
        cases = [
            (given.first + n, pilots[n % 2], ("", FAILURES[n // 4 % len(FAILURES)])[n // 2 % 2], False, False)
            for n in range(given.far)
        ]
    random.Random(0).shuffle(cases)  # an interrupted run has some of all
    given.output.parent.mkdir(parents=True, exist_ok=True)
    runs = []

    def keep(found: Iterable[tuple[Run, Heard]]) -> None:
        with (
            gzip.open(given.heard, "wb", compresslevel=1) if given.heard else nullcontext() as kept,
            given.output.open("w", encoding="utf-8") as file,
        ):
            for run, heard in found:
                runs.append(run)
                file.write(json.dumps(dataclasses.asdict(run)) + "\n")
                file.flush()
                if kept is not None:
                    pickle.dump(heard, kept)

    if given.again:
        keep(one for file in given.again for one in _again(file))
    else:
        with ProcessPoolExecutor(given.workers) as pool:
            flown = _way if given.ways else _far if given.far else _one
            keep(pool.map(flown, cases, chunksize=4))
    print(*summary(runs), sep="\n")


if __name__ == "__main__":
    main()
