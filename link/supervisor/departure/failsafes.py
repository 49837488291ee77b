"""Failsafe settings of a vehicle; its autopilot family explains them (`missions.autopilots`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context
    from skyway.link.vehicle.vehicle import Vehicle


@dataclass(slots=True)
class Failsafes:
    """The failsafe settings of one vehicle."""

    values: dict[str, float] = field(default_factory=dict)
    """By key, in our units, as they will be in flight; settings that the firmware does not have are omitted."""

    def read(self, vehicle: Vehicle, proposed: Mapping[str, float]) -> None:
        """Read the settings; those that are to be set (by key, in our units) have their new values."""
        found = vehicle.read_settings(vehicle.family.failsafes.keys)
        self.values = {key: proposed.get(key, value) for key, value in found.items()}


def left_words(ctx: Context) -> str:
    """Describe what the vehicle does if we now stop commanding it."""
    if ctx.on_ground:
        return "it stands disarmed on the ground"
    if ctx.vehicle.mode != "mission":
        return f"it stays in mode {ctx.vehicle.mode} until its battery failsafe or a pilot ends it"
    return ctx.vehicle.family.failsafes.when_left(ctx.failsafes.values)
