"""Gusts that a drone meets along its way: frozen turbulence as a sum of harmonics, or, for comparison, our own assumption.

Both give, for each run, the gust along and across the mean wind, m/s, averaged over a time step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

HARMONICS = 40
ROUGHNESS_M = 0.1, 1.0
LENGTH_M = 100.0, 350.0
LATERAL = 0.75
"""Standard deviation across the wind as a share of that along it (Panofsky and Dutton 1984)."""


class Gusts(Protocol):
    """Gusts of one flight of each run."""

    def step(self, path_m: NDArray[np.float64], mean_mps: NDArray[np.float64], dt_s: float) -> NDArray[np.float64]:
        """Mean gust over a step in which so many metres of air are passed, shape (runs, 2); to be called step by step."""


def longitudinal(wave: NDArray[np.float64], length_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Von Karman spectrum along the wind for a variance of 1, one-sided, m, over wave numbers in rad/m."""
    return 2.0 * length_m / np.pi / (1.0 + (1.339 * length_m * wave) ** 2) ** (5.0 / 6.0)


def lateral(wave: NDArray[np.float64], length_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same across the wind; its length is half of that along it."""
    x = (1.339 * length_m * wave) ** 2  # (2 x 1.339 x half the length x wave) ** 2
    return length_m / np.pi * (1.0 + 8.0 / 3.0 * x) / (1.0 + x) ** (11.0 / 6.0)


class Harmonics:
    """Frozen von Karman turbulence of intensity 1 / ln(z / z0), with random phases, roughness and length.

    Parameters
    ----------
    rngs : list of Generator
        One for each run.
    height_m : float
        Of the flight.
    """

    def __init__(self, rngs: list[np.random.Generator], height_m: float) -> None:
        runs = len(rngs)
        drawn = np.array([rng.random(2) for rng in rngs]).reshape(runs, 2)
        low, high = np.log(ROUGHNESS_M)
        self.intensity = 1.0 / np.log(height_m / np.exp(low + (high - low) * drawn[:, 0]))
        length = LENGTH_M[0] + (LENGTH_M[1] - LENGTH_M[0]) * drawn[:, 1]
        edges = np.geomspace(2.0 * np.pi / 20_000.0, 2.0 * np.pi / 5.0, HARMONICS + 1)
        jitter = np.array([rng.random(HARMONICS) for rng in rngs])
        self.wave = edges[:-1] * (edges[1:] / edges[:-1]) ** jitter
        width = np.diff(edges)
        both = longitudinal(self.wave, length[:, None]), LATERAL**2 * lateral(self.wave, length[:, None])
        self.amplitude = np.sqrt(2.0 * np.stack(both, axis=1) * width)  # (runs, 2, harmonics)
        self.phase = np.array([rng.uniform(0.0, 2.0 * np.pi, (2, HARMONICS)) for rng in rngs])
        self.passed_m = np.zeros(runs)

    def step(self, path_m: NDArray[np.float64], mean_mps: NDArray[np.float64], dt_s: float) -> NDArray[np.float64]:
        """See `Gusts`; a harmonic averaged over a path p is one in its middle times sin(k p / 2) / (k p / 2)."""
        del dt_s
        middle = self.passed_m + 0.5 * path_m
        self.passed_m = self.passed_m + path_m
        smooth = np.sinc(self.wave * path_m[:, None] / (2.0 * np.pi))
        angle = (self.wave * middle[:, None])[:, None] + self.phase
        shape = (self.amplitude * np.cos(angle) * smooth[:, None]).sum(axis=2)
        return np.asarray((self.intensity * mean_mps)[:, None] * shape)


class Relaxing:
    """The product's own assumption: an Ornstein-Uhlenbeck process of 180 s and 15 % (12 % across), held for 30 s."""

    TIME_S, SHARE, HOLD_S, MOST = 180.0, np.array([0.15, 0.12]), 30.0, 3.0

    def __init__(self, rngs: list[np.random.Generator]) -> None:
        self.rngs = rngs
        self.state = np.array([rng.standard_normal(2) for rng in rngs]).reshape(len(rngs), 2)
        self.age_s = 0.0

    def step(self, path_m: NDArray[np.float64], mean_mps: NDArray[np.float64], dt_s: float) -> NDArray[np.float64]:
        """See `Gusts`."""
        del path_m
        if self.age_s >= self.HOLD_S:
            keep = math.exp(-self.HOLD_S / self.TIME_S)
            fresh = np.array([rng.standard_normal(2) for rng in self.rngs])
            self.state = keep * self.state + math.sqrt(1.0 - keep * keep) * fresh
            self.age_s = 0.0
        self.age_s += dt_s
        return np.asarray(np.clip(self.state, -self.MOST, self.MOST) * self.SHARE * mean_mps[:, None])
