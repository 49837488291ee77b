"""The wind filter's recursion over a whole log: the same arithmetic as `models.wind_filter`, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray


REJECTED, FIRST_S, SUM_N, SUM_E = range(4)
"""Places in the memory of rejections: how many in a row, time of the first, sum of their innovations."""
SLOW, GUST = 0, 2
"""Places in the state: the slow wind (north, east), and the gust about it."""


@compiled
def _predict(
    x: NDArray[np.float64],
    p: NDArray[np.float64],
    forecast: NDArray[np.float64],
    keep: tuple[float, float],
    sigma: tuple[float, float],
) -> None:
    """Let slow wind and gust return to forecast and calm by the shares that are not kept."""
    for row in range(4):
        kept, spread = (keep[0], sigma[0]) if row < GUST else (keep[1], sigma[1])
        target = forecast[row] if row < GUST else 0.0
        x[row] = target + kept * (x[row] - target)
        for column in range(4):
            p[row, column] *= kept * (keep[0] if column < GUST else keep[1])
        p[row, row] += (1.0 - kept * kept) * spread * spread


@compiled
def _spread(p: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Covariance of the wind, slow and gust together: north-north, north-east, east-east."""
    out[0] = p[0, 0] + 2.0 * p[0, 2] + p[2, 2]
    out[1] = p[0, 1] + p[0, 3] + p[2, 1] + p[2, 3]
    out[2] = p[1, 1] + 2.0 * p[1, 3] + p[3, 3]


@compiled
def _persuaded(
    memory: NDArray[np.float64],
    p: NDArray[np.float64],
    miss: NDArray[np.float64],
    time_s: float,
    patience_s: float,
    patience_count: int,
) -> bool:
    """Count a rejection; after too many of them in a row widen the covariance of the slow wind."""
    if memory[REJECTED] == 0.0:
        memory[FIRST_S], memory[SUM_N], memory[SUM_E] = time_s, 0.0, 0.0
    memory[REJECTED] += 1.0
    memory[SUM_N] += miss[0]
    memory[SUM_E] += miss[1]
    if memory[REJECTED] < patience_count or time_s - memory[FIRST_S] < patience_s:
        return False
    mean_n, mean_e = memory[SUM_N] / memory[REJECTED], memory[SUM_E] / memory[REJECTED]
    p[0, 0] += mean_n * mean_n
    p[0, 1] += mean_n * mean_e
    p[1, 0] += mean_n * mean_e
    p[1, 1] += mean_e * mean_e
    return True


@compiled
def _update(
    x: NDArray[np.float64], p: NDArray[np.float64], miss: NDArray[np.float64], total: NDArray[np.float64]
) -> None:
    """Take a measurement whose innovation has the covariance `total`."""
    det = total[0] * total[2] - total[1] * total[1]
    seen = np.empty((4, 2))
    gain = np.empty((4, 2))
    for row in range(4):
        seen[row, 0] = p[row, 0] + p[row, 2]
        seen[row, 1] = p[row, 1] + p[row, 3]
        gain[row, 0] = (seen[row, 0] * total[2] - seen[row, 1] * total[1]) / det
        gain[row, 1] = (seen[row, 1] * total[0] - seen[row, 0] * total[1]) / det
    for row in range(4):
        x[row] += gain[row, 0] * miss[0] + gain[row, 1] * miss[1]
        for column in range(4):
            p[row, column] -= gain[row, 0] * seen[column, 0] + gain[row, 1] * seen[column, 1]


@compiled
def run_filter(
    time_s: NDArray[np.float64],
    wind: NDArray[np.float64],
    noise: NDArray[np.float64],
    forecast: NDArray[np.float64],
    settings: tuple[float, float, float, float, float, float, float, int],
    estimate: NDArray[np.float64],
    covariance: NDArray[np.float64],
    nis: NDArray[np.float64],
    accepted: NDArray[np.bool_],
) -> None:
    """Run the filter over measurements in the order of time.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
    wind : ndarray, shape (n, 2)
        Measured, m/s (north, east) TOWARDS; NaN predicts only.
    noise : ndarray, shape (n, 3)
        Covariance of each: north-north, north-east, east-east, m2/s2.
    forecast : ndarray, shape (n, 2)
        What the wind reverts to.
    settings : tuple
        tau_s, sigma_mps, gust_tau_s, gust_intensity, gust_floor_mps, gate, patience_s, patience_count of
        `models.wind_filter.WindFilterSettings`.
    estimate, covariance, nis, accepted : ndarray
        Filled with the posterior (n, 2), its covariance (n, 3), the normalised innovation squared before the gate (n,)
        and whether the measurement was used (n,).
    """
    tau_s, sigma_mps, gust_tau_s, intensity, floor_mps, gate, patience_s, patience_count = settings
    x, p, memory = np.zeros(4), np.zeros((4, 4)), np.zeros(4)
    miss, total = np.empty(2), np.empty(3)
    for row in range(len(time_s)):
        if row == 0:
            x[:GUST] = forecast[0]
        gust_mps = max(intensity * math.hypot(x[0], x[1]), floor_mps)
        step_s = max(time_s[row] - time_s[row - 1], 0.0) if row else math.inf
        keep = (math.exp(-step_s / tau_s), math.exp(-step_s / gust_tau_s))
        _predict(x, p, forecast[row], keep, (sigma_mps, gust_mps))
        miss[0], miss[1] = wind[row, 0] - x[0] - x[2], wind[row, 1] - x[1] - x[3]
        _spread(p, total)
        total += noise[row]
        value = total[2] * miss[0] * miss[0] - 2.0 * total[1] * miss[0] * miss[1] + total[0] * miss[1] * miss[1]
        value /= total[0] * total[2] - total[1] * total[1]
        nis[row] = value
        use = value <= gate
        if value > gate:
            use = _persuaded(memory, p, miss, time_s[row], patience_s, patience_count)
            _spread(p, total)
            total += noise[row]
        accepted[row] = use
        if use:
            memory[REJECTED] = 0.0
            _update(x, p, miss, total)
        estimate[row, 0], estimate[row, 1] = x[0] + x[2], x[1] + x[3]
        _spread(p, covariance[row])
