"""The uncertainties behind a promise: their sizes, their data, and the gain from halving each.

The gain of one is found by planning again with half of its standard deviation about the same mean (of other drones: with half as many),
the rest as it is; both plans are simulated in the same deliveries. What no plan counts is listed beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InfeasibleError
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.problem.error_model import USUAL_ERRORS, Errors
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.outcome import later
from skyway.planner.schedule.schedule_kernels import PAD, ROOM, TOUCH_DOWN

if TYPE_CHECKING:
    from skyway.models.base.statistics import Figure
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.result import PlanResult
    from skyway.planner.robust.robust import RobustAnswer

WIND, GUSTS, ENERGY, PADS = "wind", "gusts", "energy", "pads"
NOT_COUNTED = (
    "a wind profile that differs from the scenario's",
    "a cold or an old battery",
    "pads out of order",
)
"""A promise holds where these are small; `benchmarks.independent` says how it fares where they are not."""


@dataclass(frozen=True)
class Uncertainty:
    """One thing that is not known for sure."""

    name: str
    """``wind``, ``gusts``, ``energy`` or ``pads``."""
    size: float
    """Standard deviation: of a component of the wind at cruise height, m/s; of gusts as a share of the wind; of a leg's energy as a share of
    the model's; of pads: the mean time that a delivery waits for them and for room, s."""
    source: str
    """Data that it comes from."""
    remedy: str
    """How to know it better; empty where nothing is offered."""
    gain: Figure | None
    """How much earlier the delivery is on average where it is halved, s; None where that leaves no route."""


def uncertainties(result: PlanResult) -> list[Uncertainty]:
    """Assumptions behind the promise of a robust plan, the most valuable to improve first; empty for plans of other planners."""
    answer = result.robust
    if answer is None:
        return []
    problem = answer.policy.problem
    errors = problem.usual_errors
    belief = errors.energy_of(problem.drone)
    found = [
        Uncertainty(WIND, wind_sd_mps(answer), _wind_source(problem.ensemble), *_halved_wind(answer)),
        Uncertainty(GUSTS, errors.gust_sd, _gust_source(errors), *_halved_gusts(answer)),
        Uncertainty(ENERGY, belief.leg_sd, _energy_source(belief), *_halved_energy(answer, belief)),
        Uncertainty(PADS, waiting_s(answer), _pads_source(problem), *_halved_pads(answer)),
    ]
    return sorted(found, key=_gained, reverse=True)


def not_counted(result: PlanResult) -> list[str]:
    """Effects outside the promise of a robust plan; wind between the sites of a record is reported separately (`planner.between_sites`)."""
    if result.robust is None:
        return []
    between = (
        [] if record_days(result.problem.ensemble) else ["the error of the wind between the points of the forecast"]
    )
    return [*between, *NOT_COUNTED]


def _gained(one: Uncertainty) -> tuple[bool, float]:
    """Order: what half of it gains for sure, then the rest."""
    return (False, -math.inf) if one.gain is None else (one.gain.low > 0.0, one.gain.value)


def wind_sd_mps(answer: RobustAnswer) -> float:
    """Standard deviation of a component of the wind at cruise height, from the departure to the mean arrival, over all sites, m/s."""
    problem = answer.policy.problem
    rules = problem.rules
    wind = problem.ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    begin, end = ((at_s - wind.start_s) / wind.slot_s for at_s in (problem.depart_s, answer.outcome.mean_s))
    slots = slice(max(int(begin), 0), max(int(end), int(begin), 0) + 1)
    parts = np.stack((wind.north[:, slots], wind.east[:, slots]))
    about = parts - np.einsum("m,cmts->cts", wind.probability, parts)[:, None]
    return float(np.sqrt(np.einsum("m,cmts->cts", wind.probability, about**2).mean()))


def waiting_s(answer: RobustAnswer) -> float:
    """Mean time that a simulated delivery waits for pads, and for room at the next station, s."""
    runs, weight = answer.out_of_sample.schedule, answer.out_of_sample.weight
    arrived = np.isfinite(runs[:, -1, TOUCH_DOWN])
    landed = np.concatenate((np.full((len(runs), 1), answer.policy.problem.depart_s), runs[:, :-1, TOUCH_DOWN]), axis=1)
    waits = np.maximum(runs[arrived, :, PAD] - landed[arrived], 0.0) + runs[arrived, :, ROOM]
    return float(np.average(waits.sum(axis=1), weights=weight[arrived]))


def _planned_again(answer: RobustAnswer, problem: Problem, errors: Errors | None = None) -> Figure | None:
    """By how much the best plan in another problem is earlier than this one."""
    try:
        other = RobustSearch(problem, errors=errors).solve()
    except InfeasibleError:
        return None
    return later(answer.outcome, other.outcome)


def _halved_wind(answer: RobustAnswer) -> tuple[str, Figure | None]:
    problem = answer.policy.problem
    wind, mean = problem.ensemble, problem.ensemble.mean()
    halved = replace(wind, north=0.5 * (wind.north + mean.north), east=0.5 * (wind.east + mean.east))
    again = Problem(
        problem.scenario, problem.request, problem.drone, halved, parameters=problem.parameters, waits=problem.waits
    )
    return "reduce it with current observations or a forecast (--observed, --forecast)", _planned_again(answer, again)


def _halved_gusts(answer: RobustAnswer) -> tuple[str, Figure | None]:
    problem = answer.policy.problem
    usual = problem.usual_errors
    return "", _planned_again(answer, problem, replace(usual, gust_sd=0.5 * usual.gust_sd))


def _halved_energy(answer: RobustAnswer, belief: EnergyBelief) -> tuple[str, Figure | None]:
    halved = replace(belief, sd_between=0.5 * belief.sd_between, sd_within=0.5 * belief.sd_within)
    problem = answer.policy.problem
    gain = _planned_again(answer, problem, replace(problem.usual_errors, energy=halved))
    return "reduce it with logs of its own flights (skyway calibrate energy)", gain


def _halved_pads(answer: RobustAnswer) -> tuple[str, Figure | None]:
    problem = answer.policy.problem
    load = problem.scenario.load
    scenario = replace(problem.scenario, load=replace(load, arrivals_per_s=0.5 * load.arrivals_per_s))
    again = Problem(scenario, problem.request, problem.drone, problem.ensemble, parameters=problem.parameters)
    return "use stations with more pads or fewer others", _planned_again(answer, again)


def _wind_source(wind: WindEnsemble) -> str:
    days = record_days(wind)
    if not days:
        return f"{len(wind)} members of the forecast" if len(wind) > 1 else "one wind, without error"
    return f"{days} days of the record" if days > 1 else "one day, without error"


def record_days(wind: WindEnsemble) -> int:
    """Number of days of a record that the members are; 0 where they are not from a record."""
    try:
        return len([date.fromisoformat(label) for label in wind.labels])
    except ValueError:
        return 0


def _gust_source(errors: Errors) -> str:
    return (
        "assumed: the record has no gusts" if errors.gust_sd == USUAL_ERRORS.gust_sd else "the gusts that are forecast"
    )


def _energy_source(belief: EnergyBelief) -> str:
    return "published endurance; this drone was not measured" if belief == EnergyBelief() else "the fleet file"


def _pads_source(problem: Problem) -> str:
    seen = len(problem.busy)
    return "usual arrivals and charging times" + (f"; {seen} stations seen now" if seen else "")
