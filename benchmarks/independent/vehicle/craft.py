"""Motion of drones in small steps, all runs at once: heading to hold the track, ground speed, climb, descent, and energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.independent.vehicle.energy import Power
    from benchmarks.independent.weather.profile import PowerLaw, Stability
    from benchmarks.independent.weather.turbulence import Gusts
    from benchmarks.independent.weather.wind import TrueWind

STEP_S = 4.0
MEAN_EVERY = 5
"""The slow wind is asked for once in so many steps."""
SLOWEST_MPS = 0.5
"""A drone that the wind drives back creeps on."""
MOST_S = 5400.0
"""Nobody flies longer than that: by then every battery is empty."""


@dataclass(frozen=True, eq=False)
class Air:
    """Everything that blows on the runs."""

    wind: TrueWind
    profile: Stability | PowerLaw
    height_m: float

    def aloft(
        self, xy: NDArray[np.float64], elapsed_s: NDArray[np.float64], clock_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Mean wind at flight height, shape (runs, 2); `clock_s` is the time of the record."""
        low = self.wind.at(xy, elapsed_s)
        speed = np.hypot(low[:, 0], low[:, 1])
        return np.asarray(low * self.profile.factor(clock_s, speed, self.height_m)[:, None])


@dataclass(frozen=True)
class Flying:
    """How a drone flies."""

    airspeed_mps: float
    max_ground_mps: float
    climb_mps: float
    descent_mps: float
    height_m: float

    @property
    def climb_s(self) -> float:
        """From take-off to flight height."""
        return self.height_m / self.climb_mps

    @property
    def descent_s(self) -> float:
        """From flight height to touch-down."""
        return self.height_m / self.descent_mps


@dataclass(frozen=True, eq=False)
class Cruise:
    """What became of a straight flight; each array has shape (runs,) or (runs, 2).

    Attributes
    ----------
    took_s, energy_j : ndarray
        Time and energy from one end to the other.
    wind : ndarray
        Mean wind that the drone met, as it measures it.
    """

    took_s: NDArray[np.float64]
    energy_j: NDArray[np.float64]
    wind: NDArray[np.float64]


def triangle(
    wind: NDArray[np.float64], course: NDArray[np.float64], airspeed_mps: float, max_ground_mps: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ground speed along a course that is held, and the airspeed flown: (runs,) each.

    The velocity through the air is the one of length `airspeed_mps` whose sum with the wind has no part across the course. Where the ground
    would pass too fast the drone flies slower through the air; where the wind across is too strong it holds the course no more.
    """
    along = (wind * course).sum(axis=1)
    across = wind[:, 1] * course[:, 0] - wind[:, 0] * course[:, 1]
    forward = np.sqrt(np.maximum(airspeed_mps**2 - across**2, 0.0))
    ground = np.minimum(along + forward, max_ground_mps)
    airspeed = np.hypot(ground - along, across)
    return np.maximum(ground, SLOWEST_MPS), np.minimum(airspeed, np.maximum(airspeed_mps, np.abs(across)))


def cruise(
    air: Air,
    gusts: Gusts,
    power: Power,
    how: Flying,
    ends: tuple[NDArray[np.float64], NDArray[np.float64]],
    elapsed_s: NDArray[np.float64],
    clock_s: NDArray[np.float64],
    middle: NDArray[np.float64],
) -> Cruise:
    """Fly every run straight from one place to another at flight height.

    Parameters
    ----------
    ends : tuple of ndarray, shape (runs, 2)
        From where, and to where; who does not fly stays at its place.
    elapsed_s, clock_s : ndarray, shape (runs,)
        When each begins, since the start of its wind, and by the clock of the record.
    middle : ndarray, shape (runs, 2)
        Of the segment that this is a piece of, for winds that are the same all along one.
    """
    begin, end = ends
    length = np.linalg.norm(end - begin, axis=1)
    course = (end - begin) / np.maximum(length, 1e-9)[:, None]
    gone, took, energy = np.zeros(len(begin)), np.zeros(len(begin)), np.zeros(len(begin))
    met = np.zeros((len(begin), 2))
    mean = np.zeros((len(begin), 2))
    step = 0
    while True:
        busy = (gone < length - 1e-6) & (took < MOST_S)
        if not busy.any():
            break
        if step % MEAN_EVERY == 0:
            place = middle if air.wind.by_segment else begin + course * gone[:, None]
            mean = air.aloft(place, elapsed_s + took, clock_s + took)
        speed = np.hypot(mean[:, 0], mean[:, 1])
        unit = np.where(speed[:, None] > 1e-9, mean / np.maximum(speed, 1e-9)[:, None], [1.0, 0.0])
        gust = gusts.step(np.full(len(begin), how.airspeed_mps * STEP_S), speed, STEP_S)
        left = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
        wind = mean + unit * gust[:, :1] + left * gust[:, 1:]
        ground, airspeed = triangle(wind, course, how.airspeed_mps, how.max_ground_mps)
        dt = np.where(busy, np.minimum(STEP_S, (length - gone) / ground), 0.0)
        energy += power(airspeed, 0.0) * dt
        met += wind * dt[:, None]
        gone += ground * dt
        took += dt
        step += 1
    return Cruise(took, energy, met / np.maximum(took, 1e-9)[:, None])
