"""Structure of forecast errors, learnt from forecasts and observations: dependence on wind, and correlation in time, over distance, and within an issue.

Errors are larger in strong wind: the effect of a wind that is a tenth too strong, turned by ten degrees or early by half an hour grows with the wind. Their variance is
a + b s^2 of the forecast speed s. The error relative to that size correlates by

    (1 - brief) exp(-d / length) exp(-t / tau)

between places a distance d and times t apart; `brief` is the share that is independent at each hour and place, including the report's own error. The spread of the size between issues follows from the
fourth moment: a Gaussian error whose size is log-normal with the standard deviation w of its logarithm has the kurtosis 3 exp(4 w^2).

Sources: S. Lerch and T. L. Thorarinsdottir, "Comparison of non-homogeneous regression models for probabilistic wind speed forecasting", Tellus A 65 (2013), 21206 (variance
and wind); N. Cressie, "Statistics for Spatial Data" (1993), section 2.4 (covariance functions, nugget); D. F. Andrews and C. L. Mallows, "Scale mixtures of normal
distributions", J. R. Statist. Soc. B 36 (1974), 99-102.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.geodesy import inverse
from skyway.models.wind.estimation.field import ResidualModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAST_PAIRS, LEAST_ISSUES = 200, 8
"""With fewer, the structure of errors is not learnt."""
LONGEST_H = 12
"""Errors up to this time apart in one issue are compared."""
TAU_H = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 12.0, 18.0, 24.0, 36.0)
LENGTH_KM = (10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 90.0, 140.0, 200.0, 300.0, 500.0)
MOST_BRIEF, MOST_SEVERITY = 0.6, 0.6
FEW_PLACES = 12
"""Largest number of places of an issue that are compared with each other: the first ones."""
_USUAL = ResidualModel()


@dataclass(frozen=True, slots=True)
class ErrorShape:
    """Structure of errors; the defaults are those of all forecasts if nothing was learnt."""

    doubling_mps: float = 0.0
    """Speed at which the variance is twice that in calm air; 0: it does not depend on the wind."""
    tau_s: float = _USUAL.tau_s
    length_m: float = _USUAL.length_m
    brief: float = 0.0
    severity: float = 0.0


def in_wind(doubling_mps: float, speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance in wind of a speed over that in calm air; 1 where it does not depend on the wind."""
    if not doubling_mps > 0.0:
        return np.ones_like(speed_mps)
    return np.asarray(1.0 + (speed_mps / doubling_mps) ** 2)


def between_nodes(distance_m: NDArray[np.float64], lattice: tuple[int, int], length_m: float) -> float:
    """Mean variance of errors between the nodes of a lattice, where they are interpolated bilinearly, over that at the nodes.

    The mean of errors at the corners of a cell, which differ, is smaller. `distance_m` is of the nodes, row by row.
    """
    alike = np.exp(-distance_m / length_m)
    node = np.arange(len(distance_m)).reshape(lattice)
    sides = [min(count, 2) for count in lattice]
    corners = np.stack(
        [
            node[row : lattice[0] - sides[0] + 1 + row, column : lattice[1] - sides[1] + 1 + column].ravel()
            for row in range(sides[0])
            for column in range(sides[1])
        ]
    )
    weights = [np.ones((1, 1)) if side == 1 else np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0 for side in sides]
    both = np.kron(weights[0], weights[1])  # mean of the products of bilinear weights over a cell
    cells = alike[corners[:, None], corners[None]].mean(axis=2)
    return float((both * cells).sum())


def learn_shape(
    error: NDArray[np.float64],
    speed_mps: NDArray[np.float64],
    issue: NDArray[np.int64],
    place: NDArray[np.int64],
    lead_s: NDArray[np.float64],
    where: NDArray[np.float64],
) -> ErrorShape:
    """Learn the structure of errors.

    Parameters
    ----------
    error : ndarray, shape (pairs, 2)
        Forecast less observed, without bias, over the standard deviation of its lead.
    speed_mps, issue, place, lead_s : ndarray, shape (pairs,)
        Forecast wind, number of the issue, number of the place, and the time since the issue.
    where : ndarray, shape (places, 2)
        Latitude and longitude, degrees.
    """
    if len(error) < LEAST_PAIRS or len(np.unique(issue)) < LEAST_ISSUES:
        return ErrorShape()
    doubling = _doubling(error, speed_mps)
    left = error / np.sqrt(in_wind(doubling, speed_mps))[:, None]
    left = left / math.sqrt(float((left**2).mean()))
    tau_h, length_m, alike = _correlation(left, issue, place, lead_s, where)
    kurtosis = float((left**4).mean())
    severity = math.sqrt(max(math.log(kurtosis / 3.0), 0.0) / 4.0)
    return ErrorShape(doubling, tau_h * 3600.0, length_m, 1.0 - alike, min(severity, MOST_SEVERITY))


def _doubling(error: NDArray[np.float64], speed_mps: NDArray[np.float64]) -> float:
    """Speed at which the variance a + b s^2 is twice a, by least squares weighted by the variance that the fit itself expects."""
    square = (error**2).mean(axis=1)
    design = np.stack((np.ones_like(speed_mps), speed_mps**2), axis=1)
    weight = np.ones_like(square)
    calm, more = float(square.mean()), 0.0
    for _ in range(5):
        fit = np.linalg.lstsq(design * weight[:, None], square * weight, rcond=None)[0]
        calm, more = max(float(fit[0]), 0.1 * float(square.mean())), max(float(fit[1]), 0.0)
        weight = 1.0 / (calm + more * speed_mps**2)
    return math.sqrt(calm / more) if more * float((speed_mps**2).mean()) > 0.05 * calm else 0.0


def _correlation(
    left: NDArray[np.float64],
    issue: NDArray[np.int64],
    place: NDArray[np.int64],
    lead_s: NDArray[np.float64],
    where: NDArray[np.float64],
) -> tuple[float, float, float]:
    """(tau in hours, length in metres, 1 - brief) that fit the products of errors of one issue best."""
    used = np.unique(place)[:FEW_PLACES]
    apart_m, _ = inverse(where[:, None, 0], where[:, None, 1], where[None, :, 0], where[None, :, 1])
    count = np.zeros((LONGEST_H + 1, len(used), len(used)))
    total = np.zeros_like(count)
    for one in np.unique(issue):
        rows = np.flatnonzero((issue == one) & np.isin(place, used))
        at = np.searchsorted(used, place[rows])
        hours = np.round(np.abs(lead_s[rows, None] - lead_s[None, rows]) / 3600.0).astype(np.int64)
        product = 0.5 * left[rows] @ left[rows].T
        near = np.triu(hours <= LONGEST_H, 1)
        first, second = np.nonzero(near)
        np.add.at(count, (hours[near], at[first], at[second]), 1.0)
        np.add.at(total, (hours[near], at[first], at[second]), product[near])
    known = count > 0.0
    hour, first, second = np.nonzero(known)
    weight = count[known]
    seen = total[known] / weight
    distance_m = apart_m[used[first], used[second]]
    best = (math.inf, _USUAL.tau_s / 3600.0, _USUAL.length_m, 1.0)
    several = bool((distance_m > 1.0).any())
    for tau_h in TAU_H:
        for length_m in [1000.0 * one for one in LENGTH_KM] if several else [_USUAL.length_m]:
            shape = np.exp(-hour / tau_h - distance_m / length_m)
            alike = float((weight * shape * seen).sum() / (weight * shape**2).sum())
            alike = min(max(alike, 1.0 - MOST_BRIEF), 1.0)
            loss = float((weight * (seen - alike * shape) ** 2).sum())
            best = min(best, (loss, tau_h, length_m, alike))
    return best[1:]
