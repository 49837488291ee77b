"""Electrical power of a multirotor in flight, by mass and phase of flight."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, Protocol

from skyway.models.base.units import AIR_DENSITY_KG_M3

if TYPE_CHECKING:
    from collections.abc import Mapping

Phase = Literal["climb", "cruise", "descent"]
PHASES: tuple[Phase, ...] = ("climb", "cruise", "descent")


class EnergyModel(Protocol):
    """Interface of models of a flight's power."""

    @property
    def name(self) -> str:
        """The model's name in files."""

    @property
    def air_density_kg_m3(self) -> float:
        """Density of the air that is flown in."""

    def in_air(self, density_kg_m3: float) -> EnergyModel:
        """Return the same aircraft in air of another density."""

    def power_w(self, mass_kg: float, phase: Phase = "cruise") -> float:
        """Electrical power in watts at a take-off mass (drone, batteries and package)."""


@dataclass(frozen=True, slots=True)
class EnduranceEnergy:
    """Power law in mass through two published endurances: P(m) = P_empty (m / m_empty)^kappa.

    The same in every phase of flight. For the M200 V2, kappa is 1.71 and P_empty 552 W. The battery's energy is the
    nameplate's; masses and endurances are those without and with the greatest payload, in the standard atmosphere at sea level. In other air the
    power grows by 1 / sqrt(density), as the power that holds a rotor craft up does by momentum theory.
    """

    battery_j: float
    empty_mass_kg: float
    full_mass_kg: float
    endurance_empty_s: float
    endurance_full_s: float
    air_density_kg_m3: float = AIR_DENSITY_KG_M3

    name: str = field(default="endurance", init=False)

    def in_air(self, density_kg_m3: float) -> EnduranceEnergy:
        """Return the same aircraft in air of another density."""
        return replace(self, air_density_kg_m3=density_kg_m3)

    @property
    def empty_power_w(self) -> float:
        """Power without payload, W."""
        return self.battery_j / self.endurance_empty_s

    @property
    def kappa(self) -> float:
        """Exponent of mass."""
        if self.full_mass_kg <= self.empty_mass_kg:
            return 1.5
        return math.log(self.endurance_empty_s / self.endurance_full_s) / math.log(
            self.full_mass_kg / self.empty_mass_kg
        )

    def power_w(self, mass_kg: float, phase: Phase = "cruise") -> float:  # noqa: ARG002  one power for all phases
        """Electrical power in watts."""
        thinner = math.sqrt(AIR_DENSITY_KG_M3 / self.air_density_kg_m3)
        return float(self.empty_power_w * (mass_kg / self.empty_mass_kg) ** self.kappa * thinner)


M100_COEFFICIENTS: Mapping[Phase, tuple[float, float]] = {
    "climb": (80.4, 13.8),
    "cruise": (68.9, 16.8),
    "descent": (71.5, -24.3),
}
"""(b1, b0) of the DJI Matrice 100 for take-off, cruise and landing (Rodrigues et al. 2022, table 2)."""


@dataclass(frozen=True, slots=True)
class MomentumEnergy:
    """Induced power of momentum theory with an offset: P = b1 m^1.5 / sqrt(rho) + b0 per phase.

    The coefficients are (b1, b0) by phase: W with kg and kg/m3; the air density is that of the air flown in.

    Source: T. A. Rodrigues et al., "Drone flight data reveal energy and greenhouse gas emissions savings for very small
    package delivery", Patterns 3, 100569 (2022).
    """

    coefficients: Mapping[Phase, tuple[float, float]] = field(default_factory=lambda: dict(M100_COEFFICIENTS))
    air_density_kg_m3: float = AIR_DENSITY_KG_M3

    name: str = field(default="momentum", init=False)

    def in_air(self, density_kg_m3: float) -> MomentumEnergy:
        """Return the same aircraft in air of another density."""
        return replace(self, air_density_kg_m3=density_kg_m3)

    def power_w(self, mass_kg: float, phase: Phase = "cruise") -> float:
        """Electrical power in watts."""
        slope, offset = self.coefficients[phase]
        return float(slope * mass_kg**1.5 / math.sqrt(self.air_density_kg_m3) + offset)
