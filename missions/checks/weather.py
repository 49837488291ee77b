"""Wind for mission checks: steady, or an ensemble."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.forecast import WindEnsemble


class Weather(Protocol):
    """Wind at places and times, for each of several possible courses."""

    @property
    def probability(self) -> NDArray[np.float64]:
        """Of each member, shape (members,)."""

    def at(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], elapsed_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(north, east) towards which the air moves; places have shape (n,), times and answer (members, n)."""


@dataclass(frozen=True, slots=True)
class SteadyWind:
    """One wind everywhere, at flying height.

    Attributes
    ----------
    speed_mps : float
        Metres per second.
    from_deg : float
        Where it blows FROM.
    """

    speed_mps: float = 0.0
    from_deg: float = 0.0

    @property
    def probability(self) -> NDArray[np.float64]:
        """Certain."""
        return np.ones(1)

    def at(
        self,
        lat: NDArray[np.float64],
        lon: NDArray[np.float64],  # noqa: ARG002  the same everywhere
        elapsed_s: NDArray[np.float64],  # noqa: ARG002  and always
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the one wind, shape (1, n)."""
        north, east = vector(self.speed_mps, self.from_deg)
        shape = (1, len(lat))
        return np.broadcast_to(north, shape), np.broadcast_to(east, shape)


@dataclass(frozen=True, slots=True)
class ForecastWind:
    """The members of an ensemble, carried to flying height.

    Attributes
    ----------
    ensemble : WindEnsemble
        At flying height.
    depart_s : float
        POSIX seconds of the first take-off.
    """

    ensemble: WindEnsemble
    depart_s: float

    @property
    def probability(self) -> NDArray[np.float64]:
        """Of each member."""
        return self.ensemble.probability

    def at(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], elapsed_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Interpolate between the sites at each place, in the slot of each time."""
        elapsed = np.where(np.isfinite(elapsed_s), elapsed_s, 0.0)
        return self.ensemble.at_times(lat, lon, self.depart_s + elapsed)
