"""Clearance of flights over the ground and obstacles, where the terrain is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Clearance:
    """Clearance of a flight over terrain and obstacles.

    Attributes
    ----------
    least_m : float
        Above the highest ground and obstacle in the corridor.
    corridor_width_m : float
        Half of it on either side of the way counts.
    position_error_m : float
        How far beyond the corridor the vehicle may be.
    max_height_m : float
        Above the ground below: a flight steps down to keep this height, as far as the clearance allows.
    """

    least_m: float = 30.0
    corridor_width_m: float = 400.0
    position_error_m: float = 10.0
    max_height_m: float = 120.0

    @property
    def radius_m(self) -> float:
        """Distance from the way within which ground and obstacles count."""
        return 0.5 * self.corridor_width_m + self.position_error_m
