"""Errors that no forecast covers: gusts about the hourly wind, and the error of a drone's energy model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.ranges import range_faults
from skyway.models.drones.energy_belief import EXACT, EnergyBelief
from skyway.models.wind.gusts import GUST_SD, GUST_TIME_S

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What the truth has that no forecast tells."""

    gust_sd: float = GUST_SD
    """Standard deviation of gusts along the wind, as a share of the hourly speed."""
    gust_time_s: float = GUST_TIME_S
    """Time constant of gusts, as a drone meets them."""
    energy: EnergyBelief | None = None
    """How far the energy of flights may be from the model's; None: as is believed of each drone."""

    def __post_init__(self) -> None:
        faults: list[Fault] = []
        for name, low, high in (("gust_sd", 0.0, 1.0), ("gust_time_s", 1.0, 86_400.0)):
            faults += range_faults(name, getattr(self, name), low, high, f"from {low:g} to {high:g}")
        if faults:
            raise InputError(faults)

    def energy_of(self, drone: Drone) -> EnergyBelief:
        """How far the energy of a drone's flights may be from the model's."""
        return drone.energy_belief if self.energy is None else self.energy


USUAL_ERRORS = Errors()
"""What planners expect where nothing else is said."""
NO_ERRORS = Errors(gust_sd=0.0, energy=EXACT)
"""The truth is the hourly wind, and the energy model is right."""
