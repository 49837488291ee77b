"""Requests on the map: at a place, a station, a segment, or by dragging a stop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from skyway.web.work.question import ROBUST, Question

if TYPE_CHECKING:
    from collections.abc import Sequence

ACTIONS = (
    {"name": "start", "words": "Start here"},
    {"name": "to", "words": "Deliver here"},
    {"name": "stop_at", "words": "Stop here on the way", "station": True, "unlisted": "stopAt"},
    {"name": "not_stop_at", "words": "No need to stop here", "station": True, "listed": "stopAt"},
    {"name": "carry", "words": "Move this stop to another station", "stop": True},
    {"name": "avoid_segment", "words": "Do not fly this segment", "segment": True},
    {"name": "avoid", "words": "Do not land here", "station": True, "unlisted": "avoid"},
    {"name": "not_avoid", "words": "Landing here is fine again", "station": True, "listed": "avoid"},
)
"""Menu of a place."""


def chosen_there(q: Question, chosen: dict[str, Any]) -> Question:
    """Return the request with a choice from the menu of a place."""
    place = chosen.get("station") or f"{float(chosen['lat']):.5f},{float(chosen['lon']):.5f}"
    action = str(chosen.get("action"))
    if action in {"start", "to"}:
        return replace(q, **{action: place})
    if action == "stop_at":
        return replace(q, stop_at=(*q.stop_at, place), avoid=_without(q.avoid, place), planner=ROBUST)
    if action == "avoid":
        return replace(q, avoid=(*q.avoid, place), stop_at=_without(q.stop_at, place))
    if action in {"not_stop_at", "not_avoid", "not_others"}:
        name = action.removeprefix("not_")
        return replace(q, **{name: _without(getattr(q, name), place)})
    return replace(q, avoid=(*q.avoid, str(chosen["segment"]))) if action == "avoid_segment" else q


def stop_moved(q: Question, made: Sequence[str], old: str, new: str) -> Question:
    """Return the request with a stop moved: the drone stops there, and does not land at the old place; `made` are the stops of the plan."""
    stops = [new if one == old else one for one in q.stop_at]
    if new not in stops:
        stops = [new if one == old else one for one in made if one == old or one in q.stop_at]
    return replace(q, stop_at=tuple(dict.fromkeys(stops)), avoid=(*_without(q.avoid, new, old), old), planner=ROBUST)


def _without(names: tuple[str, ...], *gone: str) -> tuple[str, ...]:
    return tuple(one for one in names if one not in gone)
