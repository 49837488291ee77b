"""Options for building missions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.missions.builder.corridor import DEFAULT_WIDTH_M
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.models.composition.release import Release
    from skyway.models.flight.way_heights import Over

MAX_GROUND_SPEED_MPS = 20.0
"""Limit of both autopilots."""


@dataclass(frozen=True, slots=True)
class MissionOptions:
    """Options of the conversion of compositions to missions.

    Attributes
    ----------
    cruise_height_m, climb_rate_mps, descent_rate_mps : float or None
        Instead of those of the composition.
    max_ground_speed_mps : float or None
        Limit of the commanded speed of legs; the composition's own limit and 20 m/s hold in any case.
    corridor_width_m : float or None
        Width of the fence; None writes no fence.
    release : str
        ``gripper``: the mission releases the package after the last landing; ``hand``: a person does, and confirms it; ``winch``, ``place``:
        it is released in the air, and the same mission continues (`missions.builder.release_items`).
    gripper, winch : int
        Number of the gripper, and of the winch.
    elevation_m : mapping
        Ground heights of stations for which the composition has none.
    over : Over or None
        Terrain model that the legs are flown over; required if the composition was planned over one.
    """

    cruise_height_m: float | None = None
    climb_rate_mps: float | None = None
    descent_rate_mps: float | None = None
    max_ground_speed_mps: float | None = None
    corridor_width_m: float | None = DEFAULT_WIDTH_M
    release: Release = "gripper"
    gripper: int = 1
    winch: int = 1
    elevation_m: Mapping[str, float] = field(default_factory=dict)
    over: Over | None = None

    def __post_init__(self) -> None:
        limits = {
            "cruise_height_m": (self.cruise_height_m, 5.0, 1000.0),
            "climb_rate_mps": (self.climb_rate_mps, 0.5, 10.0),
            "descent_rate_mps": (self.descent_rate_mps, 0.5, 10.0),
            "max_ground_speed_mps": (self.max_ground_speed_mps, 1.0, MAX_GROUND_SPEED_MPS),
        }
        faults = [
            Fault(f"is not between {low:g} and {high:g}", field=name, value=value)
            for name, (value, low, high) in limits.items()
            if value is not None and not low <= value <= high
        ]
        if faults:
            raise InputError(faults)
