"""Verification of forecasts against observations by lead time, and the learnt error.

Bias and root mean square error (RMSE) of the speed are of the mean of the members' speeds, since the average of their vectors lets winds from different sides cancel;
the RMSE of a component is of the mean vector. The CRPS (continuous ranked probability score) is of all members, for one course the
mean absolute error. Spread is the standard deviation of the members about their mean, to be compared with the RMSE of a component.

The learnt model is EMOS for each component: the observation is Gaussian about the mean without its bias, with the variance c + d S^2 of the ensemble's
variance S^2, where c and d minimise the CRPS.

Sources: T. Gneiting, A. E. Raftery, A. H. Westveld, T. Goldman, "Calibrated Probabilistic Forecasting Using Ensemble Model Output Statistics and Minimum
CRPS Estimation", Mon. Wea. Rev. 133 (2005), 1098-1118, equations 2 and 5; H. Hersbach, "Decomposition of the Continuous Ranked Probability Score for
Ensemble Prediction Systems", Wea. Forecasting 15 (2000), 559-570; V. Fortin and others, "Why Should Ensemble Spread Match the RMSE of the Ensemble Mean?",
J. Hydrometeor. 15 (2014), 1708-1713 (the factor (M + 1)/M).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.error_shape import learn_shape
from skyway.models.weather.lead_error import PUBLISHED, LeadError
from skyway.models.weather.placing import Placing
from skyway.models.weather.profile import wind_at_height
from skyway.models.weather.weather import EAST, NORTH, Box, FieldKey

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from skyway.models.weather.weather import Weather
    from skyway.models.wind.estimation.field import WindObservation

LEAST_PAIRS = 20
"""Per lead: leads with fewer pairs are combined with the next one."""
PRIOR_PAIRS = 10.0
"""The published figures count as this many pairs in the average with the learnt ones."""
COPIES = 20
"""Copies of each member, on average, if members are not equally probable."""
SAME_SHARE = 1e-3
"""Probabilities that differ by less than this share are equal."""
STRETCH_COST = 0.01
"""If c and d are interchangeable, as they are if the spread hardly varies, members are stretched less and c is larger."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Forecasts of a wind, and the observations."""

    lead_s: NDArray[np.float64]
    """Shape (pairs,). From the issue to the observation."""
    issue: NDArray[np.int64]
    """Shape (pairs,). Number of the issue of a model."""
    place: NDArray[np.int64]
    """Shape (pairs,). Number of the place."""
    forecast: tuple[NDArray[np.float64], ...]
    """Of each pair (2, members): north and east, at the height of the observation."""
    observed: NDArray[np.float64]
    """Shape (pairs, 2). North and east."""
    where: NDArray[np.float64]
    """Shape (places, 2). Latitude and longitude of each place, degrees."""

    def __len__(self) -> int:
        return len(self.lead_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeadScore:
    """Scores of the forecasts of one range of leads."""

    lead_h: float
    """Mean of the pairs' leads."""
    pairs: int
    speed_bias_mps: float
    """Forecast less observed."""
    speed_rmse_mps: float
    component_rmse_mps: float
    spread_mps: float
    """Of a component; 0 for one course."""
    crps_mps: float
    """Of the speed."""
    calibrated_crps_mps: float
    """The same with the members calibrated by the error learnt from the other half of the issues; NaN with fewer than two."""


def pairs_of(weathers: Sequence[Weather], observed: Iterable[WindObservation], exponent: float) -> Pairs:
    """Compare each issue with the observations in its time. Raises an `InputError` if none match."""
    seen = sorted(observed, key=lambda one: one.time_s)
    where = np.array([(one.lat_deg, one.lon_deg) for one in seen]).reshape(-1, 2)
    places, number = np.unique(where, axis=0, return_inverse=True)
    number = number.ravel()
    time_s = np.array([one.time_s for one in seen])
    lead, issue, place, forecast, truth = [], [], [], [], []
    faults: list[InputError] = []
    for count, one in enumerate(weathers):
        one.needs_wind()
        issued_s = one.issued_s if math.isfinite(one.issued_s) else float(one.times_s[0])
        inside = np.flatnonzero((time_s >= one.times_s[0]) & (time_s <= one.times_s[-1]))
        for at in np.unique(number[inside]):
            spot = places[at : at + 1]
            try:
                placing = Placing(one, spot[:, 0], spot[:, 1], Box.around(spot[:, 0], spot[:, 1]))
            except InputError as error:
                faults.append(error)
                continue
            for row in inside[number[inside] == at]:
                values = _members(one, placing, seen[row], exponent)
                if values is None:
                    continue
                lead.append(max(seen[row].time_s - issued_s, 0.0))
                issue.append(count)
                place.append(int(at))
                forecast.append(values)
                truth.append((seen[row].north_mps, seen[row].east_mps))
    if not lead:
        if faults:
            raise faults[0]
        problem = "no observation lies in the time of a forecast"
        raise InputError(
            problem, weathers[0].name if weathers else None, remedy="give observations of the hours of the forecast"
        )
    return Pairs(np.array(lead), np.array(issue), np.array(place), tuple(forecast), np.array(truth), places)


def _members(one: Weather, placing: Placing, seen: WindObservation, exponent: float) -> NDArray[np.float64] | None:
    """(2, members) at an observation; None if the forecast has a gap."""
    after = int(np.clip(np.searchsorted(one.times_s, seen.time_s), 1, max(len(one.times_s) - 1, 1)))
    rows = [0] if len(one.times_s) == 1 else [after - 1, after]
    levels, heights = [], []
    for height in one.wind_heights_m:
        parts = [placing(one.fields[FieldKey(part, height)][:, rows])[..., 0] for part in (NORTH, EAST)]
        levels.append(parts)
        heights.append(height)
    stack = np.array(levels).swapaxes(0, 1)  # (component, height, member, time)
    whole = np.flatnonzero(np.isfinite(stack).any(axis=(0, 2, 3)))
    if not len(whole):
        return None
    height_m = seen.height_m if math.isfinite(seen.height_m) else heights[0]
    found = np.array(wind_at_height([heights[k] for k in whole], stack[0, whole], stack[1, whole], height_m, exponent))
    if len(rows) == 2:
        share = (seen.time_s - one.times_s[rows[0]]) / (one.times_s[rows[1]] - one.times_s[rows[0]])
        found = found[..., 0] if one.holds else (1.0 - share) * found[..., 0] + share * found[..., 1]
    else:
        found = found[..., 0]
    kept = np.flatnonzero(np.isfinite(found).all(axis=0))
    if one.probability is not None:
        kept = _equally_probable(kept, one.probability[kept])
    return found[:, kept] if len(kept) else None


def _equally_probable(members: NDArray[np.int64], probability: NDArray[np.float64]) -> NDArray[np.int64]:
    """Repeat members by their probability, so that all are equally probable; the same members if they are."""
    if not len(members) or np.ptp(probability) < SAME_SHARE * probability.max():
        return members
    count = COPIES * len(members)
    until = np.rint(count * np.cumsum(probability) / probability.sum()).astype(np.int64)
    return np.repeat(members, np.diff(until, prepend=0))


def crps(members: NDArray[np.float64], observed: float) -> float:
    """Continuous ranked probability score of an ensemble, equally probable, shape (members,)."""
    count, ordered = len(members), np.sort(members)
    apart = float((ordered * (2.0 * np.arange(1, count + 1) - count - 1)).sum()) / count**2
    return float(np.abs(members - observed).mean()) - apart


def gaussian_crps(error: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same for Gaussian distributions, from the distances of the observations from their means (Gneiting and others, equation 5)."""
    from scipy.special import ndtr

    z = error / sigma
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    return np.asarray(sigma * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * density - 1.0 / math.sqrt(math.pi)))


def _bins(pairs: Pairs) -> list[NDArray[np.int64]]:
    """Pairs by lead: by the hour; hours with few of them are combined."""
    hour = np.floor(pairs.lead_s / 3600.0).astype(np.int64)
    found: list[NDArray[np.int64]] = []
    waiting: list[NDArray[np.int64]] = []
    for one in np.unique(hour):
        waiting.append(np.flatnonzero(hour == one))
        if sum(len(part) for part in waiting) >= LEAST_PAIRS:
            found.append(np.concatenate(waiting))
            waiting = []
    if waiting:
        rest = np.concatenate(waiting)
        found = [*found[:-1], np.concatenate((found[-1], rest))] if found else [rest]
    return found


def scores(pairs: Pairs) -> list[LeadScore]:
    """Scores by lead."""
    half = _issue_halves(pairs)
    learnt = [
        learn(_subset(pairs, half != part), "") if (half != part).any() and (half == part).any() else None
        for part in (0, 1)
    ]
    found = []
    for rows in _bins(pairs):
        mean, variance = _moments(pairs, rows)
        error = mean - pairs.observed[rows]
        seen = np.hypot(*pairs.observed[rows].T)
        speed = np.array([np.hypot(*pairs.forecast[row]).mean() for row in rows])
        raw = [crps(np.hypot(*pairs.forecast[row]), float(truth)) for row, truth in zip(rows, seen, strict=True)]
        better = [math.nan]
        if all(one is not None for one in learnt):
            better = [
                crps(np.hypot(*_calibrated(pairs, row, learnt[half[row]])), float(truth))
                for row, truth in zip(rows, seen, strict=True)
            ]
        found.append(
            LeadScore(
                lead_h=float(pairs.lead_s[rows].mean()) / 3600.0,
                pairs=len(rows),
                speed_bias_mps=float((speed - seen).mean()),
                speed_rmse_mps=float(np.sqrt(((speed - seen) ** 2).mean())),
                component_rmse_mps=float(np.sqrt((error**2).mean())),
                spread_mps=float(np.sqrt(variance.mean())),
                crps_mps=float(np.mean(raw)),
                calibrated_crps_mps=float(np.mean(better)),
            )
        )
    return found


def learn(pairs: Pairs, source: str, height_m: float = 10.0) -> LeadError:
    """Learn the error of forecasts by lead from pairs, by EMOS in each range of leads; with few pairs it stays near the published one."""
    lead_h, sigma, bias, factor, added = [], [], [], [], []
    z, speed = np.empty((len(pairs), 2)), np.empty(len(pairs))
    always = _bias(_moments(pairs, np.arange(len(pairs)))[0] - pairs.observed, pairs.issue)
    for rows in _bins(pairs):
        mean, variance = _moments(pairs, rows)
        error = mean - pairs.observed[rows]
        own = len(rows) / (len(rows) + PRIOR_PAIRS)
        off = always + _bias(error - always, pairs.issue[rows])
        left = error - off
        c, d = _emos(left, variance)
        usual = PUBLISHED.at(PUBLISHED.sigma_mps, pairs.lead_s[rows], 0.0) ** 2
        lead_h.append(float(pairs.lead_s[rows].mean()) / 3600.0)
        sigma.append(math.sqrt(own * float((left**2).mean()) + (1.0 - own) * float(usual.mean())))
        bias.append((float(off[0]), float(off[1])))
        factor.append(math.sqrt(own * d + 1.0 - own))
        added.append(math.sqrt(own * c + (1.0 - own) * float(np.maximum(usual - variance, 0.0).mean())))
        z[rows], speed[rows] = left / max(float(np.sqrt((left**2).mean())), 1e-6), np.hypot(*mean.T)
    several = any(one.shape[1] > 1 for one in pairs.forecast)
    shape = learn_shape(z, speed, pairs.issue, pairs.place, pairs.lead_s, pairs.where)
    return LeadError(
        source=source, height_m=height_m, lead_h=tuple(lead_h), sigma_mps=tuple(sigma), bias_mps=tuple(bias),
        spread_factor=tuple(factor) if several else (), added_mps=tuple(added) if several else (), pairs=len(pairs),
        tau_s=shape.tau_s, length_m=shape.length_m, brief=shape.brief, severity=shape.severity, doubling_mps=shape.doubling_mps,
        usual_mps=float(np.sqrt((speed**2).mean())),
    )  # fmt: skip


def _emos(left: NDArray[np.float64], variance: NDArray[np.float64]) -> tuple[float, float]:
    """C and d of the variance c + d S^2 that minimise the CRPS of errors, shape (pairs, 2), of ensembles of variances (pairs,)."""
    from scipy.optimize import minimize

    total = float((left**2).mean())
    if not variance.any() or len(left) < LEAST_PAIRS:
        return total, 1.0

    def loss(roots: NDArray[np.float64]) -> float:
        sigma = np.sqrt(np.maximum(roots[0] ** 2 + roots[1] ** 2 * variance, 1e-6))[:, None]
        found = float(gaussian_crps(left, np.broadcast_to(sigma, left.shape)).mean())
        return found + STRETCH_COST * math.sqrt(total) * (float(roots[1]) ** 2 - 1.0) ** 2

    begin = np.array([math.sqrt(max(total - float(variance.mean()), 0.04 * total)), 1.0])
    best = minimize(loss, begin, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-5})
    return float(best.x[0] ** 2), float(best.x[1] ** 2)


def _moments(pairs: Pairs, rows: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ensemble means (pairs, 2), and variances of a component (pairs,), as an observation would have them."""
    mean = np.array([pairs.forecast[row].mean(axis=1) for row in rows])
    variance = []
    for row in rows:
        count = pairs.forecast[row].shape[1]
        variance.append(
            float(pairs.forecast[row].var(axis=1, ddof=1).mean()) * (count + 1) / count if count > 1 else 0.0
        )
    return mean, np.array(variance)


def _calibrated(pairs: Pairs, row: int, error: LeadError | None) -> NDArray[np.float64]:
    """Members of a pair, calibrated, (2, members): stretched about their mean without its bias, and spread by quantiles of the added error."""
    from scipy.special import ndtri

    values = pairs.forecast[row]
    if error is None:
        return values
    lead = pairs.lead_s[row : row + 1]
    off = np.array([error.at(tuple(pair[part] for pair in error.bias_mps), lead, 0.0)[0] for part in (0, 1)])
    mean = values.mean(axis=1, keepdims=True) - off[:, None]
    count = max(values.shape[1], 40)
    extra = error.at(error.added_mps or error.sigma_mps, lead, 0.0)[0]
    level = (np.arange(count) + 0.5) / count
    rng = np.random.default_rng(row)
    noise = np.stack([extra * ndtri(rng.permutation(level)) for _ in range(2)])
    spread = error.at(error.spread_factor, lead, 1.0)[0] * (values - values.mean(axis=1, keepdims=True))
    return np.asarray(mean + spread[:, np.arange(count) % values.shape[1]] + noise)


def _issue_halves(pairs: Pairs) -> NDArray[np.int64]:
    """Every other issue, or, of one issue, every other place: the error learnt in one half is tested in the other."""
    which = pairs.issue if len(np.unique(pairs.issue)) > 1 else pairs.place
    order = np.unique(which, return_inverse=True)[1].ravel()
    return np.asarray(order % 2)


def _subset(pairs: Pairs, chosen: NDArray[np.bool_]) -> Pairs:
    rows = np.flatnonzero(chosen)
    return Pairs(
        pairs.lead_s[rows],
        pairs.issue[rows],
        pairs.place[rows],
        tuple(pairs.forecast[row] for row in rows),
        pairs.observed[rows],
        pairs.where,
    )


def _bias(error: NDArray[np.float64], issue: NDArray[np.int64]) -> NDArray[np.float64]:
    """Bias, shape (2,): the mean, shrunk by the sampling error of the number of issues (W. James and C. Stein, 1961)."""
    mean = error.mean(axis=0)
    _, number, count = np.unique(issue, return_inverse=True, return_counts=True)
    if len(count) < 2:
        return np.asarray(mean * len(error) / (len(error) + PRIOR_PAIRS))
    each = np.stack([np.bincount(number.ravel(), error[:, part]) for part in (0, 1)], axis=1) / count[:, None]
    chance = each.var(axis=0, ddof=1) / len(count)
    return np.asarray(mean * np.maximum(1.0 - chance / np.maximum(mean**2, 1e-12), 0.0))
