"""Reduction of a drone's power in some stretches of its flights against the others, with its uncertainty.

The logarithm of the ratio of power to the model is a sum of unknown terms, each with its standard deviation: the efficiency of this drone; the effect of airspeed, climb
and descent; the model error at this airspeed and climb, common to similar flight; the difference between flights; and scatter. So similar stretches
are compared accurately, and others as far as the flights so far determine their differences. All terms are normal, so the best estimate of a fall is that of generalised least
squares (C. R. Rao, *Linear Statistical Inference*, 2nd ed., section 4a), and its standard deviation is known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.link.supervisor.proof.stretches import Stretch

_EFFICIENCY_SIGMA = 5.0
"""Standard deviation of an unknown efficiency: practically uninformative."""
_AIRSPEED_SIGMA, _CLIMB_SIGMA, _SINK_SIGMA = 0.3, 0.2, 0.2
"""Standard deviations of the effect of airspeed, relative to the model; and of the shares of T v of a climb (0.43
to 1, see `power_units`) and of a descent (0 to 0.6)."""
_MODEL_SIGMA, _LIKE_AIRSPEED_MPS, _LIKE_CLIMB_MPS = 0.02, 4.0, 1.5
"""Remaining relative model error; and its correlation lengths in airspeed and climb."""
_FLIGHT_SIGMA, _STRETCH_SIGMA, _SECOND_SIGMA = 0.006, 0.008, 0.03
"""Standard deviation between flights; between stretches; and of a second, at least."""


class Balance:
    """Stretches of flight, ready to be compared."""

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        mean = np.array([one.mean for one in stretches], dtype=np.float64)
        flight = np.array([one.flight for one in stretches])
        seconds, spread = np.array([(one.seconds, one.spread) for one in stretches], dtype=np.float64).T
        _, log_ratio, airspeed, climb, sink, self._package, airspeed_mps, climb_mps, _ = mean.T
        covariance = np.full((len(mean), len(mean)), _EFFICIENCY_SIGMA**2)
        for share, sigma in ((airspeed, _AIRSPEED_SIGMA), (climb, _CLIMB_SIGMA), (sink, _SINK_SIGMA)):
            covariance += sigma**2 * np.outer(share, share)
        apart = _apart(airspeed_mps, _LIKE_AIRSPEED_MPS) + _apart(climb_mps, _LIKE_CLIMB_MPS)
        covariance += _MODEL_SIGMA**2 * np.exp(-0.5 * apart)
        covariance += _FLIGHT_SIGMA**2 * (flight[:, None] == flight)
        covariance += np.diag(_STRETCH_SIGMA**2 + np.maximum(_SECOND_SIGMA, spread) ** 2 / seconds)
        self._root = np.linalg.cholesky(covariance)
        self._white = np.linalg.solve(self._root, log_ratio - log_ratio.mean())

    def drops(self, where: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Drop in power where a column has it, and its standard deviation, in units of the package's share of power; shape (columns,) each."""
        lighter = np.linalg.solve(self._root, -self._package[:, None] * where)
        precision = np.sum(lighter * lighter, axis=0)
        return (lighter.T @ self._white) / precision, 1.0 / np.sqrt(precision)


def _apart(values: NDArray[np.float64], like: float) -> NDArray[np.float64]:
    """Squared distances between all stretches, in units of the correlation lengths."""
    return np.asarray(((values[:, None] - values) / like) ** 2)
