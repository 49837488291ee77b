"""Orders flown in worlds: what was promised beside what became of it, counted by day."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.build import setting_for
from benchmarks.independent.delivery import DELIVERED, STRANDED, deliver
from benchmarks.independent.information import Order
from benchmarks.independent.product import planning, policies
from benchmarks.independent.product.supervised import Supervised
from benchmarks.independent.screening import chosen
from benchmarks.independent.statistics import over_days, percent, wilson
from benchmarks.independent.telling import reports

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from datetime import date
    from pathlib import Path

    from numpy.typing import NDArray

    from benchmarks.independent.information import Policy
    from benchmarks.independent.worlds import World

PLANNERS: dict[str, Callable[[planning.Planned], Policy]] = {
    "robust": policies.Robust,
    "robust-turning": policies.TurningRobust,
    "online": policies.Online,
    "fly": Supervised,
}
"""What flies: the route of a plan, the same turning back, the online policy as `evaluate` has it, and as `fly` has it."""
RESERVE = 0.2
PAYLOADS_KG = 0.2, 1.4
SAME_TIME, TENTH_S = 0.002, 0.1
"""Distances on the plane of a world are those of the ellipsoid within this share, and times are written in tenths of a second: many deliveries in light
wind take the same time, that of the greatest speed over ground, and would be late by it."""
EDGE_S = 12 * 86_400.0
"""Orders keep so far from the ends of the record."""


@dataclass(frozen=True)
class Study:
    """What is flown: so many orders in a city, each on so many days of the record, so many times a day; or the one order that is written."""

    city: str
    planner: str
    orders: int
    days: int
    runs: int
    seed: int
    order: str = ""
    now: bool = False
    """Each day is planned for by itself, with what the sites reported by the departure."""
    flown_runs: int = 0
    """What is promised is that of so many deliveries simulated as `fly` decides them, not of the fixed route; 0: the route."""

    share: float = 1.0
    """Of the deliveries whose fixed route stays clear of the reserve so many are flown (`screening`); of the others all."""

    @property
    def documents(self) -> int:
        """How many there are of one order in one world."""
        return self.days if self.now else 1


def orders(study: Study) -> Iterator[Order]:
    """Draw orders: pairs of stations with pads, hours and days of the record, payloads."""
    if study.order:
        yield written(study.order)
        return
    city = planning.city(study.city)
    ids = [name for name, pads in zip(city.ground.ids, city.ground.pads, strict=True) if pads]
    first = city.sites[0].time_s[0] + EDGE_S
    days = int((city.sites[0].time_s[-1] - EDGE_S - first) / 86_400.0)
    for number in range(study.orders):
        rng = np.random.default_rng((study.seed, 11, number))
        start, end = rng.choice(ids, 2, replace=False)
        midnight = 86_400.0 * (math.floor(first / 86_400.0) + int(rng.integers(days)))
        depart = midnight + 3600.0 * int(rng.integers(*city.hour))
        yield Order(str(start), str(end), depart, float(rng.uniform(*PAYLOADS_KG)), number)


def written(text: str) -> Order:
    """Read an order: origin, destination, departure with its UTC offset and payload in kg, with commas between."""
    origin, destination, depart, payload = text.split(",")
    return Order(origin, destination, datetime.fromisoformat(depart).timestamp(), float(payload))


def fly_order(study: Study, order: Order, worlds: Sequence[World]) -> Iterator[dict[str, Any]]:
    """Fly one order in several worlds; plans for the same sites are made once. JSON documents: one a world, or one a world and day."""
    days = planning.days_for(study.city, order, study.days, study.seed)
    plans: dict[str, tuple[planning.Planned, planning.Promise] | None] = {}
    of_run = [day for day in days for _ in range(study.runs)]
    shift = np.array([planning.shift_s(study.city, order, day) for day in of_run])
    seeds: list[tuple[int, ...]] = [
        (study.seed, order.seed, day.toordinal(), k % study.runs) for k, day in enumerate(of_run)
    ]
    if study.now:
        for world in worlds:
            for day in days:
                runs = slice(of_run.index(day), of_run.index(day) + study.runs)
                yield _flown_now(study, order, world, days, (of_run[runs], shift[runs], seeds[runs]))
        return
    for world in worlds:
        if world.kept_back not in plans:
            plan = planning.planned(study.city, order, days, world.kept_back)
            plans[world.kept_back] = None if plan is None else (plan, planning.promised(plan, study.flown_runs))
        found = plans[world.kept_back]
        document: dict[str, Any] = {"world": world.name, "order": asdict(order), "planned": found is not None}
        if found is not None:
            document |= _flown(study, world, order, *found, (of_run, shift, seeds))
        yield document


def _flown_now(
    study: Study,
    order: Order,
    world: World,
    days: Sequence[date],
    drawn: tuple[list[date], np.ndarray, list[tuple[int, ...]]],
) -> dict[str, Any]:
    """Plan for one day with what was reported by the departure, and fly that day."""
    setting = setting_for(world, planning.city(study.city), order, drawn[1], drawn[2])
    told = reports(setting, 0, order.depart_s)
    complete = len(told) == len(setting.told)
    plan = planning.planned(study.city, order, days, world.kept_back, told if complete else None)
    document: dict[str, Any] = {"world": world.name, "order": asdict(order), "planned": plan is not None}
    if plan is None:
        return document
    promise = planning.promised(plan, study.flown_runs)
    return document | _flown(study, world, order, plan, promise, drawn)


def _flown(
    study: Study,
    world: World,
    order: Order,
    plan: planning.Planned,
    promise: planning.Promise,
    drawn: tuple[list[date], np.ndarray, list[tuple[int, ...]]],
) -> dict[str, Any]:
    of_run, shift, seeds = drawn
    city, weight = planning.city(study.city), np.ones(len(seeds))
    if study.share < 1.0:
        setting = setting_for(world, city, order, shift, seeds)
        runs, weight = chosen(setting, order, policies.Robust(plan), study.share, seeds)
        of_run, seeds, shift = [of_run[k] for k in runs], [seeds[k] for k in runs], shift[runs]
    setting = setting_for(world, city, order, shift, seeds)
    flown = deliver(setting, order, PLANNERS[study.planner](plan)) if seeds else []
    return {
        "weight": weight.tolist(),
        "run": [seed[-1] for seed in seeds],
        "promised_mean_s": promise.mean_s,
        "promised_quantile_s": promise.quantile_s,
        "promised": promise.promised,
        "promised_reserve": promise.reserve,
        "day": [day.toordinal() for day in of_run],
        "ending": [run.ending for run in flown],
        "delivery_s": [round(run.time_s - order.depart_s, 1) if run.ending == DELIVERED else None for run in flown],
        "landings": [[round(soc, 5) for soc in run.landings] for run in flown],
    }


@dataclass(frozen=True)
class Verdict:
    """What a world makes of a planner's promises; shares from 0 to 1, intervals over days.

    Attributes
    ----------
    deliveries
        Flown; where some were left out (`Study.share`) each counts for as many as it stands for.
    stands_for : float
        Deliveries that those flown stand for.
    below, below_wilson, below_days
        Deliveries with a landing below the reserve.
    lowest : (float, float, float)
        Lowest charge at a landing: the least of all deliveries, and what one in 1,000 and one in 100 of them is below.
    on_time : tuple
        (level, promised, kept, interval) at the levels of the plan's own quantiles.
    """

    world: str
    orders: int
    unplanned: int
    deliveries: int
    stands_for: float
    landings: int
    below_landings: int
    lowest: tuple[float, float, float]
    below_count: int
    below: float
    below_wilson: tuple[float, float]
    below_days: tuple[float, float]
    promised_below: float
    stranded: int
    not_delivered: int
    mean_min: float
    mean_days_min: tuple[float, float]
    promised_mean_min: float
    on_time: tuple[tuple[float, float, float, tuple[float, float]], ...]

    def line(self) -> str:
        """One line for people."""
        times = "  ".join(
            f"{100 * level:.0f}%: {100 * said:.1f} -> {percent(kept, days, '{:.1f}'.format)}"
            for level, said, kept, days in self.on_time
        )
        return (
            f"{self.world:<20} {self.orders} of {self.orders + self.unplanned} orders, {self.deliveries:>6} deliveries for {self.stands_for:.0f}: {self.below_count} below,  {percent(self.below, self.below_days)} "
            f"(Wilson {percent(self.below, self.below_wilson)[len(f'{100 * self.below:.2f} ') :]}, "
            f"promised {100 * self.promised_below:.3f}; of landings {100 * self.below_landings / max(self.landings, 1):.2f}, "
            f"1 % below SoC {self.lowest[2]:.3f}) stranded {self.stranded} failed {self.not_delivered} "
            f"mean {self.mean_min:.1f} min [{self.mean_days_min[0]:.1f}, {self.mean_days_min[1]:.1f}] "
            f"promised {self.promised_mean_min:.1f}  on time {times}"
        )


def verdict(documents: Sequence[dict[str, Any]]) -> Verdict:
    """Sum the orders of one world up."""
    flown = [one for one in documents if one["planned"]]
    day = np.array([value for one in flown for value in one["day"]], dtype=np.int64)
    weight = np.array([value for one in flown for value in one["weight"]], dtype=float)
    ending = [value for one in flown for value in one["ending"]]
    landings = [value for one in flown for value in one["landings"]]
    below = np.array([any(soc < RESERVE - 1e-9 for soc in socs) for socs in landings], dtype=float)
    time_s = np.array(
        [math.nan if value is None else value for one in flown for value in one["delivery_s"]], dtype=float
    )
    due = np.array([one["promised_quantile_s"] for one in flown for _ in one["day"]])
    said = np.array([one["promised"] for one in flown for _ in one["day"]])
    kept = np.where(np.isnan(time_s), math.inf, time_s)[:, None] <= due * (1.0 + SAME_TIME) + TENTH_S
    of_order = np.array([sum(one["weight"]) for one in flown], dtype=float)

    def mean_of(name: str) -> float:
        return float(np.average([one[name] for one in flown], weights=of_order))

    there = np.isfinite(time_s)
    mean_days = over_days(time_s, day, weight)
    return Verdict(
        world=documents[0]["world"],
        orders=len(flown),
        unplanned=len(documents) - len(flown),
        deliveries=len(ending),
        stands_for=float(weight.sum()),
        landings=sum(len(socs) for socs in landings),
        below_landings=sum(soc < RESERVE - 1e-9 for socs in landings for soc in socs),
        lowest=_lowest(landings),
        below_count=int(below.sum()),
        below=float(np.average(below, weights=weight)),
        below_wilson=_wilson(below, weight),
        below_days=over_days(below, day, weight),
        promised_below=1.0 - mean_of("promised_reserve"),
        stranded=ending.count(STRANDED),
        not_delivered=len(ending) - ending.count(DELIVERED) - ending.count(STRANDED),
        mean_min=float(np.average(time_s[there], weights=weight[there])) / 60.0,
        mean_days_min=(mean_days[0] / 60.0, mean_days[1] / 60.0),
        promised_mean_min=mean_of("promised_mean_s") / 60.0,
        on_time=tuple(
            (
                level,
                float(np.average(said[:, k], weights=weight)),
                float(np.average(kept[:, k], weights=weight)),
                over_days(kept[:, k].astype(float), day, weight),
            )
            for k, level in enumerate(planning.LEVELS)
        ),
    )


def _wilson(below: NDArray[np.float64], weight: NDArray[np.float64]) -> tuple[float, float]:
    """Interval of a share: of each of the two strata that screening makes, and their ends added up."""
    low = high = 0.0
    alone = weight == 1.0
    for one in (alone, ~alone):
        if one.any():
            ends, part = wilson(int(below[one].sum()), int(one.sum())), weight[one].sum() / weight.sum()
            low, high = low + part * ends[0], high + part * ends[1]
    return float(low), float(high)


def _lowest(landings: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    least = [min(socs) for socs in landings if socs] or [math.nan]
    low, thousandth, hundredth = np.quantile(least, (0.0, 0.001, 0.01)).tolist()
    return low, thousandth, hundredth


def read_lines(path: Path, study: Study) -> list[dict[str, Any]]:
    """What was flown before in the same study; a file of another study is refused, a line cut off is flown again."""
    if not path.exists():
        return []
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    if json.loads(head) != asdict(study):
        raise SystemExit(f"{path} is of another study: {head}; give another --out")
    found = []
    for line in lines:
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return found


def digest(documents: Sequence[dict[str, Any]]) -> str:
    """Checksum of results: the same seed gives the same."""
    return f"{zlib.crc32(json.dumps(list(documents), sort_keys=True).encode()):08x}"
