"""What it gains to plan with the weather of now.

Random orders in New York or Melbourne, each on held-out days of the record. On each day it is planned twice: from the season's other days alone, and
conditioned on what the airports had published by the departure (observed at minute 51 of the hour, out five minutes later; no look ahead).
Both plans are flown in the true wind of the day, by the product's out-of-sample evaluation and in worlds of `benchmarks.independent`.
With `--minute` orders leave so many minutes past the hour, and the wind is observed at the airports at that moment: on the straight line between their reports.

    python -m benchmarks.tables.weather_of_now --requests 64 --days 2 --out flown.jsonl
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.build import setting_for
from benchmarks.independent.delivery import DELIVERED, deliver
from benchmarks.independent.product import planning, policies
from benchmarks.independent.study import Study, orders
from benchmarks.independent.verdict import RESERVE
from benchmarks.independent.weather.series import lines
from benchmarks.independent.worlds import worlds
from skyway.planner.evaluation.evaluate import fly_charging, sample_realizations
from skyway.planner.evaluation.statistics import DayBootstrap, Estimate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from datetime import date

    from benchmarks.independent.build import City
    from benchmarks.independent.information import Order
    from benchmarks.independent.worlds import World

OWN = "out of sample"
"""The product's own evaluation, beside the names of worlds."""
ARMS = ("record alone", "weather of now")


def published(city: City, order: Order, shift_s: float) -> dict[str, tuple[float, float, float]] | None:
    """The newest report of each site that was out at the departure, by the calendar of the order; None where one is missing."""
    found = {}
    for site in city.sites:
        metars = site.as_metars()
        number = metars.latest(order.depart_s + shift_s)
        time_s = float(metars.time_s[number]) - shift_s
        if number < 0 or order.depart_s - time_s > 2 * 3600.0:
            return None
        north, east = metars.wind[number].tolist()
        found[site.id] = (time_s, north, east)
    return found


def observed(city: City, order: Order, shift_s: float) -> dict[str, tuple[float, float, float]] | None:
    """The wind at each site at the departure, on the straight line between its reports, in the form of `published`; None where that is."""
    if published(city, order, shift_s) is None:
        return None
    now_s = np.array([order.depart_s + shift_s])
    metars = [site.as_metars() for site in city.sites]
    winds = {one.id: lines(one.time_s, one.wind, now_s)[0].tolist() for one in metars}
    return {name: (order.depart_s, north, east) for name, (north, east) in winds.items()}


def leaving(order: Order, minute: int) -> Order:
    """Return an order that leaves at a minute of its hour."""
    return replace(order, depart_s=order.depart_s // 3600.0 * 3600.0 + 60.0 * minute)


def flown(
    study: Study, named: Sequence[World], *, drop: int = 0, minute: int | None = None
) -> Iterator[dict[str, Any]]:
    """Plan and fly; a document for each order, day and arm."""
    city = planning.city(study.city)
    known = published if minute is None else observed
    for order in (one if minute is None else leaving(one, minute) for one in orders(study)):
        if order.seed < drop:
            continue
        days = planning.days_for(study.city, order, study.days, study.seed)
        alone = planning.planned(study.city, order, days)
        for day in days:
            shift = planning.shift_s(study.city, order, day)
            reports = known(city, order, shift)
            if alone is None or reports is None:
                continue
            now = planning.planned(study.city, order, days, reports=reports)
            for arm, plan in zip(ARMS, (alone, now), strict=True):
                told = {"arm": arm, "order": order.seed, "day": day.toordinal(), "planned": plan is not None}
                yield told if plan is None else told | _flown(study, order, day, plan, named, city)


def _flown(
    study: Study, order: Order, day: date, plan: planning.Planned, named: Sequence[World], city: City
) -> dict[str, Any]:
    found: dict[str, Any] = {"promised_mean_s": plan.promise.mean_s, "due_s": plan.promise.quantile_s}
    found["promised"] = plan.promise.promised
    assert plan.result.robust is not None
    request = replace(plan.request, drone=plan.result.composition.drone)
    truths = sample_realizations(plan.scenario, request, [day], runs=40 * study.runs, seed=study.seed + order.seed)
    own = fly_charging(truths, plan.result.composition.drone, plan.result.robust.policy)
    found[OWN] = {"s": _rounded(own.delivery_s), "below": int(own.below_reserve.sum())}
    shift = np.full(study.runs, planning.shift_s(study.city, order, day))
    seeds: list[tuple[int, ...]] = [(study.seed, order.seed, day.toordinal(), k) for k in range(study.runs)]
    policy = policies.Robust(plan)
    for world in named:
        runs = deliver(setting_for(world, city, order, shift, seeds), order, policy)
        times = [run.time_s - order.depart_s if run.ending == DELIVERED else np.nan for run in runs]
        below = sum(any(soc < RESERVE - 1e-9 for soc in run.landings) for run in runs)
        found[world.name] = {"s": _rounded(np.array(times)), "below": below}
    return found


def _rounded(times: np.ndarray) -> list[float | None]:
    return [round(one, 1) if np.isfinite(one) else None for one in times.tolist()]


def table(documents: Sequence[Mapping[str, Any]], named: Sequence[str]) -> list[str]:
    """Rows of the table, in Markdown: both arms where both have a plan, intervals over days."""
    pairs: dict[tuple[int, int], dict[str, Mapping[str, Any]]] = {}
    for one in documents:
        pairs.setdefault((one["order"], one["day"]), {})[one["arm"]] = one
    both = [arms for arms in pairs.values() if len(arms) == len(ARMS) and all(one["planned"] for one in arms.values())]
    lines = [
        f"{len({one[ARMS[0]]['order'] for one in both})} orders, {len(both)} departures on {len({one[ARMS[0]]['day'] for one in both})} days",
        "",
        "| flown | planned with | delivery, min | difference | error of the promised mean, min | of 95 % promised | below the reserve | not delivered |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name in named:
        arms = {arm: [one[arm] for one in both] for arm in ARMS}
        means = {arm: np.array([mean_known(one[name]["s"]) for one in mine]) for arm, mine in arms.items()}
        known = np.isfinite(means[ARMS[0]]) & np.isfinite(means[ARMS[1]])
        means = {arm: np.where(known, values, np.nan) for arm, values in means.items()}
        days = DayBootstrap(np.array([one[ARMS[0]]["day"] for one in both]))
        for arm in ARMS:
            missed = np.abs(means[arm] - [one["promised_mean_s"] for one in arms[arm]]) / 60.0
            kept = np.array([share_kept(one[name]["s"], one["due_s"][-1]) for one in arms[arm]])
            promised = float(np.mean([one["promised"][-1] for one in arms[arm]]))
            ratio = days.ratio(means[arm], means[ARMS[0]])
            gain = Estimate(ratio.value - 1.0, ratio.low - 1.0, ratio.high - 1.0).scaled(100.0).text("+.1f") + " %"
            below, runs = sum(one[name]["below"] for one in arms[arm]), sum(len(one[name]["s"]) for one in arms[arm])
            lost = sum(one[name]["s"].count(None) for one in arms[arm])
            lines.append(
                f"| {name if arm == ARMS[0] else ''} | {arm} | {days.mean(means[arm] / 60.0).text()} | {gain if arm != ARMS[0] else ''} | "
                f"{days.mean(missed).text()} | {100.0 * promised:.0f} %: {days.mean(kept).scaled(100.0).text('.0f')} | {below:,} of {runs:,} | {lost:,} |"
            )
    return lines


def mean_known(times: Sequence[float | None]) -> float:
    """Mean of the deliveries that arrived, s; NaN where none did."""
    known = [one for one in times if one is not None]
    return float(np.mean(known)) if known else np.nan


def share_kept(times: Sequence[float | None], due_s: float) -> float:
    """Share of the deliveries that arrived by a time."""
    return float(np.mean([one is not None and one <= due_s + 1e-6 for one in times]))


def main() -> int:
    """Fly, and print the table; lines are kept as they come, so that a run that was stopped goes on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--city", choices=("new-york", "melbourne"), default="new-york")
    parser.add_argument("--requests", type=int, default=64)
    parser.add_argument("--days", type=int, default=2, help="held-out days of each request")
    parser.add_argument(
        "--runs", type=int, default=5, help="deliveries a day in each world; 40 times as many out of sample"
    )
    parser.add_argument(
        "--minute",
        type=int,
        choices=range(60),
        metavar="0..59",
        help="of the hour, at which the wind is observed and orders leave",
    )
    parser.add_argument("--worlds", default="ours,weather,all")
    parser.add_argument("--seed", type=int, default=83)
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, one for each order, day and arm")
    parser.add_argument(
        "--also", type=Path, nargs="*", default=[], help="files of runs with other seeds, counted with it"
    )
    options = parser.parse_args()
    known = worlds(tuple(site.id for site in planning.city(options.city).sites))
    unknown = [name for name in options.worlds.split(",") if name not in known]
    if unknown:
        parser.error(f"no such world: {', '.join(unknown)}; there are {', '.join(known)}")
    named = [known[name] for name in options.worlds.split(",")]
    study = Study(options.city, "robust", options.requests, options.days, options.runs, options.seed)
    started = time.perf_counter()
    found = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    begun = max((one["order"] for one in found), default=0)
    found = [one for one in found if one["order"] < begun]  # the last may be incomplete
    options.out.write_text("".join(json.dumps(one) + "\n" for one in found), encoding="utf-8")
    for document in flown(study, named, drop=begun, minute=options.minute):
        found.append(document)
        with options.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(document) + "\n")
    for number, path in enumerate(options.also, start=1):
        others = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        found += [one | {"order": one["order"] + 100_000 * number} for one in others]
    print("\n".join(table(found, [OWN, *(world.name for world in named)])))
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
