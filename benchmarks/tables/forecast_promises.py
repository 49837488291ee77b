"""Promises of plans with a forecast of the day, on every day of New York's year that was not looked at before.

`forecast_gain` has 24 days, and all orders of a day meet one wind: its intervals are 5 points wide. Here every other day of 2013 has two orders. Plans of odd months are made
with the error that was learnt from forecasts of even months, and the other way round. Each plan is flown in four truths, so that what is missed is told apart:

- *drawn*: other draws of the very ensemble that it was made from, with queues, gusts and vehicles of their own. What is missed here is missed by the planner: it chose what looked best.
- *the day*: the wind of the record on that day.
- *the day, told*: the same of a plan that knew that wind. What is missed here is not the forecast's.
- *record alone*: the same of a plan without a forecast.

    python -m benchmarks.tables.forecast_promises --out promises.jsonl
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.product import planning
from benchmarks.tables.forecast_gain import (
    CITY,
    LEARNING_DAYS,
    LEVELS,
    Service,
    held_out_days,
    learning_days,
    orders,
)
from benchmarks.tables.weather_of_now import share_kept
from skyway.models.base.errors import InputError
from skyway.models.weather.forecasting import forecast_ensemble
from skyway.models.weather.lead_error import read_lead_error
from skyway.models.weather.readers.reading import read_weather
from skyway.models.weather.region import Region
from skyway.planner.evaluation.evaluate import Realizations, fly_charging, held_out_forecast, sample_realizations
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.problem.problem import HORIZON_H

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from benchmarks.independent.information import Order
    from skyway.models.wind.ensemble import WindEnsemble

DRAWN, DAY, TOLD, RECORD = "drawn", "the day", "the day, told", "record alone"
ARMS = DRAWN, DAY, TOLD, RECORD
RUNS = 200
FIRST, LAST = date(2013, 1, 10), date(2013, 12, 15)
LOOKED_AT = 1919, 2020
"""Seeds of the studies whose days are left out here."""


def days_of(parity: int, *, looked_at: bool) -> list[date]:
    """Days of the odd (1) or even (0) months, without those near their ends, with or without those that were looked at."""
    known: set[date] = set()
    for seed in LOOKED_AT:
        held_out = held_out_days(seed)
        known |= {*held_out, *learning_days(held_out)[1 :: LEARNING_DAYS // 20]}
    year = [FIRST + timedelta(days=number) for number in range((LAST - FIRST).days)]
    return [
        day
        for day in year
        if day.month % 2 == parity and (day - timedelta(days=3)).month == day.month and (looked_at or day not in known)
    ]


def drawn_realizations(service: Service, order: Order, base: Realizations, seed: int) -> Realizations:
    """Other draws of the ensemble that an order is planned from, one for each run of `base`."""
    scenario, request = planning.told_scenario(CITY, ""), planning.request_of(CITY, order)
    where = np.array([(site.lat, site.lon) for site in scenario.wind_sites]).T
    weathers = read_weather([service.newest(order.depart_s)])
    error = read_lead_error(service.error)
    parts: list[WindEnsemble] = []
    while sum(len(one) for one in parts) < len(base):
        region = Region(
            scenario.network.lat, scenario.network.lon, request.state.time.timestamp(), HORIZON_H,
            scenario.rules.cruise_height_m, scenario.rules.wind_profile_exponent,
            seed=1000 * (seed + 1) + len(parts), later=lambda begin, hours: scenario.analogues(_at(begin), hours, base.days[0]),
        )  # fmt: skip
        parts.append(forecast_ensemble(weathers, region, error).at_sites(*where))
    runs = len(base)
    wind = replace(
        parts[0],
        north=np.concatenate([one.north for one in parts])[:runs],
        east=np.concatenate([one.east for one in parts])[:runs],
        probability=np.full(runs, 1.0 / runs),
        labels=tuple(f"drawn {number}" for number in range(runs)),
    )
    days = tuple(base.days[0] for _ in range(runs))
    return replace(base, days=days, wind=wind, day=np.arange(runs))


def _at(posix_s: float) -> Any:
    from skyway.models.base.units import from_posix

    return from_posix(posix_s)


def flown(
    service: Service,
    days: Sequence[date],
    count: int,
    seed: int,
    known: set[tuple[int, int]],
    arms: Sequence[str] = ARMS,
) -> Iterator[dict[str, Any]]:
    """Plan and fly; a document for each order."""
    scenario = planning.told_scenario(CITY, "")
    where = np.array([(site.lat, site.lon) for site in scenario.wind_sites]).T
    for day in days:
        for order in orders(day, count, seed):
            if (day.toordinal(), order.seed) in known:
                continue
            request = planning.request_of(CITY, order)
            depart = request.state.time
            try:
                truth = scenario.truth(day, depart, HORIZON_H)
            except InputError:  # the record has a gap
                continue
            told = scenario.forecast_from(
                [service.newest(order.depart_s)], depart, HORIZON_H, error=service.error, truth=day
            )
            forecasts: dict[str, WindEnsemble] = {DAY: told.at_sites(*where)}
            if TOLD in arms:
                forecasts[TOLD] = truth
            if RECORD in arms:
                forecasts[RECORD] = held_out_forecast(scenario, request, [day])
            document: dict[str, Any] = {"day": day.toordinal(), "order": order.seed}
            for name, forecast in forecasts.items():
                plan = planning.planned_on(scenario, request, forecast)
                if plan is None:
                    continue
                base = sample_realizations(scenario, _flying(plan), [day], runs=RUNS, seed=seed + order.seed)
                document[name] = _judged(order, plan, base)
                if name == DAY:
                    document[DRAWN] = _judged(order, plan, drawn_realizations(service, order, base, seed + order.seed))
            yield document


def _flying(plan: planning.Planned) -> Any:
    return replace(plan.request, drone=plan.result.composition.drone)


def _judged(order: Order, plan: planning.Planned, truths: Realizations) -> dict[str, Any]:
    outcome = plan.result.outcome
    due = [outcome.quantile_s(level) for level in LEVELS]
    assert plan.result.robust is not None
    flown = fly_charging(truths, plan.result.composition.drone, plan.result.robust.policy)
    s = [float(one) if np.isfinite(one) else None for one in flown.delivery_s.tolist()]
    return {
        "width_s": due[-1] - due[0],
        "promised_mean_s": plan.promise.mean_s,
        "promised": [outcome.p_by(one) for one in due],
        "kept": [share_kept(s, one - order.depart_s) for one in due],
        "mean_s": float(np.mean([one for one in s if one is not None] or [np.nan])),
        "lost": s.count(None),
        "below": int(flown.below_reserve.sum()),
    }


def table(documents: Sequence[Mapping[str, Any]]) -> list[str]:
    """Rows of the table, in Markdown: orders that have a plan with all, intervals over days."""
    arms = [arm for arm in ARMS if any(arm in one for one in documents)]
    whole = [one for one in documents if all(arm in one for arm in arms)]
    days = DayBootstrap(np.array([one["day"] for one in whole]))
    lines = [
        f"{len(whole)} orders on {len({one['day'] for one in whole})} days",
        "",
        "| flown in | p5 to p95 of the arrival, min | of today's, % | promised mean, min | delivery, min | of today's, % | kept of 5 / 50 / 80 / 95 % | kept less promised, points | not delivered |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for arm in arms:
        mine = [one[arm] for one in whole]
        kept, promised = (np.array([one[name] for one in mine]) for name in ("kept", "promised"))
        levels = ", ".join(
            f"{100 * float(said.mean()):.0f}: {days.mean(one).scaled(100.0).text('.0f')}"
            for said, one in zip(promised.T, kept.T, strict=True)
        )
        off = ", ".join(days.mean(one).scaled(100.0).text("+.1f") for one in (kept - promised).T)
        columns = []
        for name in ("width_s", "promised_mean_s", "mean_s"):
            here = np.array([one[name] for one in mine]) / 60.0
            columns.append(days.mean(here).text())
            if name != "promised_mean_s":
                today = np.array([one[RECORD][name] for one in whole]) / 60.0 if RECORD in arms else here
                columns.append(
                    "" if arm == RECORD or RECORD not in arms else days.ratio(here, today).scaled(100.0).text(".0f")
                )
        lost = sum(one["lost"] for one in mine)
        lines.append(f"| {arm} | {' | '.join(columns)} | {levels} | {off} | {lost} of {RUNS * len(mine):,} |")
    return lines


def main() -> int:
    """Fly, and print the table; lines are kept as they come, so that a run that was stopped goes on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--orders", type=int, default=2, help="of each day")
    parser.add_argument("--every", type=int, default=1, help="one day in so many")
    parser.add_argument("--parity", type=int, choices=(0, 1), help="only even or odd months")
    parser.add_argument("--seed", type=int, default=1920)
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, one for each order")
    options = parser.parse_args()
    started = time.perf_counter()
    found = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    known = {(one["day"], one["order"]) for one in found}
    for parity in (0, 1) if options.parity is None else (options.parity,):
        others = days_of(1 - parity, looked_at=True)
        learning = [others[k * len(others) // LEARNING_DAYS] for k in range(LEARNING_DAYS)]
        with tempfile.TemporaryDirectory() as folder:
            service = Service.beginning(Path(folder), learning, 1.0)
            days = days_of(parity, looked_at=False)
            days = np.random.default_rng(options.seed).permutation(np.array(days))[:: options.every].tolist()
            for document in flown(service, days, options.orders, options.seed, known):
                found.append(document)
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(document) + "\n")
    print("\n".join(table(found)))
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
