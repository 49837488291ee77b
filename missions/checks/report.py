"""The check of a mission: every finding, and what each flight costs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from missions.checks.areas import check_fence, check_zones
from missions.checks.energy import FlightConditions, LegEnergy, leg_energies
from missions.checks.holds import check_energy
from missions.checks.limits import check_distances, check_heights, check_speeds
from missions.checks.route import fly
from missions.checks.structure import check_structure
from missions.dialects import dialect_of_firmware
from missions.document import MissionDocument
from missions.mission import Mission
from models.drone import M200_V2
from models.units import J_PER_WH

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from missions.dialects.protocol import Dialect
    from missions.finding import Finding
    from models.zones import NoFlyZones

SCHEMA = "skyway.check/1"
MAX_PER_KIND = 20
_ORDER = {"error": 0, "warning": 1, "info": 2}


@dataclass(frozen=True, slots=True)
class CheckReport:
    """What a check found.

    Attributes
    ----------
    findings : tuple of Finding
        Errors first, then warnings, then information; each in the order of items.
    legs : tuple of LegEnergy
        Flights, in order.
    """

    findings: tuple[Finding, ...]
    legs: tuple[LegEnergy, ...]

    @property
    def ok(self) -> bool:
        """No finding is an error."""
        return not any(finding.severity == "error" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain JSON values (``skyway.check/1``); unknown is null."""
        return {
            "schema": SCHEMA,
            "ok": self.ok,
            "findings": [
                {
                    "severity": finding.severity,
                    "item": finding.item,
                    "code": finding.code,
                    "message": finding.message,
                    "remedy": finding.remedy,
                }
                for finding in self.findings
            ],
            "legs": [
                {
                    "item_from": leg.item_from,
                    "item_to": leg.item_to,
                    "distance_m": leg.distance_m,
                    "time_s": leg.time_s,
                    "energy_wh": None if leg.energy_j is None else leg.energy_j / J_PER_WH,
                    "soc_end": leg.soc_end,
                    "p_reserve": leg.p_reserve,
                }
                for leg in self.legs
            ],
        }


def check(
    document: MissionDocument | Mission,
    *,
    dialect: Dialect | None = None,
    conditions: FlightConditions | None = None,
    zones: NoFlyZones | None = None,
) -> CheckReport:
    """Check any mission: is it complete, can the autopilot fly it, does the battery last, does it stay in its fence.

    Parameters
    ----------
    document : MissionDocument or Mission
        From any file, or from a vehicle.
    dialect : Dialect, optional
        Autopilot to check against; by default the one the file names, if any.
    conditions : FlightConditions, optional
        Vehicle, package, charge and wind; by default the built-in M200 V2, empty, in still air, and what it cannot
        do is a warning then.
    zones : NoFlyZones, optional
        No-fly zones.
    """
    if isinstance(document, Mission):
        document = MissionDocument(document)
    mission = document.mission
    flown_by = conditions or FlightConditions(M200_V2, drone_is_assumed=True)
    autopilot = dialect or dialect_of_firmware(mission.firmware)
    route = fly(mission)
    legs = leg_energies(mission, route, flown_by)
    findings = [
        *check_structure(mission, route),
        *check_speeds(mission, flown_by.drone),
        *check_distances(mission, route, flown_by.drone),
        *check_heights(mission, route),
        *check_fence(document, route, autopilot.name if autopilot else None),
        *check_energy(route, legs, flown_by),
    ]
    if autopilot is not None:
        findings += autopilot.cannot_fly(document)
    if zones is not None:
        findings += check_zones(document, route, zones)
    findings.sort(key=lambda f: (_ORDER[f.severity], -1 if f.item is None else f.item))
    return CheckReport(tuple(_without_floods(findings)), legs)


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
