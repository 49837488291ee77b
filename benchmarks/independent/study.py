"""Orders flown in worlds: what was promised beside what became of it, counted by day."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.build import setting_for
from benchmarks.independent.delivery import DELIVERED, deliver
from benchmarks.independent.information import Order
from benchmarks.independent.product import planning, policies
from benchmarks.independent.product.promise import promised
from benchmarks.independent.product.supervised import Supervised
from benchmarks.independent.screening import chosen
from benchmarks.independent.telling import reports
from benchmarks.independent.told_arrivals import TOLD

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from datetime import date
    from pathlib import Path

    from benchmarks.independent.information import Policy
    from benchmarks.independent.product.promise import Promise
    from benchmarks.independent.worlds import World

PLANNERS: dict[str, Callable[[planning.Planned], Policy]] = {
    "robust": policies.Robust,
    "robust-turning": policies.TurningRobust,
    "online": policies.Online,
    "fly": Supervised,
}
"""What flies: the route of a plan, the same turning back, the online policy as `evaluate` has it, and as `fly` has it."""
PAYLOADS_KG = 0.2, 1.4
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
    any_drone: bool = False
    """Plans choose who flies, of the region's fleet; else it is the usual drone."""

    @property
    def documents(self) -> int:
        """How many there are of one order in one world."""
        return self.days if self.now else 1


def orders(study: Study) -> Iterator[Order]:
    """Draw orders: pairs of stations with pads, hours and days of the record, payloads."""
    if study.order:
        yield replace(written(study.order), any_drone=study.any_drone)
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
        yield Order(str(start), str(end), depart, float(rng.uniform(*PAYLOADS_KG)), number, study.any_drone)


def written(text: str) -> Order:
    """Read an order: origin, destination, departure with its UTC offset and payload in kg, with commas between."""
    origin, destination, depart, payload = text.split(",")
    return Order(origin, destination, datetime.fromisoformat(depart).timestamp(), float(payload))


def fly_order(study: Study, order: Order, worlds: Sequence[World]) -> Iterator[dict[str, Any]]:
    """Fly one order in several worlds; plans for the same sites are made once. JSON documents: one a world, or one a world and day."""
    days = planning.days_for(study.city, order, study.days, study.seed)
    plans: dict[str, tuple[planning.Planned, Promise] | None] = {}
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
            plans[world.kept_back] = None if plan is None else (plan, promised(plan, study.flown_runs))
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
    promise = promised(plan, study.flown_runs)
    return document | _flown(study, world, order, plan, promise, drawn)


def _flown(
    study: Study,
    world: World,
    order: Order,
    plan: planning.Planned,
    promise: Promise,
    drawn: tuple[list[date], np.ndarray, list[tuple[int, ...]]],
) -> dict[str, Any]:
    of_run, shift, seeds = drawn
    city, weight = planning.city(study.city, plan.request.drone or ""), np.ones(len(seeds))
    route: dict[str, Any] = {}
    if study.share < 1.0:
        setting = setting_for(world, city, order, shift, seeds)
        runs, weight, lowest = chosen(setting, order, policies.Robust(plan), study.share, seeds)
        route = {
            "told_below": plan.told_below(),
            "legs": plan.legs,
            "route_day": [day.toordinal() for day in of_run],
            "route_lowest": [None if math.isnan(soc) else round(soc, 5) for soc in lowest.tolist()],
        }
        of_run, seeds, shift = [of_run[k] for k in runs], [seeds[k] for k in runs], shift[runs]
    setting = setting_for(world, city, order, shift, seeds)
    policy = PLANNERS[study.planner](plan)
    flown = deliver(setting, order, policy) if seeds else []
    if isinstance(policy, Supervised):
        route[TOLD] = [
            [tuple(round(time_s - order.depart_s, 1) for time_s in one) for one in policy.told.get(run, ())]
            for run in range(len(seeds))
        ]
    return {
        "drone": plan.request.drone,
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
    } | route


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


def append_line(path: Path, study: Study, document: dict[str, Any]) -> None:
    """Add what was flown to the file of a study, for `read_lines`; a new file begins with the study, and a line cut off is left alone."""
    there = path.read_text(encoding="utf-8") if path.exists() else ""
    begin = "" if there.endswith("\n") else "\n" if there else json.dumps(asdict(study)) + "\n"
    with path.open("a", encoding="utf-8") as file:
        file.write(begin + json.dumps(document) + "\n")


def digest(documents: Sequence[dict[str, Any]]) -> str:
    """Checksum of results: the same seed gives the same."""
    return f"{zlib.crc32(json.dumps(list(documents), sort_keys=True).encode()):08x}"
