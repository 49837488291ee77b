"""The distribution of the wind in one slot at one place, in bins of speed and direction.

This is the paper's "probability distribution of wind speed and direction in a time slot": the marginal of an
ensemble. Each occupied bin keeps its probability and the mean vector of the members in it, so that the mean
wind is not changed by the binning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.wind.ensemble import WindEnsemble

SECTORS = 16
"""Sectors of direction; the first is centred on north."""
SPEED_EDGES_MPS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, math.inf)
"""Edges of the bins of speed; a bin holds its lower edge."""
_PLACES_AT_ONCE = 8192


@dataclass(frozen=True, slots=True, eq=False)
class WindMarginal:
    """Winds that may blow in one slot at one place.

    Attributes
    ----------
    probability : ndarray, shape (bins,)
        Of each occupied bin; sums to 1.
    north, east : ndarray, shape (bins,)
        Mean vector TOWARDS of the members in the bin, m/s.
    """

    probability: NDArray[np.float64]
    north: NDArray[np.float64]
    east: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.probability)


@dataclass(frozen=True, slots=True, eq=False)
class WindMarginals:
    """Winds that may blow at many places; a place with fewer bins is filled up with probability 0.

    Attributes
    ----------
    probability, north, east : ndarray, shape (places, bins)
        As in `WindMarginal`; each row of probabilities sums to 1, occupied bins first.
    """

    probability: NDArray[np.float64]
    north: NDArray[np.float64]
    east: NDArray[np.float64]

    def at(self, place: int) -> WindMarginal:
        """Return the marginal of one place."""
        used = self.probability[place] > 0.0
        return WindMarginal(self.probability[place, used], self.north[place, used], self.east[place, used])


@dataclass(frozen=True, slots=True, eq=False)
class WindRose:
    """How often the wind blows from where and how strongly.

    Attributes
    ----------
    sector_from_deg : ndarray, shape (sectors,)
        Middle of each sector, where the wind comes FROM.
    speed_edges_mps : ndarray, shape (speeds + 1,)
        The last may be infinite.
    probability : ndarray, shape (sectors, speeds)
        Together with `calm` it sums to 1.
    calm : float
        Probability of no wind at all, which has no direction.
    """

    sector_from_deg: NDArray[np.float64]
    speed_edges_mps: NDArray[np.float64]
    probability: NDArray[np.float64]
    calm: float


def marginal(
    ensemble: WindEnsemble,
    slot: int,
    lat: float,
    lon: float,
    *,
    sectors: int = SECTORS,
    speed_edges_mps: Sequence[float] = SPEED_EDGES_MPS,
) -> WindMarginal:
    """Return the distribution of the wind in one slot at one place.

    An ensemble of one member gives its vector with probability 1.
    """
    north, east = ensemble.wind_at(lat, lon, slot)
    places = marginals(
        north[:, None], east[:, None], ensemble.probability, sectors=sectors, speed_edges_mps=speed_edges_mps
    )
    return places.at(0)


def marginals(
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    probability: NDArray[np.float64],
    *,
    sectors: int = SECTORS,
    speed_edges_mps: Sequence[float] = SPEED_EDGES_MPS,
) -> WindMarginals:
    """Return the distributions of the wind at many places.

    Parameters
    ----------
    north, east : ndarray, shape (members, places)
        Vectors TOWARDS, m/s, finite.
    probability : ndarray, shape (members,)
        Of each member.
    sectors : int
        Sectors of direction, the first centred on north.
    speed_edges_mps : sequence of float
        Rising from 0; speeds above the last edge count in the last bin. Calm is in the first sector of the
        first bin.

    Raises
    ------
    InputError
        No sectors, or edges that do not rise from 0.
    """
    _check_bins(sectors, speed_edges_mps)
    blocks = [
        _block(north[:, first:last], east[:, first:last], probability, sectors, speed_edges_mps)
        for first in range(0, north.shape[1], _PLACES_AT_ONCE)
        for last in (first + _PLACES_AT_ONCE,)
    ]
    width = max((block.shape[2] for block in blocks), default=0)
    padded = [np.pad(block, ((0, 0), (0, 0), (0, width - block.shape[2]))) for block in blocks]
    whole = np.concatenate(padded, axis=1) if padded else np.zeros((3, 0, 0))
    return WindMarginals(whole[0], whole[1], whole[2])


def _block(
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    probability: NDArray[np.float64],
    sectors: int,
    edges: Sequence[float],
) -> NDArray[np.float64]:
    """Probability, north and east of the occupied bins, shape (3, places, bins)."""
    places = north.shape[1]
    bins = sectors * (len(edges) - 1)
    sector, speed, _ = _bin(north, east, sectors, edges)
    cell = (np.arange(places) * bins + sector * (len(edges) - 1) + speed).ravel()
    weight = np.broadcast_to(probability[:, None], north.shape)
    mass, north_sum, east_sum = (
        np.bincount(cell, weights=part.ravel(), minlength=places * bins).reshape(places, bins)
        for part in (weight, weight * north, weight * east)
    )
    used = mass > 0.0
    width = int(used.sum(axis=1).max(initial=0))
    order = np.argsort(~used, axis=1, kind="stable")[:, :width]
    mass, north_sum, east_sum = (np.take_along_axis(part, order, axis=1) for part in (mass, north_sum, east_sum))
    divisor = np.where(mass > 0.0, mass, 1.0)
    return np.stack((mass, north_sum / divisor, east_sum / divisor))


def rose(
    north: ArrayLike,
    east: ArrayLike,
    probability: ArrayLike | None = None,
    *,
    sectors: int = SECTORS,
    speed_edges_mps: Sequence[float] = SPEED_EDGES_MPS,
) -> WindRose:
    """Return the table of a wind rose.

    Parameters
    ----------
    north, east : array_like
        Vectors TOWARDS of any shape, m/s; NaN is left out.
    probability : array_like or None
        Weight of each vector, broadcast to their shape; None is equal weights.
    sectors, speed_edges_mps
        As in `marginals`.

    Raises
    ------
    InputError
        No wind at all, no sectors, or edges that do not rise from 0.
    """
    _check_bins(sectors, speed_edges_mps)
    north, east = (np.asarray(part, dtype=np.float64) for part in (north, east))
    weight = np.broadcast_to(1.0 if probability is None else np.asarray(probability, np.float64), north.shape)
    known = np.isfinite(north) & np.isfinite(east)
    weight = weight[known]
    if not weight.sum() > 0.0:
        raise InputError("there is no wind for a wind rose")
    weight = weight / weight.sum()
    sector, speed, calm = _bin(north[known], east[known], sectors, speed_edges_mps)
    speeds = len(speed_edges_mps) - 1
    table = np.bincount((sector * speeds + speed)[~calm], weights=weight[~calm], minlength=sectors * speeds)
    return WindRose(
        sector_from_deg=np.arange(sectors) * 360.0 / sectors,
        speed_edges_mps=np.asarray(speed_edges_mps, dtype=np.float64),
        probability=table.astype(np.float64).reshape(sectors, speeds),
        calm=float(weight[calm].sum()),
    )


def _check_bins(sectors: int, edges: Sequence[float]) -> None:
    if sectors < 1 or len(edges) < 2 or edges[0] != 0.0 or not np.all(np.diff(edges) > 0.0):
        raise InputError("a wind distribution needs a sector and edges of speed that rise from 0")


def _bin(
    north: NDArray[np.float64], east: NDArray[np.float64], sectors: int, edges: Sequence[float]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Sector and speed bin of vectors, and whether they are calm (then sector 0)."""
    speed, direction = speed_from(north, east)
    width = 360.0 / sectors
    sector = np.floor(direction / width + 0.5).astype(np.int64) % sectors
    number = np.searchsorted(np.asarray(edges[1:-1]), speed, side="right").astype(np.int64)
    return sector, number, speed == 0.0
