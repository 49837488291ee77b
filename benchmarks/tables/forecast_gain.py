"""What a forecast gains: New York on 24 held-out days, planned from the season's days alone and from a forecast of realistic error.

Two days of each month are drawn and never used for anything else. On each of them orders leave between 8 and 21 o'clock. Each is planned four times: from the
record without that day; from the answer of a weather service issued up to two hours before (`benchmarks.cases.day_forecast`), read as a file, with the error by lead
that is published; with the error that ``skyway weather verify`` learns from the forecasts of 60 other days; and with that and the METARs that were out. All are flown in the true wind of the day: by the
product's out-of-sample evaluation, by its online policy where that is asked for, and in worlds of `benchmarks.independent`, which share no code with the planner.

    python -m benchmarks.tables.forecast_gain --orders 12 --out gain.jsonl
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cases.day_forecast import HOUR_S, DayForecasts, rest_by_lead
from benchmarks.independent.build import setting_for
from benchmarks.independent.delivery import DELIVERED, deliver
from benchmarks.independent.information import Order
from benchmarks.independent.product import planning, policies
from benchmarks.independent.study import PAYLOADS_KG
from benchmarks.independent.verdict import RESERVE
from benchmarks.independent.worlds import worlds
from benchmarks.tables.weather_of_now import mean_known, published, share_kept
from skyway.models.weather.lead_error import lead_error_text
from skyway.models.weather.readers.reading import read_weather
from skyway.models.weather.verification import learn, pairs_of
from skyway.models.wind.estimation.field import WindObservation
from skyway.planner.evaluation.evaluate import fly_charging, fly_policy, held_out_forecast, sample_realizations
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.problem.problem import HORIZON_H, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from benchmarks.independent.worlds import World
    from skyway.models.wind.ensemble import WindEnsemble

CITY, DAYS, LEARNING_DAYS = "new-york", 24, 60
OWN = "out of sample"
ONLINE = "decided again at each stop"
RECORD = "record alone"
ARMS = (RECORD, "forecast, published error", "forecast, learnt error", "the same and reports of now")
LEVELS = (0.05, 0.5, 0.8, 0.95)
OWN_RUNS = 200


def held_out_days(seed: int) -> list[date]:
    """Two days of each month of 2013, at least three apart, drawn by a seed."""
    rng = np.random.default_rng((seed, 24))
    found = []
    for month in range(1, 13):
        first = int(rng.integers(4, 13))
        found += [date(2013, month, first), date(2013, month, int(first + rng.integers(4, 15)))]
    return found


def learning_days(held_out: Sequence[date]) -> list[date]:
    """Days of the same year, none within three of those held out."""
    year = [date(2013, 1, 10) + timedelta(days=number) for number in range(340)]
    free = [day for day in year if all(abs((day - other).days) > 3 for other in held_out)]
    return [free[k * len(free) // LEARNING_DAYS] for k in range(LEARNING_DAYS)]


def orders(day: date, count: int, seed: int) -> Iterator[Order]:
    """Draw orders of a day: pairs of stations with pads, minutes between 8 and 21 o'clock, payloads."""
    ground = planning.city(CITY).ground
    ids = [name for name, pads in zip(ground.ids, ground.pads, strict=True) if pads]
    midnight = datetime(day.year, day.month, day.day, tzinfo=UTC).timestamp()
    low, high = planning.LEAVING_UTC_H[CITY]
    for number in range(count):
        rng = np.random.default_rng((seed, 25, day.toordinal(), number))
        start, end = rng.choice(ids, 2, replace=False)
        depart = midnight + 60.0 * int(rng.integers(60 * low, 60 * (high - 2)))
        yield Order(str(start), str(end), depart, float(rng.uniform(*PAYLOADS_KG)), 1000 * day.toordinal() + number)


@dataclass(frozen=True)
class Service:
    """Forecasts in files, and the error that was learnt from those of other days."""

    made: DayForecasts
    folder: Path
    error: Path

    @classmethod
    def beginning(cls, folder: Path, learnt_on: Sequence[date], scale: float) -> Service:
        """Make the forecasts of some days and learn from them, as ``skyway weather verify`` does."""
        sites = planning.city(CITY).sites
        rng = np.random.default_rng(60)
        issues = [
            datetime(day.year, day.month, day.day, int(rng.integers(0, 24)), tzinfo=UTC).timestamp()
            for day in learnt_on
        ]
        found = cls(DayForecasts(sites, rest_by_lead(sites, issues), scale), folder, folder / "error.json")
        scenario = planning.told_scenario(CITY, "")
        weathers = [one for issue in issues for one in read_weather([found.made.file(folder, issue)])]
        seen = [
            WindObservation(
                float(at) + 0.5 * HOUR_S,
                site.lat,
                site.lon,
                float(wind[0]),
                float(wind[1]),
                1.0,
                scenario.measured_at_m,
            )
            for site in sites
            for at, wind in zip(site.time_s, site.wind, strict=True)
            if any(0.0 <= at - issue <= 48 * HOUR_S for issue in issues)
        ]
        pairs = pairs_of(weathers, seen, scenario.rules.wind_profile_exponent)
        learnt = learn(pairs, f"learnt from {len(pairs):,} comparisons", scenario.measured_at_m)
        found.error.write_text(lead_error_text(learnt), encoding="utf-8")
        return found

    def newest(self, time_s: float) -> Path:
        """The newest answer that is out at a time."""
        return self.made.newest(self.folder, time_s)


def forecasts(service: Service, order: Order, day: date) -> dict[str, WindEnsemble]:
    """What each arm is told of the wind; of places where it is measured, as in the record."""
    scenario, request = planning.told_scenario(CITY, ""), planning.request_of(CITY, order)
    where = np.array([(site.lat, site.lon) for site in scenario.wind_sites]).T
    path = service.newest(order.depart_s)

    def read(begin: datetime, hours: int, error: Path | None = service.error) -> WindEnsemble:
        return scenario.forecast_from([path], begin, hours, error=error, truth=day).at_sites(*where)

    depart = request.state.time
    found = {RECORD: held_out_forecast(scenario, request, [day])}
    found[ARMS[1]], found[ARMS[2]] = read(depart, HORIZON_H, None), read(depart, HORIZON_H)
    reports = published(planning.city(CITY), order, 0.0)
    found[ARMS[3]] = found[ARMS[2]] if reports is None else planning.told_reports(scenario, request, read, reports)
    return found


def flown(service: Service, days: Sequence[date], count: int, seed: int, named: Sequence[World], runs: int,
          known: set[tuple[int, int]], online: int = 0) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Plan and fly; a document for each order and arm. `known` holds (day, order) of what is there already."""
    for day in days:
        for order in orders(day, count, seed):
            if (day.toordinal(), order.seed) in known:
                continue
            for arm, forecast in forecasts(service, order, day).items():
                told: dict[str, Any] = {"arm": arm, "order": order.seed, "day": day.toordinal()}
                plan = planning.planned_on(planning.told_scenario(CITY, ""), planning.request_of(CITY, order), forecast)
                yield (
                    told
                    | {"planned": plan is not None}
                    | ({} if plan is None else _flown(order, day, plan, named, runs, seed, online))
                )


def _flown(
    order: Order, day: date, plan: planning.Planned, named: Sequence[World], runs: int, seed: int, online: int
) -> dict[str, Any]:
    outcome = plan.result.outcome
    due = [outcome.quantile_s(level) for level in LEVELS]
    found: dict[str, Any] = {
        "promised_mean_s": plan.promise.mean_s,
        "due_s": [one - order.depart_s for one in due],
        "promised": [outcome.p_by(one) for one in due],
    }
    assert plan.result.robust is not None
    request = replace(plan.request, drone=plan.result.composition.drone)
    truths = sample_realizations(plan.scenario, request, [day], runs=OWN_RUNS, seed=seed + order.seed)
    own = fly_charging(truths, plan.result.composition.drone, plan.result.robust.policy)
    found[OWN] = {"s": _rounded(own.delivery_s), "below": int(own.below_reserve.sum())}
    if online:
        few = sample_realizations(plan.scenario, request, [day], runs=online, seed=seed + order.seed)
        drone = plan.scenario.drone(plan.result.composition.drone)
        again, _ = fly_policy(few, drone.id, RollingRobust(Problem(plan.scenario, plan.request, drone, plan.forecast)))
        found[ONLINE] = {"s": _rounded(again.delivery_s), "below": int(again.below_reserve.sum())}
    seeds: list[tuple[int, ...]] = [(seed, order.seed, k) for k in range(runs)]
    policy = policies.Robust(plan)
    for world in named:
        flights = deliver(setting_for(world, planning.city(CITY), order, np.zeros(runs), seeds), order, policy)
        times = [run.time_s - order.depart_s if run.ending == DELIVERED else np.nan for run in flights]
        below = sum(any(soc < RESERVE - 1e-9 for soc in run.landings) for run in flights)
        found[world.name] = {"s": _rounded(np.array(times)), "below": below}
    return found


def _rounded(times: np.ndarray) -> list[float | None]:
    return [round(one, 1) if np.isfinite(one) else None for one in times.tolist()]


def table(documents: Sequence[Mapping[str, Any]], named: Sequence[str]) -> list[str]:
    """Rows of the table, in Markdown: all arms where all have a plan, intervals over days."""
    by_order: dict[int, dict[str, Mapping[str, Any]]] = {}
    for one in documents:
        by_order.setdefault(one["order"], {})[one["arm"]] = one
    whole = [
        arms for arms in by_order.values() if len(arms) == len(ARMS) and all(one["planned"] for one in arms.values())
    ]
    unplanned = sum(not one["planned"] for one in documents)
    day = np.array([one[RECORD]["day"] for one in whole])
    days = DayBootstrap(day)
    lines = [
        f"{len(whole)} orders on {len(set(day.tolist()))} days; without a plan: {unplanned}",
        "",
        "| flown | planned with | p5 to p95 of the arrival, min | of today's, % | median | delivery, min | of today's, % | kept of 5 / 50 / 80 / 95 % | below the reserve | not delivered |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    width = {arm: np.array([(one[arm]["due_s"][-1] - one[arm]["due_s"][0]) / 60.0 for one in whole]) for arm in ARMS}
    for name in named:
        means = {arm: np.array([mean_known(one[arm][name]["s"]) for one in whole]) / 60.0 for arm in ARMS}
        known = np.all([np.isfinite(values) for values in means.values()], axis=0)
        for arm in ARMS:
            mine = [one[arm] for one in whole]
            mean = np.where(known, means[arm], np.nan)
            shares = days.ratio(width[arm], width[RECORD]), days.ratio(mean, np.where(known, means[RECORD], np.nan))
            kept = [
                days.mean(np.array([share_kept(one[name]["s"], one["due_s"][k]) for one in mine]))
                for k in range(len(LEVELS))
            ]
            promised = [float(np.mean([one["promised"][k] for one in mine])) for k in range(len(LEVELS))]
            below, runs = sum(one[name]["below"] for one in mine), sum(len(one[name]["s"]) for one in mine)
            lost = sum(one[name]["s"].count(None) for one in mine)
            ratios = ["" if arm == RECORD else one.scaled(100.0).text(".0f") for one in shares]
            calibration = ", ".join(
                f"{100 * said:.0f}: {one.scaled(100.0).text('.0f')}" for said, one in zip(promised, kept, strict=True)
            )
            lines.append(
                f"| {name if arm == RECORD else ''} | {arm} | {days.mean(width[arm]).text()} | {ratios[0]} | {float(np.median(width[arm])):.1f} | "
                f"{days.mean(mean).text()} | {ratios[1]} | {calibration} | {below:,} of {runs:,} | {lost:,} |"
            )
    return lines


def main() -> int:
    """Fly, and print the table; lines are kept as they come, so that a run that was stopped goes on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--orders", type=int, default=12, help="of each day")
    parser.add_argument("--days", type=int, default=DAYS)
    parser.add_argument("--runs", type=int, default=5, help="deliveries in each world")
    parser.add_argument("--worlds", default="ours,weather")
    parser.add_argument("--seed", type=int, default=1919)
    parser.add_argument("--tuning", action="store_true", help="days that the tables are not made of")
    parser.add_argument(
        "--online", type=int, default=0, help="deliveries of the online policy, which decides at each stop; slow"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="of all errors of the forecasts")
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, one for each order and arm")
    options = parser.parse_args()
    known = worlds(tuple(site.id for site in planning.city(CITY).sites))
    named = [known[name] for name in options.worlds.split(",") if name]
    held_out = held_out_days(options.seed)
    days = held_out[:: max(DAYS // options.days, 1)][: options.days]
    if options.tuning:
        days = learning_days(held_out)[1 :: LEARNING_DAYS // options.days][: options.days]
    started = time.perf_counter()
    found = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    arms: dict[tuple[int, int], int] = {}
    for one in found:
        arms[one["day"], one["order"]] = arms.get((one["day"], one["order"]), 0) + 1
    whole = {key for key, count in arms.items() if count == len(ARMS)}
    found = [one for one in found if (one["day"], one["order"]) in whole]
    options.out.write_text("".join(json.dumps(one) + "\n" for one in found), encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        service = Service.beginning(Path(folder), learning_days(held_out), options.scale)
        for document in flown(service, days, options.orders, options.seed, named, options.runs, whole, options.online):
            found.append(document)
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(document) + "\n")
    online = [ONLINE] if options.online else []
    print("\n".join(table(found, [OWN, *online, *(world.name for world in named)])))
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
