"""Errors that no forecast covers: gusts about the hourly wind, and the error of a vehicle's energy model."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.ranges import range_faults
from skyway.models.flight.energy import ENERGY_ERROR


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What the truth has that no forecast tells.

    Attributes
    ----------
    gust_sd : float
        Standard deviation of gusts along the wind, as a share of the hourly speed.
    gust_time_s : float
        Time constant of gusts, as a drone meets them.
    energy : float
        A vehicle's flights take up to this share more or less than the model's, evenly distributed.
    """

    gust_sd: float = 0.15
    gust_time_s: float = 180.0
    energy: float = ENERGY_ERROR

    def __post_init__(self) -> None:
        faults: list[Fault] = []
        for name, low, high in (("gust_sd", 0.0, 1.0), ("gust_time_s", 1.0, 86_400.0), ("energy", 0.0, 0.9)):
            faults += range_faults(name, getattr(self, name), low, high, f"from {low:g} to {high:g}")
        if faults:
            raise InputError(faults)


USUAL_ERRORS = Errors()
"""What planners expect where nothing else is said."""
NO_ERRORS = Errors(gust_sd=0.0, energy=0.0)
"""The truth is the hourly wind, and the energy model is right."""
