"""The wind filter once more: its recursion over a whole log, compiled, thousands of times faster than `WindFilter`.

It serves the tests that need hundreds of flights, and is the second opinion that `WindFilter` (filterpy) is held against.

State x = (slow wind (north, east), gust (north, east), systematic errors b_1 ... b_k), covariance P. The slow wind
returns to the forecast m, gusts and errors to 0, each as an Ornstein-Uhlenbeck process of time constant tau_i and
variance V_i, whose solution over a step of d seconds is exact. A measurement z of the wind with covariance R sees the
sum of the two winds and the errors by its sensitivity B:

    predict   x <- m + K (x - m),  P <- K P K + (I - K^2) V,     K = diag(exp(-d / tau_i))
    innovate  y = z - H x,  S = H P H' + R,                       H = [I I B]
    gate      nis = y' S^-1 y;  use z if nis <= gate (`_persuaded`: or if rejected for too long)
    update    G = P H' S^-1,  x <- x + G y,  P <- P - G H P

A sensor with a scale c and an offset o of the heading measures the air velocity scaled and turned; the state then holds
the wind scaled and turned likewise, s = c Q(o) w with Q(o) the turn by o, in which the measurement is linear
(`models.wind.estimation.systematic`), and what is told is w = Q(-o) s / c.

Sources: Kalman, "A new approach to linear filtering and prediction problems" (1960); Bar-Shalom, Li and Kirubarajan,
"Estimation with Applications to Tracking and Navigation" (2001), sections 2.9 (gating) and 5.4.
"""

import math

import numba
import numpy as np

from skyway.models.wind.estimation.filter import FilteredWind, WindFilterSettings
from skyway.models.wind.estimation.systematic import MIN_SCALE, TAU_S, Dependence

compiled = numba.njit(cache=True, error_model="numpy")
REJECTED, FIRST_S, SUM_N, SUM_E = range(4)
"""Places in the memory of rejections: how many in a row, time of the first, sum of their innovations."""
SLOW, GUST, SYSTEMATIC = 0, 2, 4
"""Places in the state: the slow wind (north, east), the gust about it, and the systematic errors of the
measurements."""


@compiled
def _predict(
    x,
    p,
    target,
    keep,
    variance,
):
    """Let each state return to its mean by the share that is not kept: x <- m + K (x - m), P <- K P K + (I - K^2) V.

    `target` is m of the slow wind, m/s; `keep` the diagonal of K and `variance` that of V, shape (states,).
    """
    for row in range(len(x)):
        mean = target[row] if row < GUST else 0.0
        x[row] = mean + keep[row] * (x[row] - mean)
        for column in range(len(x)):
            p[row, column] *= keep[row] * keep[column]
        p[row, row] += (1.0 - keep[row] * keep[row]) * variance[row]


@compiled
def _see(
    p,
    sensitivity,
    noise,
    seen,
    total,
):
    """Fill in P H' and S = H P H' + R of a measurement with H = [I I B].

    `sensitivity` is B, shape (2, k); `noise` is R and `total` S, as north-north, north-east, east-east, m2/s2; `seen`
    is P H', shape (states, 2).
    """
    # P H': columns of the slow wind and of the gust, and of the errors by B.
    for row in range(len(p)):
        for part in range(2):
            seen[row, part] = p[row, part] + p[row, GUST + part]
            for error in range(sensitivity.shape[1]):
                seen[row, part] += p[row, SYSTEMATIC + error] * sensitivity[part, error]
    # S: rows of the two winds, and then those of the errors by B.
    total[0] = seen[0, 0] + seen[2, 0] + noise[0]
    total[1] = seen[0, 1] + seen[2, 1] + noise[1]
    total[2] = seen[1, 1] + seen[3, 1] + noise[2]
    for error in range(sensitivity.shape[1]):
        total[0] += sensitivity[0, error] * seen[SYSTEMATIC + error, 0]
        total[1] += sensitivity[0, error] * seen[SYSTEMATIC + error, 1]
        total[2] += sensitivity[1, error] * seen[SYSTEMATIC + error, 1]


@compiled
def _persuaded(
    memory,
    p,
    miss,
    time_s,
    patience_s,
    patience_count,
):
    """Count a rejection; after too many of them in a row widen the covariance of the slow wind.

    P_slow <- P_slow + e e', e the mean innovation of those rejected, m/s: rejected for so long and so often, the filter
    is wrong. `memory` has shape (4,), by the names of its places in this module; `miss` is y.
    """
    # The first of them in a row.
    if memory[REJECTED] == 0.0:
        memory[FIRST_S], memory[SUM_N], memory[SUM_E] = time_s, 0.0, 0.0
    memory[REJECTED] += 1.0
    memory[SUM_N] += miss[0]
    memory[SUM_E] += miss[1]
    if memory[REJECTED] < patience_count or time_s - memory[FIRST_S] < patience_s:
        return False
    # Enough of them: e, and e e'.
    mean_n, mean_e = memory[SUM_N] / memory[REJECTED], memory[SUM_E] / memory[REJECTED]
    p[0, 0] += mean_n * mean_n
    p[0, 1] += mean_n * mean_e
    p[1, 0] += mean_n * mean_e
    p[1, 1] += mean_e * mean_e
    return True


@compiled
def _scaling(x, scale, turn):
    """Return c cos o and c sin o of the sensor in use; `scale` and `turn` are its errors, -1 for none."""
    size = max(1.0 + x[SYSTEMATIC + scale], MIN_SCALE) if scale >= 0 else 1.0
    angle = x[SYSTEMATIC + turn] if turn >= 0 else 0.0
    return size * math.cos(angle), size * math.sin(angle)


@compiled
def _tell(
    x,
    p,
    scale,
    turn,
    estimate,
    covariance,
):
    """Fill in the wind w = Q(-o) s / c and its covariance J P J', J the derivative of w by the state.

    dw/ds = Q(-o) / c, dw/dc = -w / c, dw/do = w turned left by 90 degrees: (east, -north). `estimate` is (north, east),
    m/s; `covariance` north-north, north-east, east-east, m2/s2.
    """
    # w, from s = slow wind + gust.
    cosine, sine = _scaling(x, scale, turn)
    square = cosine * cosine + sine * sine
    s_north, s_east = x[0] + x[GUST], x[1] + x[GUST + 1]
    north, east = (cosine * s_north + sine * s_east) / square, (cosine * s_east - sine * s_north) / square
    # J.
    slope = np.zeros((2, len(x)))
    for first in (0, GUST):
        slope[0, first], slope[0, first + 1] = cosine / square, sine / square
        slope[1, first], slope[1, first + 1] = -sine / square, cosine / square
    if scale >= 0:
        size = math.sqrt(square)
        slope[0, SYSTEMATIC + scale] -= north / size
        slope[1, SYSTEMATIC + scale] -= east / size
    if turn >= 0:
        slope[0, SYSTEMATIC + turn] += east
        slope[1, SYSTEMATIC + turn] -= north
    # J P J'.
    estimate[0], estimate[1] = north, east
    covariance[:] = 0.0
    for row in range(len(x)):
        for column in range(len(x)):
            covariance[0] += slope[0, row] * p[row, column] * slope[0, column]
            covariance[1] += slope[0, row] * p[row, column] * slope[1, column]
            covariance[2] += slope[1, row] * p[row, column] * slope[1, column]


@compiled
def _update(
    x,
    p,
    miss,
    seen,
    total,
):
    """Take a measurement: with the gain G = P H' S^-1, x <- x + G y, P <- P - G (P H')'."""
    det = total[0] * total[2] - total[1] * total[1]
    for row in range(len(x)):
        north = (seen[row, 0] * total[2] - seen[row, 1] * total[1]) / det
        east = (seen[row, 1] * total[0] - seen[row, 0] * total[1]) / det
        x[row] += north * miss[0] + east * miss[1]
        for column in range(len(x)):
            p[row, column] -= north * seen[column, 0] + east * seen[column, 1]


@compiled
def run_filter(
    time_s,
    wind,
    noise,
    forecast,
    sensitivity,
    scale,
    turn,
    systematic_sigma,
    settings,
    estimate,
    covariance,
    nis,
    accepted,
):
    """Run the filter over measurements in the order of time. O(n states^2).

    Takes arrays of these shapes, finite ascending times and a finite forecast;
    `models.wind.estimation.filter.filter_log` checks them.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        POSIX seconds.
    wind : ndarray, shape (n, 2)
        z: measured, m/s (north, east) TOWARDS; NaN predicts only.
    noise : ndarray, shape (n, 3)
        R of each: north-north, north-east, east-east, m2/s2.
    forecast : ndarray, shape (n, 2)
        m: what the wind reverts to, m/s.
    sensitivity : ndarray, shape (n, 2, k)
        B: how each measurement depends on k systematic errors; see `models.wind.estimation.systematic`.
    scale, turn : ndarray of int, shape (n,)
        The error that scales, and the one that turns, the air velocity behind each measurement; -1 is none. The state
        holds the wind scaled and turned likewise.
    systematic_sigma : ndarray, shape (k,)
        Standard deviation of each of these.
    settings : tuple
        tau_s, sigma_mps, gust_tau_s, gust_intensity, gust_floor_mps, gate, patience_s, patience_count of
        `models.wind.estimation.filter.WindFilterSettings`.
    estimate, covariance, nis, accepted : ndarray
        Filled with the posterior (n, 2), its covariance (n, 3), the normalised innovation squared before the gate (n,)
        and whether the measurement was used (n,).
    """
    tau_s, sigma_mps, gust_tau_s, intensity, floor_mps, gate, patience_s, patience_count = settings
    errors = len(systematic_sigma)
    states = SYSTEMATIC + errors
    x, p, memory = np.zeros(states), np.zeros((states, states)), np.zeros(4)
    keep, variance = np.empty(states), np.empty(states)
    miss, total, seen = np.empty(2), np.empty(3), np.empty((states, 2))
    scaled, turned = -1, -1
    for error in range(errors):
        variance[SYSTEMATIC + error] = systematic_sigma[error] ** 2
    for row in range(len(time_s)):
        # V and K of the step; gusts go with the speed of the slow wind. At first nothing is kept, so that P = V.
        if row == 0:
            x[:GUST] = forecast[0]
        gust_mps = max(intensity * math.hypot(x[0], x[1]), floor_mps)
        variance[:GUST], variance[GUST:SYSTEMATIC] = sigma_mps**2, gust_mps**2
        step_s = max(time_s[row] - time_s[row - 1], 0.0) if row else math.inf
        keep[:GUST], keep[GUST:SYSTEMATIC] = math.exp(-step_s / tau_s), math.exp(-step_s / gust_tau_s)
        keep[SYSTEMATIC:] = math.exp(-step_s / TAU_S)
        # Predict, with the forecast scaled and turned as the state is.
        cosine, sine = _scaling(x, scaled, turned)
        north, east = forecast[row]
        _predict(x, p, (cosine * north - sine * east, sine * north + cosine * east), keep, variance)
        # Innovate: y, S.
        for part in range(2):
            miss[part] = wind[row, part] - x[part] - x[GUST + part]
            for error in range(errors):
                miss[part] -= sensitivity[row, part, error] * x[SYSTEMATIC + error]
        _see(p, sensitivity[row], noise[row], seen, total)
        # Gate: y' S^-1 y of a 2 x 2 matrix. NaN is not above the gate, and not used either.
        value = total[2] * miss[0] * miss[0] - 2.0 * total[1] * miss[0] * miss[1] + total[0] * miss[1] * miss[1]
        value /= total[0] * total[2] - total[1] * total[1]
        nis[row] = value
        use = value <= gate
        if value > gate:
            use = _persuaded(memory, p, miss, time_s[row], patience_s, patience_count)
            _see(p, sensitivity[row], noise[row], seen, total)
        accepted[row] = use
        # Update; the state is scaled and turned by the errors of the sensor that was used last.
        if use:
            memory[REJECTED] = 0.0
            _update(x, p, miss, seen, total)
            if scale[row] >= 0 and errors > 0:
                scaled, turned = scale[row], turn[row]
        _tell(x, p, scaled, turned, estimate[row], covariance[row])


def filter_log(time_s, wind, noise, forecast, settings=None, depends=None, systematic_sigma=None):
    """Run the filter over a whole log at once.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        In order.
    wind, noise : ndarray, shapes (n, 2), (n, 3)
        Measurements (NaN: none) and their covariances (north-north, north-east, east-east).
    forecast : ndarray, shape (2,) or (n, 2)
        What the wind reverts to.
    depends, systematic_sigma : Dependence, ndarray of shape (systematic.COUNT,), optional
        How the measurements depend on systematic errors, and how large these may be; by default there are none.
    """
    given = settings or WindFilterSettings()
    count = len(time_s)
    result = FilteredWind.empty(count)
    result.time_s[:] = time_s
    result.forecast[:] = forecast
    sigma = np.zeros(0) if systematic_sigma is None else systematic_sigma
    depends = Dependence.none(count, len(sigma)) if depends is None else depends
    run_filter(
        result.time_s,
        np.ascontiguousarray(wind, dtype=np.float64),
        np.ascontiguousarray(noise, dtype=np.float64),
        result.forecast,
        np.ascontiguousarray(depends.sensitivity[:, :, : len(sigma)]),
        depends.scale,
        depends.turn,
        sigma,
        (
            given.tau_s,
            given.sigma_mps,
            given.gust_tau_s,
            given.gust_intensity,
            given.gust_floor_mps,
            given.gate,
            given.patience_s,
            given.patience_count,
        ),
        result.wind,
        result.covariance,
        result.nis,
        result.accepted,
    )
    return result


def nees(course, truth):
    """Normalised estimation error squared against the true wind, shape (n,): 2 on average where all is right."""
    miss_n, miss_e = (course.wind - truth).T
    nn, ne, ee = course.covariance.T
    return (ee * miss_n**2 - 2.0 * ne * miss_n * miss_e + nn * miss_e**2) / (nn * ee - ne * ne)
