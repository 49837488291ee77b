"""Objectives beside time: routes against all routes there are, on small networks."""

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest

from skyway.models.base.errors import InputError, NoRouteError
from skyway.models.scenario.tariff import Tariff
from skyway.planner.plan import plan
from skyway.planner.problem.mean_value import ExpectedQueues
from skyway.planner.problem.objective import Weights
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.speeds import MeanSpeeds
from skyway.planner.robust.loss_search import LossSearch
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.itinerary import Leg
from tests.planner.worlds import make_request, make_wind, make_world


def priced(rng, scenario, *, by_hour=True):
    """The same with random prices and fees."""
    count = len(scenario.network)
    energy = rng.uniform(0.1, 1.0, (count, 1)) * (rng.uniform(0.3, 3.0, (count, 168)) if by_hour else np.ones((1, 168)))
    tariff = Tariff("EUR", energy, rng.uniform(0.0, 2.0, count), 0.3, "UTC")
    drones = tuple(replace(drone, wear_per_flight_h=2.0, wear_per_cycle=0.5) for drone in scenario.drones)
    return replace(scenario, tariff=tariff, drones=drones)


def mean_value_world(number, *, by_hour=False):
    rng = np.random.default_rng((0x10, number))
    scenario = priced(rng, make_world(rng, 5, utilisation=0.4), by_hour=by_hour)
    wind = make_wind(rng, members=1, mean_mps=4.0, slots=48, turn_back=0.0)
    wind = replace(wind, north=np.repeat(wind.north[:, :1], 48, axis=1), east=np.repeat(wind.east[:, :1], 48, axis=1))
    request = make_request(scenario, rng)
    return Problem(scenario, request, scenario.drones[0], wind), wind


def least_by_enumeration(problem, queues, margin, weights):
    """Loss of every sequence of distinct stops, charged for enough; written down again, flight by flight."""
    p, network = problem, problem.network
    speeds = MeanSpeeds(p.air, p.probability, 16.0).over(0, 0, np.arange(len(network.head)))[0]
    count = len(network)
    time = np.full((count, count), np.inf)
    for segment, (tail, head) in enumerate(zip(network.tail, network.head, strict=True)):
        time[tail, head] = p.air.distance_m[segment] / speeds[segment] if speeds[segment] > 0 else np.inf
    for middle in range(count):
        time = np.minimum(time, time[:, middle, None] + time[None, middle])
    kwh = p.drone.battery_j / 3.6e6
    best = np.inf
    inner = [n for n in range(count) if n not in (p.origin, p.destination) and p.has_pads(n)]
    for length in range(len(inner) + 1):
        for middle in permutations(inner, length):
            way = [p.origin, *middle, p.destination]
            now, soc, loss = p.depart_s, p.soc, 0.0
            for here, there in pairwise(way):
                flight = time[here, there] + p.air.climb_s + p.air.descent_s
                takes = p.soc_fixed + p.soc_per_s * flight
                need = p.reserve + takes + margin * p.soc_per_s * flight
                if not need <= 1.0:
                    break
                if need > soc:
                    if not p.has_pads(here):
                        break
                    pad = float(queues[here].pad_time(now))
                    # the charge in small steps, each at the price of its hour
                    curve_s, curve_soc = p.curve(here)
                    empty = np.interp(soc, curve_soc, curve_s)
                    lasts = np.interp(need, curve_soc, curve_s) - empty
                    edges = np.linspace(0.0, lasts, 4001)
                    gained = np.diff(np.interp(empty + edges, curve_s, curve_soc))
                    middle_s = pad + 0.5 * (edges[1:] + edges[:-1])
                    # hours of the week in UTC: 1970-01-01 was a Thursday
                    hour = (np.floor(middle_s / 3600.0).astype(int) + 72) % 168
                    price = p.scenario.tariff.energy_per_kwh[here][hour]
                    loss += weights.cost * (kwh * float(price @ gained) + p.scenario.tariff.pad_fee[here])
                    now, soc = pad + lasts, need
                now += flight
                soc -= takes
                loss += weights.per_kwh * kwh * takes
                loss += weights.cost * (2.0 * flight / 3600.0 + 0.5 * takes)
            else:
                loss += weights.per_h * (now - p.depart_s) / 3600.0
                loss += weights.cost * 0.3 * kwh * max(p.soc - soc, 0.0)
                best = min(best, loss)
    return best


def loss_of(problem, queues, margin, weights, itinerary):
    """Loss of one route by the same enumeration, on a network of its stops alone."""
    stops = [int(problem.network.tail[leg.segments[0]]) for leg in itinerary]
    kept = {problem.origin, problem.destination, *stops}
    shut = replace(
        problem.network,
        stations=tuple(
            one if number in kept else replace(one, pads=0) for number, one in enumerate(problem.network.stations)
        ),
    )
    part = Problem(replace(problem.scenario, network=shut), problem.request, problem.drone, problem.ensemble)
    return least_by_enumeration(part, queues, margin, weights)


@pytest.mark.parametrize("by_hour", [False, True])
@pytest.mark.parametrize("weights", [Weights(per_kwh=1.0), Weights(cost=1.0), Weights(1.0, 6.0, 0.2)])
def test_first_route_is_the_best_of_all(weights, by_hour):
    """The search against all sequences of stops."""
    compared = 0
    for number in range(8):
        problem, _ = mean_value_world(number, by_hour=by_hour)
        queues = ExpectedQueues(problem)
        speeds = MeanSpeeds(problem.air, problem.probability, 16.0)
        everywhere = np.ones(len(problem.network), dtype=bool)
        search = LossSearch(problem, queues, speeds, 0.1, everywhere, weights, most_labels=10_000)
        found = next(iter(search.routes(1)), None)
        least = least_by_enumeration(problem, queues, 0.1, weights)
        assert (found is None) == np.isinf(least)
        if found is not None:
            assert loss_of(problem, queues, 0.1, weights, found) == pytest.approx(least, rel=1e-3)
            compared += 1
    assert compared >= 5


def all_routes(problem):
    """Every sequence of distinct stops over the network's own segments, by ways of least length."""
    network = problem.network
    count = len(network)
    length = np.full((count, count), np.inf)
    length[network.tail, network.head] = network.distance_m
    onward = np.where(np.isfinite(length), np.arange(count)[None], -1)
    for middle in range(count):
        through = length[:, middle, None] + length[None, middle]
        better = through < length
        length, onward = np.where(better, through, length), np.where(better, onward[:, middle, None], onward)
    number = {pair: n for n, pair in enumerate(zip(network.tail.tolist(), network.head.tolist(), strict=True))}

    def segments(here, there):
        found = []
        while here != there:
            after = int(onward[here, there])
            found.append(number[here, after])
            here = after
        return tuple(found)

    inner = [n for n in range(count) if n not in (problem.origin, problem.destination) and problem.has_pads(n)]
    for stops in range(len(inner) + 1):
        for middle in permutations(inner, stops):
            way = (problem.origin, *middle, problem.destination)
            if all(np.isfinite(length[a, b]) for a, b in pairwise(way)):
                yield tuple(Leg(segments(a, b)) for a, b in pairwise(way))


@pytest.mark.slow
@pytest.mark.parametrize("asked", ["energy", "cost"])
def test_plan_is_the_best_of_all_routes_simulated(asked):
    """What `robust` chooses against every route, each simulated in the same deliveries."""
    excess = []
    for number in range(5):
        rng = np.random.default_rng((0x20, number))
        scenario = priced(rng, make_world(rng, 5, utilisation=0.3))
        wind = make_wind(rng, members=6, mean_mps=4.0)
        request = make_request(scenario, rng, objective=asked)
        search = RobustSearch(Problem(scenario, request, scenario.drones[0], wind))
        try:
            chosen = search.candidates()[0]
        except NoRouteError:
            continue
        every = [search.judged(one) for one in all_routes(search.problem)]
        best = min(one.order() for one in every)
        assert chosen.order()[:2] == best[:2]
        excess.append(chosen.loss[0] / best[2] - 1.0)
    assert len(excess) >= 3
    assert np.median(excess) <= 1e-9
    assert max(excess) < 0.05


@pytest.mark.slow
def test_an_objective_is_met_and_told():
    """The plan for each objective is the best of the plans in its own terms, and says what it spends."""
    rng = np.random.default_rng(3)
    scenario = priced(rng, make_world(rng, 7, utilisation=0.3))
    wind = make_wind(rng, members=4, mean_mps=4.0)
    plans = {
        asked: plan(scenario, make_request(scenario, np.random.default_rng(4), objective=asked), forecast=wind)
        for asked in ("mean", "energy", "cost", "cost + 12/h*time", "cost within 10%, then mean")
    }
    told = {asked: one.composition for asked, one in plans.items()}
    least = {
        "mean": min(one.arrival.delivery_mean.value for one in told.values()),
        "energy": min(one.energy.mean.value for one in told.values()),
        "cost": min(one.costs.mean.value for one in told.values()),
    }
    slack = 1.03  # another set of deliveries is told than the routes were chosen in
    assert told["mean"].arrival.delivery_mean.value <= slack * least["mean"]
    assert told["energy"].energy.mean.value <= slack * least["energy"]
    assert told["cost"].costs.mean.value <= slack * least["cost"]
    assert told["cost within 10%, then mean"].costs.mean.value <= 1.1 * slack * least["cost"]
    for one in told.values():
        costs = one.costs
        assert costs.energy + costs.pad_fees + costs.refill + costs.wear == pytest.approx(costs.mean.value)
        assert costs.currency == "EUR"


def test_only_robust_takes_it_and_prices_are_needed():
    """Other planners, and scenarios without prices, refuse by name."""
    rng = np.random.default_rng(3)
    bare = make_world(rng, 4)
    wind = make_wind(rng, members=2)
    with pytest.raises(InputError, match="robust takes every objective"):
        plan(bare, make_request(bare, rng, objective="energy"), planner="pfs", forecast=wind)
    with pytest.raises(InputError, match=r"\[costs\]"):
        plan(bare, make_request(bare, rng, objective="cost, then mean"), forecast=wind)
