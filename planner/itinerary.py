"""Itineraries: what a planner decides, flown through the forecast and told as a composition."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models import geodesy
from models.queue_paths import no_queue, pack
from models.services import ArrivalDistribution, Composition, DroneService, Place, Stop, Wind
from models.units import J_PER_WH, S_PER_H, S_PER_MIN, from_posix
from models.weighted import weighted_quantile
from models.wind import speed_from
from planner.course_kernels import (
    PAD,
    READY,
    SOC_DOWN,
    SOC_OFF,
    TAKE_OFF,
    TOUCH_DOWN,
    Hops,
    Queues,
    Waits,
    flight_parts,
    fly_under,
    no_queues,
)
from planner.evaluation_kernels import plain_sky
from planner.no_route import grounded_leg, never_leaves

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray

    from models.drone import Drone
    from models.queue_paths import QueuePath
    from planner.evaluation_kernels import Sky
    from planner.problem import Problem

SAMPLES_PER_MEMBER = 8
"""Sampled queues that each member of the forecast is flown with."""
TYPICAL_SLOTS = 8
"""Slots of the forecast in which the winds of members are compared for the nominal course."""
DIVERTS = 3
"""Most divert stations that a service names."""


@dataclass(frozen=True, slots=True)
class Hop:
    """One flight and the stop before it.

    Attributes
    ----------
    segments : tuple of int
        Segments flown, without a landing between.
    charge_to : float or None
        Charge at the stop before; None uses no pad.
    not_before_s : float
        Stay at the stop before at least until then, POSIX seconds.
    """

    segments: tuple[int, ...]
    charge_to: float | None = None
    not_before_s: float = -math.inf


Itinerary = tuple[Hop, ...]


def fly_expected(problem: Problem, itinerary: Itinerary) -> NDArray[np.float64]:
    """Fly an itinerary in every member with expected waits, shape (members, hops, 6); see `course_kernels`."""
    nodes = stop_nodes(problem, itinerary)
    problem.waits.need(nodes)
    waits = Waits(problem.waits.start_s, problem.waits.step_s, problem.waits.wait_s[nodes])
    members = np.arange(len(problem.probability))
    return _fly(problem, itinerary, members, no_queues(), waits)


def fly_sampled(
    problem: Problem, itinerary: Itinerary, samples: int = SAMPLES_PER_MEMBER
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fly an itinerary in every member with sampled queues: (runs, shape (runs, hops, 6); probability, shape (runs,))."""
    nodes = stop_nodes(problem, itinerary)
    sets = [problem.queue_paths(dict.fromkeys(nodes), sample) for sample in range(samples)]
    members = np.repeat(np.arange(len(problem.probability)), samples)
    queues = Queues(*pack([paths[node] for paths in sets for node in nodes]))
    sky = plain_sky(len(members))._replace(queue=np.tile(np.arange(samples), len(problem.probability)))
    runs = _fly(problem, itinerary, members, queues, no_waits(len(itinerary)), sky)
    return runs, np.repeat(problem.probability / samples, samples)


def fly_true(problem: Problem, itinerary: Itinerary, queues: dict[int, QueuePath]) -> NDArray[np.float64]:
    """Fly an itinerary in the first member with given queues, shape (1, hops, 6)."""
    paths = [queues.get(node) or no_queue() for node in stop_nodes(problem, itinerary)]
    return _fly(problem, itinerary, np.zeros(1, dtype=np.int64), Queues(*pack(paths)), no_waits(len(itinerary)))


def no_waits(hops: int) -> Waits:
    """Make the expected waits that `fly_under` does not read where queues are sampled."""
    return Waits(0.0, 1.0, np.zeros((hops, 1)))


def stop_nodes(problem: Problem, itinerary: Itinerary) -> list[int]:
    """Node of the stop before each hop."""
    return [int(problem.network.tail[hop.segments[0]]) for hop in itinerary]


def _fly(
    problem: Problem,
    itinerary: Itinerary,
    members: NDArray[np.int64],
    queues: Queues,
    waits: Waits,
    sky: Sky | None = None,
) -> NDArray[np.float64]:
    start = (float(problem.depart_s), float(problem.soc))
    cost = (float(problem.soc_per_s), float(problem.soc_fixed))
    hops = hops_of(problem, itinerary)
    return fly_under(sky or plain_sky(len(members)), problem.air, members, hops, queues, waits, start, cost)


def hops_of(problem: Problem, itinerary: Itinerary) -> Hops:
    """Lay an itinerary out as arrays for `course_kernels`."""
    offset = np.cumsum([0, *(len(hop.segments) for hop in itinerary)])
    curves = [problem.curve(node) for node in stop_nodes(problem, itinerary)]
    points = max(len(time) for time, _ in curves)
    return Hops(
        offset=offset.astype(np.int64),
        segments=np.array([segment for hop in itinerary for segment in hop.segments], dtype=np.int64),
        charge_to=np.array([math.nan if hop.charge_to is None else hop.charge_to for hop in itinerary]),
        not_before_s=np.array([hop.not_before_s for hop in itinerary], dtype=np.float64),
        curve_s=np.array([np.pad(time, (0, points - len(time)), mode="edge") for time, _ in curves]),
        curve_soc=np.array([np.pad(soc, (0, points - len(soc)), mode="edge") for _, soc in curves]),
    )


@dataclass(frozen=True)
class Outcome:
    """What the forecast makes of an itinerary.

    Attributes
    ----------
    arrival_s, weight : ndarray, shape (runs that arrive,)
        Arrival of each run, POSIX seconds, and its probability.
    p_reserve, p_hold : ndarray, shape (hops,)
        Probability that the landing keeps the reserve, and that the wind holds the drone before the flight; both
        given that the flight is flown at all.
    p_success : float
        Probability that every landing keeps the reserve.
    p_arrive : float
        Probability that the wind opens every flight within the horizon.
    """

    arrival_s: NDArray[np.float64]
    weight: NDArray[np.float64]
    p_reserve: NDArray[np.float64]
    p_hold: NDArray[np.float64]
    p_success: float
    p_arrive: float

    @property
    def mean_s(self) -> float:
        """Mean arrival, POSIX seconds; infinite when no run arrives."""
        total = float(self.weight.sum())
        return float(np.average(self.arrival_s, weights=self.weight)) if total > 0 else math.inf

    def quantile_s(self, q: float) -> float:
        """Quantile of the arrival, POSIX seconds."""
        return weighted_quantile(self.arrival_s, self.weight, q) if len(self.weight) else math.inf

    def p_by(self, deadline_s: float) -> float:
        """Probability to arrive by a deadline, POSIX seconds."""
        return float(self.weight[self.arrival_s <= deadline_s + 1e-6].sum())


def outcome(problem: Problem, runs: NDArray[np.float64], weight: NDArray[np.float64]) -> Outcome:
    """Summarise runs of an itinerary."""
    flown = np.isfinite(runs[:, :, TOUCH_DOWN])
    kept = runs[:, :, SOC_DOWN] >= problem.reserve - 1e-9
    held = runs[:, :, TAKE_OFF] > runs[:, :, READY] + 0.5
    mass = np.maximum(weight @ flown, 1e-300)
    arrived = flown[:, -1]
    share = max(float(weight[arrived].sum()), 1e-300)
    return Outcome(
        arrival_s=runs[arrived, -1, TOUCH_DOWN],
        weight=weight[arrived],
        p_reserve=np.minimum((weight @ (flown & kept)) / mass, 1.0),
        p_hold=np.minimum((weight @ (flown & held)) / mass, 1.0),
        p_success=min(float(weight[arrived & kept.all(axis=1)].sum()) / share, 1.0),
        p_arrive=min(float(weight[arrived].sum()), 1.0),
    )


def typical_member(problem: Problem, itinerary: Itinerary) -> tuple[int, NDArray[np.float64]]:
    """Member for the nominal course, and that course with expected waits, shape (hops, 6).

    Of the tenth of the members whose arrival is nearest to the median arrival, the one whose wind is nearest to that
    of all the others (least mean vector distance over the first hours).

    Raises
    ------
    NoRouteError
        No member lets it arrive.
    """
    runs = fly_expected(problem, itinerary)
    arrival = runs[:, -1, TOUCH_DOWN]
    arrives = np.flatnonzero(np.isfinite(arrival))
    if not len(arrives):
        raise never_leaves(problem, itinerary, grounded_leg(runs))
    middle = weighted_quantile(arrival[arrives], problem.probability[arrives], 0.5)
    off = np.abs(arrival[arrives] - middle)
    near = arrives[off <= np.sort(off)[max(1, len(arrives) // 10) - 1] + 1.0]
    air = problem.air
    wind = (air.north + 1j * air.east)[:, :TYPICAL_SLOTS].reshape(len(air.north), -1)
    distance = [float(problem.probability @ np.abs(wind - wind[member]).mean(axis=1)) for member in near]
    member = int(near[int(np.argmin(distance))])
    return member, runs[member]


def compose(
    problem: Problem,
    itinerary: Itinerary,
    course: NDArray[np.float64],
    member: int,
    result: Outcome,
    *,
    planner: str,
    planning_time_s: float,
    notes: tuple[str, ...] = (),
) -> Composition:
    """Tell an itinerary as a composition whose nominal course is `course`, flown in one member."""
    network, request, drone = problem.network, problem.request, problem.drone
    services = [_service(problem, itinerary, course, member, result, number) for number in range(len(itinerary))]
    stops = [_stop(problem, itinerary, course, number) for number in range(len(itinerary))]
    named = {problem.origin, problem.destination}
    for hop in itinerary:
        for segment in hop.segments:
            named |= {int(network.tail[segment]), int(network.head[segment])}
    named |= {network.index[key] for service in services for key in service.diverts}
    stations = {
        s.id: Place(s.lat, s.lon, s.elevation_m, s.name, s.pads)
        for s in (network.stations[node] for node in sorted(named))
    }
    return Composition(
        id=f"{planner}-{network.stations[problem.origin].id}-{network.stations[problem.destination].id}",
        planner=planner,
        drone=drone.id,
        drone_parameters=_parameters(drone),
        payload_kg=request.payload_kg,
        airspeed_mps=problem.air.airspeed_mps,
        max_ground_speed_mps=drone.max_ground_speed_mps,
        cruise_height_m=problem.rules.cruise_height_m,
        climb_rate_mps=problem.rules.climb_rate_mps,
        descent_rate_mps=problem.rules.descent_rate_mps,
        reserve_soc=request.reserve_soc,
        depart=request.state.time,
        origin=network.stations[problem.origin].id,
        destination=network.stations[problem.destination].id,
        stations=stations,
        services=tuple(services),
        stops=tuple(stop for stop in stops if stop is not None),
        arrival=_distribution(result),
        planning_time_s=planning_time_s,
        seed=request.seed,
        scenario_path=problem.scenario.path,
        scenario_sha256=problem.scenario.sha256,
        success_probability=result.p_success,
        notes=notes,
    )


def _distribution(result: Outcome) -> ArrivalDistribution:
    if not len(result.weight):
        return ArrivalDistribution(None, None, None)
    return ArrivalDistribution(
        *(_instant(value) for value in (result.mean_s, result.quantile_s(0.5), result.quantile_s(0.95)))
    )


def _instant(posix_s: float) -> datetime:
    return from_posix(round(posix_s * 1000.0) / 1000.0)


def _parameters(drone: Drone) -> dict[str, float | str | None]:
    return {
        "name": drone.name,
        "provider": drone.provider,
        "mass_kg": drone.mass_kg,
        "max_payload_kg": drone.max_payload_kg,
        "battery_wh": drone.battery_j / J_PER_WH,
        "endurance_empty_min": drone.endurance_empty_s / S_PER_MIN,
        "endurance_full_min": drone.endurance_full_s / S_PER_MIN,
        "max_airspeed_mps": drone.max_airspeed_mps,
        "max_ground_speed_mps": drone.max_ground_speed_mps,
        "wind_limit_mps": drone.wind_limit_mps,
        "recharge_full_h": drone.recharge_full_s / S_PER_H,
        "energy_model": drone.energy_model.name,
    }


def _take_off(problem: Problem, course: NDArray[np.float64], number: int) -> tuple[float, float]:
    """Time and charge at the start of a flight; a drone already in the air does not climb again."""
    time, soc = float(course[number, TAKE_OFF]), float(course[number, SOC_OFF])
    if number == 0 and problem.in_flight:
        return problem.request.state.time.timestamp(), problem.request.state.soc
    return time, soc


def _service(
    problem: Problem, itinerary: Itinerary, course: NDArray[np.float64], member: int, result: Outcome, number: int
) -> DroneService:
    network = problem.network
    segments = np.array(itinerary[number].segments, dtype=np.int64)
    nodes = [int(network.tail[segments[0]]), *(int(node) for node in network.head[segments])]
    ids = [network.stations[node].id for node in nodes]
    parts = flight_parts(problem.air, member, segments, float(course[number, TAKE_OFF]))
    along, across, north, east, speed = _mean_wind(problem, member, parts)
    wind_mps, from_deg = speed_from(north, east)
    off, soc_off = _take_off(problem, course, number)
    soc_down = float(course[number, SOC_DOWN])
    return DroneService(
        id=f"leg-{number + 1}",
        origin=ids[0],
        destination=ids[-1],
        via=tuple(ids[1:-1]),
        depart=_instant(off),
        arrive=_instant(course[number, TOUCH_DOWN]),
        distance_m=float(network.distance_m[segments].sum()),
        bearing_deg=float(network.bearing_deg[segments[0]]),
        ground_speed_mps=speed,
        energy_j=(soc_off - soc_down) * problem.drone.battery_j,
        soc_depart=soc_off,
        soc_arrive=soc_down,
        wind=Wind(float(wind_mps), float(from_deg)),
        tailwind_mps=along,
        crosswind_mps=across,
        p_reserve=float(result.p_reserve[number]),
        p_hold=float(result.p_hold[number]),
        diverts=_diverts(problem, nodes, (soc_off, soc_down), (north, east)),
    )


def _mean_wind(problem: Problem, member: int, parts: NDArray[np.float64]) -> tuple[float, float, float, float, float]:
    """Means over the cruise: wind along and across the course, wind north and east, ground speed."""
    air = problem.air
    segment, slot = parts[:, 0].astype(np.int64), parts[:, 1].astype(np.int64)
    time = parts[:, 2]
    north = np.einsum("ij,ij->i", air.weight[segment], air.north[member, slot])
    east = np.einsum("ij,ij->i", air.weight[segment], air.east[member, slot])
    cos, sin = air.cos_bearing[segment], air.sin_bearing[segment]
    share = time / time.sum()
    values = (north * cos + east * sin, east * cos - north * sin, north, east, parts[:, 3])
    along, across, mean_north, mean_east, speed = (float(share @ value) for value in values)
    return along, across, mean_north, mean_east, speed


def _stop(problem: Problem, itinerary: Itinerary, course: NDArray[np.float64], number: int) -> Stop | None:
    """The stay before a flight; None before the first one where the drone leaves at once."""
    node = int(problem.network.tail[itinerary[number].segments[0]])
    arrive = problem.depart_s if number == 0 else float(course[number - 1, TOUCH_DOWN])
    soc_from = problem.soc if number == 0 else float(course[number - 1, SOC_DOWN])
    leave, soc_to = float(course[number, TAKE_OFF]), float(course[number, SOC_OFF])
    pad = float(course[number, PAD])
    if number == 0 and (problem.in_flight or leave <= arrive + 5e-4):
        return None
    charges = soc_to > soc_from + 1e-12
    charged = min(pad + problem.charge_time_s(node, soc_from, soc_to), leave) if charges else pad
    marks = [round(1000.0 * time) for time in (arrive, pad, max(charged, pad), leave)]
    _, p_free = problem.waits.at(node, arrive)
    return Stop(
        station=problem.network.stations[node].id,
        arrive=from_posix(marks[0] / 1000.0),
        wait_s=(marks[1] - marks[0]) / 1000.0,
        recharge_s=(marks[2] - marks[1]) / 1000.0,
        hold_s=max(marks[3] - marks[2], 0) / 1000.0,
        soc_from=soc_from,
        soc_to=soc_to,
        p_pad_free=min(max(p_free, 0.0), 1.0),
    )


def _diverts(
    problem: Problem, nodes: list[int], soc: tuple[float, float], wind: tuple[float, float]
) -> tuple[str, ...]:
    """Stations with pads, off the route, that stay in reach above the reserve from the point of the route nearest to them."""
    network = problem.network
    lat, lon = network.lat, network.lon
    begin, end = nodes[0], nodes[-1]
    best: dict[int, float] = {}
    with_pads = network.pads > 0
    with_pads[nodes] = False
    for part in (0.25, 0.5, 0.75):
        length = geodesy.distance_m(lat[begin], lon[begin], lat[end], lon[end])
        bearing = geodesy.bearing_deg(lat[begin], lon[begin], lat[end], lon[end])
        here = geodesy.direct(lat[begin], lon[begin], bearing, part * length)
        spare = soc[0] + part * (soc[1] - soc[0]) - problem.reserve
        within_m = (spare / problem.soc_per_s - problem.rules.descent_s) * problem.air.max_ground_speed_mps
        candidates = np.flatnonzero(with_pads & (geodesy.coarse_distance_m(*here, lat, lon) <= 1.01 * within_m))
        if not len(candidates):
            continue
        distance, course = geodesy.inverse(*here, lat[candidates], lon[candidates])
        angle = np.radians(course)
        tail = wind[0] * np.cos(angle) + wind[1] * np.sin(angle)
        speed = np.clip(problem.air.airspeed_mps + np.minimum(tail, 0.0), 1.0, problem.air.max_ground_speed_mps)
        cost = problem.soc_per_s * (distance / speed + problem.rules.descent_s)
        for k in np.flatnonzero(cost <= spare):
            node = int(candidates[k])
            best[node] = min(best.get(node, math.inf), float(distance[k]))
    nearest = sorted(best, key=best.__getitem__)[:DIVERTS]
    return tuple(network.stations[node].id for node in nearest)
