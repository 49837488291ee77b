"""Plans of the work folder that can be flown, for the departure page."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import SkywayError
from skyway.models.base.formatting import distance_text, duration
from skyway.models.composition.file import load

MOST = 200
_MOST_BYTES = 8 * 1024 * 1024


def plans(root: str, names: list[tuple[str, float, int]]) -> list[dict[str, Any]]:
    """Return a row for each file that holds a plan: names within the folder, with time and size; others are omitted."""
    return [row for one in names[:MOST] if (row := _row(root, *one)) is not None]


@lru_cache(maxsize=1000)
def _row(root: str, name: str, changed_s: float, size: int) -> dict[str, Any] | None:  # noqa: ARG001  the time is part of the key
    if size > _MOST_BYTES:
        return None
    path = Path(root) / name
    try:
        told = json.loads(path.read_bytes())
        if not isinstance(told, dict) or "legs" not in told or "stations" not in told:
            return None
        plan = load(path)
    except (OSError, ValueError, RecursionError, SkywayError):
        return None
    stops = [one.station for one in plan.stops if one.recharge_s > 0.0]
    charges = f", charged at {', '.join(stops)}" if stops else ""
    return {
        "name": name, "origin": plan.origin, "destination": plan.destination, "drone": plan.drone, "payload_kg": plan.payload_kg,
        "words": f"{plan.origin} > {plan.destination}, {distance_text(plan.distance_m)} in {duration(plan.delivery_time_s)}{charges}",
        "path": [[place.lat, place.lon] for place in (plan.stations[one] for one in plan.route)],
    }  # fmt: skip
