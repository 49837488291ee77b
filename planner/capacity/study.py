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
from skyway.planner.capacity.intervals import difference_half_width, ratio_error, share_interval

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.planner.capacity.day import Study

    Run = Callable[[list[Piece]], list[DayDone]]
    """Simulates days, and returns them in order."""

SCHEMA = "skyway.capacity/1"
NEW_STATIONS = 8
"""Number of places tried for a station."""
APART_M = 4000.0
"""Least distance from each other and from existing stations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseDone:
    """All days of one case."""

    case: Case
    days: tuple[DayDone, ...]
    winds: int
    """Number of days of the record, whose winds the days have one after another."""

    @property
    def wind(self) -> NDArray[np.int64]:
        """Number of the wind of each day."""
        return np.arange(len(self.days)) % self.winds

    def _each(self, name: str) -> NDArray[np.float64]:
        return np.array([getattr(one, name) for one in self.days], dtype=np.float64)

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
        return ratio_error(self._each("on_time"), self._each("orders"), self.wind)

    @property
    def served_between(self) -> tuple[float, float]:
        """95 % interval of that share; NaN if the days do not tell it."""
        return share_interval(self._each("on_time"), self._each("orders"), self.wind)

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
        """Mean wait of a delivered order for pads: of its drone on the way to it and with it."""
        return self._per("waited_s", "delivered") / S_PER_MIN

    @property
    def delivery_min(self) -> float:
        """Mean time of a delivered order from ready to delivered."""
        return self._per("delivery_s", "delivered") / S_PER_MIN


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """Capacity of one fleet at one promise."""

    promise_s: float
    drones: int
    orders: int
    """Number of orders at all rates together."""
    rate_per_h: float
    """Orders an hour up to which the level is reached; NaN if it is not reached even at the lowest rate, and without any orders."""
    low_per_h: float
    """Rate at which the lower end of the interval of the share falls below the level; NaN if it is below at the lowest rate."""
    high_per_h: float
    """The same of the upper end; infinite if it is not below at any rate."""
    beyond: bool
    """The level is reached at all rates of the study: the capacity is the highest one or more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Gain of a change, on the same days."""

    change: Change
    per_h: float
    """Orders an hour delivered as promised."""
    sd_per_h: float
    half_per_h: float
    """Half of the 95 % interval."""

    @property
    def sure(self) -> bool:
        """Whether it differs significantly from zero, considered alone."""
        return abs(self.per_h) > self.half_per_h


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

    @property
    def winds(self) -> int:
        """Number of days of the record whose winds were simulated."""
        return min(len(self.cases[0].days), self.cases[0].winds)


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
            capacities.append(_capacity(own, level))
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
        CaseDone(case=case, days=tuple(found[number * days : (number + 1) * days]), winds=len(study.days))
        for number, case in enumerate(cases)
    ]


def _capacity(cases: Sequence[CaseDone], level: float) -> Capacity:
    """Find where the share falls below the level, and where the ends of its interval do; cases without orders tell nothing."""
    first, told = cases[0].case, [one for one in cases if not math.isnan(one.served)]
    rates, ends = [one.case.rate_per_h for one in told], [one.served_between for one in told]
    rate = _crossing(rates, [one.served for one in told], level)
    low = _crossing(rates, [0.0 if math.isnan(one) else one for one, _ in ends], level)
    high = _crossing(rates, [1.0 if math.isnan(one) else one for _, one in ends], level)
    return Capacity(
        promise_s=first.promise_s,
        drones=first.drones,
        orders=sum(day.orders for one in cases for day in one.days),
        rate_per_h=rates[-1] if rates and rate == math.inf else rate if rates else math.nan,
        low_per_h=min(low, rates[-1]) if rates else math.nan,
        high_per_h=rates[0] if math.isnan(high) else high,
        beyond=bool(rates) and rate == math.inf,
    )


def _crossing(rates: Sequence[float], share: Sequence[float], level: float) -> float:
    """Rate at which a share falls below a level for the first time, linear between rates; NaN if it is below from the beginning, infinite if it never is."""
    first = next((number for number, one in enumerate(share) if one < level), None)
    if first is None:
        return math.inf
    if first == 0:
        return math.nan
    part = (share[first - 1] - level) / (share[first - 1] - share[first])
    return rates[first - 1] + part * (rates[first] - rates[first - 1])


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
    more = np.array([a.on_time - b.on_time for a, b in zip(other.days, base.days, strict=True)], dtype=np.float64)
    hours = np.full(len(more), study.demand.hours)
    return Effect(
        change=other.case.change,
        per_h=math.fsum(more.tolist()) / float(hours.sum()),
        sd_per_h=ratio_error(more, hours, base.wind),
        half_per_h=difference_half_width(more, hours, base.wind),
    )


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
        "winds": found.winds,
        "hours": found.study.demand.hours,
        "digest": found.study.digest,
        "cases": [_case(one) for one in found.cases],
        "capacities": [
            {
                "promise_min": one.promise_s / S_PER_MIN, "drones": one.drones, "orders_per_h": _known(one.rate_per_h),
                "low_per_h": _known(one.low_per_h), "high_per_h": _known(one.high_per_h), "or_more": one.beyond,
            }
            for one in found.capacities
        ],
        "base": None if found.base is None else _case(found.base),
        "effects": [
            {
                "change": str(one.change), "pads": list(one.change.pads), "stations": [list(new) for new in one.change.stations],
                "drones": list(one.change.drones), "orders_per_h": one.per_h, "standard_error_per_h": _known(one.sd_per_h),
                "half_width_per_h": _known(one.half_per_h),
            }
            for one in found.effects
        ],
    }  # fmt: skip


def _case(one: CaseDone) -> dict[str, Any]:
    low, high = one.served_between
    return {
        "orders_per_h": one.case.rate_per_h, "promise_min": one.case.promise_s / S_PER_MIN, "drones": one.case.drones,
        "served": _known(one.served), "served_low": _known(low), "served_high": _known(high), "served_standard_error": _known(one.served_sd),
        "promises_kept": _known(one.kept), "promises_stated": _known(one.stated),
        "below_reserve": _known(one.below), "wait_min": _known(one.wait_min), "delivery_min": _known(one.delivery_min),
        "orders": sum(day.orders for day in one.days), "promised": sum(day.promised for day in one.days),
        "delivered": sum(day.delivered for day in one.days), "as_promised": sum(day.on_time for day in one.days),
    }  # fmt: skip


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
