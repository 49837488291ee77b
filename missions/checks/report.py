"""Report of all checks of a mission: findings, and the energy of each flight."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.missions.autopilots.registry import family_of
from skyway.missions.checks.airspace import check_airspace
from skyway.missions.checks.areas import check_fence
from skyway.missions.checks.clearance import check_clearance
from skyway.missions.checks.energy import FlightConditions, LegEnergy, leg_energies
from skyway.missions.checks.holds import BATTERY_EMPTY, check_energy
from skyway.missions.checks.limits import (
    check_heights,
    check_home_distance,
    check_rally_distances,
    check_reach,
    check_speeds,
)
from skyway.missions.checks.route import fly
from skyway.missions.checks.structure import check_structure
from skyway.missions.checks.terrain import check_terrain
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.finding import Finding
from skyway.missions.items.mission import Mission
from skyway.models.base.json_text import HIDDEN
from skyway.models.drones.drone import M200_V2

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.route import Route
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.composition.heights import LegHeights
    from skyway.models.drones.drone import Drone
    from skyway.models.flight.way_heights import Over

SCHEMA = "skyway.check/1"
MAX_PER_KIND = 20
AIRSPACE_CODES = ("no-fly-zone", "above-max-height")
"""Codes of findings that an airspace forbids a flight."""
_ORDER = {"error": 0, "warning": 1, "info": 2}


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """Result of a check: ``skyway.check/1``."""

    schema: str = SCHEMA
    ok: bool
    """No finding is an error, and no battery is empty before a landing, not even with an assumed vehicle."""
    findings: tuple[Finding, ...]
    """Errors first, then warnings, then information; each in the order of items."""
    legs: tuple[LegEnergy, ...]
    """Flights, in order; only their distances if no vehicle was judged."""
    heights: tuple[LegHeights | None, ...] = ()
    """Of each flight over the terrain model; empty without one."""
    vehicle_judged: bool = field(metadata=HIDDEN)
    """False if no vehicle was named and it is not a multirotor: speeds, range and battery are unknown."""


def check(
    document: MissionDocument | Mission,
    *,
    dialect: Family | None = None,
    conditions: FlightConditions | None = None,
    zones: Airspace | None = None,
    over: Over | None = None,
    depart_s: float | None = None,
) -> CheckReport:
    """Check any mission: completeness, limits of the autopilot, battery, fence.

    Parameters
    ----------
    document : MissionDocument or Mission
        From any file, or from a vehicle.
    dialect : Family, optional
        Autopilot to check against; by default the one the file names, if any.
    conditions : FlightConditions, optional
        Vehicle, package, charge and wind; by default the built-in M200 V2, empty, in still air, whose limits are
        then only warnings. Where the vehicle is assumed, but not package, wind or charge, what follows from them is an
        error.
    zones : Airspace, optional
        Zones, and the greatest height above ground.
    depart_s : float, optional
        First take-off, POSIX seconds; without it zones count at all times.
    over : Over, optional
        Terrain model that it is flown over; without one the ground is known only at home, landings and stations.
    """
    if isinstance(document, Mission):
        document = MissionDocument(document)
    mission = document.mission
    flown_by = conditions or FlightConditions(M200_V2, drone_is_assumed=True)
    autopilot = dialect or family_of(mission.firmware)
    route = fly(mission, autopilot=autopilot)
    legs = leg_energies(mission, route, flown_by)
    heights: tuple[LegHeights | None, ...] = ()
    findings = [
        *check_structure(document, route, autopilot),
        *check_home_distance(mission, route),
        *check_rally_distances(document, route),
        *check_fence(document, route, autopilot),
    ]
    judged = not (flown_by.drone_is_assumed and (mission.is_for_the_surface or mission.is_for_wings))
    if mission.is_for_the_surface and not judged:
        message = "planned for a rover, boat or submarine: take-off, landing, heights and battery were not judged"
        findings.append(
            Finding("warning", None, "not-for-the-air", message, "name the drone that flies it, if one does")
        )
    else:
        above_home = check_heights(mission, route, flown_by.stations)
        findings += [one for one in above_home if over is None or one.code != "high"]
        if over is None:
            findings += check_clearance(mission, route, flown_by.stations)
        else:
            told, heights = check_terrain(mission, route, over, flown_by.stations)
            findings += told
        if judged:
            findings += _of_the_vehicle(mission, route, legs, flown_by)
        else:
            message = "planned for an aeroplane or a VTOL: speeds, range and battery were not judged"
            findings.append(Finding("warning", None, "not-a-multirotor", message, "name the drone that flies it"))
    if autopilot is not None:
        findings += autopilot.cannot_fly(document)
    if zones is not None:
        most = flown_by.drone.max_height_m
        findings += check_airspace(
            document, route, zones, flown_by.stations, legs, depart_s=depart_s, max_height_m=most, over=over
        )
    findings.sort(key=lambda f: (_ORDER[f.severity], -1 if f.item is None else f.item))
    if not judged:
        legs = tuple(replace(leg, time_s=None, energy_wh=None, soc_end=None, p_reserve=None) for leg in legs)
    ok = not any(finding.severity == "error" or finding.code == BATTERY_EMPTY for finding in findings)
    return CheckReport(
        ok=ok, findings=tuple(_without_floods(findings)), legs=legs, heights=heights, vehicle_judged=judged
    )


def _of_the_vehicle(
    mission: Mission, route: Route, legs: Sequence[LegEnergy], conditions: FlightConditions
) -> Iterator[Finding]:
    """Return the violations of this vehicle's limits.

    If it is only assumed they say so, and are at most warnings where nothing was stated that they follow from.
    """
    drone = conditions.drone
    of_the_drone = [*check_speeds(mission, drone), *check_reach(route, drone)]
    of_the_flight = [*check_energy(route, legs, conditions)]
    if conditions.drone_is_assumed:
        of_the_drone = [_of_assumed(finding, drone) for finding in of_the_drone]
        of_the_flight = [_of_assumed(finding, drone, stated=conditions.is_stated) for finding in of_the_flight]
    yield from (*of_the_drone, *of_the_flight)


def _of_assumed(finding: Finding, drone: Drone, *, stated: bool = False) -> Finding:
    if finding.severity == "info":
        return finding
    message = f"{finding.message} (vehicle assumed: {drone.name})"
    return replace(finding, severity=finding.severity if stated else "warning", message=message)


def _without_floods(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Keep the first findings of each kind, and count the rest."""
    kinds = Counter((finding.severity, finding.code) for finding in findings)
    seen: Counter[tuple[str, str]] = Counter()
    for finding in findings:
        kind = (finding.severity, finding.code)
        seen[kind] += 1
        if seen[kind] <= MAX_PER_KIND:
            yield finding
        elif seen[kind] == kinds[kind]:
            more = kinds[kind] - MAX_PER_KIND
            yield replace(finding, item=None, message=f"{more} more items: {finding.message}")
