"""The only door to the product: its network data, its plans, and its decisions, asked for through public names."""

from __future__ import annotations

import csv
import math
import tempfile
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from benchmarks.cases.london import london as london_scenario
from benchmarks.cases.melbourne import melbourne as melbourne_scenario
from benchmarks.cases.networks import new_york as new_york_scenario
from benchmarks.independent.build import City
from benchmarks.independent.ground import Ground, Plane
from benchmarks.independent.product.promise import Promise, promise_of
from benchmarks.independent.vehicle.craft import Flying
from benchmarks.independent.vehicle.energy import DataSheet, Tabulated
from benchmarks.independent.weather import reports
from skyway.models.base.errors import InfeasibleError
from skyway.models.composition.composition import State
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.forecast import analogue_ensemble
from skyway.models.wind.history import read_history
from skyway.models.wind.observed.conditioning import conditioned, counted
from skyway.models.wind.observed.reading import STATION_ERROR_MPS, ObservedWind
from skyway.models.wind.triangle import speed_from
from skyway.planner.between_sites import between_sites
from skyway.planner.evaluation.as_flown import thrifty
from skyway.planner.evaluation.evaluate import held_out_forecast, season_days
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.power import PowerModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from benchmarks.independent.information import Order
    from benchmarks.independent.vehicle.energy import Power
    from benchmarks.independent.weather.reports import Site
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.result import PlanResult

GRAVITY = 9.806_65
CITIES = {"new-york": new_york_scenario, "melbourne": melbourne_scenario, "london": london_scenario}
REPORTS: dict[str, Callable[[], tuple[Site, ...]]] = {
    "new-york": reports.new_york,
    "melbourne": reports.melbourne,
    "london": reports.london,
}
DRONES = {"new-york": "m200", "melbourne": "m200-v2", "london": "m200"}
LEAVING_UTC_H = {"new-york": (13, 26), "melbourne": (-2, 11), "london": (8, 21)}
"""Orders leave between 8 and 21 o'clock local time."""


@dataclass(frozen=True, eq=False)
class Planned:
    """A plan for an order, made without some days of the record."""

    scenario: Scenario
    request: Request
    forecast: WindEnsemble
    result: PlanResult
    promise: Promise

    def problem(self, *, thriftily: bool = False) -> Problem:
        """Return what was planned from, for the drone of the plan; `thriftily` with the parameters of the deliveries that `plan --as-flown` simulates."""
        parameters = thrifty(USUAL) if thriftily else USUAL
        drone = self.scenario.drone(self.request.drone or "")
        return Problem(self.scenario, self.request, drone, self.forecast, parameters=parameters)

    @property
    def legs(self) -> int:
        """Flights of its route."""
        assert self.result.robust is not None
        return len(self.result.robust.policy)

    def told_below(self) -> float | None:
        """Return the probability it tells of a landing below the reserve if its route is flown to its end in wind that no site tells."""
        assert self.result.robust is not None
        found = between_sites(self.result.robust)
        return None if found is None else found.p_below


@lru_cache(maxsize=4)
def scenario_of(city: str) -> Scenario:
    """The product's scenario of a city, on level ground: the worlds have no hills, and the wind on a leg depends on them."""
    scenario = CITIES[city]()
    level = tuple(replace(station, elevation_m=0.0) for station in scenario.network.stations)
    return replace(scenario, network=replace(scenario.network, stations=level))


@lru_cache(maxsize=8)
def told_scenario(city: str, kept_back: str) -> Scenario:
    """The same as if one of its sites did not exist: its record is read again from the rows of the others."""
    scenario = scenario_of(city)
    if not kept_back:
        return scenario
    assert scenario.history is not None
    sites = tuple(site for site in scenario.wind_sites if site.id != kept_back)
    columns = WindColumns(
        time="time_hour", site="origin", speed="wind_speed", from_="wind_dir", speed_unit="mph", time_zone="UTC",
        calm="direction-0",
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "told.csv"
        with Path(scenario.history.source).open(encoding="utf-8", newline="") as raw:
            rows = csv.reader(raw)
            head = next(rows)
            at = head.index("origin")
            with path.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file).writerows([head, *(row for row in rows if row[at] != kept_back)])
        history = read_history(path, columns, sites, scenario.measured_at_m)
    return replace(scenario, history=history, wind_sites=sites)


@lru_cache(maxsize=8)
def city(name: str, flown: str = "") -> City:
    """A region for the world: positions, pads, segments, strangers, the data sheet of the drone flown, by default the usual one, and the raw record."""
    scenario = scenario_of(name)
    drone, rules = scenario.drone(flown or DRONES[name]), scenario.rules
    sheet = DataSheet(
        mass_kg=drone.mass_kg,
        payload_kg=drone.max_payload_kg,
        battery_j=drone.battery_j,
        empty_s=drone.endurance_empty_s,
        full_s=drone.endurance_full_s,
        recharge_s=drone.recharge_full_s,
        airspeed_mps=drone.cruise_airspeed_mps,
        max_ground_mps=drone.max_ground_speed_mps,
    )
    how = Flying(
        drone.cruise_airspeed_mps, drone.max_ground_speed_mps, rules.climb_rate_mps, rules.descent_rate_mps,
        rules.cruise_height_m,
    )  # fmt: skip
    sites, ground = _region(name)
    return City(
        name,
        sites,
        ground,
        sheet,
        how,
        rules.wind_profile_exponent,
        lambda kg: plant(drone, kg, how),
        LEAVING_UTC_H[name],
    )


@lru_cache(maxsize=4)
def _region(name: str) -> tuple[tuple[Site, ...], Ground]:
    """The raw record and the ground of a region: the same whoever flies."""
    scenario = scenario_of(name)
    network, load = scenario.network, scenario.load
    plane = Plane(float(np.mean(network.lat)), float(np.mean(network.lon)))
    ground = Ground(
        ids=tuple(one.id for one in network.stations),
        plane=plane,
        xy=plane.xy(network.lat, network.lon),
        pads=np.array([one.pads for one in network.stations]),
        spots=np.array([one.holding_spots for one in network.stations]),
        tail=np.asarray(network.tail),
        head=np.asarray(network.head),
        arrivals_per_s=load.arrivals_per_s,
        charging_s=load.mean_charging_s,
        timezone=load.timezone,
    )
    return REPORTS[name](), ground


def plant(drone: Drone, payload_kg: float, how: Flying) -> Power:
    """Power of the simulated vehicle that is shipped with the product."""
    frame = Airframe(drone=drone)
    model = PowerModel.of(frame)

    def law(airspeed_mps: float, climb_mps: float) -> float:
        drag = frame.drag_n_per_speed(airspeed_mps, payload_kg) * airspeed_mps
        thrust = math.hypot(frame.mass_kg(payload_kg) * GRAVITY, drag)
        return model.electrical_w(thrust, airspeed_mps, climb_mps, drag * airspeed_mps)

    return Tabulated(law, how.climb_mps, how.descent_mps)


def days_for(name: str, order: Order, count: int, seed: int) -> tuple[date, ...]:
    """Days of the order's season to be held out of its plan and laid onto it."""
    return season_days(scenario_of(name), request_of(name, order), count, seed=seed)


def shift_s(name: str, order: Order, day: date) -> float:
    """What to add to the order's time for the record's on such a day."""
    here = datetime.fromtimestamp(order.depart_s, UTC).astimezone(ZoneInfo(scenario_of(name).timezone)).date()
    return 86_400.0 * (day - here).days


def planned(
    name: str,
    order: Order,
    days: Sequence[date],
    kept_back: str = "",
    reports: Mapping[str, tuple[float, float, float]] | None = None,
) -> Planned | None:
    """Ask for a robust plan, told the sites but one; None where there is no route.

    `reports` are those of the hour of the order, as in `information.Seen`: then the forecast is conditioned on them.
    """
    scenario, request = told_scenario(name, kept_back), request_of(name, order)
    return planned_on(
        scenario,
        request,
        held_out_forecast(scenario, request, days) if reports is None else _now(scenario, request, days, reports),
    )


def planned_on(scenario: Scenario, request: Request, forecast: WindEnsemble) -> Planned | None:
    """Ask for a robust plan on a forecast; None where there is no route."""
    try:
        result = plan(scenario, request, planner="robust", forecast=forecast)
    except InfeasibleError:
        return None
    return Planned(
        scenario, replace(request, drone=result.problem.drone.id), forecast, result, promise_of(result.outcome)
    )


def _now(
    scenario: Scenario, request: Request, days: Sequence[date], reports: Mapping[str, tuple[float, float, float]]
) -> WindEnsemble:
    """The forecast without some days of the record, conditioned on reports."""

    def forecast(begin: datetime, hours: int) -> WindEnsemble:
        local = begin.astimezone(ZoneInfo(scenario.timezone))
        assert scenario.history is not None
        return analogue_ensemble(scenario.history, local, hours, season_days=scenario.season_days, exclude=days)

    return told_reports(scenario, request, forecast, reports)


def told_reports(
    scenario: Scenario,
    request: Request,
    forecast: Callable[[datetime, int], WindEnsemble],
    reports: Mapping[str, tuple[float, float, float]],
) -> WindEnsemble:
    """A forecast conditioned on reports, by the code behind ``plan --observed``."""
    winds = []
    for site in scenario.wind_sites:
        time_s, north, east = reports[site.id]
        speed, degrees = map(float, speed_from(north, east))
        seen = WindObservation(time_s, site.lat, site.lon, north, east, STATION_ERROR_MPS**2, scenario.measured_at_m)
        winds.append(ObservedWind(site.id, "report", speed, degrees, seen))
    chosen = counted(winds, scenario.wind_sites, request.state.time.timestamp())
    found, _ = conditioned(
        forecast, chosen.winds, request.state.time, HORIZON_H, exponent=scenario.rules.wind_profile_exponent,
        residual=ResidualModel(tau_s=USUAL.online.residual_tau_s), members=USUAL.robust.members,
    )  # fmt: skip
    return found


def request_of(name: str, order: Order) -> Request:
    """The order as the product is asked for it."""
    return Request(
        state=State(datetime.fromtimestamp(order.depart_s, UTC), order.origin),
        destination=order.destination,
        payload_kg=order.payload_kg,
        drone=None if order.any_drone else DRONES[name],
        seed=order.seed,
    )
