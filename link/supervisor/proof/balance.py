"""How much less a drone draws in some stretches of its flights than in the others, with its uncertainty.

The logarithm of power over the model's is a sum of what nobody knows beforehand, each with its standard deviation: the efficiency of this drone; how much airspeed, climb
and sinking take of it; how the model is off at this airspeed and climb, the same wherever it flies alike; what differs from flight to flight; and scatter. So stretches that were flown
alike are compared well, and others as well as the flights so far have shown what is between them. All are normal, so the best estimate of a fall is that of generalised least
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
"""As good as nothing is known."""
_AIRSPEED_SIGMA, _CLIMB_SIGMA, _SINK_SIGMA = 0.3, 0.2, 0.2
"""Of what airspeed changes, relative to the model; and of the shares of T v that climbing takes (0.43 to 1, see `power_units`) and sinking gives back (0 to 0.6)."""
_MODEL_SIGMA, _LIKE_AIRSPEED_MPS, _LIKE_CLIMB_MPS = 0.02, 4.0, 1.5
"""How the model is off besides, relative; and so far apart in airspeed and climb it is off in another way."""
_FLIGHT_SIGMA, _STRETCH_SIGMA, _SECOND_SIGMA = 0.006, 0.008, 0.03
"""Between flights; between stretches; and of a second, at least."""


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
    """Squares of the distances of all, in units of what is alike."""
    return np.asarray(((values[:, None] - values) / like) ** 2)
