"""How well a forecast that a drone's measurement has updated says the wind where it measured, some time later: error against what its members tell.

A drone flies for ten minutes on a random day of New York's record, measures, and stands on a pad. The days are those whose ordinal
leaves 1, 2 or 3 when divided by 7: `benchmarks.link.supervision` flies on others. What is missing in the spread of the members is
`AGED_SHARE` and `AGED_TIME_S` of `planner.reach.wind_ahead`; the bias says how fast a measured difference fades (`residual_tau_s`).

    python -m benchmarks.tables.wind_aged --flights 500
"""

from __future__ import annotations

import argparse
import itertools
import math
import random
from datetime import date, datetime, timedelta
from datetime import time as daytime
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.link.deliveries import LOCAL, newyork
from skyway.models.base.errors import InputError
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import MEASURED_S, slot_variance, update_forecast
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.reach.wind_ahead import AGED_SHARE, AGED_TIME_S

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble

REMAINDERS = (1, 2, 3)
HOURS = (1.0, 1.5, 2.5, 4.0)
SLOTS, STEP_DEG = 4, 0.02
SPEEDS = (0.0, 7.0, 10.0, math.inf)
"""Speeds in which flights are told apart, m/s."""


def days() -> list[date]:
    """Days of the record that are looked at."""
    found = (date(2013, 1, 6) + timedelta(days=n) for n in range(350))
    return [day for day in found if day.toordinal() % 7 in REMAINDERS]


def at(air: WindEnsemble, place: tuple[float, float], time_s: float) -> NDArray[np.float64]:
    """Winds of the members at a place and a time, (north, east), m/s, shape (2, members)."""
    north, east = air.at_times(np.array([place[0]]), np.array([place[1]]), np.array([time_s]))
    return np.stack((north[:, 0], east[:, 0]))


def flights(count: int, seed: int, tau_s: float) -> Iterator[tuple[float, list[tuple[float, float]]]]:
    """Speed measured, and (error along that wind, what the members tell of it), m/s, after each of `HOURS`."""
    scenario, luck, usual = newyork(), random.Random(seed), USUAL.online
    height_m, exponent = scenario.rules.cruise_height_m, scenario.rules.wind_profile_exponent
    stations = [one for one in scenario.network.stations if one.pads]
    done = 0
    while done < count:
        day, hour, station = luck.choice(days()), luck.randrange(8, 19), luck.choice(stations)
        bearing, begin = luck.uniform(0.0, 2.0 * math.pi), datetime.combine(day, daytime(hour), LOCAL)
        try:
            truth, before = scenario.truth(day, begin, HORIZON_H), scenario.forecast(begin, HORIZON_H)
        except InputError:  # the record has a gap
            continue
        truth, before = truth.at_height(height_m, exponent), before.at_height(height_m, exponent)
        seen, place = [], (station.lat, station.lon)
        for k in range(SLOTS):
            time_s = begin.timestamp() + MEASURED_S * (k + 0.5)
            place = (
                station.lat + STEP_DEG * k * math.cos(bearing),
                station.lon + STEP_DEG * k * math.sin(bearing) / math.cos(math.radians(station.lat)),
            )
            north, east = (float(one) for one in at(truth, place, time_s)[:, 0])
            variance = slot_variance(math.hypot(north, east), MEASURED_S)
            noise = luck.gauss(0.0, math.sqrt(variance)), luck.gauss(0.0, math.sqrt(variance))
            seen.append(WindObservation(time_s, *place, north + noise[0], east + noise[1], variance, height_m))
        residual = ResidualModel(tau_s=tau_s)
        after = update_forecast(
            before, seen, residual, least_members=usual.least_members, field=scenario.field_error, here=place
        )
        wind = np.array([north, east])
        speed = float(np.hypot(*wind))
        along = wind / max(speed, 0.1)
        told = []
        for hours in HOURS:
            then_s = seen[-1].time_s + 3600.0 * hours
            members = along @ at(after, place, then_s)
            mean = float(after.probability @ members)
            spread = math.sqrt(float(after.probability @ (members - mean) ** 2))
            told.append((float(along @ at(truth, place, then_s)[:, 0]) - mean, spread))
        done += 1
        yield speed, told


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--flights", type=int, default=500)
    asked.add_argument("--seed", type=int, default=11)
    asked.add_argument("--tau-h", type=float, default=USUAL.online.residual_tau_s / 3600.0)
    given = asked.parse_args()
    found = list(flights(given.flights, given.seed, 3600.0 * given.tau_h))
    speed = np.array([one for one, _ in found])
    error, spread = np.array([told for _, told in found]).transpose(2, 0, 1)
    print(f"{len(found)} flights, residuals fade with {given.tau_h:g} h; m/s along the wind that was measured")
    print("| wind | after | mean error | error | members tell | with the age of the measurement |")
    for low, high in itertools.pairwise(SPEEDS):
        rows = (speed >= low) & (speed < high)
        for column, hours in enumerate(HOURS):
            one, told = error[rows, column], np.sqrt(np.mean(spread[rows, column] ** 2))
            aged = (
                AGED_SHARE
                * float(np.sqrt(np.mean(speed[rows] ** 2)))
                * math.sqrt(-math.expm1(-3600.0 * hours / AGED_TIME_S))
            )
            print(
                f"| {low:g} to {high:g} ({rows.sum()}) | {hours:g} h | {one.mean():+.2f} | {np.sqrt(np.mean(one**2)):.2f} | {told:.2f} | "
                f"{math.hypot(told, aged):.2f} |"
            )


if __name__ == "__main__":
    main()
