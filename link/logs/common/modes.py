"""Names of flight modes in logs, and which of them fly on rotors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.missions.autopilots.registry import FAMILIES, family_of

if TYPE_CHECKING:
    from skyway.link.logs.common.vehicle_kind import Kind


def mode_name(autopilot: int, kind: Kind, custom_mode: int) -> str:
    """Name of ``HEARTBEAT.custom_mode`` of a MAV_AUTOPILOT."""
    family = family_of(autopilot)
    return f"number {custom_mode}" if family is None else family.modes.log_name(kind, custom_mode)


def on_rotors(autopilot: Any, custom_mode: Any) -> tuple[Any, Any]:
    """Whether each MAV_AUTOPILOT tells by its mode that a plane stands on its rotors, and whether it does; arrays or numbers."""
    tells: Any = False
    stands: Any = False
    for family in FAMILIES.values():
        modes = family.modes.on_rotors
        if modes:
            mine = autopilot == family.firmware
            tells = tells | mine
            stands = stands | mine & (
                custom_mode in modes if isinstance(custom_mode, int) else np.isin(custom_mode, modes)
            )
    return tells, stands
