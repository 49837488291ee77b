"""Power of a drone by the model of the scale, and the possible errors of the model.

With thrust T = m g lift, airspeed V and climb v the power is, in units of that of hover without a package,

    (T / W)^kappa F(V) + c v T / W

where W is the drone's weight without a package, kappa and the power of hover are those of its energy model, and F is momentum theory in forward
flight (`models.drones.airspeed_load`). A climb takes all of T v where the air through the propellers
is sucked in as fast as in hover, and 0.43 of it by momentum theory, where it is sucked in more slowly by half of the climb; sinking gives back less, since that air is stirred.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from skyway.models.drones.airspeed_load import BLADE_SHARE, INDUCED_FACTOR, INFLOW_MPS

if TYPE_CHECKING:
    from skyway.models.drones.airspeed_load import AirspeedLoad

USUAL_KAPPA = 1.6
_LIFTING = (1.0 - BLADE_SHARE) / (INDUCED_FACTOR * INFLOW_MPS)
"""T v for a climb of 1 m/s under the drone's own weight."""
_CLIMBING, _SINKING = 0.75, 0.3
"""Shares of T v that a climb takes, and that a descent returns."""


class Units(NamedTuple):
    """Modelled power at a moment with the whole package, and its dependence on possible errors of the model."""

    log_units: float
    """Logarithm of the power, in units of hover without a package."""
    airspeed: float
    climb: float
    sink: float
    """`airspeed`, `climb`, `sink`: contribution of airspeed, and T v of a climb or a descent, as shares of the
    power."""
    package: float
    """Decrease of its logarithm without the package."""


@dataclass(frozen=True, slots=True)
class PowerUnits:
    """The model of one drone and its package."""

    drone_kg: float
    package_kg: float
    kappa: float = USUAL_KAPPA
    """Exponent of mass in the power of hover."""
    load: AirspeedLoad | None = None
    """Power over airspeed; None uses the power of hover."""

    @property
    def laden(self) -> float:
        """Mass with the package over that without."""
        return (self.drone_kg + self.package_kg) / self.drone_kg

    def units(self, lift: float, airspeed_mps: float, climb_mps: float) -> float:
        """Return the power with the whole package, in units of that of hover without it."""
        return sum(self._terms(lift * self.laden, airspeed_mps, climb_mps, self.load))

    def of(self, lift: float, airspeed_mps: float, climb_mps: float) -> Units:
        """Return the power of a moment; `lift` is thrust over weight."""
        load = lift * self.laden
        level, added, rising = self._terms(load, airspeed_mps, climb_mps, self.load)
        total = level + added + rising
        light = sum(self._terms(lift, airspeed_mps, climb_mps, self._without()))
        climb, sink = (_LIFTING * load * one / total for one in (max(climb_mps, 0.0), min(climb_mps, 0.0)))
        return Units(math.log(total), added / total, climb, sink, math.log(total / light))

    def share(self, drop: float) -> float:
        """Return the share of the package on board if the logarithm of power fell by `drop` times the fall for the whole package."""
        return float((self.laden ** (1.0 - drop) - 1.0) / (self.laden - 1.0))

    def share_slope(self, drop: float) -> float:
        """Derivative of the share with respect to the drop."""
        return float(self.laden ** (1.0 - drop) * math.log(self.laden) / (self.laden - 1.0))

    def _terms(
        self, load: float, airspeed_mps: float, climb_mps: float, over: AirspeedLoad | None
    ) -> tuple[float, ...]:
        level = load**self.kappa
        factor = 1.0 if over is None else float(over.factor(airspeed_mps))
        taken = _CLIMBING * max(climb_mps, 0.0) + _SINKING * min(climb_mps, 0.0)
        return level, level * (factor - 1.0), _LIFTING * load * taken

    def _without(self) -> AirspeedLoad | None:
        """Power over airspeed without the package: the same drag slows a lighter drone more."""
        if self.load is None:
            return None
        drag = self.load.drag
        heavier = {name: getattr(drag, name) * self.laden for name in ("linear_per_s", "quadratic_per_m")}
        return replace(self.load, drag=replace(drag, **heavier))
