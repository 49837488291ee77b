"""Wind at flight height from wind at 10 m: a power law whose exponent changes with stability and time of day.

By day convection mixes (0.10 to 0.18), in clear nights with little wind the layers part (0.20 to 0.45), in strong wind the air is
neutral at any hour (0.14 to 0.22). Where in its range the exponent lies is drawn, and drifts over hours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

DAY, NIGHT, NEUTRAL = (0.10, 0.18), (0.20, 0.45), (0.14, 0.22)
DRIFT_S = 4 * 3600.0
GRID_S = 600.0
MEASURED_M = 10.0
CALM_MPS, STRONG_MPS = 3.0, 7.0
"""Below the first the stability is that of the time of day, above the second it is neutral."""
SUNRISE_H, SUNSET_H, TWILIGHT_H = 6.5, 18.5, 1.0


class Stability:
    """Exponents of each run over time.

    Parameters
    ----------
    rngs : list of Generator
        One for each run.
    start_s : ndarray, shape (runs,)
        POSIX seconds at the beginning of each.
    hours : float
        How long.
    longitude_deg : float
        Tells the solar time.
    """

    def __init__(
        self, rngs: list[np.random.Generator], start_s: NDArray[np.float64], hours: float, longitude_deg: float
    ) -> None:
        self.start_s, self.longitude_deg = start_s, longitude_deg
        steps = int(hours * 3600.0 / GRID_S) + 2
        keep = np.exp(-GRID_S / DRIFT_S)
        noise = np.array([rng.standard_normal(steps) for rng in rngs]).reshape(len(rngs), steps)
        latent = np.empty_like(noise)
        latent[:, 0] = noise[:, 0]
        for k in range(1, steps):
            latent[:, k] = keep * latent[:, k - 1] + np.sqrt(1.0 - keep * keep) * noise[:, k]
        self.rank = ndtr(latent)

    def exponent(self, time_s: NDArray[np.float64], speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Exponent of each run, shape (runs,), where the wind at 10 m has a speed."""
        place = np.clip((time_s - self.start_s) / GRID_S, 0.0, self.rank.shape[1] - 1.001)
        k = place.astype(np.int64)
        run = np.arange(len(self.rank))
        rank = self.rank[run, k] + (place - k) * (self.rank[run, k + 1] - self.rank[run, k])
        hour = (time_s / 3600.0 + self.longitude_deg / 15.0) % 24.0
        rise = np.clip((hour - SUNRISE_H) / TWILIGHT_H, 0.0, 1.0)
        fall = np.clip((SUNSET_H - hour) / TWILIGHT_H, 0.0, 1.0)
        day = np.minimum(rise, fall)
        neutral = np.clip((speed_mps - CALM_MPS) / (STRONG_MPS - CALM_MPS), 0.0, 1.0)

        def within(span: tuple[float, float]) -> NDArray[np.float64]:
            return np.asarray(span[0] + (span[1] - span[0]) * rank)

        still = day * within(DAY) + (1.0 - day) * within(NIGHT)
        return np.asarray((1.0 - neutral) * still + neutral * within(NEUTRAL))

    def factor(
        self, time_s: NDArray[np.float64], speed_mps: NDArray[np.float64], height_m: float
    ) -> NDArray[np.float64]:
        """Ratio of the wind at a height to that at 10 m, shape (runs,)."""
        return np.asarray((height_m / MEASURED_M) ** self.exponent(time_s, speed_mps))


class PowerLaw:
    """The product's own assumption: one exponent for ever."""

    def __init__(self, exponent: float) -> None:
        self.constant = exponent

    def factor(
        self, time_s: NDArray[np.float64], speed_mps: NDArray[np.float64], height_m: float
    ) -> NDArray[np.float64]:
        """See `Stability.factor`."""
        del speed_mps
        return np.full(np.shape(time_s), (height_m / MEASURED_M) ** self.constant)
