"""Errors of wind forecasts by lead time, and members with such errors.

A forecast without members, or with members that are too close together, gets courses about it with an error that keeps its
sign for hours and over tens of kilometres, as forecast errors do, with the size that they have at each lead. A part of it is independent
at each hour and place; and some issues are worse than others: the size of each course is log-normal, its mean square that of the lead.

Sources of `PUBLISHED`: PredictWind, "Model Validation Technical Report" (82,000 comparisons on land: the mean absolute error of ECMWF's wind speed is 2.6 kn
on day 1, which is 1.7 m/s root mean square for a Gaussian error); meteo.matrunich.com/benchmark (2026, 30 days: root mean square errors of the
speed at 10 m of twelve models of 1.5 to 2.6 m/s). They give no hourly values: a growth of the error by `GROWTH_MPS_DAY` a day is assumed.
Members: T. Gneiting and others, "Calibrated Probabilistic Forecasting Using Ensemble Model Output Statistics and Minimum CRPS Estimation",
Mon. Wea. Rev. 133 (2005), 1098-1118; B. Van Schaeybroeck and S. Vannitsem, "Ensemble post-processing using member-by-member approaches",
Q. J. R. Meteorol. Soc. 141 (2015), 807-818: each member keeps its course, its distance from the mean is stretched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import read_text
from skyway.models.base.formatting import speed_text
from skyway.models.base.json_text import json_text
from skyway.models.weather.error_shape import between_nodes, in_wind
from skyway.models.wind.estimation.field import ResidualModel

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SCHEMA = "skyway.forecast-error/1"
PUBLISHED_MPS = 1.6
GROWTH_MPS_DAY = 0.3
MOST_MPS = 3.5
"""Upper bound of the error: the standard deviation of a component of the wind itself."""
AT_M = 10.0
MAX_BYTES = 1_000_000
_RESIDUAL = ResidualModel()


class LeadError(msgspec.Struct, frozen=True, kw_only=True):
    """The error of forecasts by lead time, for the height of the observations from which it was learnt."""

    schema: str = SCHEMA
    source: str
    """Source of the figures, for people."""
    height_m: float
    lead_h: tuple[float, ...]
    """Ascending; before the first and after the last, the nearest value holds."""
    sigma_mps: tuple[float, ...]
    """Standard deviation of a component of the wind about the forecast's mean, without bias, in usual wind."""
    bias_mps: tuple[tuple[float, float], ...] = ()
    """(north, east) of the forecast, to be subtracted; empty: none."""
    spread_factor: tuple[float, ...] = ()
    """Factor of the members' distance from their mean; empty: 1."""
    added_mps: tuple[float, ...] = ()
    """Standard deviation of a component that is added to each member; empty: the difference to `sigma_mps`."""
    tau_s: float = _RESIDUAL.tau_s
    """Time in which errors fade."""
    length_m: float = _RESIDUAL.length_m
    """Distance over which they fade."""
    brief: float = 0.0
    """Share of the variance that is independent at each hour and place."""
    severity: float = 0.0
    """Standard deviation of the logarithm of the size of an issue's errors."""
    doubling_mps: float = 0.0
    """Wind in which the variance is twice that in calm air (`error_shape`); 0: it does not depend on the wind."""
    usual_mps: float = 0.0
    """The usual wind, root mean square."""
    pairs: int = 0
    """Forecasts compared with observations; 0: from publications."""

    def at(self, values: tuple[float, ...], lead_s: NDArray[np.float64], otherwise: float) -> NDArray[np.float64]:
        """One of the series at leads, shape (leads,)."""
        if not values:
            return np.full(len(lead_s), otherwise)
        return np.asarray(np.interp(lead_s / 3600.0, self.lead_h, values))

    def in_wind(self, speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Size of errors in a wind over that in the usual one."""
        square = in_wind(self.doubling_mps, speed_mps) / in_wind(self.doubling_mps, np.array(self.usual_mps))
        return np.asarray(np.sqrt(square))


PUBLISHED = LeadError(
    source="published figures (docs/reference/files.md#forecast-errors)",
    height_m=AT_M,
    lead_h=(0.0, 24.0, 24.0 * (MOST_MPS - PUBLISHED_MPS) / GROWTH_MPS_DAY),
    sigma_mps=(PUBLISHED_MPS, PUBLISHED_MPS + GROWTH_MPS_DAY, MOST_MPS),
)


def read_lead_error(path: Path) -> LeadError:
    """Read a file of errors, as ``skyway weather verify -o`` writes it. Raises an `InputError` with its problem."""
    remedy = "write one with skyway weather verify FORECAST --observed FILE -o FILE.json"
    text = read_text(path, max_bytes=MAX_BYTES)
    try:
        found = msgspec.json.decode(text, type=LeadError)
    except (msgspec.ValidationError, msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"is not a file of forecast errors: {error}", str(path), remedy=remedy) from error
    count = len(found.lead_h)
    numbers = [
        *found.lead_h,
        *found.sigma_mps,
        *found.spread_factor,
        *found.added_mps,
        *(one for pair in found.bias_mps for one in pair),
    ]
    sound = (
        found.schema == SCHEMA
        and count > 0
        and len(found.sigma_mps) == count
        and all(len(one) in (0, count) for one in (found.bias_mps, found.spread_factor, found.added_mps))
        and all(math.isfinite(one) for one in numbers)
        and all(low < high for low, high in zip(found.lead_h, found.lead_h[1:], strict=False))
        and all(0.0 < one <= 30.0 for one in found.sigma_mps)
        and all(0.0 <= one <= 30.0 for one in (*found.spread_factor, *found.added_mps))
        and 0.0 < found.height_m <= 1000.0
        and 0.0 < found.tau_s <= 30 * 86_400.0
        and 0.0 < found.length_m <= 1e7
        and 0.0 <= found.brief <= 1.0
        and 0.0 <= found.severity <= 1.0
        and 0.0 <= found.doubling_mps <= 1000.0
        and 0.0 <= found.usual_mps <= 100.0
    )
    if not sound:
        raise InputError(Fault("figures are missing, or cannot be", str(path), remedy=remedy))
    return found


def lead_error_text(error: LeadError) -> str:
    """Return the file of errors."""
    return json_text(error, indent=1)


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """Wind series of one model, shape (members, slots, places) each, and a note on added errors."""

    north: NDArray[np.float64]
    east: NDArray[np.float64]
    each: int
    """This many in a row are of one member."""
    note: str


def with_errors(
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    lead_s: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    error: LeadError,
    *,
    factor: float,
    slot_s: float,
    members: int,
    seed: int,
    lattice: tuple[int, int] | None = None,
) -> Courses:
    """Add the typical error of such forecasts to courses.

    Parameters
    ----------
    north, east : ndarray, shape (members, slots, places)
        As forecast.
    Since the issue.
        From the issue on.
    distance_m : ndarray, shape (places, places)
        Between the places.
    error : LeadError
        Size of the error.
    factor : float
        Of the wind at the height of the courses over that at the height of the errors.
    slot_s : float
        Length of a slot.
    members : int
        Approximate number of courses, the same number for each member; never fewer than there are members.
    seed : int
        Of the random numbers.
    lattice : tuple of int, optional
        Rows and columns of the places, between which the wind is interpolated: errors that reach far are larger at the nodes by as much as interpolation takes off, so that
        they are right on average over the region. The independent part at each hour and place is not enlarged: over a leg it averages out, too.
    """
    given = len(north)
    sigma = factor * error.at(error.sigma_mps, lead_s, 0.0)
    if error.bias_mps:
        off = [factor * error.at(tuple(pair[part] for pair in error.bias_mps), lead_s, 0.0) for part in (0, 1)]
        north, east = north - off[0][None, :, None], east - off[1][None, :, None]
    stretch = error.at(error.spread_factor, lead_s, 1.0)[None, :, None]
    mean = north.mean(axis=0), east.mean(axis=0)
    size = error.in_wind(np.hypot(*mean) / factor)  # (slots, places)
    wanted = sigma[:, None] * size
    variance = np.zeros(north.shape[1:])
    if given > 1:
        north, east = (middle + stretch * (part - middle) for part, middle in zip((north, east), mean, strict=True))
        variance = 0.5 * (north.var(axis=0, ddof=1) + east.var(axis=0, ddof=1))
        missing = np.sqrt(np.maximum(wanted**2 - variance, 0.0))
        if error.added_mps:
            missing = factor * error.at(error.added_mps, lead_s, 0.0)[:, None] * size
        each = max(round(members / given), 1) if missing.any() else 1
        note = "its members are spread so far that they err as such forecasts do"
    else:
        missing = wanted
        each = max(2 * (members // 2), 2) if wanted.any() else 1
        note = "its one course is given errors"
    north, east = np.repeat(north, each, axis=0), np.repeat(east, each, axis=0)
    kept = 1.0 if lattice is None else between_nodes(distance_m, lattice, error.length_m)
    noise = _noise(given, each, north.shape[1:], distance_m, error, slot_s, seed, kept)
    note = f"{note}: {error.source}, {speed_text(float(wanted[0].mean()))} a component at first"
    return Courses(north + missing * noise[0], east + missing * noise[1], each, note)


def _noise(
    given: int,
    each: int,
    shape: tuple[int, ...],
    distance_m: NDArray[np.float64],
    error: LeadError,
    slot_s: float,
    seed: int,
    kept: float,
) -> NDArray[np.float64]:
    """Errors of mean square 1, correlated in space and time, shape (2, members, slots, places); the far-reaching part is larger by the variance lost in interpolation.

    They come in pairs of opposite sign: the mean of the courses made of one member is the member's course. Of a single course the pairs are half the members apart, so that
    every second member, which plans select from many, also forms pairs.
    """
    slots, places = shape
    rng = np.random.default_rng(seed)
    alike = np.exp(-distance_m / error.length_m) + 1e-9 * np.eye(places)
    root = np.linalg.cholesky(alike)
    count = given * each
    half = (count + 1) // 2
    fresh = rng.standard_normal((slots, 2, half, places)) @ root.T
    keep = math.exp(-slot_s / error.tau_s)
    found = np.empty_like(fresh)
    found[0] = fresh[0]
    for slot in range(1, slots):
        found[slot] = keep * found[slot - 1] + math.sqrt(1.0 - keep**2) * fresh[slot]
    found /= math.sqrt(kept)
    if error.brief > 0.0:
        found = math.sqrt(1.0 - error.brief) * found + math.sqrt(error.brief) * rng.standard_normal(found.shape)
    if error.severity > 0.0:
        found *= _sizes(half, error.severity, rng)[:, None]
    if given == 1:
        both = np.concatenate((found, -found), axis=2)
    else:
        both = np.stack((found, -found), axis=3).reshape(slots, 2, -1, places)
    return np.moveaxis(both[:, :, :count], 0, 2)


def _sizes(count: int, severity: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Sizes of errors, log-normal, of mean square 1, in any order, shape (count,)."""
    from scipy.special import ndtri

    found = np.exp(severity * ndtri((rng.permutation(count) + 0.5) / count))
    return np.asarray(found / np.sqrt((found**2).mean()))
