"""New York: 200 drones and 300 orders in an hour, planned jointly, one after another, and each alone; flown with other drones at the pads."""

from __future__ import annotations

import argparse
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from skyway.missions.examples import NEW_YORK
from skyway.models.orders.fitting import Work, fit
from skyway.models.orders.order import Order, Vehicle
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.file import read_scenario
from skyway.planner.capacity.execution import carry_out, strangers
from skyway.planner.dispatch.dispatch import dispatch, result_of
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.dispatch.search import Search
from skyway.planner.parameters.planner import USUAL

START = datetime(2013, 7, 10, 14, tzinfo=UTC)
MAX_LATE_S = 1800.0


def city(seed: int, drones: int, orders: int, utilisation: float, start: datetime = START) -> Work:
    """Return New York with numbers of drones, and orders over an hour, and other drones that occupy a share of the pads."""
    scenario = read_scenario(NEW_YORK)
    rng = np.random.default_rng(seed)
    pads = np.maximum(scenario.network.pads, 1)
    charging = np.full((len(scenario.network), 168), 2400.0)
    rates = np.where(scenario.network.pads[:, None] > 0, utilisation * pads[:, None] / charging, 0.0)
    scenario = replace(scenario, load=PadLoad(rates, charging, scenario.timezone))
    stations = [one.id for one in scenario.network.stations if one.pads]
    vehicles = [
        Vehicle(id=f"d{one}", type="m200", home=home, place=home, soc=float(rng.uniform(0.5, 1.0)))
        for one, home in enumerate(rng.choice(stations, drones))
    ]
    made = []
    for one in range(orders):
        begin, end = rng.choice(stations, 2, replace=False)
        ready = start + timedelta(minutes=float(rng.uniform(0.0, 60.0)))
        due = ready + timedelta(minutes=float(rng.choice([120.0, 150.0, 180.0])))
        made.append(Order(id=f"o{one}", origin=begin, destination=end, mass_kg=float(rng.choice([0.2, 0.5, 0.8])), ready=ready, due=due))  # fmt: skip
    return fit(scenario, made, vehicles)


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drones", type=int, default=200)
    parser.add_argument("--orders", type=int, default=300)
    parser.add_argument("--utilisation", type=float, default=0.7, help="of the pads, by strangers")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--days", type=int, default=10, help="draws of the strangers")
    options = parser.parse_args()
    work = city(1, options.drones, options.orders, options.utilisation)
    forecast = work.scenario.forecast(START, 48)
    laid = lay_out_problem(work, START, forecast, USUAL)
    plans = {"together": dispatch(work, START, forecast=forecast, time_limit_s=options.seconds).routes}
    first_come = Search(laid.problem, USUAL.dispatch)
    for order in np.argsort(laid.problem.orders.ready_s):
        first_come.insert_best(int(order))
    plans["first come, first served"] = tuple(result_of(work, laid, first_come)[0])
    flights = laid.problem.flights
    many = np.where(flights.pads > 0, options.drones, 0)
    roomy = replace(laid.problem, flights=flights._replace(pads=many, first_pad=np.cumsum(many) - many))
    alone = Search(roomy, USUAL.dispatch)
    for order in np.argsort(laid.problem.orders.ready_s):
        alone.insert_best(int(order))
    plans["each as if alone"] = tuple(result_of(work, replace(laid, problem=roomy), alone)[0])
    network, load = work.scenario.network, work.scenario.load
    pads = {one.id: one.pads for one in network.stations if one.pads}
    ready = {one.id: one.ready.timestamp() for one in work.orders}
    due = {one.id: one.due.timestamp() for one in work.orders}
    print(f"{options.orders} orders, {options.drones} drones, {sum(pads.values())} pads, strangers keep {options.utilisation:g} of them busy, {options.days} draws")  # fmt: skip
    for name, routes in plans.items():
        served, timely, waits, times = [], [], [], []
        for day in range(options.days):
            drawn = strangers(load.arrivals_per_s[:, 0], load.mean_charging_s[:, 0], START.timestamp(), day)
            others = {one.id: drawn[number] for number, one in enumerate(network.stations)}
            done = carry_out(routes, ready, pads, others, START.timestamp())
            kept = [one for one, at in done.delivered_s.items() if at <= due[one] + MAX_LATE_S]
            served.append(len(kept) / options.orders)
            timely.append(sum(at <= due[one] for one, at in done.delivered_s.items()) / options.orders)
            waits.append(np.mean([done.waited_s.get(one, 0.0) for one in done.delivered_s]) / 60.0)
            times.append(np.mean([at - ready[one] for one, at in done.delivered_s.items()]) / 60.0)
        planned = sum(len(route.orders) for route in routes)
        print(
            f"{name:<26} planned {planned}; delivered at most 30 min late {100 * np.mean(served):.1f} %, on time {100 * np.mean(timely):.1f} %; "
            f"waiting for pads {np.mean(waits):.1f} min an order, from ready to delivered {np.mean(times):.1f} min"
        )


if __name__ == "__main__":
    main()
