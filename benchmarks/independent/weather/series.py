"""The true wind at the sites between their reports: steps, straight lines, or a bridge with an f^-5/3 spectrum.

Each passes exactly through every report at the time at which it was observed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.weather.reports import Site

Between = Literal["steps", "lines", "spectrum"]
GRID_S = 60.0
HOUR_S = 3600.0


def hourly_change_mps(site: Site) -> float:
    """Root mean square change of a component from one report to the next, an hour later."""
    apart = np.abs(np.diff(site.time_s) - HOUR_S) < 1.0
    change = np.diff(site.wind, axis=0)[apart]
    return float(np.sqrt(np.mean(change**2)))


def coloured(rng: np.random.Generator, points: int, columns: int, change_mps: float) -> NDArray[np.float64]:
    """Noise with an f^-5/3 spectrum every `GRID_S`, shape (points, columns), whose mean square change in an hour is given."""
    whole = 1 << (2 * points - 1).bit_length()
    number = np.arange(1, whole // 2)
    power = number ** (-5.0 / 3.0)
    turn = 2.0 * np.pi * number * HOUR_S / GRID_S / whole
    scale = change_mps / np.sqrt(np.sum(power * (1.0 - np.cos(turn))) * 2.0)
    modes = np.zeros((whole // 2 + 1, columns), dtype=complex)
    drawn = rng.standard_normal((2, len(number), columns))
    modes[1 : whole // 2] = (drawn[0] + 1j * drawn[1]) * (scale * np.sqrt(power))[:, None] * whole / 2.0
    return np.fft.irfft(modes, whole, axis=0)[:points]


class SiteWinds:
    """True wind at every site, for each run.

    Parameters
    ----------
    sites : sequence of Site
    between : Between
    start_s : ndarray, shape (runs,)
        POSIX seconds of the record at which the series of each run begins; on a whole minute.
    hours : float
        How long they are.
    rngs : list of Generator
        One for each run.
    """

    def __init__(
        self,
        sites: Sequence[Site],
        between: Between,
        start_s: NDArray[np.float64],
        hours: float,
        rngs: list[np.random.Generator],
    ) -> None:
        if np.any(start_s % GRID_S):
            raise ValueError("a series begins on a whole minute")
        self.between = between
        points = int(hours * HOUR_S / GRID_S) + 1
        self.wind = np.empty((len(start_s), points, len(sites), 2))
        for column, site in enumerate(sites):
            change = hourly_change_mps(site) if between == "spectrum" else 0.0
            for run, begin in enumerate(start_s.tolist()):
                grid = begin + GRID_S * np.arange(points)
                if between == "steps":
                    at = np.searchsorted(site.time_s, grid, side="right") - 1
                    self.wind[run, :, column] = site.wind[np.maximum(at, 0)]
                    continue
                self.wind[run, :, column] = lines(site.time_s, site.wind, grid)
                if between == "spectrum":
                    self.wind[run, :, column] += bridge(site.time_s, grid, rngs[run], change)

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Wind at the sites so long after the start, shape (runs, sites, 2)."""
        run = np.arange(len(self.wind))
        place = np.clip(elapsed_s / GRID_S, 0.0, self.wind.shape[1] - 1.001)
        k = np.floor(place + 1e-9).astype(np.int64)
        if self.between == "steps":
            return np.asarray(self.wind[run, k])
        part = (place - k)[:, None, None]
        return np.asarray((1.0 - part) * self.wind[run, k] + part * self.wind[run, k + 1])


def lines(time_s: NDArray[np.float64], wind: NDArray[np.float64], grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Straight lines through reports, shape (points, 2)."""
    return np.stack([np.interp(grid, time_s, wind[:, axis]) for axis in (0, 1)], axis=-1)


def bridge(
    time_s: NDArray[np.float64], grid: NDArray[np.float64], rng: np.random.Generator, change_mps: float
) -> NDArray[np.float64]:
    """Coloured noise less the straight lines through its own values at the reports: 0 at each of them."""
    inside = (time_s >= grid[0]) & (time_s <= grid[-1])
    noise = coloured(rng, len(grid), 2, change_mps)
    if not inside.any():
        return noise - noise[:1]
    knots = time_s[inside]
    return noise - lines(knots, lines(grid, noise, knots), grid)
