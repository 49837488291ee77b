"""Errors that no forecast covers: gusts about the hourly wind, and the error of a drone's energy model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import percent
from skyway.models.base.ranges import range_faults
from skyway.models.drones.energy_belief import EXACT, EnergyBelief
from skyway.models.wind.gusts import GUST_SD, GUST_TIME_S

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone
    from skyway.models.wind.ensemble import WindEnsemble

GUSTS_AHEAD_S = 3 * 3600.0
"""What a forecast tells of gusts counts so far ahead: as long as deliveries usually take."""


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of the truth that no forecast contains."""

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
        """Error of the energy model for a drone's flights."""
        return drone.energy_belief if self.energy is None else self.energy

    def in_forecast(self, forecast: WindEnsemble, begin_s: float) -> Errors:
        """Return a copy with the gusts that a forecast contains for the hours from an instant on, if any."""
        weather = forecast.weather
        told = np.empty(0) if weather is None else weather.between("gust_sd", begin_s, begin_s + GUSTS_AHEAD_S)
        return replace(self, gust_sd=float(told.mean())) if len(told) and self.gust_sd > 0.0 else self


USUAL_ERRORS = Errors()
"""What planners expect where nothing else is said."""
NO_ERRORS = Errors(gust_sd=0.0, energy=EXACT)
"""The truth is the hourly wind, and the energy model is right."""


def gust_notes(errors: Errors) -> list[str]:
    """Describe the strength of the gusts of a forecast."""
    if errors.gust_sd == GUST_SD:
        return []
    return [
        f"gusts as forecast: a standard deviation of {percent(errors.gust_sd)} of the wind ({percent(GUST_SD)} without a forecast)"
    ]
