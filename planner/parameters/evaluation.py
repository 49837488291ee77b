"""Parameters of evaluations."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class EvaluationParameters(Parameters):
    """Of `planner.evaluation`: the longest simulated delivery, and the counting of its figures."""

    max_stops: int = parameter(60, "number of stops after which a policy has given up", 1, 10_000)
    patience: float = parameter(
        1.0 / 24.0, "a waiting policy decides again after this share of its wait so far: some 100 times in all", 0, 1
    )
    replicates: int = parameter(1000, "resamples of the bootstrap over days behind each interval", 10, 10**6)
