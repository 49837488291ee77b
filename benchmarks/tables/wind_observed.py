"""How well a forecast conditioned on observed winds says the wind of the next hours: CRPS by lead hour.

Random hours of three records; the report of the hour before the departure is observed (New York: METARs of minute 51), the season's other
days are the forecast, and what the record says 1 to 12 h after the report is the truth. New York: the odd weeks were tuned on, the even
ones judge. Melbourne (2023) and London (2005, forecast from 1998 to 2004 alone) have one site each and were not tuned on.

    python -m benchmarks.tables.wind_observed --hours 300
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from benchmarks.cases.melbourne import melbourne
from benchmarks.cases.networks import new_york
from benchmarks.independent.weather.reports import LONDON, WIND
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.models.wind.forecast import analogue_ensemble
from skyway.models.wind.history import WindHistory, WindSite, read_history
from skyway.models.wind.observed.conditioning import LEAST_MEMBERS
from skyway.models.wind.observed.reading import STATION_ERROR_MPS
from skyway.planner.parameters.planner import USUAL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble

LEADS_H = (1, 2, 3, 6, 12)
AGES_H = (0, 1, 2, 3, 6, 9)
OBSERVED_S = 51 * 60.0


@dataclass(frozen=True)
class Way:
    """A way to condition a forecast; without `tau_h` it is left as it is."""

    name: str
    tau_h: float = 0.0
    least: float = 1.0
    error_mps: float = 0.7
    most: int = 10_000
    age_h: int = 0

    def applied(self, ensemble: WindEnsemble, history: WindHistory, row: int) -> WindEnsemble:
        """Condition on the reports of the row so many hours before another."""
        if not self.tau_h:
            return ensemble
        at = row - 1 - self.age_h
        time_s = history.start_s + at * history.slot_s + OBSERVED_S
        seen = [
            WindObservation(time_s, site.lat, site.lon, float(history.north[at, k]), float(history.east[at, k]), self.error_mps**2)
            for k, site in enumerate(history.sites)
        ]  # fmt: skip
        residual = ResidualModel(tau_s=self.tau_h * 3600.0)
        return update_forecast(ensemble, seen, residual, slot_s=history.slot_s, least_members=self.least).most_probable(
            self.most
        )


TAU_H = USUAL.online.residual_tau_s / 3600.0
CHOSEN = Way("as chosen", TAU_H, LEAST_MEMBERS, STATION_ERROR_MPS, USUAL.robust.members)
WAYS = (
    Way("record alone"),
    Way("as `skyway forecast`", 6.0),
    Way("as flights", TAU_H, USUAL.online.least_members),
    CHOSEN,
    *(replace(CHOSEN, name=f"as chosen, report {age + 1} h before the first hour", age_h=age) for age in AGES_H[1:]),
)


def crps(
    values: NDArray[np.float64], probability: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """CRPS of weighted members, shape (members, ...), against a truth, shape (...): E|X - y| - E|X - X'| / 2 (Gneiting and Raftery, 2007)."""
    order = np.argsort(values, axis=0)
    ordered = np.take_along_axis(values, order, axis=0)
    weight = probability[order]
    below = np.cumsum(weight, axis=0)[:-1]
    apart = np.sum(below * (1.0 - below) * np.diff(ordered, axis=0), axis=0)
    return np.asarray(np.sum(weight * np.abs(ordered - truth), axis=0) - apart)


def measured(
    history: WindHistory, zone: str, rows: list[int], exclude_year: int | None
) -> dict[str, tuple[NDArray[np.float64], float]]:
    """CRPS a component by lead, shape (leads,), and the share of truths within the middle 80 %, by way."""
    found: dict[str, list[NDArray[np.float64]]] = {way.name: [] for way in WAYS}
    inside: dict[str, list[float]] = {way.name: [] for way in WAYS}
    leads = np.array(LEADS_H)
    for row in rows:
        oldest = row - 1 - max(AGES_H)
        begin = datetime.fromtimestamp(history.start_s + oldest * history.slot_s, UTC).astimezone(ZoneInfo(zone))
        days = (
            []
            if exclude_year is None
            else [datetime(exclude_year, 1, 1, tzinfo=UTC).date() + timedelta(days=k) for k in range(366)]
        )
        ensemble = analogue_ensemble(history, begin, row - oldest + max(LEADS_H) + 48, exclude=days)
        slots = row - oldest + leads - 1
        truth = np.stack((history.north[row + leads - 1], history.east[row + leads - 1]))
        for way in WAYS:
            told = way.applied(ensemble, history, row)
            values = np.stack((told.north[:, slots], told.east[:, slots]), axis=1)  # (members, 2, leads, sites)
            found[way.name].append(crps(values, told.probability, truth).mean(axis=(0, 2)))
            below = np.einsum("m,m...->...", told.probability, values < truth)
            inside[way.name].append(float(np.mean((below >= 0.1) & (below <= 0.9))))
    return {name: (np.mean(values, axis=0), float(np.mean(inside[name]))) for name, values in found.items()}


def hours(history: WindHistory, count: int, fits: NDArray[np.bool_], seed: int) -> list[int]:
    """Random rows between whose neighbours the record is complete."""
    rng = np.random.default_rng(seed)
    near = max(AGES_H) + 2
    whole = history.complete
    good = [
        row
        for row in np.flatnonzero(fits).tolist()
        if near < row < len(history) - 61 and whole[row - near : row + 60].all()
    ]
    return sorted(rng.choice(good, min(count, len(good)), replace=False).tolist())


def records(count: int, seed: int) -> Iterator[tuple[str, WindHistory, str, list[int], int | None]]:
    """Names, records, time zones, rows to judge, and the year whose days are left out."""
    world = new_york()
    assert world.history is not None
    odd = (np.arange(len(world.history)) // (24 * 7)) % 2 == 1
    yield "New York, weeks not tuned on", world.history, world.timezone, hours(world.history, count, odd, seed), None
    other = melbourne().history
    assert other is not None
    yield "Melbourne", other, "Australia/Melbourne", hours(other, count, np.ones(len(other), dtype=bool), seed), None
    columns = WindColumns(time="time_utc", site=None, speed="wind_speed_mps", from_="wind_from_deg", time_zone="UTC")
    path = WIND / "london_1998_2005_hourly_wind.csv.gz"
    london = read_history(path, columns, (WindSite("london", *LONDON),), 10.0)
    years = (np.arange(len(london)) * 3600.0 + london.start_s) >= datetime(2005, 1, 1, tzinfo=UTC).timestamp()
    yield "London 2005, from 1998 to 2004", london, "Europe/London", hours(london, count, years, seed), 2005


def main() -> int:
    """Print the table, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=300, help="random hours of each record")
    parser.add_argument("--seed", type=int, default=83)
    options = parser.parse_args()
    started = time.perf_counter()
    print(f"| record | conditioned | {' | '.join(f'{lead} h' for lead in LEADS_H)} | within 80 % |")
    print("| --- | --- |" + " --- |" * (len(LEADS_H) + 1))
    for name, history, zone, rows, year in records(options.hours, options.seed):
        for way, (values, inside) in measured(history, zone, rows, year).items():
            told = f"{name}, {len(rows)} hours" if way == WAYS[0].name else ""
            print(
                f"| {told} | {way} | {' | '.join(f'{one:.2f}' for one in values)} | {100.0 * inside:.0f} % |",
                flush=True,
            )
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
