"""The stations of a cut mission: its pads, its start and its end; and their region."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.flight.rules import FlightRules
from skyway.models.network.station import Station

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.scenario.scenario import Scenario
    from skyway.recharge.cutting import Recharged

SAME_M = 10.0
"""A start or an end this close to a pad is at that pad."""


@dataclass(frozen=True, eq=False, slots=True)
class WorkPlaces:
    """Stations by their names in the work."""

    pads: tuple[Station, ...]
    start: Station
    end: Station
    """The same as `start`, or a pad, if it is there."""

    def of(self, pad: int | None, *, end: bool) -> str:
        """Return the id of the station of a pad, otherwise of the end or the start."""
        return self.pads[pad].id if pad is not None else self.end.id if end else self.start.id

    def pad_of(self, station: str | None) -> int | None:
        """Return the pad at a station; None if it has none."""
        return next((number for number, pad in enumerate(self.pads) if pad.id == station), None)

    @property
    def more(self) -> tuple[Station, ...]:
        """Stations without pads."""
        known = {pad.id for pad in self.pads}
        return tuple({one.id: one for one in (self.start, self.end) if one.id not in known}.values())


def places_of(found: Recharged) -> WorkPlaces:
    """Return the stations of a cut mission."""
    work, pads = found.problem.work, found.problem.ways.pads
    home = work.mission.home
    home_m = None if home is None else home.altitude_m
    start = _station("home", work.places[0], home_m, pads)
    ends_m = None if home_m is None else home_m + (work.heights_m[-1] if work.points[-1].on_ground else 0.0)
    end = _station("end", work.places[-1], ends_m, (*pads, start))
    return WorkPlaces(pads, start, end)


def starts_of(drones: Sequence[Recharged]) -> tuple[Station, ...]:
    """Return the start of each of several drones that share a mission, each at a different station, regardless of their distance."""
    starts = []
    for number, found in enumerate(drones, start=1):
        home = found.problem.work.mission.home
        place = found.problem.work.places[0]
        starts.append(
            Station(f"start-{number}", f"start-{number}", *place, None if home is None else home.altitude_m, 0, 0)
        )
    return tuple(starts)


def _station(name: str, place: tuple[float, float], ground_m: float | None, known: Sequence[Station]) -> Station:
    """Return the station at a place, a known one if it is there."""
    away, _ = geodesy.inverse(*place, [one.lat for one in known], [one.lon for one in known])
    nearest = int(np.argmin(away))
    if float(away[nearest]) <= SAME_M:
        return known[nearest]
    taken = {one.id for one in known}
    while name in taken:
        name += "-of-mission"
    return Station(name, name, *place, ground_m, 0, 0)


def region_with(found: Recharged, places: WorkPlaces, region: Scenario | None) -> Scenario:
    """Return the region of a cut mission: all its stations, its drone, and its usual height as cruise height."""
    from skyway.building import build_scenario
    from skyway.models.network.sources import network_of

    conditions, work = found.problem.options.conditions, found.problem.work
    usual_m = float(np.median([step.height_m for step in work.steps if step.height_m > 0.0] or [60.0]))
    rules = FlightRules() if region is None else region.rules
    rules = replace(
        rules,
        cruise_height_m=max(usual_m, 5.0),
        climb_rate_mps=conditions.climb_rate_mps,
        descent_rate_mps=conditions.descent_rate_mps,
    )
    if region is None:
        stations = (*places.pads, *places.more)
        return build_scenario(stations, segments=(), drones=(conditions.drone,), rules=rules, name="work")
    network = region.network
    more = places.more
    joined = network_of((*network.stations, *more), segments=())
    return replace(
        region, network=joined, drones=(conditions.drone,), rules=rules, load=region.load.extended(len(more))
    )
