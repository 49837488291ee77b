"""The distribution of the wind in bins of speed and direction: in one slot at one place, and as a wind rose.

The former is the paper's "probability distribution of wind speed and direction in a time slot": the marginal of an
ensemble. Each occupied bin keeps its probability and the mean vector of the members in it, so that the mean
wind is not changed by the binning.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble

SECTORS = 16
"""Sectors of direction; the first is centred on north."""
SPEED_EDGES_MPS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, math.inf)
"""Edges of the bins of speed; a bin holds its lower edge. Calm is in the first bin of the first sector."""
_SPEEDS = len(SPEED_EDGES_MPS) - 1


class WindMarginal(NamedTuple):
    """Winds that may blow in one slot at one place."""

    probability: NDArray[np.float64]
    """Shape (bins,). Of each occupied bin; sums to 1."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    """Shape (bins,) each. Mean vector TOWARDS of the members in the bin, m/s."""


def marginal(ensemble: WindEnsemble, slot: int, lat: float, lon: float) -> WindMarginal:
    """Return the distribution of the wind in one slot at one place.

    An ensemble of one member gives its vector with probability 1.
    """
    north, east = ensemble.wind_at(lat, lon, slot)
    cell, _ = _bin(north, east)
    weight = ensemble.probability
    mass, north_sum, east_sum = (np.bincount(cell, weights=part) for part in (weight, weight * north, weight * east))
    used = mass > 0.0
    return WindMarginal(mass[used].astype(np.float64), north_sum[used] / mass[used], east_sum[used] / mass[used])


class WindRose(NamedTuple):
    """Wind rose: frequency of winds by direction and speed."""

    probability: NDArray[np.float64]
    """Shape (sectors, speeds). Together with `calm` it sums to 1."""
    calm: float
    """Probability of no wind at all, which has no direction."""


def rose(north: NDArray[np.float64], east: NDArray[np.float64], probability: NDArray[np.float64]) -> WindRose:
    """Return the wind rose of vectors TOWARDS, m/s, each of a probability; all of one shape."""
    cell, calm = _bin(north.ravel(), east.ravel())
    weight = probability.ravel() / probability.sum()
    table = np.bincount(cell[~calm], weights=weight[~calm], minlength=SECTORS * _SPEEDS)
    return WindRose(table.astype(np.float64).reshape(SECTORS, _SPEEDS), float(weight[calm].sum()))


def _bin(north: NDArray[np.float64], east: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Number of the bin of each vector, sector by sector, and whether it is calm (then in sector 0)."""
    speed, direction = speed_from(north, east)
    sector = np.floor(direction / (360.0 / SECTORS) + 0.5).astype(np.int64) % SECTORS
    number = np.searchsorted(np.asarray(SPEED_EDGES_MPS[1:-1]), speed, side="right").astype(np.int64)
    return sector * _SPEEDS + number, speed == 0.0
