"""Loading the named scenario, or the built-in one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.models.scenario.scenario import Scenario

BUILT_IN = "builtin:newyork"
"""Path of the built-in scenario in plans and reports."""


def load_scenario(path: Path | None) -> Scenario:
    """Read the scenario named, or the built-in one, which ``newyork`` names where there is no such folder."""
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario.file import read_scenario

    if path is None or str(path) == BUILT_IN or (str(path) == NEW_YORK.name and not path.exists()):
        return replace(read_scenario(NEW_YORK), path=BUILT_IN)
    return read_scenario(path)
