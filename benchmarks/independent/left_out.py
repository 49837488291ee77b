"""Promises as flown, judged by leaving each day of a season out in turn: ``python -m benchmarks.independent.left_out --requests 20``.

A delivery decided as `fly` decides costs a second or two of a processor, in the product's simulation as in a world. Held-out days with a promise of a hundred
simulated deliveries each are beyond reach. Here one delivery is simulated (`plan --as-flown`) on each of some days of the season, and one is flown in a world on each of the
same days, with a plan and a forecast that lack the day, but no other: a calm day among stormy ones that are left out as well would be told as too calm. Each day is promised the quantiles of the simulated deliveries of the other days.
The same is done with the simulated delivery of that day itself: a day is as early or as late as any other (exchangeability), so it keeps the level, or more where many
arrivals fall on one moment. What the world keeps less than that is what the simulation promises too much; most of what days differ in is in both
(a control variate: P. Glasserman, "Monte Carlo methods in financial engineering" (2003), chapter 4.1).

The world is flown with the parameters of the simulated deliveries, which think less on the ground than `fly` (decision 132).

With 19 other days the quantile of 50, 80 and 95 % is the 10th, 16th and 19th of them, which the twentieth keeps with just that probability.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.build import setting_for
from benchmarks.independent.delivery import DELIVERED, deliver
from benchmarks.independent.information import LEVELS
from benchmarks.independent.product import planning, promise
from benchmarks.independent.product.supervised import Supervised
from benchmarks.independent.statistics import over_days
from benchmarks.independent.study import Study, append_line, orders, read_lines
from benchmarks.independent.verdict import RESERVE, in_time
from benchmarks.independent.worlds import worlds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import date

    from numpy.typing import NDArray

    from benchmarks.independent.information import Order
    from benchmarks.independent.worlds import World

NEIGHBOUR_DAYS = 2
"""Days nearer than that share hours, and do not promise for each other."""


@dataclass(frozen=True)
class LeftOut(Study):
    """What is flown: one delivery on each of `days` days of the season of each order, evenly."""

    longest_min: float = 60.0
    """Orders whose fixed route takes longer on average are not flown."""
    shortest_min: float = 0.0
    """Nor those whose fixed route takes less."""


def flown(study: LeftOut, order: Order, chosen: Sequence[World]) -> Iterator[dict[str, Any]]:
    """Simulate and fly an order on the days of its season: one JSON document a world."""
    simulated: dict[str, dict[date, float] | None] = {}
    plans: dict[tuple[str, date], planning.Planned | None] = {}
    city = planning.city(study.city)
    for world in chosen:
        if world.kept_back not in simulated:
            plan = planning.planned(study.city, order, (), world.kept_back)
            asked = plan is not None and study.shortest_min <= plan.promise.mean_s / 60.0 <= study.longest_min
            simulated[world.kept_back] = promise.simulated(plan, study.days) if plan is not None and asked else None
        promised = simulated[world.kept_back]
        document: dict[str, Any] = {"world": world.name, "order": asdict(order), "flown": promised is not None}
        if promised is not None:
            arrived, lowest = [], []
            for day in promised:
                key = world.kept_back, day
                if key not in plans:
                    plans[key] = planning.planned(study.city, order, (day,), world.kept_back)
                shift = np.array([planning.shift_s(study.city, order, day)])
                setting = setting_for(world, city, order, shift, [(study.seed, order.seed, day.toordinal(), 0)])
                plan = plans[key]
                (run,) = [None] if plan is None else deliver(setting, order, Supervised(plan, thriftily=True))
                there = run is not None and run.ending == DELIVERED
                arrived.append(round(run.time_s - order.depart_s, 1) if run is not None and there else math.inf)
                lowest.append(math.nan if run is None else round(min(run.landings, default=math.nan), 5))
            document |= {
                "day": [day.toordinal() for day in promised],
                "simulated_s": [round(one, 1) for one in promised.values()],
                "flown_s": arrived,
                "lowest": lowest,
            }
        yield document


def kept(due_of: NDArray[np.float64], flown_s: NDArray[np.float64], day: NDArray[np.int64]) -> NDArray[np.float64]:
    """Whether each day keeps the quantiles of the simulated deliveries of the other days, shape (days, levels)."""
    found = np.zeros((len(day), len(LEVELS)))
    for k, one in enumerate(day.tolist()):
        others = np.sort(due_of[np.abs(day - one) >= NEIGHBOUR_DAYS])
        due = [others[math.ceil(level * len(others) - 1e-9) - 1] for level in LEVELS]
        found[k] = in_time(flown_s[k], np.array(due))
    return found


def report(documents: Sequence[dict[str, Any]]) -> Iterator[str]:
    """One line for each world: what simulated deliveries keep, what those of the world keep, and the difference with the wider of two intervals, over days and over orders."""
    for name in dict.fromkeys(one["world"] for one in documents):
        mine = [one for one in documents if one["world"] == name and one["flown"]]
        if not mine:
            continue
        parts = [(np.array(one["day"]), np.array(one["simulated_s"]), np.array(one["flown_s"])) for one in mine]
        itself = np.concatenate([kept(simulated, simulated, day) for day, simulated, _ in parts])
        world = np.concatenate([kept(simulated, flown_s, day) for day, simulated, flown_s in parts])
        blocks = [
            np.concatenate([day for day, _, _ in parts]),
            np.concatenate([np.full(len(day), number) for number, (day, _, _) in enumerate(parts)]),
        ]
        words = []
        for k, level in enumerate(LEVELS):
            less = world[:, k] - itself[:, k]
            ends = [over_days(less, block) for block in blocks]
            low, high = min(end[0] for end in ends), max(end[1] for end in ends)
            words.append(
                f"{100 * level:.0f} %: {100 * itself[:, k].mean():.1f} -> {100 * world[:, k].mean():.1f}, {100 * less.mean():+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
            )
        simulated_s, flown_s = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        both = np.isfinite(simulated_s) & np.isfinite(flown_s)
        below = sum(soc < RESERVE - 1e-9 for one in mine for soc in one["lowest"])
        yield (
            f"{name:<14} {len(mine)} orders, {len(flown_s)} days; {'; '.join(words)}; "
            f"mean {simulated_s[both].mean() / 60:.1f} -> {flown_s[both].mean() / 60:.1f} min, median {np.median(simulated_s) / 60:.1f} -> {np.median(flown_s) / 60:.1f}; "
            f"not delivered {np.isinf(simulated_s).sum()} -> {np.isinf(flown_s).sum()}; below the reserve {below}"
        )


def main(argv: list[str] | None = None) -> int:
    """Fly order by order, each in all worlds; lines are kept as they come, so that a run that was stopped goes on."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.independent.left_out", description=__doc__)
    parser.add_argument("--city", choices=sorted(planning.CITIES), default="new-york")
    parser.add_argument("--worlds", default="ours,field,without-LGA", help="names with commas between")
    parser.add_argument("--requests", type=int, default=20)
    parser.add_argument("--days", type=int, default=20, help="of the season, evenly")
    parser.add_argument(
        "--longest", type=float, default=60.0, help="orders whose fixed route takes so long on average at most, min"
    )
    parser.add_argument("--shortest", type=float, default=0.0, help="and at least, min")
    parser.add_argument("--seed", type=int, default=150)
    parser.add_argument(
        "--out", type=Path, help="JSON lines, one for each request and world; what is there is not flown again"
    )
    options = parser.parse_args(argv)
    known = worlds(tuple(site.id for site in planning.city(options.city).sites))
    chosen = [known[name] for name in options.worlds.split(",")]
    study = LeftOut(
        options.city, "fly", options.requests, options.days, 1, options.seed,
        longest_min=options.longest, shortest_min=options.shortest,
    )  # fmt: skip
    found = read_lines(options.out, study) if options.out is not None else []
    done = {(one["world"], one["order"]["seed"]) for one in found}
    for order in orders(study):
        missing = [world for world in chosen if (world.name, order.seed) not in done]
        for document in flown(study, order, missing) if missing else ():
            found.append(document)
            if options.out is not None:
                append_line(options.out, study, document)
    for line in report(found):
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
