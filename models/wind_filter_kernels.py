"""The wind filter's recursion over a whole log: the same arithmetic as `models.wind_filter`, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray


NORTH, EAST, NN, NE, EE, REJECTED, FIRST_S, SUM_N, SUM_E = range(9)
"""Places in the state: wind, its covariance; rejections in a row, time of the first, sum of their innovations."""
STATE_SIZE = 9


@compiled
def _predict(state: NDArray[np.float64], north: float, east: float, keep: float, variance: float) -> None:
    """Let the wind return to the forecast by the share that is not kept."""
    state[NORTH] = north + keep * (state[NORTH] - north)
    state[EAST] = east + keep * (state[EAST] - east)
    keep *= keep
    state[NN] = keep * state[NN] + (1.0 - keep) * variance
    state[NE] = keep * state[NE]
    state[EE] = keep * state[EE] + (1.0 - keep) * variance


@compiled
def _nis(state: NDArray[np.float64], miss_n: float, miss_e: float, noise: NDArray[np.float64]) -> float:
    """Normalised innovation squared."""
    s_nn, s_ne, s_ee = state[NN] + noise[0], state[NE] + noise[1], state[EE] + noise[2]
    value = s_ee * miss_n * miss_n - 2.0 * s_ne * miss_n * miss_e + s_nn * miss_e * miss_e
    return float(value / (s_nn * s_ee - s_ne * s_ne))


@compiled
def _persuaded(
    state: NDArray[np.float64], miss_n: float, miss_e: float, time_s: float, patience_s: float, patience_count: int
) -> bool:
    """Count a rejection; after too many of them in a row widen the covariance."""
    if state[REJECTED] == 0.0:
        state[FIRST_S], state[SUM_N], state[SUM_E] = time_s, 0.0, 0.0
    state[REJECTED] += 1.0
    state[SUM_N] += miss_n
    state[SUM_E] += miss_e
    if state[REJECTED] < patience_count or time_s - state[FIRST_S] < patience_s:
        return False
    mean_n, mean_e = state[SUM_N] / state[REJECTED], state[SUM_E] / state[REJECTED]
    state[NN] += mean_n * mean_n
    state[NE] += mean_n * mean_e
    state[EE] += mean_e * mean_e
    return True


@compiled
def _update(state: NDArray[np.float64], miss_n: float, miss_e: float, noise: NDArray[np.float64]) -> None:
    """Take a measurement."""
    nn, ne, ee = state[NN], state[NE], state[EE]
    s_nn, s_ne, s_ee = nn + noise[0], ne + noise[1], ee + noise[2]
    det = s_nn * s_ee - s_ne * s_ne
    gain_nn, gain_ne = (nn * s_ee - ne * s_ne) / det, (ne * s_nn - nn * s_ne) / det
    gain_en, gain_ee = (ne * s_ee - ee * s_ne) / det, (ee * s_nn - ne * s_ne) / det
    state[NORTH] += gain_nn * miss_n + gain_ne * miss_e
    state[EAST] += gain_en * miss_n + gain_ee * miss_e
    state[NN] = nn - gain_nn * nn - gain_ne * ne
    state[NE] = ne - gain_nn * ne - gain_ne * ee
    state[EE] = ee - gain_en * ne - gain_ee * ee
    state[REJECTED] = 0.0


@compiled
def run_filter(
    time_s: NDArray[np.float64],
    wind: NDArray[np.float64],
    noise: NDArray[np.float64],
    forecast: NDArray[np.float64],
    tau_s: float,
    sigma_mps: float,
    gate: float,
    patience_s: float,
    patience_count: int,
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
    tau_s, sigma_mps, gate, patience_s, patience_count
        As in `models.wind_filter.WindFilterSettings`.
    estimate, covariance, nis, accepted : ndarray
        Filled with the posterior (n, 2), its covariance (n, 3), the normalised innovation squared before the gate (n,)
        and whether the measurement was used (n,).
    """
    state = np.zeros(STATE_SIZE)
    variance = sigma_mps * sigma_mps
    state[NN] = state[EE] = variance
    for row in range(len(time_s)):
        if row == 0:
            state[NORTH], state[EAST] = forecast[0, 0], forecast[0, 1]
        else:
            keep = math.exp(-max(time_s[row] - time_s[row - 1], 0.0) / tau_s)
            _predict(state, forecast[row, 0], forecast[row, 1], keep, variance)
        miss_n, miss_e = wind[row, 0] - state[NORTH], wind[row, 1] - state[EAST]
        value = _nis(state, miss_n, miss_e, noise[row])
        nis[row] = value
        use = value <= gate
        if value > gate:
            use = _persuaded(state, miss_n, miss_e, time_s[row], patience_s, patience_count)
        accepted[row] = use
        if use:
            _update(state, miss_n, miss_e, noise[row])
        estimate[row] = state[NORTH : EAST + 1]
        covariance[row] = state[NN : EE + 1]
