"""Modelled energy of a flight so far, second by second: the reference for learning the energy belief."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.planner.reach.reach import Reach


@dataclass(slots=True)
class ModelledUse:
    """Modelled charge of a flight."""

    per_s: float
    fixed: float
    """`per_s`, `fixed`: charge per second of cruise, and charge of climb and descent beyond that."""
    load: AirspeedLoad | None = None
    """Its dependence on airspeed."""
    soc: float = 0.0
    """Charge so far, without `fixed`."""
    counted_s: float = math.nan
    """Time up to which it is counted, POSIX seconds."""

    @classmethod
    def by(cls, reach: Reach) -> ModelledUse:
        """Return the model of a flight, from the computation of reachable stations."""
        return cls(reach.soc_per_s, reach.power.soc_fixed(reach.rules.climb_s, reach.rules.descent_s), reach.load)

    @property
    def total(self) -> float:
        """Return the charge of the flight so far."""
        return self.fixed + self.soc

    def begin(self, time_s: float) -> None:
        """Begin with the take-off."""
        self.soc, self.counted_s = 0.0, time_s

    def restore(self, soc: float, time_s: float) -> None:
        """Restore the modelled use until an instant from a journal."""
        self.soc, self.counted_s = soc, time_s

    def hear(self, time_s: float, velocity: tuple[float, float], wind: tuple[float, float]) -> None:
        """Count the time since the last call; ground velocity and wind are (north, east), m/s."""
        duration_s = time_s - self.counted_s
        if not duration_s > 0.0:
            return
        airspeed = math.hypot(velocity[0] - wind[0], velocity[1] - wind[1])
        factor = 1.0 if self.load is None or not math.isfinite(airspeed) else float(self.load.factor(airspeed))
        self.soc += self.per_s * factor * duration_s
        self.counted_s = time_s


def count_use(ctx: Context) -> None:
    """Count the modelled charge of the flight, at the airspeed from wind and ground speed."""
    s, use = ctx.observed.sample, None if ctx.delivery.leg is None else ctx.delivery.leg.modelled
    if use is None or s is None or not ctx.in_air:
        return
    use.hear(ctx.now_s, (s.vel_north_mps, s.vel_east_mps), ctx.wind.here(s))
