"""The true wind at 10 m at any time and place: a random field that passes through the wind at all sites.

Between the sites it is a Gaussian field with exponential covariance, conditioned by kriging: an unconditioned field, drawn as a sum
of harmonics, is corrected by the kriged differences at the sites (Journel 1974). Its sill is that of the record, whose leave-one-out
errors it reproduces. For comparison there is the product's own assumption, inverse squares of distance at the middle of a segment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.ground import Plane
    from benchmarks.independent.weather.reports import Site
    from benchmarks.independent.weather.series import SiteWinds

Space = Literal["inverse-distance", "field"]
LENGTH_M = 10_000.0, 40_000.0
MODES = 96
USUAL_ERROR_MPS = 1.8
"""Leave-one-out error of a component at 10 m in New York (2.6 m/s at 60 m with the exponent 0.2), where a record has one site only."""
FASTEST_RAD_S = 2.0 * np.pi / 600.0
"""What changes faster is turbulence, drawn elsewhere."""


def ordinary_weights(
    sites: NDArray[np.float64], place: NDArray[np.float64], length_m: float
) -> tuple[NDArray[np.float64], float]:
    """Ordinary kriging of a place from sites, exponential covariance of sill 1: (weights, variance)."""
    count = len(sites)
    inverse = _inverse(sites, length_m)
    target = np.append(np.exp(-np.linalg.norm(sites - place, axis=1) / length_m), 1.0)
    weights = inverse @ target
    return weights[:count], float(1.0 - weights @ target)


def _inverse(sites: NDArray[np.float64], length_m: float) -> NDArray[np.float64]:
    """Inverse of the matrix of ordinary kriging, shape (sites + 1, sites + 1)."""
    count = len(sites)
    matrix = np.ones((count + 1, count + 1))
    matrix[:count, :count] = np.exp(-np.linalg.norm(sites[:, None] - sites[None], axis=2) / length_m)
    matrix[count, count] = 0.0
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


@dataclass(frozen=True)
class LeftOut:
    """Leave-one-out errors of a record.

    Attributes
    ----------
    error_mps : float
        Root mean square of a component, at the height of the instruments.
    sill_mps : float
        Standard deviation of a field with the length asked for that has these errors.
    keeps_s : float
        Correlation time of the errors.
    """

    error_mps: float
    sill_mps: float
    keeps_s: float


def leave_one_out(sites: Sequence[Site], plane: Plane, length_m: float) -> LeftOut:
    """Krige each site of a record from the others at common times; of one site, what is usual in New York."""
    if len(sites) == 1:
        return LeftOut(USUAL_ERROR_MPS, USUAL_ERROR_MPS, 2.0 * 3600.0)
    times = sites[0].time_s
    for site in sites[1:]:
        times = np.intersect1d(times, site.time_s)
    wind = np.stack([site.wind[np.searchsorted(site.time_s, times)] for site in sites], axis=1)
    xy = plane.xy([site.lat for site in sites], [site.lon for site in sites])
    errors, variances = [], []
    for out in range(len(sites)):
        others = [k for k in range(len(sites)) if k != out]
        weights, variance = ordinary_weights(xy[others], xy[out], length_m)
        errors.append(wind[:, out] - np.einsum("s,tsc->tc", weights, wind[:, others]))
        variances.append(variance)
    error = np.stack(errors)
    square = float(np.mean(error**2))
    next_hour = np.abs(np.diff(times) - 3600.0) < 1.0
    kept = float(np.mean((error[:, 1:] * error[:, :-1])[:, next_hour])) / square
    return LeftOut(square**0.5, (square / float(np.mean(variances))) ** 0.5, -3600.0 / math.log(max(kept, 0.1)))


class TrueWind(Protocol):
    """Wind at 10 m where each run is."""

    by_segment: bool
    """Asked for the middle of the segment flown instead of the place."""

    def at(self, xy: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Wind (north, east) at positions, shape (runs, 2)."""


class InverseDistance:
    """Sites weighted by the inverse square of their distance."""

    by_segment = True

    def __init__(self, sites: NDArray[np.float64], winds: SiteWinds) -> None:
        self.sites, self.winds = sites, winds

    def at(self, xy: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `TrueWind`."""
        square = np.maximum(((xy[:, None] - self.sites[None]) ** 2).sum(axis=2), 1.0)
        weight = 1.0 / square
        weight /= weight.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum("rs,rsc->rc", weight, self.winds.at(elapsed_s)))


class RandomField:
    """A Gaussian field through the sites; its length is drawn for each run.

    Parameters
    ----------
    sites : ndarray, shape (sites, 2)
    winds : SiteWinds
    told : callable
        `LeftOut` of a length.
    rngs : list of Generator
    """

    by_segment = False

    def __init__(
        self,
        sites: NDArray[np.float64],
        winds: SiteWinds,
        lengths: NDArray[np.float64],
        left_out: Sequence[LeftOut],
        rngs: list[np.random.Generator],
    ) -> None:
        self.sites, self.winds, self.length_m = sites, winds, lengths
        self.inverse = np.stack([_inverse(sites, length) for length in lengths.tolist()])
        self.sill = np.array([one.sill_mps for one in left_out])
        drawn = [
            self._modes(rng, length, one.keeps_s) for rng, length, one in zip(rngs, lengths, left_out, strict=True)
        ]
        self.wave, self.frequency, self.phase = (np.stack(part) for part in zip(*drawn, strict=True))

    @staticmethod
    def _modes(
        rng: np.random.Generator, length_m: float, keeps_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Wave numbers, frequencies and phases: the spectral distributions of exp(-d / length) and exp(-t / time)."""
        rank = (rng.permutation(MODES) + rng.random(MODES)) / MODES
        size = np.sqrt(1.0 / (1.0 - rank) ** 2 - 1.0) / length_m
        course = 2.0 * np.pi * rng.random(MODES)
        wave = np.stack((size * np.cos(course), size * np.sin(course)))
        rank = (rng.permutation(MODES) + rng.random(MODES)) / MODES
        frequency = np.clip(np.tan(np.pi * (rank - 0.5)) / keeps_s, -FASTEST_RAD_S, FASTEST_RAD_S)
        return wave, frequency, 2.0 * np.pi * rng.random((2, MODES))

    def free(self, xy: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The unconditioned field at places, shape (runs, places, 2), of `xy` (runs, places, 2)."""
        angle = np.einsum("rpc,rcm->rpm", xy, self.wave) + (self.frequency * elapsed_s[:, None])[:, None]
        cosine, sine = np.cos(angle), np.sin(angle)
        # cos(angle + phase), the phases of both components
        north = np.einsum("rpm,rm->rp", cosine, np.cos(self.phase[:, 0])) - np.einsum(
            "rpm,rm->rp", sine, np.sin(self.phase[:, 0])
        )
        east = np.einsum("rpm,rm->rp", cosine, np.cos(self.phase[:, 1])) - np.einsum(
            "rpm,rm->rp", sine, np.sin(self.phase[:, 1])
        )
        return np.asarray(np.stack((north, east), axis=-1) * (self.sill * np.sqrt(2.0 / MODES))[:, None, None])

    def at(self, xy: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `TrueWind`."""
        runs, count = len(xy), len(self.sites)
        apart = np.linalg.norm(xy[:, None] - self.sites[None], axis=2)
        target = np.concatenate((np.exp(-apart / self.length_m[:, None]), np.ones((runs, 1))), axis=1)
        weight = np.einsum("rij,rj->ri", self.inverse, target)[:, :count]
        places = np.concatenate((np.broadcast_to(self.sites, (runs, count, 2)), xy[:, None]), axis=1)
        free = self.free(places, elapsed_s)
        return np.asarray(free[:, -1] + np.einsum("rs,rsc->rc", weight, self.winds.at(elapsed_s) - free[:, :-1]))
