"""Missions for the page: map, profile, items, findings; read, checked, converted and corrected by the functions of the commands."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.checking import conditions_of, over_of, weather_of
from skyway.missions import check, family_named, read, write
from skyway.missions.checks.fixes import CERTAIN, fixed
from skyway.missions.checks.route import fly
from skyway.missions.files.dropped import dropped
from skyway.missions.items.altitude_frames import frame_name
from skyway.missions.items.geofence import FencePolygon
from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, duration, energy_text, modelled, percent
from skyway.web.work.question import number
from skyway.web.work.region import loaded

if TYPE_CHECKING:
    from skyway.missions.checks.report import CheckReport
    from skyway.missions.items.document import MissionDocument

MOST_ITEMS = 2000
"""Number of items that are listed."""
CIRCLE = 48
"""Number of corners of a drawn circle."""


def shown(path: str, scenario: str | None, asked: dict[str, str]) -> dict[str, Any]:
    """Return a mission and the findings of `skyway check`; `asked` has drone, autopilot, wind, payload, soc, reserve, and whether in the scenario."""
    document = read(Path(path))
    report = _report(document, scenario, asked)
    route = fly(document.mission)
    legs = []
    along_m = 0.0
    for leg in route.legs:
        points, profile = [], []
        before = leg.start
        if before is not None:
            points.append([before.lat, before.lon])
        for step in leg.steps:
            if before is not None:
                along_m += geodesy.distance_m(before.lat, before.lon, step.point.lat, step.point.lon)
            before = step.point
            points.append([step.point.lat, step.point.lon])
            profile.append([along_m / 1000.0, step.height_m, step.item])
        legs.append({"points": points, "profile": profile})
    places = {step.item: [step.point.lat, step.point.lon] for step in route.steps}
    home = document.mission.home
    return {
        "legs": legs,
        "places": {str(item): place for item, place in places.items() if item is not None},
        "home": None if home is None else [home.point.lat, home.point.lon],
        "fence": [_area(area) for area in document.fence.areas],
        "rally": [[one.point.lat, one.point.lon] for one in document.rally.points],
        "items": _items(document),
        "count": len(document.mission.items),
        "findings": [
            {
                "severity": one.severity, "item": one.item, "code": one.code, "message": one.message, "remedy": one.remedy or "",
                "place": places.get(one.item) if one.item is not None else None, "certain": one.code in CERTAIN,
            }
            for one in report.findings
        ],
        "flights": _flights(report),
        "ok": report.ok,
        "lost": {suffix: list(dropped(document, suffix)) for suffix in (".plan", ".waypoints")},
    }  # fmt: skip


def _report(document: MissionDocument, scenario: str | None, asked: dict[str, str]) -> CheckReport:
    region = loaded(scenario) if asked.get("region") else None
    wind = asked.get("wind", "").strip() or None
    weather = weather_of(region, wind, asked.get("depart", "").strip() or None, None, zoned=False)
    conditions = conditions_of(
        region, asked.get("drone") or None, weather, number(asked.get("payload") or "0", "--payload"),
        number(asked.get("soc") or "100", "--soc"), number(asked.get("reserve") or "20", "--reserve"),
    )  # fmt: skip
    flown_by = family_named(asked["autopilot"]) if asked.get("autopilot") else None
    zones = None if region is None else region.network.zones
    return check(document, dialect=flown_by, conditions=conditions, zones=zones, over=over_of(region, None, None, None))


def _flights(report: CheckReport) -> list[dict[str, str]]:
    found = []
    for leg in report.legs:
        row = {"items": f"{leg.item_from} to {leg.item_to}", "distance": distance_text(leg.distance_m)}
        if leg.time_s is not None:
            row |= {"time": duration(leg.time_s), "energy": energy_text(leg.energy_j)}
        if leg.soc_end is not None:
            ends = percent(leg.soc_end) if leg.soc_end > 0 else "the battery does not last"
            row |= {"ends": ends, "kept": modelled(leg.p_reserve)}
        found.append(row)
    return found


def _items(document: MissionDocument) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for position, item in enumerate(document.mission.items[:MOST_ITEMS]):
        values = ", ".join("-" if math.isnan(value) else f"{value:g}" for value in item.params)
        place = f"{item.point.lat:.7f}, {item.point.lon:.7f}" if item.point else ""
        height_m = item.z if item.is_located and not math.isnan(item.z) else None
        cells = [str(position), item.name, frame_name(item.frame), values, place]
        rows.append({"cells": cells, "height_m": height_m})
    return rows


def _area(area: Any) -> dict[str, Any]:
    if isinstance(area, FencePolygon):
        ring = [[one.lat, one.lon] for one in area.vertices]
    else:
        turns = (360.0 * step / CIRCLE for step in range(CIRCLE))
        ring = [list(geodesy.direct(area.center.lat, area.center.lon, turn, area.radius_m)) for turn in turns]
    return {"inside": area.inclusion, "points": [*ring, ring[0]] if ring else []}


def converted(path: str, suffix: str, asked: dict[str, str] | None, scenario: str | None) -> dict[str, Any]:
    """Return a mission in a format: its files, and the losses of that format; with `asked` the certain findings are fixed first."""
    document = read(Path(path))
    told: tuple[str, ...] = ()
    if asked is not None:
        document, told = fixed(document, _report(document, scenario, asked).findings)
    stem = Path(path).stem
    with tempfile.TemporaryDirectory() as folder:
        files = write(document, Path(folder) / f"{stem}{suffix}")
        return {
            "files": [(file.name, file.read_bytes()) for file in files],
            "told": [*told, *(f"not kept: {line}" for line in dropped(document, suffix))],
        }
