"""What a flight should have taken by the model so far, second by second: what the belief about the energy is learnt from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.models.drones.airspeed_load import AirspeedLoad


@dataclass(slots=True)
class ModelledUse:
    """Charge by the model.

    Attributes
    ----------
    per_s, fixed : float
        Charge a second of cruise in the model, and what climb and descent take beyond that.
    load : AirspeedLoad or None
        How it changes with airspeed.
    soc : float
        So far, `fixed` not counted; at first nothing.
    heard_s : float
        Until when it is counted, POSIX seconds.
    """

    per_s: float
    fixed: float
    load: AirspeedLoad | None = None
    soc: float = 0.0
    heard_s: float = math.nan

    @property
    def total(self) -> float:
        """Charge of the flight so far."""
        return self.fixed + self.soc

    def begin(self, time_s: float) -> None:
        """Begin with the take-off."""
        self.soc, self.heard_s = 0.0, time_s

    def hear(self, time_s: float, velocity: tuple[float, float], wind: tuple[float, float]) -> None:
        """Count the time since the last call, with the airspeed of now.

        Parameters
        ----------
        velocity, wind : (north, east)
            Over the ground, and of the air, m/s.
        """
        duration_s = time_s - self.heard_s
        if not duration_s > 0.0:
            return
        airspeed = math.hypot(velocity[0] - wind[0], velocity[1] - wind[1])
        factor = 1.0 if self.load is None or not math.isfinite(airspeed) else float(self.load.factor(airspeed))
        self.soc += self.per_s * factor * duration_s
        self.heard_s = time_s
