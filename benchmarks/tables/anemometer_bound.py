"""How much drones could tell at best of the wind of the next hour over an airport: what drones that hover over it would tell.

The same days, hours, winds and forecasts as in `anemometer`. Instead of twenty drones somewhere, drones hover over all three airports at flight height,
over the one that is asked for too, and tell the wind 25, 15 and 5 minutes before: one each, with the error that a drone has (`FILTER_MPS`, `GUST_SHARE`), or twenty each. What that tells of the wind
15 to 60 minutes later is learnt by least squares from 60 other days of the same nature and the same forecasts, the spread of what is left included: the best linear filter, with the true covariances.
Drones somewhere else cannot tell more, by whatever filter.

    python -m benchmarks.tables.anemometer_bound
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.product import planning
from benchmarks.tables.anemometer import (
    DRONES,
    FILTER_MPS,
    GUST_SHARE,
    HEIGHT_M,
    HOURS,
    HOURS_UTC,
    LEADS_MIN,
    NATURES,
    Nature,
    crps,
)
from benchmarks.tables.forecast_gain import CITY, Service, held_out_days, learning_days
from skyway.models.base.units import from_posix
from skyway.planner.evaluation.statistics import DayBootstrap

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import date

    from numpy.typing import NDArray

BEFORE_MIN = (25, 15, 5)
TRAINING_HOURS_UTC = (13, 15, 17, 19, 21)
DRAWS = 400
OVER = {"one drone over each airport": 1, "twenty over each": 20}


def cases(
    days: Sequence[date], hours: Sequence[int], service: Service, seed: int, nature: str
) -> Iterator[dict[str, Any]]:
    """For each day, hour and airport: what is known before, what comes, and what was forecast; all winds (north, east) at flight height."""
    scenario = planning.told_scenario(CITY, "")
    sites = planning.city(CITY).sites
    lat, lon = (np.array([getattr(site, name) for site in sites]) for name in ("lat", "lon"))
    apart = np.hypot(lat[:, None] - lat, (lon[:, None] - lon) * np.cos(np.radians(lat.mean())))
    for day in days:
        for hour in hours:
            now_s = datetime(day.year, day.month, day.day, hour, tzinfo=UTC).timestamp() + 1200.0
            begin_s = now_s - 3600.0
            told = scenario.forecast_from(
                [service.newest(now_s)], from_posix(begin_s), HOURS, error=service.error, truth=day
            ).at_height(HEIGHT_M, scenario.rules.wind_profile_exponent)
            truth = Nature(begin_s, (seed, day.toordinal(), hour), DRONES, smooth=nature == "smooth")
            known: dict[int, list[NDArray[np.float64]]] = {}
            expected: dict[int, list[NDArray[np.float64]]] = {}
            members: dict[int, list[NDArray[np.float64]]] = {}
            for minute in (*(-one for one in BEFORE_MIN), *LEADS_MIN):
                at_s = now_s + 60.0 * minute
                known[minute], expected[minute], members[minute] = [], [], []
                for k in range(len(sites)):
                    here = np.full(DRONES, lat[k]), np.full(DRONES, lon[k])
                    known[minute].append(truth.aloft(*here, at_s - begin_s)[0])
                    both = np.stack(told.wind_at(float(lat[k]), float(lon[k]), told.slot_at(at_s)), axis=-1)
                    expected[minute].append(told.probability @ both)
                    members[minute].append(both)
            for k in range(len(sites)):
                order = np.argsort(apart[k])
                before = np.array([[known[-b][i] for i in order] for b in BEFORE_MIN]).reshape(-1, 2)
                then = np.array([[expected[-b][i] for i in order] for b in BEFORE_MIN]).reshape(-1, 2)
                error = np.hypot(FILTER_MPS, GUST_SHARE * np.hypot(*before.T))[:, None]
                rng = np.random.default_rng((seed, day.toordinal(), hour, k))
                drawn = rng.standard_normal(before.shape)
                yield {
                    "day": day.toordinal(),
                    "known": [before + error / np.sqrt(count) * drawn - then for count in OVER.values()],
                    "later": np.array([known[m][k] for m in LEADS_MIN]),
                    "expected": np.array([expected[m][k] for m in LEADS_MIN]),
                    "members": [members[m][k] for m in LEADS_MIN],
                    "probability": told.probability,
                }


def gains(training: Sequence[dict[str, Any]], tested: Sequence[dict[str, Any]]) -> list[NDArray[np.float64]]:
    """CRPS of the speed, shape (cases, leads), of the forecast alone, of it with the errors that it had, and of it with what drones `OVER` the airports tell."""
    rng = np.random.default_rng(1)
    alone = np.array(
        [
            [
                crps(np.hypot(*one["members"][lead].T), one["probability"], float(np.hypot(*one["later"][lead])))
                for lead in range(len(LEADS_MIN))
            ]
            for one in tested
        ]
    )
    found = [alone]
    size = {id(one): np.sqrt(1.0 + (np.hypot(*one["expected"].T) / 8.0) ** 2) for one in (*training, *tested)}
    for use in (None, *range(len(OVER))):
        scores = np.empty_like(alone)
        for lead in range(len(LEADS_MIN)):
            off = np.array([(one["later"] - one["expected"])[lead] for one in training])  # (cases, components)
            scale = np.array([size[id(one)][lead] for one in training])[:, None]
            told = np.zeros((len(training), 0, 2)) if use is None else np.array([one["known"][use] for one in training])
            design = np.concatenate([told[:, :, part] / scale for part in (0, 1)])
            gain = np.linalg.lstsq(design, np.concatenate((off / scale).T), rcond=None)[0]
            left = (off - np.einsum("cfp,f->cp", told, gain)) / scale
            for row, one in enumerate(tested):
                here = np.zeros((0, 2)) if use is None else one["known"][use]
                mean = one["expected"][lead] + gain @ here
                drawn = mean + size[id(one)][lead] * left[rng.integers(len(left), size=DRAWS)]
                speed = np.hypot(*one["later"][lead])
                scores[row, lead] = crps(np.hypot(*drawn.T), np.full(DRAWS, 1.0 / DRAWS), float(speed))
        found.append(scores)
    return found


def main() -> int:
    """Learn, score, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--days", type=int, default=24)
    parser.add_argument("--seed", type=int, default=2020)
    options = parser.parse_args()
    held_out = held_out_days(options.seed)
    learning = learning_days(held_out)
    started = time.perf_counter()
    print(
        f"| wind | minutes ahead | forecast alone, m/s | with the errors it had | {' | better by, % | '.join(OVER)} | better by, % |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        service = Service.beginning(Path(folder), learning, 1.0)
        for nature in NATURES:
            training = list(cases(learning, TRAINING_HOURS_UTC, service, options.seed + 1, nature))
            tested = list(cases(held_out[: options.days], HOURS_UTC, service, options.seed, nature))
            scores = gains(training, tested)
            days = DayBootstrap(np.array([one["day"] for one in tested]))
            for which, lead in [*zip(np.eye(len(LEADS_MIN)), LEADS_MIN, strict=True), (np.full(4, 0.25), "15 to 60")]:
                alone, *others = (one @ which for one in scores)
                cells = [days.mean(one).text(".2f") for one in (alone, *others)]
                gained = [days.ratio(alone - one, alone).scaled(100.0).text(".0f") for one in others[1:]]
                told = [word for pair in zip(cells[2:], gained, strict=True) for word in pair]
                print(f"| {nature} | {lead} | {' | '.join((*cells[:2], *told))} |", flush=True)
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
