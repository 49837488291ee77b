"""What one drone draws under its package, over airspeed and climb, as it was flown: what is weighed after the release need not be flown alike.

Power is a sum of three terms of the model in `weighing`: hover, what airspeed takes away or adds, and climb. Their coefficients are learnt from all of
the flight under the package, in cells of like airspeed and climb; what a drone has not shown of itself stays near the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from statistics import fmean
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Terms = tuple[float, float, float]
"""Hover, airspeed and climb: power in units of that of hover without a package, by the model."""

_CELL_MPS, _CELL_CLIMB_MPS = 1.0, 0.5
_CELL_SIGMA, _SECOND_SIGMA = 0.015, 0.04
"""Standard deviations of power, relative: of a cell, however long it was flown, and of a second in it."""
_PRIOR = 0.3
"""Standard deviation of what airspeed and climb take, relative to the model."""
_BORROWED_SIGMA = 0.03
"""That of the power of a take-off of which only the gain over the model is known."""
_ROUNDS = 5


@dataclass(frozen=True, slots=True)
class Fitted:
    """Power by the three terms, W, and how well it is known."""

    watts: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def expected_w(self, terms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Power with the package at each row of terms."""
        return np.asarray(terms @ self.watts)

    def error(self, terms: NDArray[np.float64]) -> float:
        """Standard deviation, relative, of the mean over the rows."""
        mean = (terms / self.expected_w(terms)[:, None]).mean(axis=0)
        return math.sqrt(max(float(mean @ self.covariance @ mean), 0.0))


@dataclass(slots=True)
class OwnPower:
    """The flight of one drone under its package, in cells of like airspeed and climb."""

    _cells: dict[tuple[int, int], list[float]] = field(default_factory=dict)
    """Samples, seconds, the newest second, and sums of power and of each term."""

    def hear(self, time_s: float, power_w: float, terms: Terms, flown: tuple[float, float]) -> None:
        """Take a sample; `flown` is its airspeed and climb, m/s."""
        key = round(flown[0] / _CELL_MPS), round(flown[1] / _CELL_CLIMB_MPS)
        cell = self._cells.setdefault(key, [0.0, 0.0, -math.inf, 0.0, 0.0, 0.0, 0.0])
        second = math.floor(time_s)
        if second != cell[2]:
            cell[1], cell[2] = cell[1] + 1.0, second
        cell[0] += 1.0
        for k, value in enumerate((power_w, *terms)):
            cell[3 + k] += value

    def fit(self, gains: Sequence[float]) -> Fitted | None:
        """Fit the three coefficients; cells that do not agree with the others count less. Without any, `gains` of take-offs will do."""
        rows = [[*(one / cell[3] for one in cell[4:]), cell[1]] for cell in self._cells.values()]
        if not rows and not gains:
            return None
        table = np.array(rows or [[1.0 / fmean(gains), 0.0, 0.0, 1.0]])
        shares, seconds = table[:, :3], table[:, 3]
        sigma = np.hypot(_CELL_SIGMA, _SECOND_SIGMA / np.sqrt(seconds)) if rows else np.array([_BORROWED_SIGMA])
        weight, watts = np.ones(len(shares)), 1.0 / float(np.median(shares.sum(axis=1)))
        for _ in range(_ROUNDS):
            spread = sigma / np.sqrt(weight)
            near_model = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]) / (_PRIOR * watts)
            left = np.vstack([shares / spread[:, None], near_model])
            covariance = np.linalg.inv(left.T @ left)
            found = covariance @ left.T @ np.concatenate([1.0 / spread, [0.0, 0.0]])
            away = np.abs(shares @ found - 1.0) / sigma
            weight, watts = 1.0 / np.maximum(away, 1.0), float(found[0])
        return Fitted(found, covariance)
