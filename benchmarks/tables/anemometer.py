"""Twenty drones as an anemometer: how much better a forecast says the wind of the next hour with what they measured on their way.

On 24 held-out days of New York, at two hours each, one airport after the other is kept back as the truth. Twenty drones fly somewhere in the network, through wind that
passes through all three airports (`benchmarks.independent.weather`): *smooth*, straight lines between reports, inverse squares of the distance between airports; *rough*, a spectrum
between reports, a Gaussian field between airports, a profile that changes with stability. Each tells the mean of ten minutes of its way, three times, with gusts and errors in it. The
forecast is that of the season's days, without the airport, or that of a weather service (`benchmarks.cases.day_forecast`, error learnt from other days). The product updates it with what
was measured as `skyway forecast` does (`assimilated`). What each says of the speed at flight height over the airport that was kept back, 15 to 60 minutes later, is scored by the CRPS; the
score itself is written here, not the product's. Orders that leave at that hour are planned with each and flown on the day by the out-of-sample evaluation.

    python -m benchmarks.tables.anemometer --orders 2
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.build import LENGTHS
from benchmarks.independent.product import planning
from benchmarks.independent.weather.profile import PowerLaw, Stability
from benchmarks.independent.weather.series import SiteWinds
from benchmarks.independent.weather.wind import LENGTH_M, InverseDistance, RandomField, leave_one_out
from benchmarks.tables.forecast_gain import CITY, Service, held_out_days, learning_days, orders
from skyway.models.base.units import from_posix
from skyway.models.wind.estimation.assimilation import assimilated
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.forecast import analogue_ensemble
from skyway.models.wind.triangle import height_factor
from skyway.planner.evaluation.evaluate import fly_charging, held_out_forecast, sample_realizations
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import HORIZON_H

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.weather.reports import Site
    from benchmarks.independent.weather.wind import TrueWind
    from skyway.models.wind.ensemble import WindEnsemble

DRONES, SLOTS, SLOT_S, POINTS = 20, 3, 600.0, 6
SPEED_MPS = 15.0
FILTER_MPS, GUST_SHARE = 0.5, 0.08
"""Standard deviations of the error of a mean of ten minutes: of the filter, and what is left of the gusts as a share of the wind."""
TOLD_VARIANCE = 0.7**2
LEADS_MIN = (15, 30, 45, 60)
HOURS_UTC = (14, 20)
HEIGHT_M, HOURS = 60.0, 6
FORECASTS = ("season's days", "weather service")
NATURES = ("smooth", "rough")
UPDATED = ", updated"
AS_FLOWN = ResidualModel(tau_s=USUAL.online.residual_tau_s)


class Nature:
    """The wind of one day, passing through all airports; each of several asked places is a run of its own in the same field."""

    def __init__(self, begin_s: float, seed: tuple[int, ...], places: int, *, smooth: bool = False) -> None:
        city = planning.city(CITY)
        self.plane, self.begin_s = city.ground.plane, begin_s
        self.sites = tuple(site.as_metars() for site in city.sites)
        low, high = LENGTH_M
        length = low + (high - low) * int(np.random.default_rng(seed).integers(LENGTHS)) / (LENGTHS - 1)

        def rngs(purpose: int) -> list[np.random.Generator]:
            return [np.random.default_rng((*seed, purpose)) for _ in range(places)]

        begin = np.full(places, begin_s)
        self.series = SiteWinds(self.sites, "lines" if smooth else "spectrum", begin, HOURS, rngs(1))
        xy = self.plane.xy([one.lat for one in self.sites], [one.lon for one in self.sites])
        told = leave_one_out(city.sites, self.plane, length)
        self.field: TrueWind = InverseDistance(xy, self.series)
        self.profile: PowerLaw | Stability = PowerLaw(city.exponent)
        if not smooth:
            self.field = RandomField(xy, self.series, np.full(places, length), [told] * places, rngs(2))
            self.profile = Stability(rngs(3), begin, HOURS, self.plane.lon)

    def aloft(self, lat: NDArray[np.float64], lon: NDArray[np.float64], after_s: float) -> NDArray[np.float64]:
        """Wind at flight height, shape (places, 2)."""
        elapsed = np.full(len(lat), after_s)
        found = self.field.at(self.plane.xy(lat, lon), elapsed)
        factor = self.profile.factor(self.begin_s + elapsed, np.hypot(*found.T), HEIGHT_M)
        return found * factor[:, None]


def measured(nature: Nature, now_after_s: float, rng: np.random.Generator) -> list[WindObservation]:
    """What the drones tell of the half hour before an instant."""
    scenario = planning.told_scenario(CITY, "")
    network = scenario.network
    segment = rng.integers(len(network.tail), size=DRONES)
    tail, head = network.tail[segment], network.head[segment]
    share = rng.random(DRONES)
    found: list[WindObservation] = []
    for slot in range(SLOTS):
        begin = now_after_s - (SLOTS - slot) * SLOT_S
        winds, lats, lons = [], [], []
        for point in range(POINTS):
            after = begin + SLOT_S * (point + 0.5) / POINTS
            moved = (share + (after - now_after_s) * SPEED_MPS / network.distance_m[segment]) % 1.0
            lats.append(network.lat[tail] + moved * (network.lat[head] - network.lat[tail]))
            lons.append(network.lon[tail] + moved * (network.lon[head] - network.lon[tail]))
            winds.append(nature.aloft(lats[-1], lons[-1], after))
        mean = np.mean(winds, axis=0)
        error = np.hypot(FILTER_MPS, GUST_SHARE * np.hypot(*mean.T))
        told = mean + error[:, None] * rng.standard_normal(mean.shape)
        where = np.mean(lats, axis=0), np.mean(lons, axis=0)
        found += [
            WindObservation(
                nature.begin_s + begin + 0.5 * SLOT_S, float(where[0][k]), float(where[1][k]), float(told[k, 0]), float(told[k, 1]),
                TOLD_VARIANCE, HEIGHT_M,
            )
            for k in range(DRONES)
        ]  # fmt: skip
    return found


def crps(values: NDArray[np.float64], weight: NDArray[np.float64], truth: float) -> float:
    """Mean distance of the members from the truth, less half of their mean distance from each other."""
    apart = np.abs(values[:, None] - values[None])
    return float(weight @ np.abs(values - truth) - 0.5 * weight @ apart @ weight)


def updated(before: WindEnsemble, seen: Sequence[WindObservation]) -> WindEnsemble:
    """The product's answer, as ``skyway forecast`` has it."""
    scenario = planning.told_scenario(CITY, "")
    factor = float(height_factor(HEIGHT_M, scenario.measured_at_m, scenario.rules.wind_profile_exponent))
    least = USUAL.online.least_members
    return assimilated(
        before, seen, scenario.field_error.at_height(factor), AS_FLOWN, slot_s=900.0, least_members=least
    )


def scored(days: Sequence[date], service: Service, seed: int) -> Iterator[dict[str, Any]]:
    """A document for each nature, day, hour and airport: CRPS of the speed by lead, with and without the drones."""
    scenario = planning.told_scenario(CITY, "")
    exponent = scenario.rules.wind_profile_exponent
    for day in days:
        for hour in HOURS_UTC:
            now_s = datetime(day.year, day.month, day.day, hour, tzinfo=UTC).timestamp() + 1200.0
            begin_s = now_s - 3600.0
            of_service = scenario.forecast_from(
                [service.newest(now_s)], from_posix(begin_s), HOURS, error=service.error, truth=day
            ).at_height(HEIGHT_M, exponent)
            for name in NATURES:
                key = seed, day.toordinal(), hour
                nature = Nature(begin_s, key, DRONES, smooth=name == "smooth")
                seen = measured(nature, now_s - begin_s, np.random.default_rng(key))
                for site in planning.city(CITY).sites:
                    told = planning.told_scenario(CITY, site.id)
                    assert told.history is not None
                    season = analogue_ensemble(
                        told.history, from_posix(begin_s), HOURS, season_days=told.season_days, exclude=[day]
                    ).at_height(HEIGHT_M, exponent)
                    document: dict[str, Any] = {"nature": name, "day": day.toordinal(), "hour": hour, "site": site.id}
                    for forecast, before in zip(FORECASTS, (season, of_service), strict=True):
                        both = before, updated(before, seen)
                        document[forecast] = [
                            [_score(one, nature, site, now_s + 60.0 * lead) for one in both] for lead in LEADS_MIN
                        ]
                    yield document


def _score(ensemble: WindEnsemble, nature: Nature, site: Site, at_s: float) -> float:
    here = np.full(DRONES, site.lat), np.full(DRONES, site.lon)
    truth = float(np.hypot(*nature.aloft(*here, at_s - nature.begin_s)[0]))
    north, east = ensemble.wind_at(site.lat, site.lon, ensemble.slot_at(at_s))
    return crps(np.hypot(north, east), ensemble.probability, truth)


def delivered(days: Sequence[date], service: Service, count: int, seed: int) -> Iterator[dict[str, Any]]:
    """A document for each order: mean delivery and landings below the reserve with each forecast, with and without the drones."""
    scenario = planning.told_scenario(CITY, "")
    exponent = scenario.rules.wind_profile_exponent
    for day in days:
        for order in orders(day, count, seed):
            begin_s = 3600.0 * (order.depart_s // 3600.0 - 1)
            key = seed, day.toordinal(), order.seed
            nature = Nature(begin_s, key, DRONES, smooth=True)
            seen = measured(nature, order.depart_s - begin_s, np.random.default_rng(key))
            request = planning.request_of(CITY, order)
            where = np.array([(site.lat, site.lon) for site in scenario.wind_sites]).T
            season = held_out_forecast(scenario, request, [day])
            told = scenario.forecast_from(
                [service.newest(order.depart_s)], request.state.time, HORIZON_H, error=service.error, truth=day
            )
            document: dict[str, Any] = {"day": day.toordinal(), "order": order.seed}
            for name, before in zip(FORECASTS, (season, told.at_sites(*where)), strict=True):
                level = before.at_height(HEIGHT_M, exponent)
                for arm, forecast in ((name, level), (name + UPDATED, updated(level, seen))):
                    plan = planning.planned_on(scenario, request, forecast)
                    if plan is None or plan.result.robust is None:
                        continue
                    flying = replace(request, drone=plan.result.composition.drone)
                    truths = sample_realizations(scenario, flying, [day], runs=200, seed=seed + order.seed)
                    flown = fly_charging(truths, plan.result.composition.drone, plan.result.robust.policy)
                    mean_s = float(np.nanmean(np.where(np.isfinite(flown.delivery_s), flown.delivery_s, np.nan)))
                    document[arm] = [mean_s, int(flown.below_reserve.sum())]
            yield document


def table(documents: Sequence[dict[str, Any]]) -> list[str]:
    """Rows of the scores, in Markdown, intervals over days."""
    lines = [
        "| wind | forecast | minutes ahead | CRPS alone, m/s | with 20 drones | better by, % |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for nature in NATURES:
        mine = [one for one in documents if one["nature"] == nature]
        days = DayBootstrap(np.array([one["day"] for one in mine]))
        for name in FORECASTS:
            values = np.array([one[name] for one in mine])
            for which, lead in [*zip(np.eye(len(LEADS_MIN)), LEADS_MIN, strict=True), (np.full(4, 0.25), "15 to 60")]:
                alone, after = (values[..., part] @ which for part in (0, 1))
                gain = days.ratio(alone - after, alone).scaled(100.0).text(".0f")
                lines.append(
                    f"| {nature} | {name} | {lead} | {days.mean(alone).text('.2f')} | {days.mean(after).text('.2f')} | {gain} |"
                )
    return lines


def deliveries(documents: Sequence[dict[str, Any]]) -> list[str]:
    """Rows of the deliveries, in Markdown: orders that have a plan with all forecasts."""
    arms = [name + more for name in FORECASTS for more in ("", UPDATED)]
    whole = [one for one in documents if all(arm in one for arm in arms)]
    days = DayBootstrap(np.array([one["day"] for one in whole]))
    lines = [
        f"{len(whole)} orders", "", "| planned with | delivery, min | of that without drones, % | below the reserve, of 200 each |", "| --- | --- | --- | --- |"
    ]  # fmt: skip
    for arm in arms:
        mean, base = (np.array([one[name][0] for one in whole]) / 60.0 for name in (arm, arm.removesuffix(UPDATED)))
        share = days.ratio(mean, base).scaled(100.0).text(".0f") if arm.endswith(UPDATED) else ""
        lines.append(f"| {arm} | {days.mean(mean).text()} | {share} | {sum(one[arm][1] for one in whole)} |")
    return lines


def main() -> int:
    """Score and fly, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--days", type=int, default=24)
    parser.add_argument("--orders", type=int, default=0, help="of each day, planned with and without the drones")
    parser.add_argument("--seed", type=int, default=2020)
    parser.add_argument("--tuning", action="store_true", help="days that the table is not made of")
    options = parser.parse_args()
    held_out = held_out_days(options.seed)
    days = (learning_days(held_out)[2::3] if options.tuning else held_out)[: options.days]
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        service = Service.beginning(Path(folder), learning_days(held_out), 1.0)
        found = list(scored(days, service, options.seed))
        print("\n".join(table(found)), flush=True)
        if options.orders:
            print("\n".join(deliveries(list(delivered(days, service, options.orders, options.seed)))))
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
