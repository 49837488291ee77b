"""Loading the named scenario, or the built-in one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.models.scenario.scenario import Scenario

BUILT_IN = "builtin:newyork"
"""Path of the built-in scenario in plans and reports."""


def load_scenario(path: Path | None) -> Scenario:
    """Read the named scenario, or the built-in one, which ``newyork`` names unless such a folder exists."""
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario.file import read_scenario

    if path is None or str(path) == BUILT_IN or (str(path) == NEW_YORK.name and not path.exists()):
        return replace(read_scenario(NEW_YORK), path=BUILT_IN)
    return read_scenario(path)


def with_terrain(scenario: Scenario, terrain: Sequence[str] | None, obstacles: Sequence[str] | None) -> Scenario:
    """Return a scenario over the terrain models and obstacles that are named; obstacles join those of the scenario.

    Raises an `InputError` if a file is wrong or lies elsewhere, or if the scenario names its terrain already.
    """
    from skyway.models.base.errors import InputError
    from skyway.models.scenario.ground import over_terrain
    from skyway.models.terrain.files import read_terrain, with_obstacles

    known = scenario.network.over
    if not terrain and not obstacles:
        return scenario
    if known is None:
        return over_terrain(scenario, read_terrain(terrain or (), obstacles or ()))
    if terrain:
        remedy = "remove --terrain; --obstacles adds obstacles"
        raise InputError("the scenario names its terrain already", scenario.path, field="--terrain", remedy=remedy)
    return over_terrain(scenario, with_obstacles(known.terrain, obstacles or ()))
