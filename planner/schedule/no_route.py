"""Reasons for no route: the violated constraint, with figures."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.airspace.ways import columns
from skyway.models.base.errors import NoRouteError
from skyway.models.base.formatting import distance_text, duration, height_text, percent, probability, speed_text
from skyway.models.base.geodesy import coarse_distance_m
from skyway.models.base.units import S_PER_H
from skyway.models.flight.closures import closing_zones
from skyway.models.flight.kernels import NEVER, next_opening, slot_of
from skyway.planner.problem.flight_table import ground_speeds
from skyway.planner.problem.ways_on import flight_range_m, landings
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.lookahead.lookahead import Lookahead
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary

SELDOM = 0.2
"""Where the wind allows flights in a smaller share of the forecast, the wind is why there is no route."""
SAMPLED = 200
"""Segments in which that share is counted, about."""
LONG_WAIT_S = 6 * 3600.0
"""Where the shortest wait for a pad is longer, the load is why there is no route."""


def _reached(problem: Problem, usable: NDArray[np.bool_], start: int | None = None) -> NDArray[np.bool_]:
    """Return which nodes usable segments join to a node, by default the origin, shape (nodes,)."""
    tail, head = problem.network.tail[usable], problem.network.head[usable]
    found = np.zeros(len(problem.network), dtype=np.bool_)
    found[problem.origin if start is None else start] = True
    while True:
        new = head[found[tail] & ~found[head]]
        if not len(new):
            return found
        found[new] = True


def joined(problem: Problem) -> bool:
    """Return whether any chain of segments leads from the origin to the destination."""
    return bool(_joined_nodes(problem)[problem.destination])


def _joined_nodes(problem: Problem) -> NDArray[np.bool_]:
    return _reached(problem, np.ones(len(problem.network.tail), dtype=np.bool_))


def _held_in_zone(problem: Problem) -> str | None:
    """Report that the start or the destination lies in a zone that is always closed; None if neither does."""
    network = problem.network
    zones = network.zones
    if zones is None:
        return None
    for node in (problem.destination, problem.origin):
        here = [node]
        climb = columns(network.lat[here], network.lon[here], network.ground_m[here], problem.rules.cruise_height_m)
        for number in zones.hits(climb)[1].tolist():
            zone, volume = zones.zones[zones.volumes[number][0]], zones.volumes[number][1]
            if zones.always_closed[number]:
                return (
                    f"{network.stations[node].id} lies in the zone {zone.label} of {zone.source}, {zone.kind} from {volume} at all times, or nearer"
                    " to it than the margin; choose another place"
                )
    return None


def _parted(problem: Problem, start: str, goal: str) -> str:
    """Report the parts of the network of origin and destination, and where the parts are nearest to each other."""
    network = problem.network
    here = _joined_nodes(problem)
    part = next(part for part in network.parts() if goal in part)
    there = np.array([station.id in part for station in network.stations]) & ~here
    landed = np.array([not station.flyover for station in network.stations])
    near, far = np.flatnonzero(here & landed), np.flatnonzero(there & landed)
    lat, lon = (np.array([getattr(station, name) for station in network.stations]) for name in ("lat", "lon"))
    gaps = np.array([coarse_distance_m(float(lat[node]), float(lon[node]), lat[far], lon[far]) for node in near])
    a, b = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    ground = "" if network.over is None or not network.over.notes else f"; {'; '.join(network.over.notes)}"
    return (
        f"no route from {start} to {goal}: no chain of segments joins them (the network is in parts; {len(near)} stations can be "
        f"reached from {start}, {len(far)} are beyond); the gap is least from {network.stations[int(near[a])].id} to "
        f"{network.stations[int(far[b])].id}, {distance_text(gaps[a, b])}{ground}"
    )


def grounded_leg(schedules: NDArray[np.float64]) -> int:
    """Number of the leg at which most runs end, of schedules of shape (runs, legs, 6) of which none arrives."""
    first = np.argmin(np.isfinite(schedules[:, :, TOUCH_DOWN]), axis=1)
    return int(np.argmax(np.bincount(first)))


def emptied_leg(schedule: NDArray[np.float64]) -> int | None:
    """Number of the first leg in a schedule of shape (legs, 6) that ends with an empty battery; None if there is none."""
    empty = schedule[:, SOC_LANDING] < 0.0
    return int(np.argmax(empty)) if empty.any() else None


def _closed(problem: Problem, segments: NDArray[np.int64]) -> str | None:
    """Report the zones, or the greatest height, that close one of some segments throughout the forecast; None if there are none."""
    air, network = problem.air, problem.network
    for segment in segments.tolist():
        if not air.shut[:, air.shut_of[segment]].all():
            continue
        zones = closing_zones(network).get(segment, ())
        if not zones or network.zones is None:
            most = height_text(problem.drone.max_height_m)
            return f"it would be flown higher above the ground than {problem.drone.id} may be ({most})"
        found = [network.zones.zones[zone] for zone in zones]
        named = ", ".join(f"{zone.label} ({zone.kind}, active {zone.activation})" for zone in found)
        given = " ".join(f"--authorized {zone.id}" for zone in found)
        advice = f"; with the authorization: {given}" if all(zone.kind == "authorization" for zone in found) else ""
        return f"it is closed throughout the forecast by {named}{advice}"
    return None


def _leaving(problem: Problem) -> NDArray[np.int64]:
    """Segments that leave the origin."""
    first = problem.network.first
    return np.arange(first[problem.origin], first[problem.origin + 1])


def _now(problem: Problem) -> NDArray[np.int64]:
    return np.array([slot_of(problem.air, problem.depart_s)])


def _flyable_share(problem: Problem, slots: NDArray[np.int64], segments: NDArray[np.int64]) -> float:
    """Share of the hours and segments in which the wind of the forecast allows a flight."""
    air = problem.air._replace(shut=np.zeros_like(problem.air.shut))
    speeds = (ground_speeds(air, member, slots, segments) for member in range(len(problem.probability)))
    shares = [float(np.mean(speed > 0.0)) for speed in speeds]
    return float(np.dot(problem.probability, shares) / problem.probability.sum())


def _too_strong(problem: Problem, segments: NDArray[np.int64], slots: NDArray[np.int64] | None = None) -> str:
    """Describe a wind in which no flight over some segments is possible, in some slots or throughout the forecast."""
    drone, air = problem.drone, problem.air
    north, east = (wind if slots is None else wind[:, slots] for wind in (air.north, air.east))
    least = float(np.hypot(north @ air.weight[segments].T, east @ air.weight[segments].T).min())
    limit = f"the limit of {drone.id} ({drone.wind_limit_mps:g} m/s)"
    if least > drone.wind_limit_mps:
        return f"{speed_text(least)} or more, above {limit}"
    return f"above {limit} or too strong for an airspeed of {problem.air.airspeed_mps:g} m/s"


class WindBetween:
    """Ways that the wind closes throughout the forecast of a problem, whatever the zones.

    Parameters
    ----------
    problem : Problem
        Drone and wind; its origin and destination are not used.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        air, network = problem.air._replace(shut=np.zeros_like(problem.air.shut)), problem.network
        slots, every = np.arange(air.north.shape[1]), np.arange(len(network.tail))
        speeds = (ground_speeds(air, member, slots, every) for member in range(len(problem.probability)))
        self._open = np.any([(speed > 0.0).any(axis=0) for speed in speeds], axis=0)
        self._reached = lru_cache(maxsize=None)(lambda start: _reached(problem, self._open, start))

    def closing(self, start: int, goal: int) -> str | None:
        """Report the wind that closes every way between two nodes; None if some way is open at some hour, or none exists."""
        problem, network, reached = self._problem, self._problem.network, self._reached(start)
        closed = np.flatnonzero(reached[network.tail] & ~reached[network.head])
        if reached[goal] or not len(closed) or not _reached(problem, np.ones_like(self._open), start)[goal]:
            return None
        a, b = network.stations[start].id, network.stations[goal].id
        return f"throughout the forecast the wind on every way from {a} to {b} is {_too_strong(problem, closed)}"


def never_leaves(
    problem: Problem, itinerary: Itinerary, leg: int, required_soc: float = 0.0, way_on_soc: float = 0.0
) -> NoRouteError:
    """Explain a route that cannot be flown in any wind of the forecast: it never begins the leg (see `grounded_leg`).

    The drone requires at least `required_soc` at its take-off: the energy binds if that is not available. Of it
    `way_on_soc` is for the way on from a target without pads.
    """
    network, drone = problem.network, problem.drone
    segments = np.array(itinerary[leg].segments, dtype=np.int64)
    a, b = (network.stations[int(node)].id for node in (network.tail[segments[0]], network.head[segments[-1]]))
    begin = f"no route from {network.stations[problem.origin].id} to {network.stations[problem.destination].id}:"
    where = f"leg {a} > {b} ({distance_text(network.distance_m[segments].sum())})"
    members = range(len(problem.probability))
    most = problem.soc if leg == 0 and not problem.has_pads(problem.origin) else 1.0
    if required_soc > most:
        message = (
            f"{begin} {where} takes {percent(required_soc - problem.reserve - way_on_soc)} of the battery of {drone.id} in the best "
            f"forecast wind, with gusts and the error of the energy model; {_way_on_words(problem, b, way_on_soc)}"
            f"{percent(most - problem.reserve)} are available above the reserve of {percent(problem.reserve)}"
            f"{'' if most == 1.0 else f', and {a} has no pad'}: {percent(required_soc - most)} missing"
        )
        return NoRouteError(message, constraint="energy")
    closed = _closed(problem, segments)
    if closed is not None:
        return NoRouteError(f"{begin} {where} cannot be flown: {closed}", constraint="airspace")
    if all(next_opening(problem.air, member, segments, problem.depart_s) == NEVER for member in members):
        message = f"{begin} throughout the forecast the wind on {where} is {_too_strong(problem, segments)}"
        return NoRouteError(message, constraint="wind")
    if problem.in_flight and leg == 0:
        strong = _too_strong(problem, segments, _now(problem))
        message = (
            f"{begin} in the whole forecast the wind on {where} is now {strong}, and a drone in the air cannot hold"
        )
        return NoRouteError(message, constraint="wind")
    message = (
        f"{begin} {where} cannot start within the forecast: when the wind allows it and the charge suffices, {b} is "
        f"likely to have neither a free pad nor a holding spot"
    )
    return NoRouteError(message, constraint="room")


def _way_on_words(problem: Problem, target: str, soc: float) -> str:
    if soc <= 0.0:
        return ""
    if not problem.ways_on:
        return f"and from {target}, {problem.why_on}, {nothing_in_reach(problem)}; "
    with_it = "" if not problem.keeps_for_package else " with the package still on board"
    return (
        f"the flight on from {target}, {problem.why_on},{with_it} takes {percent(soc)} more in an unfavourable wind; "
    )


def runs_empty(problem: Problem, itinerary: Itinerary, leg: int, advice: str = "") -> NoRouteError:
    """Refuse a route on which a leg typically ends with an empty battery in the air."""
    network, segments = problem.network, itinerary[leg].segments
    a, b = (network.stations[int(node)].id for node in (network.tail[segments[0]], network.head[segments[-1]]))
    message = (
        f"no route from {network.stations[problem.origin].id} to {network.stations[problem.destination].id}: on leg {a} > {b} "
        f"{problem.drone.id} typically runs out of charge, hovering until there is a pad or a holding spot at {b} or in more "
        f"wind than the planner expected{advice}"
    )
    return NoRouteError(message, constraint="energy")


def no_way_on(problem: Problem, segment: int, there_soc: float, on_soc: float, budget_soc: float) -> NoRouteError:
    """Refuse a target without pads: with the charge for a flight over a segment there, and the way on, no battery is sufficient.

    The message gives the deficit; both are charges that a full battery must have above the reserve.
    """
    network = problem.network
    start, goal = (network.stations[node].id for node in (problem.origin, problem.destination))
    a = network.stations[int(network.tail[segment])].id
    begin = f"no route from {start} to {goal}, {problem.why_on}:"
    with_it = "" if not problem.keeps_for_package else ", with the package still on board,"
    if not problem.ways_on:
        return NoRouteError(f"{begin} {nothing_in_reach(problem)}", constraint="energy")
    if not math.isfinite(there_soc + on_soc):
        strong = _too_strong(problem, np.array([segment], dtype=np.int64))
        message = f"{begin} throughout the forecast the wind on the flight there or on the flight on is {strong}"
        return NoRouteError(message, constraint="wind")
    message = (
        f"{begin} the flight from {a} takes {percent(there_soc)} of the battery of {problem.drone.id} and the flight on to the next pad"
        f"{with_it} {percent(on_soc)} in the worst forecast wind; {percent(budget_soc)} are available above the reserve of "
        f"{percent(problem.reserve)}: {percent(there_soc + on_soc - budget_soc)} missing"
    )
    return NoRouteError(message, constraint="energy")


def nothing_in_reach(problem: Problem) -> str:
    """Report the distance from a target without pads to the next station, and the drone's range."""
    network, here = problem.network, problem.destination
    reach_m = flight_range_m(problem)
    able = landings(problem)
    name = network.stations[here].id
    if not able.any():
        return f"no station with pads leads on from {name} to where the drone is to be in the end"
    rows = np.flatnonzero(able)
    away_m = coarse_distance_m(float(network.lat[here]), float(network.lon[here]), network.lat[rows], network.lon[rows])
    nearest = int(np.argmin(away_m))
    station = network.stations[int(rows[nearest])].id
    if away_m[nearest] <= reach_m:
        return f"no segments lead on from it; the nearest station with pads is {station}, {distance_text(float(away_m[nearest]))} away"
    return (
        f"the nearest station with pads is {station}, {distance_text(float(away_m[nearest]))} away, and a full battery of "
        f"{problem.drone.id} flies {distance_text(reach_m)} above the reserve: {distance_text(float(away_m[nearest]) - reach_m)} too far"
    )


def no_room(problem: Problem) -> NoRouteError:
    """Refuse a destination at which no landing is possible for any arrival within the forecast."""
    start, goal = (problem.network.stations[node].id for node in (problem.origin, problem.destination))
    busy = problem.request.state.busy_pads.get(goal)
    there = "" if busy is None else f" behind the {busy} drones that are there now"
    message = (
        f"no route from {start} to {goal}: there is neither a pad nor a holding spot free at {goal} within the forecast{there}; "
        "choose another destination or a later departure"
    )
    return NoRouteError(message, constraint="room")


def _not_in_turn(problem: Problem, begin: str, usable: NDArray[np.bool_]) -> NoRouteError:
    """Explain why flights that are all possible at some hour make no route: wind, full stations, or both and the charge.

    `usable` are the segments that a full battery is enough for in some wind of the forecast, shape (segments,).
    """
    network, drone = problem.network, problem.drone
    start, leaving, now = network.stations[problem.origin].id, _leaving(problem), _now(problem)
    if _flyable_share(problem, now, leaving) == 0.0:
        message = (
            f"{begin} the wind on every segment from {start} is now {_too_strong(problem, leaving, now)}, "
            "and no sequence of flights in the later hours leads there"
        )
        return NoRouteError(message, constraint="wind")
    some = np.flatnonzero(usable)[:: max(np.count_nonzero(usable) // SAMPLED, 1)]
    share = _flyable_share(problem, np.arange(problem.air.north.shape[1]), some)
    if share < SELDOM:
        message = (
            f"{begin} only in {probability(share)} of the forecast hours is the wind within the limit of {drone.id} "
            f"({drone.wind_limit_mps:g} m/s) and weak enough for an airspeed of {problem.air.airspeed_mps:g} m/s: too few for the "
            "flights and charges of a route"
        )
        return NoRouteError(message, constraint="wind")
    near = [int(node) for node in np.unique(network.head[leaving]) if problem.has_pads(int(node))]
    waits = {node: problem.waits.at(node, problem.depart_s)[0] for node in near}
    if waits and problem.destination not in network.head[leaving] and min(waits.values()) > LONG_WAIT_S:
        shortest = min(waits, key=lambda node: waits[node])
        message = (
            f"{begin} the stations are full: of those one flight from {start} {network.stations[shortest].id} has the shortest "
            f"expected wait for a pad, {round(waits[shortest] / S_PER_H)} h; check the load of the scenario, or choose a later departure"
        )
        return NoRouteError(message, constraint="room")
    message = (
        f"{begin} each segment can be flown on a full battery at some hour, but not one after the other as wind, zones, queues "
        f"and charge ({percent(problem.soc)} now) develop"
    )
    return NoRouteError(message, constraint="energy")


def no_route(problem: Problem, lookahead: Lookahead, *, room: bool = True) -> NoRouteError:
    """Explain a failed search: disconnected, energy on the decisive segment, wind, or no room at the destination.

    The decisive segment is the one with the lowest requirement among those that lead out of the reachable part. Whether there is
    `room` within the forecast is determined by the caller, from the queues.
    """
    network = problem.network
    start = network.stations[problem.origin].id
    goal = network.stations[problem.destination].id
    if not joined(problem):
        held = _held_in_zone(problem)
        if held is not None:
            return NoRouteError(f"no route from {start} to {goal}: {held}", constraint="airspace")
        return NoRouteError(_parted(problem, start, goal), constraint="disconnected")
    charge = np.array([lookahead.flight(segment, problem.depart_s)[1] for segment in range(len(network.tail))])
    reached = _reached(problem, charge <= lookahead.budget)
    if reached[problem.destination] and not room:
        return no_room(problem)
    if reached[problem.destination]:
        return _not_in_turn(
            problem, f"no route from {start} to {goal} within the forecast:", charge <= lookahead.budget
        )
    out = np.flatnonzero(reached[network.tail] & ~reached[network.head]).tolist()
    least = min(out, key=lambda i: (charge[i], network.distance_m[i]))
    a, b = network.stations[int(network.tail[least])].id, network.stations[int(network.head[least])].id
    where = f"segment {a} > {b} ({distance_text(network.distance_m[least])})"
    closed = _closed(problem, np.array([least], dtype=np.int64))
    if closed is not None:
        message = f"no route from {start} to {goal}: {where} cannot be flown: {closed}"
        return NoRouteError(message, constraint="airspace")
    if not math.isfinite(charge[least]):
        strong = _too_strong(problem, np.array([least], dtype=np.int64))
        message = f"no route from {start} to {goal}: throughout the forecast the wind on {where} is {strong}"
        return NoRouteError(message, constraint="wind")
    if int(network.head[least]) == problem.destination and problem.needs_escape:
        there = lookahead.without_way_on(least, problem.depart_s)
        return no_way_on(problem, least, there, charge[least] - there, lookahead.budget)
    message = (
        f"no route from {start} to {goal}: {where} takes {percent(charge[least])} of the battery of "
        f"{problem.drone.id} in the worst forecast wind, {percent(lookahead.budget)} are there above the reserve "
        f"of {percent(problem.reserve)} (longest flight {duration(problem.longest_flight_s)})"
    )
    return NoRouteError(message, constraint="energy")
