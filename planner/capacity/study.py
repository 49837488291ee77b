"""A study of the capacity of a network: orders an hour, promise, fleet, and the most useful addition."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.geodesy import coarse_distance_m
from skyway.models.base.units import S_PER_MIN
from skyway.planner.capacity.changes import Change
from skyway.planner.capacity.day import Case, DayDone, Piece

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.models.network.network import Network
    from skyway.planner.capacity.day import Study

    Run = Callable[[list[Piece]], list[DayDone]]
    """Simulates days, and returns them in order."""

SCHEMA = "skyway.capacity/1"
NEW_STATIONS = 8
"""Number of places tried for a station."""
APART_M = 4000.0
"""Least distance from each other and from existing stations."""
REPLICATES = 200
SURE = 1.96


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseDone:
    """All days of one case."""

    case: Case
    days: tuple[DayDone, ...]

    def _sum(self, name: str) -> float:
        return math.fsum(getattr(one, name) for one in self.days)

    def _per(self, name: str, by: str) -> float:
        total = self._sum(by)
        return self._sum(name) / total if total else math.nan

    @property
    def served(self) -> float:
        """Share of all orders that were delivered as promised."""
        return self._per("on_time", "orders")

    @property
    def served_sd(self) -> float:
        """Standard error of that share, by the differences between the days."""
        orders = np.array([one.orders for one in self.days], dtype=np.float64)
        on_time = np.array([one.on_time for one in self.days], dtype=np.float64)
        if len(orders) < 2 or not orders.sum():
            return math.nan
        rest = on_time - self.served * orders
        return float(np.sqrt(len(rest) / (len(rest) - 1) * (rest**2).sum()) / orders.sum())

    @property
    def kept(self) -> float:
        """Share of the promised orders that were delivered in time."""
        return self._per("on_time", "promised")

    @property
    def stated(self) -> float:
        """Mean stated probability of promised orders; NaN if none was stated."""
        return self._per("stated", "promised")

    @property
    def below(self) -> float:
        """Share of landings below the reserve."""
        return self._per("below", "landings")

    @property
    def wait_min(self) -> float:
        """Mean wait for pads of an order."""
        return self._per("waited_s", "delivered") / S_PER_MIN

    @property
    def delivery_min(self) -> float:
        """Mean time from ready to delivered."""
        return self._per("delivery_s", "delivered") / S_PER_MIN


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """Capacity of one fleet at one promise."""

    promise_s: float
    drones: int
    rate_per_h: float
    """Orders an hour up to which the level is reached; NaN if it is not reached even at the lowest rate."""
    low_per_h: float
    high_per_h: float
    """95 % interval, by resampling of days."""
    beyond: bool
    """The level is reached at the highest rate of the study, too: the capacity is that rate or more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Gain of a change, on the same days."""

    change: Change
    per_h: float
    """Orders an hour delivered as promised."""
    sd_per_h: float

    @property
    def sure(self) -> bool:
        """Whether it differs significantly from zero, considered alone."""
        return abs(self.per_h) > SURE * self.sd_per_h


@dataclass(frozen=True, slots=True, kw_only=True)
class CapacityFound:
    """Result of a study."""

    study: Study
    level: float
    """Required share of all orders delivered as promised."""
    cases: tuple[CaseDone, ...]
    capacities: tuple[Capacity, ...]
    base: CaseDone | None
    """The case that changes were compared with."""
    effects: tuple[Effect, ...]
    """The most helpful first."""
    days_simulated: int


def find_capacity(
    study: Study, rates: Sequence[float], promises_s: Sequence[float], fleets: Sequence[int], *, days: int, level: float, network: Network | None,
    run: Run,
) -> CapacityFound:  # fmt: skip
    """Study all rates, promises and fleets; with a network also the gain of one more pad, station or drone where the first fleet is full."""
    cases = [
        Case(rate_per_h=rate, promise_s=promise, drones=drones)
        for promise in promises_s
        for drones in fleets
        for rate in sorted(rates)
    ]
    done = _run(study, cases, days, run)
    capacities = []
    for promise in promises_s:
        for drones in fleets:
            own = [one for one in done if one.case.promise_s == promise and one.case.drones == drones]
            capacities.append(_capacity(own, level, study.seed))
    base: CaseDone | None = None
    effects: tuple[Effect, ...] = ()
    more = 0
    if network is not None:
        base, effects, more = _effects(study, done, capacities[0], days, network, run)
    return CapacityFound(
        study=study, level=level, cases=tuple(done), capacities=tuple(capacities), base=base, effects=effects, days_simulated=len(cases) * days + more
    )  # fmt: skip


def _run(study: Study, cases: Sequence[Case], days: int, run: Run) -> list[CaseDone]:
    pieces = [Piece(study=study, case=case, day=day) for case in cases for day in range(days)]
    found = run(pieces)
    return [
        CaseDone(case=case, days=tuple(found[number * days : (number + 1) * days])) for number, case in enumerate(cases)
    ]


def _capacity(cases: Sequence[CaseDone], level: float, seed: int) -> Capacity:
    first = cases[0].case
    rates = np.array([one.case.rate_per_h for one in cases])
    orders = np.array([[day.orders for day in one.days] for one in cases], dtype=np.float64)
    on_time = np.array([[day.on_time for day in one.days] for one in cases], dtype=np.float64)
    found = _crossing(rates, on_time.sum(axis=1), orders.sum(axis=1), level)
    random = np.random.default_rng(seed)
    drawn = []
    for _ in range(REPLICATES):
        again = random.integers(orders.shape[1], size=orders.shape[1])
        drawn.append(_crossing(rates, on_time[:, again].sum(axis=1), orders[:, again].sum(axis=1), level))
    low, high = np.quantile(np.nan_to_num(drawn, nan=0.0), (0.025, 0.975))
    share = on_time[-1].sum() / max(orders[-1].sum(), 1.0)
    return Capacity(
        promise_s=first.promise_s, drones=first.drones, rate_per_h=found, low_per_h=float(low), high_per_h=float(high), beyond=bool(share >= level)
    )  # fmt: skip


def _crossing(rates: Any, on_time: Any, orders: Any, level: float) -> float:
    """Rate at which the share falls below a level for the first time, linear between rates; NaN if it is below from the beginning."""
    share = on_time / np.maximum(orders, 1.0)
    below = np.flatnonzero(share < level)
    if not len(below):
        return float(rates[-1])
    first = int(below[0])
    if first == 0:
        return math.nan
    part = (share[first - 1] - level) / (share[first - 1] - share[first])
    return float(rates[first - 1] + part * (rates[first] - rates[first - 1]))


def _effects(
    study: Study, done: Sequence[CaseDone], capacity: Capacity, days: int, network: Network, run: Run
) -> tuple[CaseDone, tuple[Effect, ...], int]:
    """Compare possible additions with the present state, at the lowest rate of the study that is no less than the capacity."""
    own = [one for one in done if one.case.promise_s == capacity.promise_s and one.case.drones == capacity.drones]
    full = 0.0 if math.isnan(capacity.rate_per_h) else capacity.rate_per_h
    base = next((one for one in own if one.case.rate_per_h >= full), own[-1])
    stations = [one.id for one in network.stations if one.pads and not one.flyover]
    changes = [Change(pads=(one,)) for one in stations] + [Change(drones=(one,)) for one in stations]
    changes += [
        Change(stations=((f"new-{number}", lat, lon),))
        for number, (lat, lon) in enumerate(candidates(network, base.days), 1)
    ]
    found = _run(study, [replace(base.case, change=one) for one in changes], days, run)
    effects = [_effect(study, base, one) for one in found]
    effects.sort(key=lambda one: (-one.per_h, str(one.change)))
    return base, tuple(effects), len(changes) * days


def _effect(study: Study, base: CaseDone, other: CaseDone) -> Effect:
    hours = study.demand.hours
    more = np.array([a.on_time - b.on_time for a, b in zip(other.days, base.days, strict=True)]) / hours
    sd = float(more.std(ddof=1) / math.sqrt(len(more))) if len(more) > 1 else math.nan
    return Effect(change=other.case.change, per_h=math.fsum(more.tolist()) / len(more), sd_per_h=sd)


def candidates(network: Network, days: Sequence[DayDone]) -> list[tuple[float, float]]:
    """Places for a station: middles of the ways on which most orders were missed, apart from each other and from existing stations."""
    place = {one.id: (one.lat, one.lon) for one in network.stations}
    missed: dict[tuple[float, float], int] = {}
    for day in days:
        for origin, destination in day.missed:
            if origin in place and destination in place:
                (lat, lon), (lat2, lon2) = place[origin], place[destination]
                middle = (round((lat + lat2) / 2.0, 4), round((lon + lon2) / 2.0, 4))
                missed[middle] = missed.get(middle, 0) + 1
    lats, lons = [one.lat for one in network.stations], [one.lon for one in network.stations]
    found: list[tuple[float, float]] = []
    for lat, lon in sorted(missed, key=lambda one: (-missed[one], one)):
        if len(found) == NEW_STATIONS:
            break
        if float(coarse_distance_m(lat, lon, lats, lons).min()) < APART_M:
            continue
        network_near = network.with_target(lat, lon) if _may_stand(network, lat, lon) else None
        if network_near is not None and len(network_near.tail) > len(network.tail):
            found.append((lat, lon))
            lats, lons = [*lats, lat], [*lons, lon]
    return found


def _may_stand(network: Network, lat: float, lon: float) -> bool:
    from skyway.models.base.errors import InputError

    try:
        network.with_target(lat, lon)
    except InputError:
        return False
    return True


def document_of(found: CapacityFound) -> dict[str, Any]:
    """Return the result as JSON values (`SCHEMA`); unknown values are None."""
    return {
        "schema": SCHEMA,
        "level": found.level,
        "days_simulated": found.days_simulated,
        "hours": found.study.demand.hours,
        "digest": found.study.digest,
        "cases": [_case(one) for one in found.cases],
        "capacities": [
            {
                "promise_min": one.promise_s / S_PER_MIN, "drones": one.drones, "orders_per_h": _known(one.rate_per_h), "low_per_h": one.low_per_h,
                "high_per_h": one.high_per_h, "or_more": one.beyond,
            }
            for one in found.capacities
        ],
        "base": None if found.base is None else _case(found.base),
        "effects": [
            {
                "change": str(one.change), "pads": list(one.change.pads), "stations": [list(new) for new in one.change.stations],
                "drones": list(one.change.drones), "orders_per_h": one.per_h, "standard_error_per_h": _known(one.sd_per_h),
            }
            for one in found.effects
        ],
    }  # fmt: skip


def _case(one: CaseDone) -> dict[str, Any]:
    return {
        "orders_per_h": one.case.rate_per_h, "promise_min": one.case.promise_s / S_PER_MIN, "drones": one.case.drones,
        "served": _known(one.served), "served_standard_error": _known(one.served_sd), "promises_kept": _known(one.kept), "promises_stated": _known(one.stated),
        "below_reserve": _known(one.below), "wait_min": _known(one.wait_min), "delivery_min": _known(one.delivery_min),
        "orders": sum(day.orders for day in one.days), "delivered": sum(day.delivered for day in one.days),
    }  # fmt: skip


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
