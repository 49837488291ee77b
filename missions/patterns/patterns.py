"""Patterns of QGroundControl (surveys, corridors, structure scans, landings), expanded to items."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.missions.items.json_fields import JsonField
from skyway.missions.patterns import landing_pattern, structure_scan
from skyway.missions.patterns import transects as transect_patterns

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_ITEMS = 100_000
PATTERN_VERSIONS = {
    "survey": (2, 3, 4, 5),
    "CorridorScan": (1, 2),
    "StructureScan": (3,),
    "fwLandingPattern": (1, 2),
    "vtolLandingPattern": (1,),
    "TransectStyleComplexItem": (0, 1, 2),
}
"""Versions of patterns that QGroundControl reads, and those older ones whose items the file holds."""
BUILT = {"survey": transect_patterns.survey, "CorridorScan": transect_patterns.corridor}
"""Patterns that are built from their settings if their file contains no items."""
_WITHOUT_STYLE = (2, 3)
"""Versions of surveys that never held items."""


def expand(source: JsonField, number_here: int) -> tuple[list[Mapping[str, Any]], bool]:
    """Return the simple items of a pattern, and whether they were built as in QGroundControl.

    The items are those in the file, if any. Landing patterns count as contained: their expansion is exact. An
    `InputError`, which names the number of the first item, refuses an unknown pattern or version, and one that
    cannot be built from the contents of the file.
    """
    kind = str(source["complexItemType"].value or source["type"].value)
    _check_version(kind, source)
    if kind in landing_pattern.LANDINGS:
        return landing_pattern.expand(kind, source), False
    if kind == "StructureScan":
        return structure_scan.structure_scan(source), True
    style = source["TransectStyleComplexItem"]
    has_style = isinstance(style.value, dict)
    if has_style:
        _check_version("TransectStyleComplexItem", style)
    inner = (style if has_style else source)["Items"].value
    if isinstance(inner, list) and inner:
        if len(inner) > MAX_ITEMS:
            raise source.fault(f"has more than {MAX_ITEMS} items", len(inner))
        return [JsonField(one, source.file, source.name).mapping() for one in inner], False
    version = source["version"].value
    never_held = kind == "survey" and version in _WITHOUT_STYLE
    if kind not in BUILT or version == 1 or (inner is None and not never_held):
        # QGroundControl opens no plan in which the list is missing
        remedy = "open and save the plan in QGroundControl, or replace the pattern by waypoints"
        raise source.fault(f"not supported: {kind} (item {number_here}) without the items it expands to", remedy=remedy)
    return BUILT[kind](source), True


def _check_version(kind: str, source: JsonField) -> None:
    """Refuse a pattern of a version that QGroundControl refuses: its items may mean something else."""
    known = PATTERN_VERSIONS.get(kind)
    version = source.get("version", 0 if kind == "TransectStyleComplexItem" else None)
    if known is not None and (isinstance(version.value, bool) or version.value not in known):
        remedy = f"known: {', '.join(map(str, known))}; open and save the plan in QGroundControl"
        raise version.fault(f"is a version of {kind} that skyway does not know", version.value, remedy)
