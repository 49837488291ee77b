"""Drag of a multirotor: from tilt to air velocity.

A rotor craft that moves through the air with velocity v is held back by ``d = c1 v + c2 |v| v`` (metres per second squared).
Thrust beyond the observed acceleration balances that drag, so attitude and ground velocity determine the wind.
Linear drag is that of the rotors (induced and blade drag), quadratic that of the body.

Source: R. Mahony, V. Kumar, P. Corke, "Multirotor Aerial Vehicles", IEEE RAM 19(3), 2012 (rotor drag); J. Gonzalez-Rocha
et al., "Sensing wind from quadrotor motion", JGCD 42(4), 2019 (wind from tilt).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import GRAVITY_MPS2

if TYPE_CHECKING:
    from numpy.typing import NDArray

FLIGHT_TO_FLIGHT_RELATIVE, FLIGHT_TO_FLIGHT_BIAS_MPS2 = 0.10, 0.10
"""Differences of drag and level of one aircraft between flights (load, propellers, attitude when it was armed): four
flights of one Matrice 100 gave 5 to 12 % and 0.06 to 0.12 m/s2."""
FLIGHT_TO_FLIGHT_MANOEUVRE = 0.03
"""Share of an acceleration that the drag of another flight may misinterpret as drag: the drag changes between hover and cruise, and attitude
and velocity are not of quite the same instant. In five logged flights (Matrice 100, a quadrotor) the drag seen scatters by 0.18 m/s2 in
steady flight and by 0.25 to 0.35 at 2 m/s2, of which the scatter that calibration finds has a part already."""
SLOWEST_MPS = 0.5
"""Least airspeed at which slopes of the drag are taken: purely quadratic drag has none at rest."""
MAX_TILT_RAD = math.radians(60.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class DragModel:
    """Drag of one kind of multirotor."""

    linear_per_s: float = 0.30
    """c1."""
    quadratic_per_m: float = 0.0
    """c2."""
    bias_forward_mps2: float = 0.0
    bias_right_mps2: float = 0.0
    """What the tilt shows in still air: the autopilot's level is not quite level."""
    sigma_mps2: float = 0.20
    """Standard deviation of the drag seen, averaged over `period_s`."""
    period_s: float = 1.0
    """Time over which telemetry is averaged to one measurement."""
    relative_sigma: float = 0.0
    """Relative standard deviation of the coefficients themselves, from this flight to another of the same aircraft."""
    bias_sigma_mps2: float = 0.0
    """Standard deviation of each bias, likewise."""
    manoeuvre_share: float = 0.0
    """Share of the acceleration that is added to `sigma_mps2` (squares) while the vehicle accelerates."""

    def __post_init__(self) -> None:
        if not (self.linear_per_s >= 0.0 and self.quadratic_per_m >= 0.0):
            raise InputError("drag must not be negative", field="drag", value=(self.linear_per_s, self.quadratic_per_m))
        if not self.linear_per_s + self.quadratic_per_m > 0.0:
            raise InputError("with a drag of 0 the wind cannot be estimated", field="drag")

    def another_flight(self) -> DragModel:
        """Return the same drag with its uncertainty for another flight of the same aircraft."""
        return replace(
            self,
            relative_sigma=min(math.hypot(self.relative_sigma, FLIGHT_TO_FLIGHT_RELATIVE), 1.0),
            bias_sigma_mps2=math.hypot(self.bias_sigma_mps2, FLIGHT_TO_FLIGHT_BIAS_MPS2),
            manoeuvre_share=min(math.hypot(self.manoeuvre_share, FLIGHT_TO_FLIGHT_MANOEUVRE), 1.0),
        )

    def drag(self, air_velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Drag, m/s2, of velocities through the air, shape (n, 2)."""
        speed = np.hypot(air_velocity[:, 0], air_velocity[:, 1])[:, None]
        return np.asarray(air_velocity * (self.linear_per_s + self.quadratic_per_m * speed))

    def air_velocity(self, drag: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity through the air, shape (n, 2), that gives a drag in m/s2, shape (n, 2)."""
        size = np.hypot(drag[:, 0], drag[:, 1])
        c1, c2 = self.linear_per_s, self.quadratic_per_m
        # of the two forms of the root, this one needs no division by c2 and no difference of similar numbers
        speed = 2.0 * size / (c1 + np.sqrt(c1 * c1 + 4.0 * c2 * size) + 1e-12)
        return np.asarray(drag / (c1 + c2 * speed + 1e-12)[:, None])

    def slope(self, air_velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Air velocity per unit of drag at these air velocities, s, shape (n, 2, 2): less along the flow than across it."""
        speed = np.hypot(air_velocity[:, 0], air_velocity[:, 1])
        unit = air_velocity / np.maximum(speed, 1e-9)[:, None]
        slow = np.maximum(speed, SLOWEST_MPS)
        across = 1.0 / (self.linear_per_s + self.quadratic_per_m * slow)
        along = 1.0 / (self.linear_per_s + 2.0 * self.quadratic_per_m * slow)
        flow = unit[:, :, None] * unit[:, None, :]
        return np.asarray(across[:, None, None] * np.eye(2) + (along - across)[:, None, None] * flow)

    def noise(self, air_velocity: NDArray[np.float64], acceleration: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the independent error of each wind measured at these air velocities and accelerations, shape (n, 3): nn, ne, ee.

        It excludes the common error of all of them, of the coefficients or of the bias (`models.wind.estimation.systematic`).
        """
        slope = self.slope(air_velocity)
        variance = self.sigma_mps2**2 + self.manoeuvre_share**2 * (acceleration**2).sum(axis=1)
        total = variance[:, None, None] * (slope @ slope)
        return np.asarray(total[:, (0, 0, 1), (0, 1, 1)])


def thrust_acceleration(
    roll_rad: NDArray[np.float64],
    pitch_rad: NDArray[np.float64],
    yaw_rad: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Horizontal acceleration (north, east) that a tilted thrust gives while it holds the vehicle up, shape (n, 2).

    NaN if the vehicle is tilted by more than 60 degrees: nothing is held up then.
    """
    cos_roll, sin_roll = np.cos(roll_rad), np.sin(roll_rad)
    cos_pitch, sin_pitch = np.cos(pitch_rad), np.sin(pitch_rad)
    cos_yaw, sin_yaw = np.cos(yaw_rad), np.sin(yaw_rad)
    up = cos_roll * cos_pitch
    held = np.where(up > math.cos(MAX_TILT_RAD), GRAVITY_MPS2 / np.maximum(up, 0.1), np.nan)
    north = -(cos_roll * sin_pitch * cos_yaw + sin_roll * sin_yaw) * held
    east = -(cos_roll * sin_pitch * sin_yaw - sin_roll * cos_yaw) * held
    return np.stack([north, east], axis=1)


def lean_acceleration(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float]:
    """Return what `thrust_acceleration` gives for one attitude, (north, east), many times as fast; 0 where that is unknown."""
    cos_roll, cos_pitch = math.cos(roll_rad), math.cos(pitch_rad)
    up = cos_roll * cos_pitch
    if not up > math.cos(MAX_TILT_RAD):
        return 0.0, 0.0
    held = GRAVITY_MPS2 / up
    ahead, aside = cos_roll * math.sin(pitch_rad), math.sin(roll_rad)
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
    return -(ahead * cos_yaw + aside * sin_yaw) * held, -(ahead * sin_yaw - aside * cos_yaw) * held
