"""The energy of a flight: the power of each phase times the time in it, as joules and as a share of the battery.

Planners, checks, replays and supervisors use this module. The duration of a phase comes from `models.flight.kernels` (through
wind that changes) or of a log.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from skyway.models.drones.drone import Drone
    from skyway.models.drones.power import Phase


@dataclass(frozen=True, slots=True)
class FlightPower:
    """Power of one drone with one package.

    Attributes
    ----------
    climb_w, cruise_w, descent_w : float
        Electrical power in each phase; hovering takes as much as the cruise.
    battery_j : float
        Nameplate energy.
    """

    climb_w: float
    cruise_w: float
    descent_w: float
    battery_j: float

    @classmethod
    def of(cls, drone: Drone, payload_kg: float) -> FlightPower:
        """Return the power of a drone that carries a package."""
        model, mass_kg = drone.energy_model, drone.mass_kg + payload_kg
        climb_w, cruise_w, descent_w = (model.power_w(mass_kg, phase) for phase in ("climb", "cruise", "descent"))
        return cls(climb_w, cruise_w, descent_w, drone.battery_j)

    def power_w(self, phase: Phase) -> float:
        """Power in a phase."""
        return {"climb": self.climb_w, "cruise": self.cruise_w, "descent": self.descent_w}[phase]

    def energy_j(self, climb_s: float, cruise_s: ArrayLike, descent_s: float) -> ArrayLike:
        """Energy of a flight with the given times of climb, of cruise or hover, and of descent; numbers or arrays."""
        return self.climb_w * climb_s + self.descent_w * descent_s + self.cruise_w * cruise_s  # type: ignore[operator]

    @property
    def soc_per_s(self) -> float:
        """Charge that a second of cruise takes."""
        return self.cruise_w / self.battery_j

    def soc_climb(self, climb_s: float) -> float:
        """Charge that a climb takes."""
        return self.climb_w / self.battery_j * climb_s

    def soc_descent(self, descent_s: float) -> float:
        """Charge that a descent takes."""
        return self.descent_w / self.battery_j * descent_s

    def soc_fixed(self, climb_s: float, descent_s: float) -> float:
        """Charge that climb and descent take beyond as long a cruise: a flight of T seconds takes soc_fixed + soc_per_s T."""
        extra_j = (self.climb_w - self.cruise_w) * climb_s
        extra_j += (self.descent_w - self.cruise_w) * descent_s
        return extra_j / self.battery_j
