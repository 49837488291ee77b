"""A winch: line that goes out and comes in, with the package on its hook.

The hook opens where the package stands on the ground; it can stay shut, and the drum can jam.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.formatting import with_unit

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

_SLOW_PER_S = 1.0
"""Speed for each metre that is missing: the last one is slow (ArduPilot's WINCH_POS_P)."""
_HANGS_M = 0.3
"""The package is as tall; with less line out than this it is still at the drone."""
_STANDS_M = 0.05


@dataclass(slots=True)
class Winch:
    """The winch of one vehicle."""

    line_m: float = 0.0
    """Out."""
    wanted_m: float = 0.0
    speed_mps: float = 0.0
    """Positive is out."""
    rate_mps: float = 1.0

    def pay_out(self, metres: float, rate_mps: float) -> None:
        """So much line more, or less, than is out now."""
        self.wanted_m, self.rate_mps = max(self.line_m + metres, 0.0), max(abs(rate_mps), 0.05)

    def set_rate(self, mps: float) -> None:
        """Go on at a speed; 0 stops."""
        self.rate_mps = max(abs(mps), 0.05)
        self.wanted_m = self.line_m if mps == 0.0 else 100.0 if mps > 0.0 else 0.0

    @property
    def moving(self) -> bool:
        """Whether the drum turns."""
        return abs(self.speed_mps) > 0.01

    def advance(self, vehicle: Vehicle, duration_s: float) -> None:
        """Let time pass."""
        missing = self.wanted_m - self.line_m
        if missing == 0.0 and self.speed_mps == 0.0:
            return
        self.speed_mps = max(-self.rate_mps, min(self.rate_mps, _SLOW_PER_S * missing))
        if abs(missing) < 0.01:
            self.line_m, self.speed_mps = self.wanted_m, 0.0
        faults = vehicle.faults
        if "winch-jammed" in faults.active and self.speed_mps > 0.0 and self.line_m >= faults.value("winch-jammed"):
            self.speed_mps = 0.0
        self.line_m = max(self.line_m + self.speed_mps * duration_s, 0.0)
        above_m = vehicle.body.alt_m - vehicle.ground_m
        if self.line_m > _HANGS_M and self.line_m >= above_m - _STANDS_M and not vehicle.autopilot.package_let_go:
            vehicle.autopilot.package_let_go = True
            vehicle.event(f"the package stands on the ground, {with_unit(self.line_m, 'm')} of line out")
            vehicle.autopilot.let_go(1.0 - faults.value("gripper-stuck"))
