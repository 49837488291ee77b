"""New York: the probabilities with which orders are promised, and their outcome on days that were not forecast, flown by an independent simulation."""

from __future__ import annotations

import argparse
import itertools
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from benchmarks.fleet.bench_city import city
from benchmarks.fleet.judge_promises import BELOW, Day
from skyway.models.base.errors import InputError
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.parameters.planner import USUAL
from skyway.planner.promises.promises import promised

BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
RESERVE = 0.2


def main() -> None:
    """Print stated probabilities beside observed frequencies."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drones", type=int, default=200)
    parser.add_argument("--orders", type=int, default=300)
    parser.add_argument("--utilisation", type=float, default=0.7, help="of the pads, by strangers")
    parser.add_argument("--iterations", type=int, default=100, help="iterations in each plan")
    parser.add_argument("--days", type=int, default=40)
    parser.add_argument("--start", default="2013-07-10T14:00+00:00")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--unsupervised", action="store_true", help="drones never return: each flight is flown to its end"
    )
    parser.add_argument("--blind", action="store_true", help="nobody sees the pads before")
    options = parser.parse_args()
    start = datetime.fromisoformat(options.start).astimezone(UTC)
    prompt = replace(USUAL, dispatch=replace(USUAL.dispatch, max_late_s=0.0))
    rows: list[tuple[int, float, bool, float]] = []
    landings: list[float] = []
    returned = 0
    stated_below, spent_s = [], 0.0
    random = np.random.default_rng(options.seed)
    dates = [start.date() + timedelta(days=int(one) - 30) for one in random.permutation(61)]
    for number, day in enumerate(dates):
        if number >= options.days:
            break
        work = city(1000 * options.seed + number, options.drones, options.orders, options.utilisation, start)
        try:
            truth = Day(work, day, start, number, supervised=not options.unsupervised)
        except InputError:
            continue  # the record has a gap
        seen = NOTHING_SEEN if options.blind else PadsSeen(truth.present(), {})
        forecast = work.scenario.forecast(start, 48, truth=day)
        plan = dispatch(work, start, forecast=forecast, reserve=RESERVE, iterations=options.iterations, time_limit_s=1e4, parameters=prompt, bounded=False, seen=seen)  # fmt: skip
        begun = time.process_time()
        plan = promised(work, plan, forecast, prompt, reserve=RESERVE, seed=number, seen=seen)
        spent_s += time.process_time() - begun
        truth.run(plan.routes, RESERVE)
        due = {one.id: one.due.timestamp() for one in work.orders}
        for one in plan.answers:
            if one.outlook is not None:
                at_s = truth.delivered_s.get(one.order, np.inf)
                late = np.nan if one.outlook.p95 is None else float(at_s <= one.outlook.p95.timestamp())
                rows.append((number, one.outlook.chance, at_s <= due[one.order], late))
        landings += truth.landings
        returned += truth.returned
        stated_below.append(plan.below_reserve or 0.0)
        own = [one for one in rows if one[0] == number]
        print(f"{day}: {len(own)} promised, stated {np.mean([one[1] for one in own]):.3f}, kept {np.mean([one[2] for one in own]):.3f}", flush=True)  # fmt: skip
    _show(rows)
    below = np.mean(np.array(landings) < RESERVE - BELOW)
    print(f"  landings below the reserve: {100 * below:.3f} % of {len(landings)} ({returned} after a return), stated {100 * np.mean(stated_below):.3f} %; worlds take {spent_s / len(stated_below):.2f} s of a processor a plan")  # fmt: skip


def _show(rows: list[tuple[int, float, bool, float]]) -> None:
    """Print the result over all days."""
    days, stated, kept, late = np.array(rows).T
    rest = np.array([(kept - stated)[days == one].sum() for one in np.unique(days)])
    error = np.sqrt((rest**2).sum() * len(rest) / (len(rest) - 1)) / len(kept)
    print(f"{len(rest)} days, {len(kept)} promises: stated {100 * stated.mean():.1f} %, kept {100 * kept.mean():.1f} %, difference {100 * (kept - stated).mean():+.1f} points (standard error {100 * error:.1f}, by days); Brier score {((kept - stated) ** 2).mean():.4f}, {((kept - kept.mean()) ** 2).mean():.4f} with one probability for all; {kept.sum() / len(rest):.1f} a day kept")  # fmt: skip
    for low, high in itertools.pairwise(BINS):
        own = (stated >= low) & ((stated < high) | (high == 1.0))
        if own.any():
            print(f"  stated {low:.2f} to {high:.2f}: {own.sum()} promises, {100 * stated[own].mean():.1f} % stated, {100 * kept[own].mean():.1f} % kept")  # fmt: skip
    known = np.isfinite(late)
    print(f"  by the p95: {100 * late[known].mean():.1f} % of {known.sum()} (95 % wanted)")


if __name__ == "__main__":
    main()
