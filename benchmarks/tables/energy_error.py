"""How far the energy of flights is from the model's: the figures behind `models.drones.energy_belief`.

Flights of a DJI Matrice 100 (`../shared/data/power`): each is predicted by a model fitted to the others, as a whole and in its straight
legs; and by the endurance that the maker publishes, to which nothing was fitted, with and without the power over airspeed of momentum
theory. The held-out table asks of each flight and leg whether it stays within the quantiles of a belief fitted without its flight.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.networks import new_york
from benchmarks.planners.bench_gap import DRONE, requests
from skyway.link.logs.reader import open_log
from skyway.models.base.errors import InfeasibleError
from skyway.models.base.units import J_PER_WH, S_PER_MIN
from skyway.models.calibration.energy import VERTICAL_MPS, PowerRecord, fit_energy, power_record, smoothed
from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.models.drones.drag import DragModel
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.drones.power import EnduranceEnergy
from skyway.models.wind.triangle import along_across, ground_speed
from skyway.planner.evaluation.evaluate import fly_charging, held_out_forecast, sample_realizations, season_days
from skyway.planner.evaluation.realizations import LEGS
from skyway.planner.plan import plan
from skyway.planner.registry import ROBUST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.drones.telemetry import TelemetryTrack

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "power"
EMPTY_KG = 3.68
"""Mass of the Matrice 100 of these flights, with battery and recorders (Rodrigues et al. 2021)."""
M100 = replace(M200_V2, id="m100", mass_kg=EMPTY_KG, max_payload_kg=1.0)
PUBLISHED = (
    EnduranceEnergy(99.9 * J_PER_WH, 2.355, 3.355, 22 * S_PER_MIN, 13 * S_PER_MIN),
    EnduranceEnergy(129.96 * J_PER_WH, 2.431, 3.431, 28 * S_PER_MIN, 16 * S_PER_MIN),
)
"""Hovering times that DJI publishes for the Matrice 100, without and with 1 kg of payload: batteries TB47D and TB48D."""
LOAD = AirspeedLoad(DragModel(linear_per_s=0.037, quadratic_per_m=0.005))
CRUISE_MPS = 20.0
WIND_SD_MPS = 0.4
"""Of the wind that a flight has measured: what the filter says of itself, 0.31 to 0.53 m/s in nine of ten decisions of 107 supervised deliveries."""
MOVING_MPS, TURN_RAD, LEAST_LEG_S, GAP_S = 1.5, 0.35, 8.0, 4.0
"""A straight leg: faster than this over the ground, its course within this of its median, so long, and without longer gaps."""
LEAST_HALVED_S = 15.0
"""Halves of shorter legs are mostly gaining speed and braking."""
BEFORE = EnergyBelief(1.05, 1e-4, 1e-6)
"""What plans charged for before: 5 % more than the model on the first leg, then what the legs so far have shown."""
SEED = 11
QUANTILES = (0.9, 0.95, 0.99, 0.999)


@dataclass(frozen=True, slots=True)
class Leg:
    """One straight leg in level flight: mean power of it, and of its halves, as ratios to the model fitted to the other flights."""

    time_s: float
    ratio: float
    halves: tuple[float, float]


@dataclass(frozen=True, slots=True)
class FlightRatios:
    """One flight: energy measured over modelled.

    Attributes
    ----------
    name : str
        Number of the flight.
    whole : float
        By the model fitted to the other flights.
    legs : tuple of Leg
        The same of its straight legs.
    published, published_load : tuple of float
        Power in cruise over that of each of `PUBLISHED`, without and with the power over the airspeed that was measured on board.
    """

    name: str
    whole: float
    legs: tuple[Leg, ...]
    published: tuple[float, ...]
    published_load: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Fitted:
    """What the flights say, named as in `models.drones.energy_belief`."""

    flight_sd: float
    leg_sd: float
    part_sd: float
    published_mean: float
    published_sd: float
    published_leg_sd: float
    airspeed_sd: float
    airspeed_leg_sd: float
    flights: int
    legs: int
    kurtosis: float


def flights(folder: Path = DATA) -> list[FlightRatios]:
    """Read the flights, and predict each by the others."""
    paths = sorted(folder.glob("m100_flight_*.csv"))
    tracks, records, air = [], [], []
    for path in paths:
        with path.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        (track,) = open_log(path).tracks()
        tracks.append(track)
        records.append(power_record(path.stem[-3:], track, EMPTY_KG + float(rows[0]["payload"]) / 1000.0))
        air.append(np.array([float(row["wind_speed"]) for row in rows if row["regime"] == "cruise"]))
    return [_ratios(number, tracks, records, air) for number in range(len(paths))]


def _ratios(
    number: int, tracks: Sequence[TelemetryTrack], records: Sequence[PowerRecord], air: Sequence[NDArray[np.float64]]
) -> FlightRatios:
    record, others = records[number], [*records[:number], *records[number + 1 :]]
    model = fit_energy(others, "momentum", M100, 1.225).model
    cruise_w = record.energy_j["cruise"] / record.time_s["cruise"]
    published = tuple(cruise_w / one.power_w(record.mass_kg) for one in PUBLISHED)
    load = float(LOAD.factor(air[number]).mean())
    return FlightRatios(
        record.name,
        record.total_j / record.predicted_j(model),
        tuple(straight_legs(tracks[number], model.power_w(record.mass_kg))),
        published,
        tuple(one / load for one in published),
    )


def straight_legs(track: TelemetryTrack, modelled_w: float) -> list[Leg]:
    """Find the straight legs of a flight in level cruise."""
    time_s, power = track.time_s, track["power_w"]
    north, east = track["vel_north_mps"], track["vel_east_mps"]
    course = np.unwrap(np.arctan2(east, north))
    level = np.abs(smoothed(time_s, track["vel_down_mps"])) < VERTICAL_MPS
    moving = level & (np.hypot(north, east) > MOVING_MPS) & np.isfinite(power)
    legs, first = [], 0
    while first < len(time_s):
        last = first
        while (
            moving[first] and last + 1 < len(time_s) and moving[last + 1] and time_s[last + 1] - time_s[last] < GAP_S
            and abs(course[last + 1] - np.median(course[first : last + 1])) < TURN_RAD
        ):  # fmt: skip
            last += 1
        if time_s[last] - time_s[first] > LEAST_LEG_S:
            whole = slice(first, last + 1)
            middle = int(np.searchsorted(time_s, 0.5 * (time_s[first] + time_s[last])))
            means = [_mean_w(time_s[one], power[one]) for one in (whole, slice(first, middle), slice(middle, last + 1))]
            ratios = [one / modelled_w for one in means]
            legs.append(Leg(float(time_s[last] - time_s[first]), ratios[0], (ratios[1], ratios[2])))
        first = last + 1
    return legs


def _mean_w(time_s: NDArray[np.float64], power: NDArray[np.float64]) -> float:
    weight = np.minimum(np.gradient(time_s), 0.5)
    return float((power * weight).sum() / weight.sum())


def fit(found: Sequence[FlightRatios]) -> Fitted:
    """Standard deviations of the parts: legs about their flight, halves about their leg, flights, and aircraft."""
    about = np.concatenate(
        [np.array([one.ratio for one in flight.legs]) - np.mean([one.ratio for one in flight.legs]) for flight in found]
    )
    legs = [one for flight in found for one in flight.legs]
    halves = np.array([one.halves[0] - one.halves[1] for one in legs if one.time_s > LEAST_HALVED_S])
    leg_sd = math.sqrt(float((about**2).sum()) / (len(legs) - len(found)))
    whole = np.array([flight.whole for flight in found])
    slow = float(np.mean([flight.published for flight in found]))
    fast = float(LOAD.factor(CRUISE_MPS))
    loaded = np.array([flight.published_load for flight in found])
    return Fitted(
        flight_sd=math.sqrt(float(((whole - 1.0) ** 2).mean())),
        leg_sd=leg_sd,
        part_sd=math.sqrt(float((halves**2).mean()) / 2.0),
        published_mean=0.5 * (slow + fast),
        published_sd=0.5 * (fast - slow) / EnergyBelief().sigmas(0.99),
        published_leg_sd=math.hypot(leg_sd, load_sd()),
        airspeed_sd=math.sqrt(float(((loaded - 1.0) ** 2).mean())),
        airspeed_leg_sd=math.hypot(leg_sd, WIND_SD_MPS * airspeed_slope()),
        flights=len(found),
        legs=len(legs),
        kurtosis=float((about**4).mean() / (about**2).mean() ** 2),
    )


@lru_cache(maxsize=1)
def load_sd(departures: int = 60, legs: int = 5) -> float:
    """Standard deviation, within a delivery, of the power over airspeed of momentum theory on legs that differ by 0.4 rad in course.

    Deliveries in any direction through hours of the record with flyable wind, at `CRUISE_MPS` through the air and at most over the ground.
    """
    world, rng, variance = new_york(), np.random.default_rng(SEED), []
    rules, limit = world.rules, world.drone(DRONE).wind_limit_mps
    for request in requests(world, departures, SEED):
        air = world.forecast(request.state.time, 6).at_height(rules.cruise_height_m, rules.wind_profile_exponent)
        member = rng.integers(0, len(air.probability))
        north, east = float(air.north[member, 0, 0]), float(air.east[member, 0, 0])
        if math.hypot(north, east) < limit:
            course = rng.uniform(0.0, 2.0 * math.pi) + 0.4 * rng.standard_normal((20, legs))
            along, across = along_across(north, east, np.cos(course), np.sin(course))
            speed = ground_speed(CRUISE_MPS, along, across, limit)
            load = LOAD.factor(np.hypot(np.minimum(speed, CRUISE_MPS) - along, across))
            variance.append(load.var(axis=1, ddof=1).mean())
    return math.sqrt(float(np.mean(variance)))


def airspeed_slope() -> float:
    """Relative growth of the power with each m/s at `CRUISE_MPS` through the air, by momentum theory."""
    slower, same, faster = LOAD.factor(CRUISE_MPS + np.array([-1.0, 0.0, 1.0])).tolist()
    return float((faster - slower) / (2.0 * same))


def held_out(found: Sequence[FlightRatios]) -> list[tuple[float, float, float, int]]:
    """How many legs stay within a quantile: (quantile, before, after, of how many), the belief fitted without their flight.

    Before: evenly within 5 %. Legs count as their ratio by the model fitted to the other flights.
    """
    rows = []
    for quantile in QUANTILES:
        before = after = count = 0
        for number, flight in enumerate(found):
            others = fit([*found[:number], *found[number + 1 :]])
            belief = EnergyBelief(1.0, others.flight_sd, others.leg_sd, others.legs - others.flights)
            for leg in flight.legs:
                count += 1
                before += leg.ratio <= 1.0 + 0.05 * (2.0 * quantile - 1.0)
                after += leg.ratio <= belief.quantile(quantile)
        rows.append((quantile, before / count, after / count, count))
    return rows


def drawn(found: Sequence[FlightRatios], *, calibrated: bool, runs: int, seed: int) -> NDArray[np.float64]:
    """Bootstrap the ratios of legs, shape (runs, LEGS): a flight, and a leg about it.

    Where nothing was measured, the known range instead of a flight, and the airspeed of each leg, too.
    """
    rng = np.random.default_rng(seed)
    about = np.concatenate(
        [np.array([leg.ratio for leg in flight.legs]) - np.mean([leg.ratio for leg in flight.legs]) for flight in found]
    )
    legs = rng.choice(about, (runs, LEGS))
    if calibrated:
        return np.asarray(rng.choice([flight.whole for flight in found], (runs, 1)) + legs)
    slow, fast = float(np.mean([flight.published for flight in found])), float(LOAD.factor(CRUISE_MPS))
    return np.asarray(rng.uniform(slow, fast, (runs, 1)) + load_sd() * rng.standard_normal((runs, LEGS)) + legs)


@dataclass(frozen=True, slots=True)
class Delivered:
    """What became of the deliveries of one belief: means over requests, s; shares of all deliveries."""

    name: str
    requests: int
    promised_s: float
    delivery_s: float
    p_reserve: float
    below_reserve: float
    delivered: float
    planning_s: float


def deliveries(
    found: Sequence[FlightRatios], count: int, *, calibrated: bool, days: int = 6, runs: int = 600
) -> list[Delivered]:
    """Plan random requests with the belief before and after, and fly them on held-out days with bootstrapped energy."""
    world = new_york()
    after = EnergyBelief.calibrated([one.whole - 1.0 for one in found]) if calibrated else EnergyBelief()
    beliefs = {"before": BEFORE, "after": after}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in beliefs}
    for number, request in enumerate(requests(world, count, SEED)):
        away = season_days(world, request, days, seed=SEED + number)
        forecast = held_out_forecast(world, request, away)
        ratios = drawn(found, calibrated=calibrated, runs=runs, seed=number)
        told = {}
        for name, belief in beliefs.items():
            drones = tuple(replace(one, energy_belief=belief) if one.id == DRONE else one for one in world.drones)
            started = time.process_time()
            try:
                result = plan(replace(world, drones=drones), request, planner=ROBUST, forecast=forecast)
            except InfeasibleError:
                break
            seconds = time.process_time() - started
            assert result.robust is not None
            realizations = replace(sample_realizations(world, request, away, runs=runs, seed=number), ratios=ratios)
            flown = fly_charging(realizations, DRONE, result.robust.policy)
            told[name] = (
                result.outcome.mean_s - result.problem.depart_s, float(np.nanmean(flown.delivery_s)), result.outcome.p_success,
                float((flown.lowest_soc < result.problem.reserve - 1e-9).mean()), float(flown.delivered.mean()), seconds,
            )  # fmt: skip
        else:
            for name, values in told.items():
                rows[name].append(values)
    return [_delivered(name, found_) for name, found_ in rows.items()]


def _delivered(name: str, rows: Sequence[tuple[float, ...]]) -> Delivered:
    """Means over requests, and the median planning time."""
    promised_s, delivery_s, p_reserve, below_reserve, delivered, _ = np.mean(rows, axis=0).tolist()
    planning_s = float(np.median([one[5] for one in rows]))
    return Delivered(name, len(rows), promised_s, delivery_s, p_reserve, below_reserve, delivered, planning_s)


def main() -> int:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--deliveries", type=int, default=0, help="random requests that are planned and flown, too")
    options = parser.parse_args()
    found = flights()
    print(fit(found))
    for flight in found:
        print(
            flight.name,
            f"{flight.whole:.3f}",
            *(f"{leg.ratio:.3f}" for leg in flight.legs),
            "published",
            flight.published,
        )
    print("quantile, legs within it before and after, of")
    for row in held_out(found):
        print("  {:.3f}  {:.3f}  {:.3f}  {:d}".format(*row))
    for calibrated in (False, True) if options.deliveries else ():
        for one in deliveries(found, options.deliveries, calibrated=calibrated):
            print("calibrated" if calibrated else "not measured", one)
    return 0


if __name__ == "__main__":
    sys.exit(main())
