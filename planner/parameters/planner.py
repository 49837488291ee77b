"""All parameters of planners, in one tree."""

from __future__ import annotations

from dataclasses import dataclass, field

from skyway.models.base.parameters import Parameters
from skyway.planner.parameters.baselines import IesParameters, PfsParameters
from skyway.planner.parameters.dispatch import DispatchParameters
from skyway.planner.parameters.evaluation import EvaluationParameters
from skyway.planner.parameters.exact import ExactParameters
from skyway.planner.parameters.online import OnlineParameters
from skyway.planner.parameters.robust import RobustParameters
from skyway.planner.parameters.simulation import ScheduleParameters
from skyway.planner.parameters.tours import ToursParameters


@dataclass(frozen=True)
class PlannerParameters(Parameters):
    """A part for each planner, and those shared by all."""

    robust: RobustParameters = field(default_factory=RobustParameters)
    exact: ExactParameters = field(default_factory=ExactParameters)
    pfs: PfsParameters = field(default_factory=PfsParameters)
    ies: IesParameters = field(default_factory=IesParameters)
    schedule: ScheduleParameters = field(default_factory=ScheduleParameters)
    online: OnlineParameters = field(default_factory=OnlineParameters)
    evaluation: EvaluationParameters = field(default_factory=EvaluationParameters)
    dispatch: DispatchParameters = field(default_factory=DispatchParameters)
    tours: ToursParameters = field(default_factory=ToursParameters)


USUAL = PlannerParameters()
"""All parameters at their defaults."""
