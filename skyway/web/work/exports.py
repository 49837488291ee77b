"""Export files of a plan, in the formats of the commands."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Any

from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text
from skyway.models.composition.file import from_json
from skyway.planner.problem.request import NEAREST_PAD

KINDS = {
    "plan.json": "Plan (skyway)",
    "plan": "QGroundControl .plan",
    "waypoints": "Mission Planner .waypoints",
    "geojson": "GeoJSON",
    "kml": "KML",
    "html": "Briefing",
}
"""File name extension and label of each."""


def export(
    scenario: str | None, plan: dict[str, Any], kind: str, stem: str, more: dict[str, str]
) -> list[tuple[str, bytes]]:
    """Return the files of a plan: name and content; `more` has ``autopilot``, ``contacts`` and ``elevation``.

    A mission comes with its parameters, and as .waypoints with fence and rally points, as ``skyway mission`` writes them.
    """
    from skyway.web.work.region import loaded

    text = json.dumps(plan)
    composition = from_json(text)
    if kind == "plan.json":
        return [(f"{stem}.json", (json_text(plan, indent=1) + "\n").encode())]
    if kind == "geojson":
        from skyway.route_geojson import route_geojson

        return [(f"{stem}.geojson", (json_text(route_geojson(composition), indent=1) + "\n").encode())]
    if kind == "kml":
        from skyway.route_kml import route_kml

        return [(f"{stem}.kml", route_kml(composition).encode())]
    if kind == "html":
        from skyway.briefing import briefing

        return [
            (f"{stem}.html", briefing(composition, loaded(scenario), more.get("contacts", "").splitlines()).encode())
        ]
    if kind in {"plan", "waypoints"}:
        from skyway.flying import heights, terrain_of
        from skyway.missions import family_named
        from skyway.missions.autopilots import NAMES
        from skyway.missions.builder.export_files import write_export
        from skyway.missions.builder.from_composition import whole_mission
        from skyway.missions.builder.mission_options import MissionOptions

        flown_by = family_named(more.get("autopilot") or NAMES[0])
        ground = heights(None, more.get("elevation", "").replace(",", " ").split())
        made = whole_mission(composition, flown_by, MissionOptions(over=terrain_of(composition), elevation_m=ground))
        with tempfile.TemporaryDirectory() as folder:
            written = write_export(
                made, flown_by.parameter_file(made.parameters, flown_by.released), Path(folder) / f"{stem}.{kind}"
            )
            return [(file.name, file.read_bytes()) for file in written]
    raise InputError("no such format", field="format", value=kind, remedy=", ".join(KINDS))


def opened(path: str) -> dict[str, Any]:
    """Read a plan file: the plan, and its request as fields of a question."""
    from skyway.models.composition.file import load, to_json

    composition = load(path)
    soc = composition.services[0].soc_depart if composition.services else 1.0
    back, not_before = composition.way_back, composition.not_before
    return {
        "plan": to_json(composition),
        "question": {
            "start": _named(composition, composition.origin), "to": _named(composition, composition.destination),
            "payload": f"{composition.payload_kg:g}", "depart": composition.depart.isoformat(), "drone": composition.drone,
            "planner": composition.planner, "reserve": f"{100.0 * composition.reserve_soc:g}", "soc": f"{100.0 * soc:g}",
            "not_before": "" if not_before is None else not_before.isoformat(),
            "return_to": "" if back is None or back.asked == NEAREST_PAD else back.asked,
            "dwell": "" if back is None or not back.dwell_s else f"{back.dwell_s:g}s",
            "if_undelivered": "" if back is None else back.undelivered_to or "",
        },
    }  # fmt: skip


def _named(composition: Any, name: str) -> str:
    """A station by its id; a start or target that was given as a place, by its place."""
    place = composition.stations[name]
    return f"{place.lat},{place.lon}" if re.fullmatch(r"(start|target)(-new)*", name) else name
