"""All parameters that a researcher can set by name: ``planner.robust.members=50``."""

from __future__ import annotations

from dataclasses import dataclass, field

from skyway.models.base.parameters import Parameters
from skyway.models.wind.estimation.filter import WindFilterSettings
from skyway.planner.parameters.planner import PlannerParameters


@dataclass(frozen=True)
class WindParameters(Parameters):
    """Of `models.wind`."""

    filter: WindFilterSettings = field(default_factory=WindFilterSettings)


@dataclass(frozen=True)
class Settings(Parameters):
    """The whole tree."""

    planner: PlannerParameters = field(default_factory=PlannerParameters)
    wind: WindParameters = field(default_factory=WindParameters)
