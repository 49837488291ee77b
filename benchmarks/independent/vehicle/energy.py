"""Electrical power in flight, by laws of our own; both agree with the endurances in hover of the drone's data sheet.

The product's default is a power that depends on the mass alone. `Momentum` is that of a rotor: induced velocity by Glauert's equation in
forward flight, profile power of the blades, drag of the body, and losses in motors and wires that grow with the square of the power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

G_MPS2 = 9.806_65
DENSITY_KG_M3 = 1.225


@dataclass(frozen=True)
class DataSheet:
    """What the maker says of a drone.

    Attributes
    ----------
    mass_kg, payload_kg : float
        Empty, and the heaviest payload.
    battery_j, empty_s, full_s : float
        Energy, and endurance in hover without and with the heaviest payload.
    recharge_s, airspeed_mps, max_ground_mps : float
        From empty to full; speed that is held; greatest speed over ground.
    """

    mass_kg: float
    payload_kg: float
    battery_j: float
    empty_s: float
    full_s: float
    recharge_s: float
    airspeed_mps: float
    max_ground_mps: float

    def hover_w(self, payload_kg: float) -> float:
        """Power in hover: a power of the mass through both endurances."""
        ratio = (self.mass_kg + self.payload_kg) / self.mass_kg
        power = math.log(self.empty_s / self.full_s) / math.log(ratio)
        return self.battery_j / self.empty_s * float(((self.mass_kg + payload_kg) / self.mass_kg) ** power)


class Power(Protocol):
    """Power of each run, W."""

    def __call__(self, airspeed_mps: NDArray[np.float64], climb_mps: float) -> NDArray[np.float64]:
        """Flying at an airspeed while climbing (or, negative, descending) at a rate."""


class Flat:
    """The product's own assumption: the power of hover at any speed."""

    def __init__(self, sheet: DataSheet, payload_kg: float) -> None:
        self.watts = sheet.hover_w(payload_kg)

    def __call__(self, airspeed_mps: NDArray[np.float64], climb_mps: float) -> NDArray[np.float64]:
        """See `Power`."""
        del climb_mps
        return np.full(np.shape(airspeed_mps), self.watts)


class Momentum:
    """Momentum theory, for runs whose drag and blades are drawn.

    Parameters
    ----------
    sheet : DataSheet
    payload_kg : float
    rngs : list of Generator
        One for each run.
    """

    DISC_M2, TIP_MPS, INDUCED = 0.55, 115.0, 1.15
    PROFILE_SHARE = 0.20, 0.32  # of the power in hover
    DRAG_AREA_M2 = 0.030, 0.050
    PACKAGE_AREA_M2 = 0.008
    DENSITY = 1.15, 1.29
    AVIONICS_W = 12.0
    REGAINED = 0.4  # share of the falling weight's power that a descent saves

    def __init__(self, sheet: DataSheet, payload_kg: float, rngs: list[np.random.Generator]) -> None:
        drawn = np.array([rng.random(3) for rng in rngs]).reshape(len(rngs), 3)
        self.sheet, self.mass_kg = sheet, sheet.mass_kg + payload_kg
        self.profile_share = self.PROFILE_SHARE[0] + np.diff(self.PROFILE_SHARE)[0] * drawn[:, 0]
        self.area_m2 = self.DRAG_AREA_M2[0] + np.diff(self.DRAG_AREA_M2)[0] * drawn[:, 1]
        self.area_m2 = self.area_m2 + (self.PACKAGE_AREA_M2 if payload_kg > 0.0 else 0.0)
        self.density = self.DENSITY[0] + np.diff(self.DENSITY)[0] * drawn[:, 2]
        self.profile_w = (
            self.profile_share / (1.0 - self.profile_share) * self._induced_w(sheet.mass_kg, DENSITY_KG_M3, 0.0)
        )
        # electrical = c s + d s^2 of the shaft power s, through both endurances at the density of the data sheet
        light = self._shaft_w(sheet.mass_kg, DENSITY_KG_M3)
        heavy = self._shaft_w(sheet.mass_kg + sheet.payload_kg, DENSITY_KG_M3)
        at_light = sheet.battery_j / sheet.empty_s - self.AVIONICS_W
        at_heavy = sheet.battery_j / sheet.full_s - self.AVIONICS_W
        self.square = (at_heavy / heavy - at_light / light) / (heavy - light)
        self.linear = at_light / light - self.square * light

    def _induced_w(self, thrust_kg: object, density: object, airspeed: object) -> NDArray[np.float64]:
        """Thrust times induced velocity, by Glauert: v^4 + V^2 v^2 = v_h^4."""
        thrust = np.asarray(thrust_kg, dtype=np.float64) * G_MPS2
        hover = thrust / (2.0 * np.asarray(density) * self.DISC_M2)  # v_h^2
        half = 0.5 * np.asarray(airspeed, dtype=np.float64) ** 2
        return self.INDUCED * thrust * np.sqrt(np.sqrt(half**2 + hover**2) - half)

    def _shaft_w(self, mass_kg: float, density: float) -> NDArray[np.float64]:
        """In hover; the blades' own drag grows as the induced power."""
        load = (mass_kg / self.sheet.mass_kg) ** 1.5
        return np.asarray(self._induced_w(mass_kg, density, 0.0) + self.profile_w * load)

    def __call__(self, airspeed_mps: NDArray[np.float64], climb_mps: float) -> NDArray[np.float64]:
        """See `Power`."""
        drag = 0.5 * self.density * self.area_m2 * airspeed_mps**2
        thrust_kg = np.hypot(self.mass_kg, drag / G_MPS2)
        load = (thrust_kg / self.sheet.mass_kg) ** 1.5
        blades = self.profile_w * load * (1.0 + 4.65 * (airspeed_mps / self.TIP_MPS) ** 2)
        rising = self.mass_kg * G_MPS2 * climb_mps * (1.0 if climb_mps > 0.0 else self.REGAINED)
        shaft = self._induced_w(thrust_kg, self.density, airspeed_mps) + blades + drag * airspeed_mps + rising
        shaft = np.maximum(shaft, 0.2 * self.profile_w)
        return np.asarray(self.linear * shaft + self.square * shaft**2 + self.AVIONICS_W)


class Tabulated:
    """Power read from a table over airspeed, for laws that are worked out one speed at a time."""

    def __init__(self, law: Callable[[float, float], float], climb_mps: float, descent_mps: float) -> None:
        self.speed = np.linspace(0.0, 45.0, 46)
        self.table = {
            rate: np.array([law(float(v), rate) for v in self.speed]) for rate in (0.0, climb_mps, -descent_mps)
        }

    def __call__(self, airspeed_mps: NDArray[np.float64], climb_mps: float) -> NDArray[np.float64]:
        """See `Power`."""
        return np.asarray(np.interp(airspeed_mps, self.speed, self.table[climb_mps]))
