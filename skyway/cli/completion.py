"""Shell completion of stations, drones and planners, from the scenario on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario


def stations(ctx: Any, incomplete: str) -> list[tuple[str, str]]:  # typer's own Context, or click's in older releases
    """Offer station ids, with their names."""
    world = _scenario(ctx)
    places = () if world is None else tuple(one for one in world.network.stations if not one.flyover)
    return [(place.id, place.name) for place in places if place.id.startswith(incomplete)]


def drones(ctx: Any, incomplete: str) -> list[tuple[str, str]]:
    """Offer the drones of the fleet."""
    world = _scenario(ctx)
    fleet = () if world is None else world.drones
    return [(drone.id, drone.name) for drone in fleet if drone.id.startswith(incomplete)]


def planners(incomplete: str) -> list[str]:
    """Offer the planners."""
    from skyway.planner.registry import PLANNERS

    return [name for name in PLANNERS if name.startswith(incomplete)]


def _scenario(ctx: Any) -> Scenario | None:
    """Return the scenario on the line, or the built-in one; None where it cannot be read: the shell shows no errors."""
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario.file import read_scenario

    try:
        return read_scenario(Path(ctx.params.get("scenario") or NEW_YORK))
    except SkywayError:
        return None
