"""Notes of a plan on waits for a time: for a station to open, or for the earliest delivery."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.models.base.formatting import clock, duration
from skyway.models.base.units import from_posix

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.models.composition.service import DroneService, Stop
    from skyway.planner.problem.problem import Problem

SHOWN_S = 30.0
"""A shorter wait is not reported."""


def opening_notes(problem: Problem, services: Sequence[DroneService], stops: Sequence[Stop]) -> Iterator[str]:
    """Yield a note for each wait for a station to open: at the station itself, or before a flight to one without holding spots."""
    index, stations = problem.network.index, problem.network.stations
    depart, zone = problem.request.state.time, ZoneInfo(problem.load.timezone)
    earliest = problem.request.not_before
    if earliest is not None:
        waits = [(stop.station, stop.hold_s) for stop in stops if stop.hold_s > SHOWN_S]
        at = ", ".join(f"{duration(held_s)} at {station}" for station, held_s in waits)
        told = f"the package does not arrive before {clock(earliest, zone, depart)}"
        yield told + (f": the drone holds {at}" if at else "")
    for stop in stops:
        here = index[stop.station]
        leg = next((one for one in services if one.origin == stop.station and one.depart >= stop.arrive), None)
        ends_s = stop.arrive.timestamp() + stop.wait_s + stop.recharge_s
        for begin_s, end_s in _closed(problem, here):
            if stop.recharge_s > 0.0 and min(end_s, ends_s) - max(begin_s, stop.arrive.timestamp()) > SHOWN_S:
                opens = clock(from_posix(end_s), zone, depart)
                yield f"waits for {stop.station} to open at {opens} (open {stations[here].open_hours})"
        if leg is None or stop.hold_room_s <= SHOWN_S:
            continue
        there = index[leg.destination]
        for begin_s, end_s in _closed(problem, there):
            if (
                not stations[there].holding_spots
                and stations[there].pads
                and begin_s <= leg.arrive.timestamp() - stop.hold_room_s < end_s
            ):
                opens = clock(from_posix(end_s), zone, depart)
                hours = stations[there].open_hours
                yield f"waits at {stop.station} for {leg.destination} to open at {opens} (open {hours}; nobody can wait there)"


def _closed(problem: Problem, node: int) -> list[tuple[float, float]]:
    closures = problem.closures.get(node)
    return [] if closures is None else [(begin, end) for begin, end in closures.closed_s.tolist()]
