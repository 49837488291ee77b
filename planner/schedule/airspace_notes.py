"""Airspace notes of a plan: its authorizations and conditions, and the zones that it waits for or avoids."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.airspace.ways import Ways, chosen, columns, flown_at, level_flights, together
from skyway.models.base.formatting import zone_clock
from skyway.models.base.units import from_posix
from skyway.models.flight.heights import cleared_grounds_m
from skyway.models.network.zoned import flown_ways, raised_ways

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.zone import Zone
    from skyway.models.composition.service import DroneService, Stop
    from skyway.models.network.network import Network
    from skyway.planner.problem.problem import Problem

WAITS = "the drone waits at {}"
"""End of the note on a leg that leaves when a zone ends."""


def leg_ways(network: Network, nodes: Sequence[int], cruise_height_m: float) -> Ways:
    """Return a leg over nodes as flown by a mission: climb, ways at the heights of `models.flight.heights`, descent."""
    segments = _segments(network, nodes)
    if network.flown is not None and segments is not None:
        pairs = np.column_stack((nodes[:-1], nodes[1:]))
        flown = type(network.flown)(*(values[segments] for values in network.flown))
        level, climbs = flown_ways(network.stations, pairs, cruise_height_m, flown)
        return together(level, chosen(climbs, np.array([nodes[0], nodes[-1]])))
    lat, lon, ground_m = (values[list(nodes)] for values in (network.lat, network.lon, network.ground_m))
    height_m = np.array(cleared_grounds_m(ground_m.tolist())) + cruise_height_m
    places = lat[:-1], lon[:-1], lat[1:], lon[1:]
    if np.isfinite(height_m).all():
        ways = flown_at(places, (height_m[:-1], height_m[1:]), (ground_m[:-1], ground_m[1:]))
    else:
        ways = level_flights(places, (ground_m[:-1], ground_m[1:]), cruise_height_m)
    pairs = np.column_stack((nodes[:-1], nodes[1:])).astype(np.int64)
    ways = raised_ways(ways, network.stations, pairs, cruise_height_m)
    ends = [0, -1]
    return together(ways, columns(lat[ends], lon[ends], ground_m[ends], cruise_height_m))


def _segments(network: Network, nodes: Sequence[int]) -> NDArray[np.int64] | None:
    """Return the segments between nodes, None if one pair is not joined."""
    found = []
    for tail, head in pairwise(nodes):
        begin, end = int(network.first[tail]), int(network.first[tail + 1])
        hit = np.flatnonzero(network.head[begin:end] == head)
        if not len(hit):
            return None
        found.append(begin + int(hit[0]))
    return np.array(found, dtype=np.int64)


def airspace_notes(problem: Problem, services: Sequence[DroneService], stops: Sequence[Stop]) -> tuple[str, ...]:
    """Return the notes for the operator, in sentences; empty if no zone concerns the delivery."""
    airspace = problem.network.zones
    if airspace is None or not airspace.zones:
        return ()
    return tuple(
        dict.fromkeys((*_told(problem, services), *_waits(problem, services, stops), *_around(problem, services)))
    )


def _nodes(problem: Problem, service: DroneService) -> list[int]:
    return [problem.network.index[name] for name in (service.origin, *service.via, service.destination)]


def _told(problem: Problem, services: Sequence[DroneService]) -> Iterator[str]:
    """Authorizations and conditions of the zones that legs enter."""
    airspace = problem.network.zones
    if airspace is None:
        return
    for service in services:
        ways = leg_ways(problem.network, _nodes(problem, service), problem.rules.cruise_height_m)
        for _, zone, _ in airspace.told(ways, service.depart.timestamp(), service.arrive.timestamp()):
            what = "the authorization for" if zone.kind == "authorization" else "the conditions of"
            said = f": {zone.message}" if zone.message else ""
            yield f"{service.origin} to {service.destination} is flown under {what} {zone.label}{said}"


def _waits(problem: Problem, services: Sequence[DroneService], stops: Sequence[Stop]) -> Iterator[str]:
    """Legs that leave when a zone ends."""
    airspace, clock = problem.network.zones, ZoneInfo(problem.scenario.timezone)
    if airspace is None:
        return
    for service in services:
        hold_s = sum(stop.hold_s for stop in stops if stop.station == service.origin and _ends(stop, service))
        if hold_s <= 0.0:
            continue
        ways = leg_ways(problem.network, _nodes(problem, service), problem.rules.cruise_height_m)
        off_s = service.depart.timestamp() - hold_s
        for _, zone, (_, end_s) in airspace.conflicts(ways, off_s, off_s + service.flight_time_s):
            ends = ends_at(zone, off_s, end_s)
            until = f" until {zone_clock(from_posix(ends), clock)}" if math.isfinite(ends) else ""
            yield f"{service.origin} to {service.destination} is closed{until} by {zone.label} ({zone.kind}): {WAITS.format(service.origin)}"


def _ends(stop: Stop, service: DroneService) -> bool:
    """Whether a stop is the one before a leg."""
    spent_s = stop.wait_s + stop.recharge_s + stop.hold_s
    return abs((service.depart - stop.arrive).total_seconds() - spent_s) < 1.0


def ends_at(zone: Zone, from_s: float, end_s: float) -> float:
    """Return the end of the activity of a zone that a flight meets, which may be after the flight."""
    spans = zone.activation.spans(from_s, from_s + 172_800.0)
    return next((last for first, last in spans if first <= end_s <= last), end_s)


def _around(problem: Problem, services: Sequence[DroneService]) -> Iterator[str]:
    """Zones on the straight way of the delivery that an authorization would open."""
    airspace, network = problem.network.zones, problem.network
    if airspace is None or not services:
        return
    ways = leg_ways(network, [problem.origin, problem.destination], problem.rules.cruise_height_m)
    begin_s, end_s = services[0].depart.timestamp(), services[-1].arrive.timestamp()
    for _, zone, _ in airspace.conflicts(ways, begin_s, end_s):
        if zone.kind == "authorization":
            yield f"the straight way needs an authorization for {zone.label}: with it, give --authorized {zone.id}"
