"""How far `robust` is above the wait-and-see bound where only the wind is unsure: no queues, no gusts, no errors of energy.

The bound of a request is the mean over members of the exact planner's answer when it is told the member. The fixed route
with charges decided at each stop is flown in every member by a drone whose forecast lacks that member and its neighbours;
planning again at every stop is flown on days that the forecast lacks, and so is the fixed route, for comparison.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.networks import new_york
from benchmarks.tables.arguments import whole
from benchmarks.tables.figure import Figure
from skyway.models.base.errors import InfeasibleError
from skyway.models.composition.composition import State
from skyway.models.queues.load import PadLoad
from skyway.planner.evaluation.evaluate import (
    NO_ERRORS,
    clairvoyant_times,
    fly_charging,
    fly_policy,
    held_out_forecast,
    sample_realizations,
    season_days,
)
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.request import Request
from skyway.planner.problem.speeds import TrueSpeeds
from skyway.planner.robust.robust import RobustSearch

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.evaluation.realizations import Realizations
    from skyway.planner.robust.charge_policy import ChargePolicy
    from skyway.planner.robust.robust import RobustAnswer

MEAN_TARGET, P95_TARGET = 2.0, 4.0
"""Percent above the bound that is wanted, over requests."""
DRONE = "m200"
FIRST = datetime(2013, 1, 10, 19, tzinfo=UTC)
DAYS_DRAWN, HOURS_DRAWN = 350, (-6, 7)
PAYLOADS_KG = 0.2, 1.4


@dataclass(frozen=True)
class GapRow:
    """One request.

    Attributes
    ----------
    origin, destination, depart : str
        Of the request.
    payload_kg : float
        Mass of the package.
    bound_s, fixed_s : float
        Means over the members of the forecast: of the exact planner that is told the member, and of the fixed route.
    worlds, missed : int
        Members that both answer, and those that only the exact planner arrives in.
    parts : dict of str to float
        Means over the same members of what lies between both, where asked for; see `parts_of`.
    day_bound_s, day_fixed_s, rolling_s, told_s : float
        Means over held-out days: bound, fixed route, planning again, and the same rules told the wind of the day; NaN where
        that was not flown.
    days : int
        Those days.
    rolling_failed : int
        Days on which planning again did not deliver though the exact planner does.
    seconds : float
        Spent on planning again.
    """

    origin: str
    destination: str
    depart: str
    payload_kg: float
    bound_s: float
    fixed_s: float
    worlds: int
    missed: int
    parts: dict[str, float]
    day_bound_s: float = math.nan
    day_fixed_s: float = math.nan
    rolling_s: float = math.nan
    told_s: float = math.nan
    days: int = 0
    rolling_failed: int = 0
    seconds: float = 0.0

    def document(self) -> dict[str, object]:
        """The row for a JSON file; unknown is None."""
        values = vars(self).items()
        return {key: None if isinstance(one, float) and math.isnan(one) else one for key, one in values}


def calm_pads() -> Scenario:
    """The built-in scenario without other drones: every pad is free."""
    world = new_york()
    return replace(world, load=PadLoad.none(len(world.network), world.load.timezone))


def requests(world: Scenario, count: int, seed: int) -> Iterator[Request]:
    """Draw requests: random pairs of stations with pads, hours of the day, days of the year and payloads."""
    ids = [station.id for station in world.network.stations if station.pads]
    rng = np.random.default_rng((seed, 3))
    for number in range(count):
        start, end = rng.choice(ids, 2, replace=False)
        later = timedelta(days=int(rng.integers(0, DAYS_DRAWN)), hours=int(rng.integers(*HOURS_DRAWN)))
        payload_kg = float(rng.uniform(*PAYLOADS_KG))
        state = State(FIRST + later, str(start))
        yield Request(state=state, destination=str(end), payload_kg=payload_kg, drone=DRONE, seed=number)


def told(problem: Problem, stops: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """Delivery time of the exact planner told each member, shape (members,); infinite where there is no way."""
    queues = problem.queue_paths(range(len(problem.network)), 0)
    found = np.full(len(problem.probability), math.inf)
    for member in range(len(found)):
        search = ExactSearch(problem, queues, speeds=TrueSpeeds(problem.air, member), stops=stops)
        if search.find() is not None:
            found[member] = search.best_s - problem.depart_s
    return found


def by_member(policy: ChargePolicy) -> NDArray[np.float64]:
    """Delivery time of a policy in each member, forecast by the others, shape (members,)."""
    members = len(policy.problem.probability)
    return policy.simulate(NO_ERRORS, members).arrival_s - policy.problem.depart_s


def parts_of(answer: RobustAnswer) -> dict[str, NDArray[np.float64]]:
    """What lies between the bound and the fixed route: delivery times in each member, shape (members,).

    ``own stops``: the exact planner told the member that may land only where the policy does: the price of the route.
    ``sure``: the policy charging for what it expects, with half of the flights below; ``unsmoothed``: without the width
    that is given to members; ``uncalibrated``: without the calibrated margin. ``best route``: in each member the best of
    the routes that were compared.
    """
    policy, problem = answer.policy, answer.policy.problem
    stops = np.zeros(len(problem.network), dtype=bool)
    stops[[int(problem.network.head[leg.segments[-1]]) for leg in policy.itinerary]] = True
    known = policy.known
    loose = known._replace(epsilon=0.5, smoothing=0.0, margin=0.0)
    routes = [by_member(one.policy) for one in answer.candidates]
    return {
        "own stops": told(problem, stops),
        "sure": by_member(replace(policy, known=loose)),
        "unsmoothed": by_member(replace(policy, known=known._replace(smoothing=0.0))),
        "uncalibrated": by_member(replace(policy, known=known._replace(margin=0.0))),
        "best route": np.min(routes, axis=0),
    }


def measure_request(
    world: Scenario, request: Request, *, days: int = 0, why: bool = False, rolling: bool = True
) -> GapRow | None:
    """Measure one request; None where there is no route.

    Parameters
    ----------
    world, request
        What is asked for.
    days : int
        Held-out days on which plans are flown; 0: none.
    why : bool
        Also tell the parts of the gap.
    rolling : bool
        Plan again on those days, too.
    """
    away = season_days(world, request, days, seed=request.seed) if days else ()
    forecast = held_out_forecast(world, request, away)
    start = Problem(world, request, world.drone(DRONE), forecast)
    try:
        answer = RobustSearch(start, errors=NO_ERRORS).solve()
    except InfeasibleError:
        return None
    problem = answer.policy.problem
    bound, fixed = told(problem), by_member(answer.policy)
    both = np.isfinite(bound) & np.isfinite(fixed)
    if not both.any():
        return None
    parts = parts_of(answer) if why else {}
    weight = problem.probability[both]
    state = request.state
    row = GapRow(
        origin=state.station or "",
        destination=request.destination,
        depart=state.time.isoformat(),
        payload_kg=request.payload_kg,
        bound_s=float(np.average(bound[both], weights=weight)),
        fixed_s=float(np.average(fixed[both], weights=weight)),
        worlds=int(both.sum()),
        missed=int((np.isfinite(bound) & ~both).sum()),
        parts={name: float(np.average(found[both], weights=weight)) for name, found in parts.items()},
    )
    if not away:
        return row
    realizations = sample_realizations(world, request, away, runs=len(away), errors=NO_ERRORS, seed=request.seed)
    best, _, _ = clairvoyant_times(realizations, DRONE, "exact", range(len(realizations)))
    flown = fly_charging(realizations, DRONE, answer.policy).delivery_s
    started = time.perf_counter()
    rolled = fly_policy(realizations, DRONE, RollingRobust(start, NO_ERRORS))[0].delivery_s if rolling else flown
    seconds = time.perf_counter() - started
    told_wind = rolled
    if rolling:
        told_wind = np.array([_told_the_wind(start, realizations, run) for run in range(len(realizations))])
    solved = np.isfinite(best) & np.isfinite(flown) & np.isfinite(rolled) & np.isfinite(told_wind)
    if not solved.any():
        return row
    return replace(
        row,
        day_bound_s=float(best[solved].mean()),
        day_fixed_s=float(flown[solved].mean()),
        rolling_s=float(rolled[solved].mean()) if rolling else math.nan,
        told_s=float(told_wind[solved].mean()) if rolling else math.nan,
        days=int(solved.sum()),
        rolling_failed=int((np.isfinite(best) & ~np.isfinite(rolled)).sum()),
        seconds=seconds,
    )


def _told_the_wind(start: Problem, realizations: Realizations, run: int) -> float:
    """Delivery time of the rolling horizon in one realization, with a perfect wind forecast, s."""
    told = Problem(start.scenario, start.request, start.drone, realizations.wind.member(int(realizations.day[run])))
    return float(fly_policy(realizations, DRONE, RollingRobust(told, NO_ERRORS), np.array([run]))[0].delivery_s[0])


def measured(count: int, *, seed: int = 1, days: int = 0, why: bool = False, rolling: bool = True) -> Iterator[GapRow]:
    """Rows of so many random requests, those without a route left out."""
    world = calm_pads()
    for request in requests(world, count, seed):
        row = measure_request(world, request, days=days, why=why, rolling=rolling)
        if row is not None:
            yield row


def gaps(values: Iterable[float], bounds: Iterable[float]) -> NDArray[np.float64]:
    """Percent above the bound, NaN left out, ascending."""
    found = 100.0 * (np.array(list(values)) / np.array(list(bounds)) - 1.0)
    return np.sort(found[np.isfinite(found)])


def figures_of(rows: list[GapRow]) -> list[Figure]:
    """Mean and 95th percentile over requests of each gap, beside what is wanted."""
    columns = {
        "fixed route, charges decided at each stop": gaps([r.fixed_s for r in rows], [r.bound_s for r in rows]),
        "the same on held-out days": gaps([r.day_fixed_s for r in rows], [r.day_bound_s for r in rows]),
        "rolling horizon, held-out days": gaps([r.rolling_s for r in rows], [r.day_bound_s for r in rows]),
        "  rolling horizon, perfect wind forecast": gaps([r.told_s for r in rows], [r.day_bound_s for r in rows]),
    }
    for name in rows[0].parts if rows else ():
        columns[f"  {name}"] = gaps([r.parts[name] for r in rows], [r.bound_s for r in rows])
    found = []
    for name, gap in columns.items():
        if not len(gap):
            continue
        wanted = (None, None) if name.startswith(" ") else (MEAN_TARGET, P95_TARGET)
        note = f"wind only, {len(gap)} requests"
        found.append(Figure(f"{name}: mean above bound", float(gap.mean()), "%", wanted[0], note))
        found.append(Figure(f"{name}: p95 above bound", float(np.quantile(gap, 0.95)), "%", wanted[1], note))
    return found


def measure(count: int = 30) -> list[Figure]:
    """Return the figures of the fixed route; the rolling horizon takes minutes and is run by this module's own command."""
    return figures_of(list(measured(count, days=6, rolling=False)))


def main() -> int:
    """Measure from a command line; rows are written as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=whole(1), default=60)
    parser.add_argument("--days", type=whole(1), default=6, help="held-out days of each request")
    parser.add_argument("--seed", type=whole(0), default=1)
    parser.add_argument("--why", action="store_true", help="tell the parts of the gap")
    parser.add_argument(
        "--no-rolling", action="store_true", help="leave the rolling horizon out: it takes seconds a delivery"
    )
    parser.add_argument("--out", type=Path, help="write rows to this file, one JSON document a line")
    options = parser.parse_args()
    rows = []
    for row in measured(
        options.requests, seed=options.seed, days=options.days, why=options.why, rolling=not options.no_rolling
    ):
        rows.append(row)
        if options.out is not None:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row.document()) + "\n")
    for figure in figures_of(rows):
        print(figure.line())
    failed, flown = sum(r.rolling_failed for r in rows), sum(r.days + r.rolling_failed for r in rows)
    print(
        f"  {sum(r.missed for r in rows)} members that only the exact planner arrives in; on {failed} of {flown} days"
    )
    print("  the rolling horizon did not deliver though the exact planner does")
    return 0


if __name__ == "__main__":
    sys.exit(main())
