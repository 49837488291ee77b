"""Compositions from schedules: legs with their forecast wind, stops with their waits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.parameters import changed
from skyway.models.base.units import J_PER_WH, from_posix
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution, DeliveryCosts, EnergyDistribution
from skyway.models.composition.heights import LegHeights, TerrainUse
from skyway.models.composition.service import DroneService, LegSegment, Place, Stop
from skyway.models.flight.rules import segment_factors
from skyway.models.flight.way_heights import way_heights
from skyway.models.wind.summary import Passage, Wind, WindSummary, summarise_wind
from skyway.models.wind.triangle import speed_from
from skyway.planner.reach.diverts import divert_cover
from skyway.planner.reach.reach import Reach
from skyway.planner.schedule.airspace_notes import airspace_notes
from skyway.planner.schedule.opening_notes import opening_notes
from skyway.planner.schedule.schedule_kernels import (
    PAD,
    ROOM,
    SOC_LANDING,
    SOC_TAKE_OFF,
    TAKE_OFF,
    TOUCH_DOWN,
    flight_parts,
)

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome


def compose(
    problem: Problem,
    itinerary: Itinerary,
    schedule: NDArray[np.float64],
    member: int,
    result: Outcome,
    *,
    planner: str,
    planning_time_s: float,
    notes: tuple[str, ...] = (),
) -> Composition:
    """Return an itinerary as a composition whose typical schedule is `schedule`, flown in one member."""
    network, request, drone = problem.network, problem.request, problem.drone
    reach = Reach(
        problem.scenario, problem.forecast.thinned(problem.parameters.schedule.divert_members), drone, request.payload_kg, drone.energy_belief.next_flight(),
        parameters=problem.parameters.online, watched=True,
    )  # fmt: skip
    services = [_service(problem, reach, itinerary, schedule, member, result, n) for n in range(len(itinerary))]
    stops = [_stop(problem, itinerary, schedule, number) for number in range(len(itinerary))]
    named = {problem.origin, problem.destination}
    for leg in itinerary:
        for segment in leg.segments:
            named |= {int(network.tail[segment]), int(network.head[segment])}
    named |= {network.index[key] for service in services for key in service.diverts}
    stations = {network.stations[node].id: Place.of(network.stations[node]) for node in sorted(named)}
    return Composition(
        id=f"{planner}-{network.stations[problem.origin].id}-{network.stations[problem.destination].id}",
        planner=planner,
        drone=drone.id,
        drone_parameters={
            "name": drone.name,
            "provider": drone.provider,
            **drone.figures,
            "energy_model": drone.energy_model.name,
        },
        payload_kg=request.payload_kg,
        airspeed_mps=problem.air.airspeed_mps,
        max_ground_speed_mps=drone.max_ground_speed_mps,
        cruise_height_m=problem.rules.cruise_height_m,
        climb_rate_mps=problem.rules.climb_rate_mps,
        descent_rate_mps=problem.rules.descent_rate_mps,
        reserve_soc=request.reserve_soc,
        parameters=changed(problem.parameters, "planner"),
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
        success=None if result.crossed is None else result.success,
        notes=(
            *notes,
            *(() if network.over is None else network.over.notes),
            *airspace_notes(problem, services, [stop for stop in stops if stop is not None]),
            *opening_notes(problem, services, [stop for stop in stops if stop is not None]),
        ),
        terrain=None if network.over is None else TerrainUse.of(network.over.terrain, network.over.clearance),
        authorized=() if network.zones is None else tuple(sorted(network.zones.authorized)),
        zones=() if network.zones is None else network.zones.handed,
        not_before=request.not_before,
        energy=_energy(result),
        costs=_costs(problem, result),
    )


def _energy(result: Outcome) -> EnergyDistribution | None:
    if result.spending is None or not len(result.weight):
        return None
    mean, late = result.spread(result.spending.energy_j / J_PER_WH)
    return EnergyDistribution(mean, late)


def _costs(problem: Problem, result: Outcome) -> DeliveryCosts | None:
    spent, tariff = result.spending, problem.tariff
    if spent is None or tariff is None or not len(result.weight):
        return None
    parts = (result.average(part) for part in (spent.energy, spent.fees, spent.refill, spent.wear))
    return DeliveryCosts(tariff.currency, *result.spread(spent.cost), *parts)


def _distribution(result: Outcome) -> ArrivalDistribution:
    if not len(result.weight):
        return ArrivalDistribution(None, None, None)
    figures = result.delivery, result.delivery_quantile(0.5), result.delivery_quantile(0.95)
    mean, middle, late = (_instant(result.start_s + figure.value) for figure in figures)
    if result.crossed is None:
        return ArrivalDistribution(mean, middle, late)
    return ArrivalDistribution(mean, middle, late, *figures, runs=len(result.weight), p_arrive=result.p_arrive)


def _instant(posix_s: float) -> datetime:
    return from_posix(round(posix_s * 1000.0) / 1000.0)


def _take_off(problem: Problem, schedule: NDArray[np.float64], number: int) -> tuple[float, float]:
    """Time and charge at the start of a flight; a drone already in the air does not climb again."""
    time, soc = float(schedule[number, TAKE_OFF]), float(schedule[number, SOC_TAKE_OFF])
    if number == 0 and problem.in_flight:
        return problem.request.state.time.timestamp(), problem.request.state.soc
    return time, soc


def _service(
    problem: Problem, reach: Reach, itinerary: Itinerary, schedule: NDArray[np.float64], member: int, result: Outcome,
    number: int,
) -> DroneService:  # fmt: skip
    network = problem.network
    segments = np.array(itinerary[number].segments, dtype=np.int64)
    nodes = [int(network.tail[segments[0]]), *(int(node) for node in network.head[segments])]
    ids = [network.stations[node].id for node in nodes]
    parts = flight_parts(problem.air, member, segments, float(schedule[number, TAKE_OFF]))
    winds = _winds(problem, segments, parts, float(schedule[number, TAKE_OFF]))
    each = [_segment(problem, segment, wind) for segment, wind in zip(segments.tolist(), winds[1:], strict=True)]
    flown = np.array([parts[parts[:, 0] == segment, 2].sum() for segment in segments])
    share = flown / flown.sum()
    off, soc_off = _take_off(problem, schedule, number)
    soc_down = float(schedule[number, SOC_LANDING])
    return DroneService(
        id=f"leg-{number + 1}",
        origin=ids[0],
        destination=ids[-1],
        via=tuple(ids[1:-1]),
        depart=_instant(off),
        arrive=_instant(schedule[number, TOUCH_DOWN]),
        distance_m=float(network.distance_m[segments].sum()),
        bearing_deg=float(network.bearing_deg[segments[0]]),
        ground_speed_mps=float(parts[:, 2] @ parts[:, 3] / parts[:, 2].sum()),
        energy_j=(soc_off - soc_down) * problem.drone.battery_j,
        soc_depart=soc_off,
        soc_arrive=soc_down,
        wind=winds[0].wind,
        tailwind_mps=float(share @ [one.tailwind_mps for one in each]),
        crosswind_mps=float(share @ [one.crosswind_mps for one in each]),
        p_reserve=float(result.p_reserve[number]),
        p_hold=float(result.p_hold[number]),
        p_hold_room=float(result.p_hold_room[number]),
        segments=tuple(each),
        course_wind=_course_wind(problem, member, parts),
        diverts=_diverts(problem, reach, nodes, (off, soc_off)),
        heights=_heights(problem, nodes),
    )


def _heights(problem: Problem, nodes: list[int]) -> LegHeights | None:
    """Heights of a leg over the terrain model."""
    network = problem.network
    if network.over is None:
        return None
    places = [(float(network.lat[node]), float(network.lon[node])) for node in nodes]
    least = [(network.stations[node].least_m, network.stations[node].least_agl_m) for node in nodes]
    found = way_heights(places, network.ground_m[nodes].tolist(), network.over.cruise_height_m, network.over, least)
    return LegHeights.of(found, network.over.terrain)


def _winds(
    problem: Problem, segments: NDArray[np.int64], parts: NDArray[np.float64], off_s: float
) -> list[WindSummary]:
    """Forecast winds on a leg as a whole, and on each of its segments, at the time and height of flight."""
    network, height, exponent = problem.network, problem.rules.cruise_height_m, problem.rules.wind_profile_exponent
    tail = network.tail[segments]
    lat, lon = geodesy.midpoint(
        network.lat[tail], network.lon[tail], network.bearing_deg[segments], network.distance_m[segments]
    )
    factors = segment_factors(network, problem.rules, segments)
    passages = []
    now = off_s + problem.air.climb_s
    for number, segment in enumerate(segments):
        until = now + float(parts[parts[:, 0] == segment, 2].sum())
        passages.append(Passage(float(lat[number]), float(lon[number]), now, until, float(factors[number])))
        now = until
    ways = [passages, *([one] for one in passages)] if len(passages) > 1 else [passages, passages]
    return [summarise_wind(problem.forecast, way, height, exponent) for way in ways]


def _course_wind(problem: Problem, member: int, parts: NDArray[np.float64]) -> Wind:
    """Mean vector over the cruise of the wind in one member."""
    air = problem.air
    segment, slot, share = parts[:, 0].astype(np.int64), parts[:, 1].astype(np.int64), parts[:, 2] / parts[:, 2].sum()
    north, east = (
        float(share @ np.einsum("ij,ij->i", air.weight[segment], part[member, slot])) for part in (air.north, air.east)
    )
    speed, direction = speed_from(north, east)
    return Wind(float(speed), float(direction))


def _segment(problem: Problem, segment: int, wind: WindSummary) -> LegSegment:
    network = problem.network
    bearing = float(network.bearing_deg[segment])
    along, across = wind.components(bearing)
    head = network.stations[int(network.head[segment])].id
    return LegSegment(head, float(network.distance_m[segment]), bearing, wind.wind, along, across)


def _stop(problem: Problem, itinerary: Itinerary, schedule: NDArray[np.float64], number: int) -> Stop | None:
    """The stay before a flight; None before the first one if the drone leaves at once."""
    node = int(problem.network.tail[itinerary[number].segments[0]])
    arrive = problem.depart_s if number == 0 else float(schedule[number - 1, TOUCH_DOWN])
    soc_from = problem.soc if number == 0 else float(schedule[number - 1, SOC_LANDING])
    leave, soc_to = float(schedule[number, TAKE_OFF]), float(schedule[number, SOC_TAKE_OFF])
    pad = float(schedule[number, PAD])
    if number == 0 and (problem.in_flight or leave <= arrive + 5e-4):
        return None
    charges = soc_to > soc_from + 1e-12
    charged = pad + problem.charge_time_s(node, soc_from, soc_to) if charges else pad
    closures, closed_s, p_open = problem.closures.get(node), 0.0, 1.0
    if closures is not None and charges:
        charged = float(closures.past(np.array(pad), np.array(charged)))
        closed_s = float(closures.within(np.array(pad), np.array(min(charged, leave))))
        p_open = float(closures.put_off(np.array(arrive), np.array(arrive)) <= arrive)
    charged = min(charged, leave)
    marks = [round(1000.0 * time) for time in (arrive, pad, max(charged, pad), leave)]
    held_s = max(marks[3] - marks[2], 0) / 1000.0
    _, p_free = problem.waits.at(node, arrive)
    return Stop(
        station=problem.network.stations[node].id,
        arrive=from_posix(marks[0] / 1000.0),
        wait_s=(marks[1] - marks[0] + round(1000.0 * closed_s)) / 1000.0,
        recharge_s=(marks[2] - marks[1] - round(1000.0 * closed_s)) / 1000.0,
        hold_s=held_s,
        hold_room_s=min(round(float(schedule[number, ROOM]), 3), held_s),
        soc_from=soc_from,
        soc_to=soc_to,
        p_pad_free=min(max(p_free, 0.0), 1.0) * p_open,
    )


def _diverts(problem: Problem, reach: Reach, nodes: list[int], off: tuple[float, float]) -> tuple[str, ...]:
    """Divert stations of a leg that takes off at a time with a charge, as the online policy finds them."""
    online, schedule, reserve = problem.parameters.online, problem.parameters.schedule, problem.reserve
    way = [(float(problem.network.lat[node]), float(problem.network.lon[node])) for node in nodes]
    cover = divert_cover(
        reach, way, *off, floor_soc=reserve * online.divert_share,
        epsilon=problem.epsilon, destination=problem.network.stations[nodes[-1]].id, reserve_soc=reserve, most=schedule.max_diverts, every_m=schedule.divert_every_m,
    )  # fmt: skip
    return cover.stations
