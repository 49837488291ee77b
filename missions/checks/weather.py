"""Wind for mission checks: steady, or an ensemble."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.wind.estimation.field import MIN_PROFILE_M
from skyway.models.wind.triangle import height_factor, vector

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.forecast import WindEnsemble


class Weather(Protocol):
    """Wind at places and times, for each of several possible courses."""

    @property
    def probability(self) -> NDArray[np.float64]:
        """Of each member, shape (members,)."""

    def at(
        self,
        lat: NDArray[np.float64],
        lon: NDArray[np.float64],
        elapsed_s: NDArray[np.float64],
        height_m: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(north, east) towards which the air moves, shape (members, n).

        Places and heights above the ground have shape (n,), times (members, n).
        """


@dataclass(frozen=True, slots=True)
class SteadyWind:
    """One wind everywhere, at flying height."""

    speed_mps: float = 0.0
    """Metres per second."""
    from_deg: float = 0.0
    """Where it blows FROM."""

    @property
    def probability(self) -> NDArray[np.float64]:
        """Its probability, 1."""
        return np.ones(1)

    def at(
        self,
        lat: NDArray[np.float64],
        lon: NDArray[np.float64],  # noqa: ARG002  the same everywhere
        elapsed_s: NDArray[np.float64],  # noqa: ARG002  and always
        height_m: NDArray[np.float64],  # noqa: ARG002  and at any height
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the one wind, shape (1, n)."""
        north, east = vector(self.speed_mps, self.from_deg)
        shape = (1, len(lat))
        return np.broadcast_to(north, shape), np.broadcast_to(east, shape)


@dataclass(frozen=True, slots=True)
class ForecastWind:
    """The members of an ensemble, converted to the flown height."""

    ensemble: WindEnsemble
    """At any height."""
    depart_s: float
    """POSIX seconds of the first take-off."""
    profile_exponent: float = 0.0
    """Exponent of the wind profile (`models.wind.triangle.height_factor`), not applied below `MIN_PROFILE_M`; 0: none."""

    @property
    def probability(self) -> NDArray[np.float64]:
        """Of each member."""
        return self.ensemble.probability

    def at(
        self,
        lat: NDArray[np.float64],
        lon: NDArray[np.float64],
        elapsed_s: NDArray[np.float64],
        height_m: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Interpolate between the sites at each place, in the slot of each time."""
        elapsed = np.where(np.isfinite(elapsed_s), elapsed_s, 0.0)
        north, east = self.ensemble.at_times(lat, lon, self.depart_s + elapsed)
        factor = height_factor(np.maximum(height_m, MIN_PROFILE_M), self.ensemble.height_m, self.profile_exponent)
        return factor * north, factor * east
