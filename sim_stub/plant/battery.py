"""The battery: energy, voltage under load, CC-CV charging."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.drones.charging import ChargingCurve

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone

CELLS = 6
_SOC = (0.0, 0.02, 0.05, 0.10, 0.20, 0.40, 0.60, 0.80, 0.90, 1.0)
_CELL_V = (3.20, 3.35, 3.52, 3.62, 3.69, 3.77, 3.87, 4.03, 4.14, 4.30)
"""Open-circuit voltage of one high-voltage lithium-polymer cell over its state of charge."""


@dataclass(slots=True)
class Battery:
    """One flight battery (all packs together)."""

    capacity_j: float
    """Nameplate energy."""
    curve: ChargingCurve
    """Charging without a limit of the pad."""
    soc: float = 1.0
    """True state of charge, 0-1."""
    resistance_ohm: float = 0.025
    """Internal resistance of all packs together."""
    nominal_ohm: float = 0.025
    """Of sound ones."""
    current_a: float = 0.0
    """Drawn at present; negative while charging."""
    power_w: float = 0.0

    @classmethod
    def of(cls, drone: Drone, soc: float = 1.0) -> Battery:
        """The battery of a drone at a state of charge."""
        return cls(drone.battery_j, drone.charging_curve(), soc)

    @property
    def open_voltage_v(self) -> float:
        """Voltage without load."""
        soc = min(max(self.soc, 0.0), 1.0)
        for index in range(1, len(_SOC)):
            if soc <= _SOC[index]:
                share = (soc - _SOC[index - 1]) / (_SOC[index] - _SOC[index - 1])
                return CELLS * (_CELL_V[index - 1] + share * (_CELL_V[index] - _CELL_V[index - 1]))
        return CELLS * _CELL_V[-1]

    @property
    def voltage_v(self) -> float:
        """Voltage at the terminals under the present load."""
        return max(self.open_voltage_v - self.current_a * self.resistance_ohm, 0.0)

    @property
    def empty(self) -> bool:
        """Nothing left to fly with."""
        return self.soc <= 0.0

    def discharge(self, power_w: float, duration_s: float) -> None:
        """Draw power for a time; a battery that is empty gives none."""
        energy = min(power_w * duration_s, max(self.soc, 0.0) * self.capacity_j)
        self.soc -= energy / self.capacity_j
        if self.soc < 1e-12:
            self.soc = 0.0
        self.power_w = power_w
        self.current_a = power_w / self.open_voltage_v

    def charge(self, duration_s: float, to_soc: float, pad_power_w: float | None) -> None:
        """Charge for a time on a pad, by the charging curve and no further than a state of charge."""
        curve = self.curve if pad_power_w is None else self._limited(pad_power_w)
        before = self.soc
        reached = float(curve.soc(curve.time_from_empty_s(before) + duration_s))
        self.soc = max(before, min(reached, to_soc, 1.0))
        self.power_w = -(self.soc - before) * self.capacity_j / duration_s if duration_s > 0.0 else 0.0
        self.current_a = self.power_w / self.open_voltage_v

    def time_to_soc_s(self, to_soc: float, pad_power_w: float | None) -> float:
        """Time on a pad to reach a state of charge; 0 where it is reached."""
        if to_soc <= self.soc:
            return 0.0
        curve = self.curve if pad_power_w is None else self._limited(pad_power_w)
        return float(curve.duration_s(self.soc, np.float64(min(to_soc, 1.0))))

    def _limited(self, pad_power_w: float) -> ChargingCurve:
        return ChargingCurve(self.curve.full_time_s, pad_power_w / self.capacity_j)
