"""Region, times and heights of a requested wind."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Places, times and height of a requested wind."""

    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    """Places that it must cover, such as stations."""
    depart_s: float
    hours: int
    height_m: float
    exponent: float
    """Of the profile, where a forecast has one height."""
    seed: int = 0
    later: Callable[[float, int], WindEnsemble] | None = field(default=None, compare=False)
    """Winds of the record from an instant for a number of hours, used after the end of the forecast."""
