"""What a seed changes: the same requests are planned with several seeds, and pairs of plans are compared.

``python -m benchmarks.tables.seeds [--seeds 10] [--only 0,5] [--out FILE]`` plans requests in the networks of New York, of the template, of the
hills, and of Melbourne where its data are; with ``--drawn 60 [--draw-seed 1]`` that many requests drawn at random in New York instead. It prints,
for each request, the mean delivery and its standard deviation between seeds, how many of all pairs of seeds agree in it within 2 % and in the route,
and the processor time of a plan; about ten minutes on an idle core.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cases.instances import FOLDER, read_instance
from benchmarks.tables.arguments import whole, wholes
from skyway.missions.examples import NEW_YORK
from skyway.models.base.errors import InfeasibleError, InputError
from skyway.models.composition.composition import State
from skyway.models.scenario.file import read_scenario
from skyway.planner.explain import stop_names
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.registry import ROBUST

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.models.scenario.scenario import Scenario

CASES = (
    ("newyork", "siuh-north", "white-plains", "2013-07-10T14:00-04:00", 0.8),
    ("newyork", "bellevue", "jacobi", "2013-02-10T10:00-05:00", 1.0),
    ("newyork", "coney-island", "white-plains", "2013-11-05T09:00-05:00", 0.5),
    ("newyork", "jersey-city", "mineola", "2013-05-12T16:00-04:00", 0.8),
    ("newyork", "jersey-city", "jacobi", "2013-07-17T08:00-04:00", 0.8),
    ("newyork", "yonkers", "siuh-north", "2013-03-21T12:00-04:00", 0.4),
    ("newyork", "mineola", "jersey-city", "2013-09-02T07:30-04:00", 1.2),
    ("newyork", "city-hall", "white-plains", "2013-12-14T17:00-05:00", 0.3),
    ("newyork", "columbia", "coney-island", "2013-04-08T11:00-04:00", 0.9),
    ("newyork", "white-plains", "jersey-city", "2013-06-23T15:00-04:00", 0.6),
    ("newyork", "jacobi", "siuh-north", "2013-08-15T10:00-04:00", 1.0),
    ("newyork", "belvedere", "mineola", "2013-10-29T13:00-04:00", 0.7),
    ("template", "north", "south", "2025-06-10T12:00+02:00", 0.5),
    ("template", "west", "north", "2025-06-20T09:00+02:00", 1.0),
    ("template", "south", "north", "2025-06-14T17:00+02:00", 0.3),
    ("hills", "depot", "pass", "2026-06-01T10:00+00:00", 0.8),
    ("hills", "westridge", "pass", "2026-06-01T07:00+00:00", 0.3),
)
"""Network, from, to, departure, payload in kg."""
MELBOURNE, DELIVERIES = "melbourne-0.7.json", 5
WITHIN = 0.02


@dataclass(frozen=True)
class Asked:
    """A request, and the day that its forecast leaves out."""

    network: str
    scenario: Scenario
    request: Request
    truth: date | None = None


def requests() -> Iterator[Asked]:
    """Those of `CASES`, and the first deliveries of an instance of Melbourne."""
    known = {name: read_scenario(NEW_YORK.parent / name) for name in ("newyork", "template", "hills")}
    for network, origin, to, depart, payload_kg in CASES:
        state = State(datetime.fromisoformat(depart), origin)
        yield Asked(network, known[network], Request(state=state, destination=to, payload_kg=payload_kg))
    instance = read_instance(FOLDER / MELBOURNE)
    try:
        scenario = instance.scenario()
    except InputError as error:
        print(error, file=sys.stderr)
        return
    for delivery in instance.deliveries[:DELIVERIES]:
        yield Asked("melbourne", scenario, *instance.request(delivery, "enough"))


def drawn(count: int, seed: int) -> Iterator[Asked]:
    """Requests between any two stations of New York, at any minute of 2013, with 0.2 to 1.4 kg."""
    scenario = read_scenario(NEW_YORK)
    rng = np.random.default_rng(seed)
    ids = [station.id for station in scenario.network.stations]
    year_min = 365 * 24 * 60
    for _ in range(count):
        origin, to = rng.choice(ids, 2, replace=False)
        depart = datetime(2013, 1, 1, tzinfo=UTC) + timedelta(minutes=int(rng.integers(year_min)))
        request = Request(
            state=State(depart, str(origin)), destination=str(to), payload_kg=round(rng.uniform(0.2, 1.4), 1)
        )
        yield Asked("newyork", scenario, request)


def planned(asked: Asked, seeds: range) -> Iterator[dict[str, Any]]:
    """Plan a request with several seeds, the first one twice: what is kept for the next is not counted."""
    depart = asked.request.state.time
    forecast = asked.scenario.forecast(depart, HORIZON_H, truth=asked.truth)
    for number, seed in enumerate([seeds[0], *seeds]):
        begun = time.process_time()
        request = replace(asked.request, seed=seed)
        found = plan(asked.scenario, request, planner=ROBUST, forecast=forecast)
        spent = time.process_time() - begun
        assert found.robust is not None
        if number:
            delivery = found.outcome.delivery
            yield {
                "network": asked.network,
                "from": request.state.station,
                "to": request.destination,
                "seed": seed,
                "drone": found.problem.drone.id,
                "route": list(stop_names(found.robust.candidates[0])),
                "mean_min": delivery.value / 60.0,
                "seed_error_min": delivery.seed_error / 60.0,
                "margin": found.robust.policy.known.margin,
                "p_success": found.outcome.p_success,
                "processor_s": spent,
            }


def row(plans: list[dict[str, Any]]) -> dict[str, float]:
    """Figures of the plans of one request."""
    mean = np.array([one["mean_min"] for one in plans])
    routes = [(one["drone"], *one["route"]) for one in plans]
    first, second = np.triu_indices(len(plans), 1)
    off = np.abs(mean[first] - mean[second]) / (0.5 * (mean[first] + mean[second]))
    same = [routes[a] == routes[b] for a, b in zip(first, second, strict=True)]
    return {
        "mean_min": float(mean.mean()),
        "deviation": float(mean.std(ddof=1) / mean.mean()),
        "told": float(np.mean([one["seed_error_min"] for one in plans]) / mean.mean()),
        "within": float((off <= WITHIN).mean()),
        "same_route": float(np.mean(same)),
        "routes": len(Counter(routes)),
        "processor_s": float(np.mean([one["processor_s"] for one in plans])),
    }


def main() -> int:
    """Plan, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=whole(2), default=10)
    parser.add_argument("--only", type=wholes, help="numbers of requests, 0,5")
    parser.add_argument("--drawn", type=whole(1), help="number of requests drawn at random, instead of the chosen ones")
    parser.add_argument("--draw-seed", type=whole(0), default=1)
    parser.add_argument("--out", type=Path, help="a line of JSON for each plan")
    options = parser.parse_args()
    rows = []
    every = list(drawn(options.drawn, options.draw_seed) if options.drawn else requests())
    if options.only is not None and max(options.only) >= len(every):
        parser.error(f"--only: requests have the numbers 0 to {len(every) - 1}")
    for number, asked in enumerate(every):
        if options.only is not None and number not in options.only:
            continue
        name = f"{number:2d} {asked.network} {asked.request.state.station} > {asked.request.destination}"
        try:
            plans = list(planned(asked, range(options.seeds)))
        except InfeasibleError as error:
            print(f"{name}: {error}", flush=True)
            continue
        if options.out is not None:
            with options.out.open("a") as file:
                file.writelines(json.dumps(one) + "\n" for one in plans)
        found = row(plans)
        rows.append(found)
        print(
            f"{name}: {found['mean_min']:.1f} min, deviation {100 * found['deviation']:.1f} % (told {100 * found['told']:.1f} %), "
            f"pairs within 2 % {100 * found['within']:.0f} %, same route {100 * found['same_route']:.0f} % ({found['routes']} routes), "
            f"{found['processor_s']:.2f} s",
            flush=True,
        )
    if rows:
        of = {key: np.array([one[key] for one in rows]) for key in rows[0]}
        print(
            f"{len(rows)} requests: pairs within 2 % {100 * of['within'].mean():.0f} %, same route {100 * of['same_route'].mean():.0f} %, "
            f"deviation {100 * np.median(of['deviation']):.1f} % (median), {of['processor_s'].mean():.2f} s a plan"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
