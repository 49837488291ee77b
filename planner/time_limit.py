"""Note on an answer cut off by a time limit: how much better another could be at most."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.models.base.formatting import percent, spent
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.explain import mean_bound_s

if TYPE_CHECKING:
    from skyway.planner.baselines.ies import ExhaustiveSearch
    from skyway.planner.result import PlanResult


def _told(time_limit_s: float, gap: float, what: str) -> str:
    note = f"cut off after {time_limit_s:g} s: the best found, perhaps not the best there is"
    if not math.isfinite(gap):
        return note
    return f"{note}; {what} takes at most {percent(max(math.ceil(100.0 * gap), 1) / 100.0)} longer than that"


def cut_off_note(search: ExactSearch | ExhaustiveSearch, time_limit_s: float) -> str:
    """Note that an answer is not proved optimal, and what is proved."""
    return _told(time_limit_s, search.gap if isinstance(search, ExactSearch) else math.inf, "it")


def beyond_limit(result: PlanResult, time_limit_s: float) -> PlanResult:
    """Note that a complete answer of `robust` took longer than the limit, if it did: simulations that have begun are not cut off."""
    if result.planning_time_s <= time_limit_s:
        return result
    note = (
        f"planned in {spent(result.planning_time_s)}, longer than the time limit of {time_limit_s:g} s: the simulations of a route are not "
        "cut off; fewer deliveries take less (planner.robust.final_runs)"
    )
    composition = replace(result.composition, notes=(*result.composition.notes, note))
    return replace(result, composition=composition)


def with_gap(result: PlanResult, time_limit_s: float) -> PlanResult:
    """Note that an answer of `robust` left options unsearched, and how much time they could save at most."""
    taken_s = result.outcome.mean_s - result.problem.depart_s
    note = _told(time_limit_s, taken_s / mean_bound_s(result.problem) - 1.0, "on average it")
    composition = replace(result.composition, notes=(*result.composition.notes, note))
    return replace(result, composition=composition, complete=False)
