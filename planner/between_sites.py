"""The effect on a robust plan of wind that no site of the record measures.

A plan is simulated in the wind that is interpolated between the sites of the record. The wind there is another one, by an error whose
covariance the record tells (`models.wind.field_error`). Given a simulated delivery, each flight of it takes normally distributed energy more or
less, with the standard deviation

    s = e c sqrt(sum over segments i, j of t(i) t(j) r(i, j))

where e c is the charge that a second of this flight takes, t(i) the seconds that the error of the wind over a segment costs for each of its
standard deviations, and r(i, j) the correlation of the errors. What a flight has left above the reserve is x. Flown to its end whatever
the wind, it lands below the reserve with probability Phi(-x / s). `fly` turns it on its way, about halfway: what is met there is known by then, half of the
variance, and what is still unknown must be kept but for epsilon, d deviations, so that it is turned with

    Phi(-(x - d s / sqrt(2)) / (s / sqrt(2)))

A flight that is turned costs the time to use the share `OnlineParameters.turned_share` of what it could, and to charge that again, and s more, on the
pad where it began. Where a full battery is not enough for that, it waits until what it met, x + s, has faded (`FieldError.tau_s`). Then it gets there. Later flights of the delivery are as they were: who waits for pads then was not sampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.wind.triangle import along_across
from skyway.planner.reach.wind_ahead import slower_s
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN
from skyway.planner.uncertainties import record_days

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.out_of_sample import OutOfSample
    from skyway.planner.robust.robust import RobustAnswer
    from skyway.planner.schedule.outcome import Outcome

_TURNED = 0x54
"""Of the deviates that say which flights are turned."""
PIECE_M = 2000.0
"""The error of the wind is one and the same over so much of a segment."""


@dataclass(frozen=True, eq=False)
class BetweenSites:
    """Results of a plan in wind that the sites of the record do not measure."""

    sd_mps: float
    """Standard deviation of a component where it is least known on the route, in the usual wind there."""
    station: str
    """Id of the station next to that."""
    p_below: float
    """Probability that a delivery lands below the reserve if each flight is flown to its end."""
    p_turned: float
    """Probability that `fly` turns a flight of a delivery back."""
    turned: Outcome
    """Deliveries with flights that are turned."""


def between_sites(answer: RobustAnswer) -> BetweenSites | None:
    """How a robust plan performs between the wind sites; None for forecasts from a record, which has errors of its own."""
    problem, policy = answer.policy.problem, answer.policy
    if not record_days(problem.ensemble):
        return None
    runs, sigmas = answer.out_of_sample, NormalDist().inv_cdf(1.0 - problem.epsilon)
    legs = len(policy)
    flown = np.isfinite(runs.schedule[:, :, TOUCH_DOWN])
    spread, delay = np.zeros(flown.shape), np.zeros(flown.shape)
    left = runs.schedule[:, :, SOC_LANDING] - problem.reserve
    left[:, -1] -= policy.way_on_soc
    worst = (0.0, "")
    for leg in range(legs):
        there, segments = np.flatnonzero(flown[:, leg]), policy.itinerary[leg].segments
        off_s = runs.schedule[there, leg, TAKE_OFF]
        slower, known = slower_sd_s(problem, segments, runs.member[there], off_s)
        worst = max(worst, known)
        spread[there, leg] = runs.energy[there, leg] * problem.soc_per_s * slower
        flights = runs.schedule[there, leg]
        delay[there, leg] = _delay_s(problem, segments[0], flights, spread[there, leg], left[there, leg])
    below = np.where(flown, chance_above(left, spread), 0.0)
    half = spread / np.sqrt(2.0)
    turned = np.where(flown, chance_above(left - sigmas * half, half), 0.0)
    turned = np.maximum(turned, below)  # it looks later, too
    return BetweenSites(
        *worst,
        float(runs.weight @ (1.0 - (1.0 - below).prod(axis=1))),
        float(runs.weight @ (1.0 - (1.0 - turned).prod(axis=1))),
        _turned_outcome(answer, turned, delay),
    )


def chance_above(left: NDArray[np.float64], spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Chance that a normal deviate of this spread is above what is left."""
    from scipy.special import ndtr

    return np.asarray(ndtr(-left / np.maximum(spread, 1e-12)))


def slower_sd_s(
    problem: Problem, segments: Sequence[int], member: NDArray[np.int64], take_off_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], tuple[float, str]]:
    """Standard deviation of the time of flights over segments, s, shape (runs,), for what the sites do not tell of the wind.

    Also where that is worst known: the standard deviation of a component there on average wind of these flights, m/s, and the nearer end of the segment.
    """
    air, network = problem.air, problem.network
    slot = np.clip(((take_off_s - air.start_s) // air.slot_s).astype(np.int64), 0, air.north.shape[1] - 1)
    pieces = pieces_of(problem, segments)
    of, length_m = pieces.of, pieces.length_m
    north, east = (np.einsum("rs,ns->rn", part[member, slot], air.weight[of]) for part in (air.north, air.east))
    field, calm = problem.scenario.field_error, pieces.covariance
    variance = np.maximum(np.diagonal(calm), 0.0)
    sd_mps = np.sqrt(variance * field.in_wind(np.hypot(north, east)))
    along = along_across(north, east, air.cos_bearing[of], air.sin_bearing[of])
    costs_s = slower_s(length_m, along, air.airspeed_mps, air.max_ground_speed_mps, sd_mps)
    scale = np.sqrt(np.maximum(variance, 1e-12))
    square = np.einsum("ri,ij,rj->r", costs_s, calm / np.outer(scale, scale), costs_s)
    usual = sd_mps.mean(axis=0) if len(sd_mps) else np.zeros(len(of))
    worst = int(usual.argmax())
    near = network.head[of[worst]] if pieces.share[worst] > 0.5 else network.tail[of[worst]]
    return np.sqrt(np.maximum(square, 0.0)), (float(usual[worst]), network.stations[int(near)].id)


class Pieces(NamedTuple):
    """Pieces of a way over segments, shape (n,) each."""

    of: NDArray[np.int64]
    """Segment of each."""
    share: NDArray[np.float64]
    """Its middle, as a share of the segment."""
    length_m: NDArray[np.float64]
    covariance: NDArray[np.float64]
    """Shape (n, n): of the errors of the interpolated wind, in calm air, m2/s2 (`models.wind.field_error`)."""


def pieces_of(problem: Problem, segments: Sequence[int]) -> Pieces:
    """Cut a way over segments into pieces of about `PIECE_M`."""
    wind, network, field = problem.ensemble, problem.network, problem.scenario.field_error
    parts = [(one, part) for one in segments for part in _parts(float(problem.air.distance_m[one]))]
    of = np.array([one for one, _ in parts])
    share = np.array([part for _, (part, _) in parts])
    length_m = np.array([length for _, (_, length) in parts])
    tail, head = network.tail[of], network.head[of]
    lat, lon = (values[tail] + share * (values[head] - values[tail]) for values in (network.lat, network.lon))
    calm = field.covariance(lat, lon, wind.weights(lat, lon), wind.site_lat, wind.site_lon)
    return Pieces(of, share, length_m, calm)


def _parts(length_m: float) -> list[tuple[float, float]]:
    """Middles, as shares of a segment, and lengths of its pieces."""
    count = max(round(length_m / PIECE_M), 1)
    return [((k + 0.5) / count, length_m / count) for k in range(count)]


def _delay_s(
    problem: Problem, first: int, flights: NDArray[np.float64], spread: NDArray[np.float64], left: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much later a flight gets there that was turned, s; `flights` are rows of a schedule, `left` is what they have left without the error."""
    share = problem.parameters.online.turned_share
    leaves = flights[:, SOC_TAKE_OFF]
    used = np.maximum(share * (leaves - problem.reserve), 0.0)
    away_s = used / problem.soc_per_s
    # What it met it meets again, as far as that has not faded: the charge is raised by it, up to a full battery.
    met = np.maximum(left, 0.0) + spread
    node = int(problem.network.tail[first])
    if not problem.has_pads(node):
        return np.asarray(away_s)
    curve_s, curve_soc = problem.curve(node)
    more = np.clip(curve_soc[-1] - leaves, 0.0, spread)
    charged_s = np.interp(leaves + more, curve_soc, curve_s) - np.interp(leaves - used, curve_soc, curve_s)
    bears = np.maximum(left, 0.0) + more
    lasts = np.maximum(met / np.maximum(bears, 0.1 * met + 1e-9), 1.0)
    faded_s = problem.scenario.field_error.tau_s * np.log(lasts)
    return np.asarray(away_s + np.maximum(charged_s, faded_s))


def _turned_outcome(answer: RobustAnswer, turned: NDArray[np.float64], delay_s: NDArray[np.float64]) -> Outcome:
    """The outcome of a plan whose flights are turned with these chances and arrive so much later then."""
    runs: OutOfSample = answer.out_of_sample
    rng = np.random.default_rng((answer.policy.problem.request.seed, _TURNED))
    later_s = np.where(rng.random(turned.shape) < turned, delay_s, 0.0).sum(axis=1)
    arrives = np.isfinite(runs.schedule[:, -1, TOUCH_DOWN])
    return replace(answer.outcome, arrival_s=answer.outcome.arrival_s + later_s[arrives])
