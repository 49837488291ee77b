"""Report of the losses when a mission file is written in another format."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.missions.files.plan_writer import required
from skyway.missions.items.fence_items import CLAIMED_COUNT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from skyway.missions.items.document import MissionDocument

COMMENT = "comment"
_SHOWN = 6
"""Keys that are named individually."""
_REPEATED = frozenset({"Altitude", "AMSLAltAboveTerrain", "AltitudeMode"})
"""Keys of items in which QGroundControl repeats the contents of the item."""


def dropped(document: MissionDocument, suffix: str) -> tuple[str, ...]:
    """Return the parts of a document that a file with this suffix cannot contain, a line each."""
    text = suffix == ".waypoints"
    return (*(_of_waypoints(document) if text else _of_plan(document)), *_of_both(document))


def _of_waypoints(document: MissionDocument) -> Iterator[str]:
    mission = document.mission
    for pattern in mission.complex_items:
        kind = pattern.source.get("complexItemType") or pattern.source.get("type")
        yield f"the {kind} becomes its {pattern.count} items, from item {pattern.first}: it can no longer be edited as one"
    planned = required(mission)
    del planned["plannedHomePosition"]
    told = [f"{key} {value:g}" for key, value in planned.items() if value is not None]
    if told:
        yield f"what it was planned for: {', '.join(told)}"
    if mission.home is None:
        yield "home is unknown: row 0 is 0, 0"
    elif mission.home.altitude_m is None:
        yield "the height of home is unknown: row 0 has NaN"
    comments = sum(COMMENT in item.extra for item in mission.items)
    if comments:
        yield f"comments of {comments} items: QGroundControl does not open files with comments"
    terrain = sum(item.was_planned_above_terrain for item in mission.items)
    if terrain:
        yield f"that the heights of {terrain} items were computed above terrain: they stay, above sea level"
    patterns = {n for p in mission.complex_items for n in range(p.first, p.first + p.count)}
    simple = [item for number, item in enumerate(mission.items) if number not in patterns]
    yield from _keys("fields of items", (key for item in simple for key in item.extra if key != COMMENT))
    yield from _keys("fields of the plan", (*document.extra, *mission.extra))
    yield from _keys("fields of the fence", document.fence.extra)
    yield from _keys("fields of rally points", document.rally.extra)
    areas = (key for area in document.fence.areas for key in area.extra if key != CLAIMED_COUNT)
    yield from _keys("fields of fence areas", areas)


def _of_plan(document: MissionDocument) -> Iterator[str]:
    missing = [key for key, value in required(document.mission).items() if value is None]
    if missing and document.mission.items:
        yield f"unknown, and filled in because QGroundControl requires it: {', '.join(missing)}"


def _of_both(document: MissionDocument) -> Iterator[str]:
    for number, area in enumerate(document.fence.polygons):
        claimed = area.extra.get(CLAIMED_COUNT)
        if claimed is not None:
            yield f"fence polygon {number} stated {claimed:g} vertices but has another number: written with the right one"
    yield from _keys("of rally points", (key for rally in document.rally.points for key in rally.extra))


def _keys(what: str, keys: Iterable[str]) -> Iterator[str]:
    names = [key for key in dict.fromkeys(keys) if key not in _REPEATED]
    if names:
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        yield f"{what}: {', '.join(sorted(names)[:_SHOWN])}{more}"
