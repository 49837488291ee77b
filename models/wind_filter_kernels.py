"""The wind filter's recursion over a whole log: the same arithmetic as `models.wind_filter`, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from models.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
    variance = sigma_mps * sigma_mps
    north = east = 0.0
    nn, ne, ee = variance, 0.0, variance
    rejected, first_s, sum_n, sum_e = 0, 0.0, 0.0, 0.0
    for row in range(len(time_s)):
        if row == 0:
            north, east = forecast[0, 0], forecast[0, 1]
        else:
            keep = math.exp(-max(time_s[row] - time_s[row - 1], 0.0) / tau_s)
            north = forecast[row, 0] + keep * (north - forecast[row, 0])
            east = forecast[row, 1] + keep * (east - forecast[row, 1])
            keep *= keep
            nn = keep * nn + (1.0 - keep) * variance
            ne = keep * ne
            ee = keep * ee + (1.0 - keep) * variance
        miss_n, miss_e = wind[row, 0] - north, wind[row, 1] - east
        s_nn, s_ne, s_ee = nn + noise[row, 0], ne + noise[row, 1], ee + noise[row, 2]
        det = s_nn * s_ee - s_ne * s_ne
        value = (s_ee * miss_n * miss_n - 2.0 * s_ne * miss_n * miss_e + s_nn * miss_e * miss_e) / det
        nis[row] = value
        use = value <= gate
        if not use and value == value:  # noqa: PLR0124  false for NaN
            if rejected == 0:
                first_s, sum_n, sum_e = time_s[row], 0.0, 0.0
            rejected += 1
            sum_n += miss_n
            sum_e += miss_e
            if rejected >= patience_count and time_s[row] - first_s >= patience_s:
                mean_n, mean_e = sum_n / rejected, sum_e / rejected
                nn += mean_n * mean_n
                ne += mean_n * mean_e
                ee += mean_e * mean_e
                s_nn, s_ne, s_ee = nn + noise[row, 0], ne + noise[row, 1], ee + noise[row, 2]
                det = s_nn * s_ee - s_ne * s_ne
                use = True
        accepted[row] = use
        if use:
            rejected = 0
            gain_nn, gain_ne = (nn * s_ee - ne * s_ne) / det, (ne * s_nn - nn * s_ne) / det
            gain_en, gain_ee = (ne * s_ee - ee * s_ne) / det, (ee * s_nn - ne * s_ne) / det
            north += gain_nn * miss_n + gain_ne * miss_e
            east += gain_en * miss_n + gain_ee * miss_e
            new_nn = nn - gain_nn * nn - gain_ne * ne
            new_ne = ne - gain_nn * ne - gain_ne * ee
            new_ee = ee - gain_en * ne - gain_ee * ee
            nn, ne, ee = new_nn, new_ne, new_ee
        estimate[row, 0], estimate[row, 1] = north, east
        covariance[row, 0], covariance[row, 1], covariance[row, 2] = nn, ne, ee
