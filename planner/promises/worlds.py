"""Worlds in which the plan of a fleet is flown: winds of the forecast, energies as they are believed, and others at the pads as they are expected."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.drones.energy_belief import LEAST_RATIO
from skyway.models.drones.time_belief import TimeBelief
from skyway.models.flight.energy import FlightPower
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.models.queues.waiting_times import present_at
from skyway.planner.dispatch.flight_times import air_times, charge_of, fixed_s, shortest_m
from skyway.planner.dispatch.flights import mode_problem
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.flight_table import ground_speeds
from skyway.planner.problem.request import DEFAULT_EPSILON
from skyway.planner.promises.flown_kernels import Checked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.queues.load import PadLoad
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.parameters.planner import PlannerParameters

OTHERS_H = 14
"""So many hours others come to the pads; a delivery takes less."""


class Winds(NamedTuple):
    """Flights between the places in each wind of a forecast."""

    time_s: NDArray[np.float64]
    need: NDArray[np.float64]
    """Shape (members, modes, slots, places, places) each: time in the air, and the charge that the model says."""
    probability: NDArray[np.float64]
    """Shape (members,)."""
    far_m: NDArray[np.float64]
    """Shape (places, places): length of the shortest way."""
    fixed_s: float
    """Time in the air beyond the segments."""


class Times(NamedTuple):
    """Times that are drawn, shape (worlds, steps) each: see `flown_kernels.World`."""

    pace: NDArray[np.float64]
    more_s: NDArray[np.float64]
    charging: NDArray[np.float64]


class Others(NamedTuple):
    """Who else comes to the pads, in each world."""

    come_s: NDArray[np.float64]
    lasts_s: NDArray[np.float64]
    begin: NDArray[np.int64]
    """Those of place p in world w are begin[w, p] : begin[w, p + 1], in order of coming; shape (worlds, places + 1)."""


def winds_of(
    work: Work, laid: Laid, depart: datetime, forecast: WindEnsemble, parameters: PlannerParameters, members: int
) -> Winds:
    """Work out all flights in each member of a forecast, thinned to so many: each on the way that is fastest in it."""
    slots = laid.problem.flights.time_s.shape[1]
    times, needs = [], []
    before: list[NDArray[np.float64]] = []
    time_s = probability = np.empty(0)
    for drone_id, mass_kg in laid.modes:
        problem = mode_problem(work, depart, forecast, parameters, work.scenario.drone(drone_id), mass_kg, members)
        every, rows = np.arange(len(problem.network.tail)), np.arange(slots)
        speeds = [ground_speeds(problem.air, member, rows, every) for member in range(len(problem.probability))]
        if not before or any(not np.array_equal(one, other) for one, other in zip(speeds, before, strict=True)):
            time_s = np.stack([air_times(problem, laid.places, one) for one in speeds])
            before = speeds
        times.append(time_s)
        needs.append(charge_of(problem, time_s))
        probability = problem.probability
    return Winds(
        np.stack(times, axis=1),
        np.stack(needs, axis=1),
        probability,
        shortest_m(problem, laid.places),
        fixed_s(problem),
    )


def members_of(probability: NDArray[np.float64], worlds: int, random: np.random.Generator) -> NDArray[np.int64]:
    """Return the member of each world, as often as is probable, in random order."""
    evenly = (np.arange(worlds) + random.random()) / worlds
    found = np.searchsorted(np.cumsum(probability), evenly * probability.sum(), side="right")
    return random.permutation(np.minimum(found, len(probability) - 1)).astype(np.int64)


def ratios_of(work: Work, drone: NDArray[np.int64], worlds: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Draw the energy over the model's of each step, shape (worlds, steps): what persists of a drone, and what is fresh; `drone` has the number of each step's."""
    beliefs = [USUAL_ERRORS.energy_of(work.scenario.drone(one.type)) for one in work.vehicles]
    mean, between, within, freedom = np.array(
        [(one.mean_ratio, one.sd_between, one.sd_within, one.degrees_of_freedom) for one in beliefs]
    ).T
    usual = mean + between * random.standard_t(freedom, (worlds, len(beliefs)))
    fresh = random.standard_t(freedom[drone], (worlds, len(drone)))
    return np.asarray(np.maximum(usual[:, drone] + within[drone] * fresh, LEAST_RATIO))


def times_of(
    drone: NDArray[np.int64], worlds: int, random: np.random.Generator, parameters: PlannerParameters
) -> Times:
    """Draw the times of each step, as they are believed (`models.drones.time_belief`); `drone` has the number of each step's."""
    pace, more_s, charging = (np.empty((worlds, len(drone))) for _ in range(3))
    ground_s, manoeuvres_s = parameters.dispatch.ground_s, parameters.online.manoeuvres_s
    for one in np.unique(drone):
        own = np.flatnonzero(drone == one)
        drawn = TimeBelief().sampled(random, worlds, len(own))
        pace[:, own] = drawn.flights.T
        more_s[:, own] = ground_s * drawn.ground.T + manoeuvres_s * (drawn.manoeuvres[:, None] - 1.0)
        charging[:, own] = drawn.charging[:, None]
    return Times(pace, more_s, charging)


def landings_of(
    work: Work, in_air_s: Mapping[str, float], worlds: int, random: np.random.Generator, parameters: PlannerParameters
) -> NDArray[np.float64]:
    """Draw by how much later than expected each drone lands that is in the air for some time at the beginning, s, shape (worlds, drones)."""
    found = np.zeros((worlds, len(work.vehicles)))
    for number, one in enumerate(work.vehicles):
        if one.id in in_air_s:
            drawn = TimeBelief().sampled(random, worlds, 1)
            rest_s = min(in_air_s[one.id], parameters.online.manoeuvres_s)
            found[:, number] = in_air_s[one.id] * (drawn.flights[0] - 1.0) + rest_s * (drawn.manoeuvres - 1.0)
    return found


def checks_of(
    work: Work, margin: float, margin_of: Mapping[str, DepartureMargin] | None = None, epsilon: float = DEFAULT_EPSILON
) -> Checked:
    """Return what the check before a take-off counts with for each drone: its departure margin, or the usual one."""
    known, rows = margin_of or {}, []
    for one in work.vehicles:
        if one.type in known:
            own = known[one.type]
            rows.append((own.share, own.pace_mps, own.least, own.most))
        else:
            share = checked_ratio(USUAL_ERRORS.energy_of(work.scenario.drone(one.type)), margin, epsilon)
            rows.append((share, 0.0, share, share))
    return Checked(*np.array(rows, dtype=np.float64).reshape(-1, 4).T.copy())


def asked_of(
    work: Work, drone: NDArray[np.int64], worlds: int, random: np.random.Generator, margin_of: Mapping[str, DepartureMargin] | None
) -> NDArray[np.float64]:  # fmt: skip
    """Draw by how much the check deviates from the departure margin at each step, shape (worlds, steps): as in legs for which it was computed."""
    found, known = np.zeros((worlds, len(drone))), margin_of or {}
    kinds = np.array([one.type for one in work.vehicles])[drone] if len(drone) else np.empty(0, dtype=str)
    for kind, own in known.items():
        which = np.flatnonzero(kinds == kind)
        found[:, which] = random.choice(np.array(own.deviations), (worlds, len(which)))
    return found


def power_shares(work: Work, laid: Laid) -> NDArray[np.float64]:
    """Power with each order's package over that with the next heavier class, in which flights are worked out, by type and order; 1 where it is not carried."""
    orders, types = laid.problem.orders, [one for one in work.scenario.drones if any(of.type == one.id for of in work.vehicles)]  # fmt: skip
    found = np.ones(orders.mode.shape)
    for row, drone in enumerate(types):
        for column, order in enumerate(work.orders):
            mode = int(orders.mode[row, column])
            if mode >= 0:
                carried, class_kg = FlightPower.of(drone, order.mass_kg), laid.modes[mode][1]
                found[row, column] = carried.soc_per_s / FlightPower.of(drone, class_kg).soc_per_s
    return found


def checked_ratio(belief: EnergyBelief, margin: float, epsilon: float) -> float:
    """Ratio of energy to the model's in the wind of now that flights stay below but for a share epsilon; `margin` is for what the wind does on the way."""
    return belief.mean_ratio * (
        1.0 + math.hypot(margin, belief.sigmas(1.0 - epsilon) * belief.leg_sd / belief.mean_ratio)
    )


def others_of(
    work: Work, laid: Laid, depart: datetime, worlds: int, random: np.random.Generator, *, seen: PadsSeen = NOTHING_SEEN,
    holds: Sequence[Hold] = (),
) -> Others:  # fmt: skip
    """Draw who else comes to the pads: strangers as the load of the hours says, from what was seen on, and the holders of windows when these begin."""
    network, begin_s = work.scenario.network, depart.timestamp()
    booked: dict[str, list[tuple[float, float]]] = {}
    for hold in holds:
        opens_s, closes_s = hold.window.opens.timestamp(), hold.window.closes.timestamp()
        if closes_s > begin_s:
            booked.setdefault(hold.window.station, []).append((max(opens_s, begin_s), closes_s - max(opens_s, begin_s)))
    world_of, place_of, come, lasts = [], [], [], []
    for place, node in enumerate(laid.places):
        station = network.stations[node]
        if not station.pads:
            continue
        world, at_s, for_s = _strangers(
            work.scenario.load, node, station.pads, begin_s, worlds, random, seen, station.id
        )
        own = np.array(booked.get(station.id, ())).reshape(-1, 2)
        world = np.concatenate((world, np.repeat(np.arange(worlds), len(own))))
        come.append(np.concatenate((at_s, np.tile(own[:, 0], worlds))))
        lasts.append(np.concatenate((for_s, np.tile(own[:, 1], worlds))))
        world_of.append(world)
        place_of.append(np.full(len(world), place))
    if not come:
        return Others(np.empty(0), np.empty(0), np.zeros((worlds, len(laid.places) + 1), dtype=np.int64))
    worlds_of, places_of, at_s = np.concatenate(world_of), np.concatenate(place_of), np.concatenate(come)
    order = np.lexsort((at_s, places_of, worlds_of))
    edges = (np.arange(worlds)[:, None] * len(laid.places) + np.arange(len(laid.places) + 1)).ravel()
    begin = np.searchsorted((worlds_of * len(laid.places) + places_of)[order], edges).reshape(worlds, -1)
    return Others(at_s[order], np.concatenate(lasts)[order], begin.astype(np.int64))


def _strangers(
    load: PadLoad, node: int, pads: int, begin_s: float, worlds: int, random: np.random.Generator, seen: PadsSeen, station: str
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """World, time of coming and time on the pad of the strangers of one station; those that are there come at the beginning."""
    arrivals, charging = load.hourly(node, begin_s, OTHERS_H)
    if station in seen.busy:
        there = np.full(worlds, seen.busy[station])
    else:
        (share,) = present_at(load, [node], [pads], begin_s)
        there = np.searchsorted(share, random.random(worlds) * share[-1], side="right")
    first = np.repeat(np.arange(worlds), there)
    stay_s = random.exponential(float(charging[0]), len(first)) if len(first) else np.empty(0)
    known = np.maximum(np.sort(np.array(seen.free_s.get(station, ()))) - begin_s, 0.0)
    if len(known) and len(first):
        rank = np.arange(len(first)) - np.repeat(np.cumsum(there) - there, there)
        stay_s = np.where(rank < len(known), known[np.minimum(rank, len(known) - 1)], stay_s)
    count = random.poisson(np.broadcast_to(arrivals * S_PER_H, (worlds, OTHERS_H)))
    hour = np.repeat(np.tile(np.arange(OTHERS_H), worlds), count.ravel())
    come_s = begin_s + S_PER_H * (hour + random.random(len(hour)))
    lasts_s = random.exponential(1.0, len(hour)) * charging[hour]
    world = np.concatenate((first, np.repeat(np.arange(worlds), count.sum(axis=1))))
    return world, np.concatenate((np.full(len(first), begin_s), come_s)), np.concatenate((stay_s, lasts_s))
